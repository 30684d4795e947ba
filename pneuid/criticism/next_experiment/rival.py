"""A fitted model as a rival of others: what it does under given inputs, and how well it follows what another would show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.curves import relaxed_covariance
from pneuid.estimation.differentiate import Motion
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.own import own_of
from pneuid.estimation.preparation import Run
from pneuid.estimation.shooting import Shooting, relaxed_smoothing
from pneuid.interval import trajectory_function
from pneuid.mapped import Mapped
from pneuid.recording import Recording

STEP_SECONDS = 0.005
"""Time over which inputs are handed to a model at once, s; on a servo rig also the sample time of its position controller."""


@dataclass(frozen=True)
class Played:
    """What one rival does: states ``(ns, N)`` and outputs ``(ny, N)``, SI; NaN from where they are no longer finite."""

    states: np.ndarray
    outputs: np.ndarray


class Rival:
    """One fitted model, made ready to be played and to be fitted to what another one would show."""

    def __init__(self, fit: Fit) -> None:
        self.fit, self.plant = fit, fit.plant
        self.dt = float(np.median(np.concatenate([run.data[0] for run in fit.runs])))
        self.hold = max(1, round(STEP_SECONDS / self.dt))
        values = {**fit.problem.values, **fit.relaxed_values}
        self.theta = fit.plant.theta(values, fit.ranges, smoothing=relaxed_smoothing(fit.plant))
        self._piece = Mapped(trajectory_function(fit.plant, self.hold, fit.problem.substeps), 1)
        shared = [j for j, name in enumerate(fit.problem.free) if name in fit.plant.theta_names]
        covariance = relaxed_covariance(fit)[np.ix_(shared, shared)]
        slope = fit.problem.scaling.slope(fit.relaxed.X[: fit.problem.nq])[shared]
        scaled = covariance / np.outer(slope, slope)
        self.known = np.linalg.inv(scaled + np.diag(1e-9 * np.diag(scaled).max() * np.ones(len(shared)) + 1e-12))
        self.free = [fit.problem.free[j] for j in shared]

    def moved(self, s: np.ndarray, inputs: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """States ``(ns, K + 1)`` and outputs ``(ny, K)`` over the ``hold`` samples from ``k`` on; inputs ``(nw, N)``."""
        data = self._columns(inputs[:, k : k + self.hold + 1])[:, : self.hold]
        outputs, states = self._piece(s, data, self.theta)
        return states, outputs

    def played(self, start: np.ndarray, inputs: np.ndarray) -> Played:
        """What the model does from the state ``start`` under ``inputs`` ``(nw, N)``, N a multiple of ``hold``."""
        N, K = inputs.shape[1], self.hold
        states, outputs = np.full((start.size, N), np.nan), np.full((len(self.plant.outputs), N), np.nan)
        s = start
        for k in range(0, N, K):
            passed, outputs[:, k : k + K] = self.moved(s, inputs, k)
            states[:, k : k + K], s = passed[:, :K], passed[:, K]
            if not np.all(np.isfinite(s)):
                break
        return Played(states, outputs)

    def unable(self, t: np.ndarray, inputs: np.ndarray, seen: Played, own: Played) -> float:
        """Twice the cost that is left when this model is fitted to another's noise-free ``outputs``.

        t ``(N,)`` in s; inputs ``(nw, N)``; seen : what the other one did; own : what this one did, for the states that no
        sensor shows. One Gauss-Newton step of the relaxed problem with what the recordings in hand say of the parameters.
        """
        fit, plant = self.fit, self.plant
        run = self._run(t, inputs, seen.outputs)
        values = {**fit.problem.values, **fit.relaxed_values}
        problem = Shooting(plant, [run], self.free, values, fit.ranges, fit.problem.substeps, fit.problem.samples)
        problem.set_smoothing(relaxed_smoothing(plant))
        problem.relaxation = fit.problem.relaxation
        at = problem.samples * np.arange(problem.nint)
        # motion and pressures are measured, and the bristle follows from them
        shared = plant.explicit_count + 1
        nodes = np.vstack([seen.states[:shared, at], own.states[shared:, at]])
        q = problem.scaling.to_q(np.array([values[name] for name in self.free]))
        X = problem.join(np.clip(q, problem.scaling.lower, problem.scaling.upper), nodes)
        gradient, hessian = relaxed_system(problem, X)
        rows, cols = np.meshgrid(np.arange(problem.nq), np.arange(problem.nq), indexing="ij")
        known = sp.csc_matrix((self.known.ravel(), (rows.ravel(), cols.ravel())), shape=hessian.shape)
        end, cost = problem.evaluate_values(X)
        total = cost + 0.5 * float(np.sum((problem.defects(end, X) / problem.relaxation) ** 2))
        # the parameters' weak priors are in what is known already
        index, _, inverse = problem.priors
        twice, pull = index < problem.nq, problem.prior_residual(X)
        gradient[index[twice]] -= pull[twice] * inverse[twice]
        total += 0.5 * float(np.sum(pull[~twice] ** 2))
        step = factorised(hessian + known, problem.nq).solve(gradient)
        return max(2.0 * (total - 0.5 * float(gradient @ step)), 0.0)

    def _columns(self, inputs: np.ndarray) -> np.ndarray:
        """Data columns without measurements."""
        plant, N = self.plant, inputs.shape[1]
        data = np.zeros((1 + 2 * len(plant.inputs) + 2 * len(plant.outputs), N))
        data[0], count = self.dt, len(plant.inputs)
        data[1 : 1 + count] = inputs
        data[1 + count : 1 + 2 * count] = np.diff(inputs, axis=1, append=inputs[:, -1:]) / self.dt
        return data

    def _run(self, t: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Run:
        """A noise-free recording made ready, its inputs as they were and not as they would be estimated."""
        plant, data = self.plant, self._columns(inputs)
        names = (*plant.inputs, *plant.outputs)
        signals = {name: row for name, row in zip(names, (*inputs, *outputs), strict=True) if name != "a"}
        open_sides = {"p1", "p2"} - set(plant.rig.chambers)
        seen = {name: row for name, row in signals.items() if name not in open_sides}
        record = Recording.from_arrays("next.csv", plant.rig, t=t, **seen)
        count = len(plant.outputs)
        data[-2 * count : -count] = outputs
        data[-count:] = np.array([[1.0 / self.fit.noise[name]] for name in plant.outputs])
        still = np.zeros(t.size)
        motion = Motion(signals["x"], signals.get("v", still), still, 0.0)
        free = np.zeros(t.size, dtype=bool)
        return Run("next.csv", t, data, own_of(plant.rig, record), (), plant.inputs, plant.outputs, record, motion, free)
