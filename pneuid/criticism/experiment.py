"""The next experiment: the recording that separates rival models best per second, and what it can be expected to decide.

Every excitation of the library is played on each rival in closed loop; the command is then held against the other rivals.
How far a rival can follow the noise-free recording of another, when its parameters and states adapt as far as the data in
hand and the sensors allow, is one Gauss-Newton step of the relaxed problem; what it cannot follow is the separation (half
the noncentrality of the likelihood ratio; Atkinson, Fedorov, Biometrika 62 (1975) 57, linearised).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.stats import norm

from pneuid.criticism.decision import Verdict
from pneuid.criticism.diagnosis import Command
from pneuid.criticism.excitations import LOWER_SUPPLY, SERVO_LIBRARY, Axis, Excitation
from pneuid.criticism.refits import Asked, Standing, refit
from pneuid.criticism.screening import screen
from pneuid.effect import Effect
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.curves import relaxed_covariance
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import prepare
from pneuid.estimation.shooting import Shooting, relaxed_smoothing
from pneuid.estimation.solver import Monitor
from pneuid.interval import trajectory_function
from pneuid.physics.gas import R_AIR, RHO_REFERENCE
from pneuid.recording import Recording

DURATIONS = (6.0,)
"""Lengths in s that are tried."""

MARGIN = 0.06
"""Share of the stroke that stays free at either end, on every rival."""

HIGHEST_PRESSURE = 1.05
"""Largest chamber pressure, over the supply's (absolute), that a rival may reach."""

SHRINK = (1.0, 0.6, 0.35)
"""Sizes of an excitation that are tried, largest first, until every rival stays inside the limits."""

CORE = 5
"""States of the base model: position, speed, pressures and bristle."""

CONTROL_SECONDS = 0.005
BANDWIDTH = 12.0
"""Of the position controller that makes the command, rad/s."""

SETTLING = 0.4
"""Seconds at rest before the excitation starts."""

ENOUGH = 0.9
"""Power from which the separation per second counts and not the separation."""

MOST_RIVALS = 3
"""Candidates of an ambiguous verdict that are told apart."""

NEEDED = 30.0
"""Likelihood ratio (twice the difference of costs) that decides: twice what an effect must gain to be refitted."""


@dataclass(frozen=True)
class Experiment:
    """A proposed recording: excitation, command, power (chance that it decides) and separation in likelihood-ratio units."""

    excitation: Excitation
    command: Command
    power: float
    separation: float
    rivals: tuple[str, ...]

    @property
    def why(self) -> str:
        """The reason in a sentence."""
        seconds = float(self.command.t[-1])
        return (
            f"to tell {' from '.join(self.rivals)}: {self.excitation.name} of {seconds:.0f} s ({self.excitation.says}); of all "
            "in the library it makes the models differ most per second"
        )


def propose(fits: Sequence[Fit], names: Sequence[str]) -> Experiment | None:
    """The experiment that tells rival ``fits`` apart best, None where none keeps inside the limits or tells anything.

    names : what each fit has that the others lack. Servo rigs.
    """
    if len(fits) < 2 or not fits[0].plant.servo:
        return None
    rivals = [_Rival(fit) for fit in fits]
    found = []
    for excitation in SERVO_LIBRARY:
        for seconds in DURATIONS:
            played = _playable(rivals, excitation, seconds)
            if played is None:
                continue
            command, states = played
            separation = _separation(rivals, command, states)
            power = float(norm.cdf((separation - NEEDED) / (2.0 * np.sqrt(max(separation, 1e-9)))))
            found.append(Experiment(excitation, command, power, separation, tuple(names)))
    sure = [item for item in found if item.power >= ENOUGH]
    if sure:
        return max(sure, key=lambda item: item.separation / float(item.command.t[-1]))
    return max(found, key=lambda item: item.separation, default=None)


def for_verdict(
    verdict: Verdict, base: Fit, catalogue: Mapping[str, Effect], monitor: Monitor | None = None
) -> Experiment | None:
    """The experiment for an ambiguous verdict: its candidates are fitted and told apart; None for other verdicts."""
    diagnosis = verdict.diagnosis
    if diagnosis.verdict != "ambiguous":
        return None
    order = list(catalogue)
    present = {effect.name for effect in verdict.best.plant.effects}
    effects = [catalogue[name] for name in diagnosis.effects[:MOST_RIVALS] if not catalogue[name].richer_law]
    starts = {score.effect.name: score.start for score in screen(base, effects, order)}
    asked = {effect.name: Asked(effect, starts.get(effect.name, {})) for effect in effects}
    fits = [
        verdict.best if name in present else refit(Standing.of(base), one, order, monitor) for name, one in asked.items()
    ]
    return propose(fits, [effect.name for effect in effects])


class _Rival:
    """One fitted model, made ready to be played and to be fitted to what another one would show."""

    def __init__(self, fit: Fit) -> None:
        self.fit, self.plant = fit, fit.plant
        self.dt = float(np.median(np.concatenate([run.data[0] for run in fit.runs])))
        self.hold = max(1, round(CONTROL_SECONDS / self.dt))
        values = {**fit.problem.values, **fit.relaxed_values}
        self.theta = fit.plant.theta(values, fit.ranges, smoothing=relaxed_smoothing(fit.plant))
        self.piece = trajectory_function(fit.plant, self.hold, fit.problem.substeps)
        shared = [j for j, name in enumerate(fit.problem.free) if name in fit.plant.theta_names]
        covariance = relaxed_covariance(fit)[np.ix_(shared, shared)]
        slope = fit.problem.scaling.slope(fit.relaxed.X[: fit.problem.nq])[shared]
        scaled = covariance / np.outer(slope, slope)
        self.known = np.linalg.inv(scaled + np.diag(1e-9 * np.diag(scaled).max() * np.ones(len(shared)) + 1e-12))
        self.free = [fit.problem.free[j] for j in shared]

    def rest(self, x: float, supply: float) -> np.ndarray:
        """State at rest at ``x`` (m) with chambers in balance near 60 % of the supply (Pa absolute)."""
        rig, known = self.plant.rig, {state.name: state.initial for state in self.plant.effect_states}
        level = 0.6 * (supply - rig.patm)
        known |= {"x": x, "p2": rig.patm + level, "p1": rig.patm + min(level * rig.A2 / rig.A1, supply - rig.patm)}
        return np.array([known.get(name, 0.0) for name in self.plant.states])

    def followed(self, reference: np.ndarray, supply: np.ndarray, closed: np.ndarray) -> np.ndarray:
        """Command ``(N,)`` of a position controller that follows ``reference`` (m) on this model, null where ``closed``."""
        rig, K = self.plant.rig, self.hold
        gain, slope = rig.full_scale / self.top_speed, np.gradient(reference, self.dt)
        u = np.full(reference.size, rig.null)
        s = self.rest(float(reference[0]), float(supply[0]))
        for k in range(0, u.size - K, K):
            wanted = gain * (BANDWIDTH * (reference[k + K] - s[0]) + slope[k])
            after = rig.null if closed[k + K] else rig.null + float(np.clip(wanted, -rig.full_scale, rig.full_scale))
            u[k : k + K + 1] = np.linspace(u[k], after, K + 1)
            s = self._moved(s, u, supply, k)[:, K]
            if not np.all(np.isfinite(s)):
                break
        u[k + K :] = u[k + K]
        return u

    def played(self, start: float, u: np.ndarray, supply: np.ndarray) -> np.ndarray:
        """States ``(ns, N)`` under the command ``u`` from rest at ``start`` (m); NaN from where they are no longer finite."""
        K = self.hold
        states = np.full((len(self.plant.states), u.size), np.nan)
        s = self.rest(start, float(supply[0]))
        for k in range(0, u.size, K):
            passed = self._moved(s, u, supply, k)
            states[:, k : k + K], s = passed[:, :K], passed[:, K]
            if not np.all(np.isfinite(s)):
                break
        return states

    def _moved(self, s: np.ndarray, u: np.ndarray, supply: np.ndarray, k: int) -> np.ndarray:
        """States ``(ns, K + 1)`` over the samples from ``k`` on."""
        plant, K = self.plant, self.hold
        data = np.zeros((1 + 2 * len(plant.inputs) + 2 * len(plant.outputs), K))
        data[0] = self.dt
        for row, values in enumerate((u, supply)):
            data[1 + row] = values[k : k + K]
            after = values[min(k + K, values.size - 1)]
            data[1 + len(plant.inputs) + row] = np.diff(values[k : k + K], append=after) / self.dt
        return np.asarray(self.piece(s, data, self.theta)[1])

    @property
    def top_speed(self) -> float:
        """Speed in m/s at which the open valve's choked flow fills the larger chamber at the supply's pressure."""
        rig = self.plant.rig
        conductance = self.fit.values.get("C", rig.conductance)
        return float(0.6 * conductance * RHO_REFERENCE * R_AIR * rig.temperature / rig.A1)

    def unable(self, command: Command, seen: np.ndarray, own: np.ndarray) -> float:
        """Twice the cost that is left when this model is fitted to another's noise-free states ``seen``; ``own`` : its own."""
        rig, fit, names = self.plant.rig, self.fit, self.plant.states
        record = Recording.from_arrays(
            "next.csv", rig, t=command.t, u=command.u, psup=command.supply, x=seen[0], p1=seen[2], p2=seen[3]
        )
        run = prepare(record, self.plant, fit.noise)
        values = {**fit.problem.values, **fit.relaxed_values}
        problem = Shooting(self.plant, [run], self.free, values, fit.ranges, fit.problem.substeps, fit.problem.samples)
        problem.set_smoothing(relaxed_smoothing(self.plant))
        problem.relaxation = fit.problem.relaxation
        at = problem.samples * np.arange(problem.nint)
        nodes = np.vstack([(seen if i < CORE else own)[i, at] for i in range(len(names))])
        q = problem.scaling.to_q(np.array([values[name] for name in self.free]))
        X = problem.join(np.clip(q, problem.scaling.lower, problem.scaling.upper), nodes)
        gradient, hessian = relaxed_system(problem, X)
        rows, cols = np.meshgrid(np.arange(problem.nq), np.arange(problem.nq), indexing="ij")
        known = sp.csc_matrix((self.known.ravel(), (rows.ravel(), cols.ravel())), shape=hessian.shape)
        H = hessian + known
        end, cost = problem.evaluate_values(X)
        total = cost + 0.5 * float(np.sum((problem.defects(end, X) / problem.relaxation) ** 2))
        # the parameters' weak priors are in what is known already
        index, _, inverse = problem.priors
        twice, pull = index < problem.nq, problem.prior_residual(X)
        gradient[index[twice]] -= pull[twice] * inverse[twice]
        total += 0.5 * float(np.sum(pull[~twice] ** 2))
        step = factorised(H).solve(gradient)
        return max(2.0 * (total - 0.5 * float(gradient @ step)), 0.0)


def _axis(rival: _Rival) -> Axis:
    rig = rival.plant.rig
    return Axis(2 * MARGIN * rig.stroke, (1 - 2 * MARGIN) * rig.stroke, 0.7 * rival.top_speed)


def _playable(rivals: Sequence[_Rival], excitation: Excitation, seconds: float) -> tuple[Command, list[np.ndarray]] | None:
    """The command by which the first rival follows the excitation, small enough for all, and what each does under it."""
    first, rig = rivals[0], rivals[0].plant.rig
    t = np.arange(round((SETTLING + seconds) / first.dt) // first.hold * first.hold) * first.dt
    moving = np.maximum(t - SETTLING, 0.0)
    share, axis = moving / moving[-1], _axis(first)
    path, closed = excitation.path(moving, axis), excitation.closed(share) & (t > SETTLING)
    supply = rig.patm + (rig.supply - rig.patm) * (1.0 - (1.0 - LOWER_SUPPLY) * excitation.lowered(share))
    for size in SHRINK:
        reference = axis.middle + size * (path - axis.middle)
        u = first.followed(reference, supply, closed)
        states = [rival.played(float(reference[0]), u, supply) for rival in rivals]
        if all(_within(rival, supply, seen) for rival, seen in zip(rivals, states, strict=True)):
            return Command(t, u, supply, states[0][0]), states
    return None


def _within(rival: _Rival, supply: np.ndarray, states: np.ndarray) -> bool:
    """Whether a rival keeps inside stroke and pressure limits."""
    rig = rival.plant.rig
    room, highest = MARGIN * rig.stroke, HIGHEST_PRESSURE * float(supply.max())
    inside = bool(np.all(np.isfinite(states)) and states[0].min() > room and states[0].max() < rig.stroke - room)
    return inside and bool(states[2:4].max() < highest and states[2:4].min() > 0.5 * rig.patm)


def _separation(rivals: Sequence[_Rival], command: Command, states: Sequence[np.ndarray]) -> float:
    """The smallest of what any rival cannot follow of any other."""
    return min(
        rivals[j].unable(command, states[i], states[j])
        for i in range(len(rivals)) for j in range(len(rivals)) if i != j
    )  # fmt: skip
