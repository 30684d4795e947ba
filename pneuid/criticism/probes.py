"""Unknown functions in any equation at the price of one: a value per interval and equation, and splines as its weights.

A function of a slow signal hardly changes within an interval of the fit. So one compiled plant, which adds a constant per
interval to every equation, serves the functions of all signals in all equations: ``value_i = sum_j B_j(signal_i) c_j`` with
the mean of the splines over interval ``i``. The sensitivities to the constants are local to an interval; those to the
amplitudes ``c`` follow by products, whatever their number. Both the screening (one Newton step, as in ``screening``) and
the joint fit of amplitudes, parameters and nodes (Levenberg-Marquardt on the relaxed cost) are made of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from pneuid.effect import Effect, Parameter, Scope
from pneuid.effects._spline import LEAST_FRICTION, Term, columns
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import THREADS, Evaluation, Shooting
from pneuid.estimation.solver import relaxed_system
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import COARSE, FINE, Expression
from pneuid.plant import Plant
from pneuid.rig import Rig

SERVO_PROBES = ("force", "level", "flow_1", "flow_2", "opening", "gain", "sensor_x", "sensor_p1", "sensor_p2")
BENCH_PROBES = ("force", "level")
"""Where a constant is added: a sensor of force cannot be told from a force, the rate of a pressure not from a flow."""

_SIZES = {"opening": 0.02, "gain": 0.02, "sensor_x": 1e-4, "sensor_p1": 1e3, "sensor_p2": 1e3}

ITERATIONS = 25
SETTLED = 1e-4
"""Relative fall of the cost by which the joint fit ends."""


class Probe(Effect):
    """A constant in every equation, zero when off; it differs from interval to interval."""

    name, equation, mechanism = "probe", "force", "a value of its own in every interval is added to every equation"
    reference, experiment = "score test, Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50", ""

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """One amplitude per equation."""
        names = SERVO_PROBES if rig.kind == "servo" else BENCH_PROBES
        return tuple(
            Parameter(f"probe_{name}", name, "1", -np.inf, np.inf, 0.0, probe_size(name, rig), "", off=0.0) for name in names
        )

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Adds to the sum of forces, N."""
        return force + scope.p.probe_force

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Adds to the level of friction, N."""
        more = scope.p.probe_level
        return replace(
            k, Fc=ca.fmax(k.Fc + more, LEAST_FRICTION * k.Fc), Fs=ca.fmax(k.Fs + more, LEAST_FRICTION * k.Fs)
        )

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Adds to both mass flows, kg/s."""
        return mdot1 + scope.p.probe_flow_1, mdot2 + scope.p.probe_flow_2

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Adds to the opening and to the valve's gain."""
        return opening * (1.0 + scope.p.probe_gain) + scope.p.probe_opening

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Adds to what the sensors of a servo rig show."""
        return value + getattr(scope.p, f"probe_sensor_{signal}", 0.0)


def probe_size(name: str, rig: Rig) -> float:
    """Typical size of a probe, SI."""
    equation = {"level": "friction"}.get(name, name)
    return _SIZES.get(name) or Term(equation, "p1").size(rig)


def probe_of(term: Term) -> str:
    """The probe through which a term acts."""
    if term.equation == "friction":
        return "force" if term.signal == "v" else "level"
    if term.equation == "valve":
        return "opening" if term.signal == "u" and not term.factor else "gain"
    return term.equation


@dataclass(frozen=True)
class Joint:
    """A relaxed fit with unknown terms: amplitudes per term (SI), base parameters (SI), cost, covariance of all amplitudes."""

    terms: tuple[Term, ...]
    amplitudes: tuple[np.ndarray, ...]
    values: dict[str, float]
    cost: float
    covariance: np.ndarray


class Probed(Shooting):
    """The relaxed problem of a fit with a probe in every equation; ``added`` is ``(probes, nint)``, SI."""

    def __init__(self, fit: Fit) -> None:
        old = fit.problem
        plant = Plant(fit.plant.rig, fit.plant.law.name, [*fit.plant.effects, Probe()])
        self.probes = plant.own_parameters(Probe.name)
        values = plant.starts() | fit.relaxed_values
        super().__init__(plant, fit.runs, [*old.free, *self.probes], values, fit.ranges, old.substeps, old.samples)
        self.set_smoothing(COARSE)
        self.relaxation = old.relaxation
        self.nbase, self.count = old.nq, len(self.probes)
        self._rows = [plant.theta_names.index(name) for name in self.probes]
        self.added = np.zeros((self.count, self.nint))
        self.point = np.concatenate([fit.relaxed.X[: old.nq], np.zeros(self.count), fit.relaxed.X[old.nq :]])
        q, width = fit.relaxed.X[: old.nq], old.scaling.upper - old.scaling.lower
        self.fixed = (q - old.scaling.lower < 1e-3 * width) | (old.scaling.upper - q < 1e-3 * width)
        value, slope = old.constraints(q)
        if value.size:
            # what holds with equality is not left to this unconstrained search
            self.fixed |= np.any(np.abs(slope[value < 1e-3]) > 1e-6, axis=0)
        base = np.concatenate([np.flatnonzero(~self.fixed), np.arange(self.nq, self.size)])
        self.base = base.astype(int)
        self._seen: tuple[bytes, Evaluation] | None = None

    def theta_of(self, changed: Mapping[str, float], plant: Plant | None = None) -> np.ndarray:
        """As in ``Shooting``, with every interval's own values of the probes."""
        found = super().theta_of(changed, plant)
        found[self._rows] = self.added
        return found

    def evaluate(self, X: np.ndarray) -> Evaluation:
        """As in ``Shooting``; the last point is kept."""
        key = X.tobytes() + self.added.tobytes()
        if self._seen is None or self._seen[0] != key:
            self._seen = key, super().evaluate(X)
        return self._seen[1]

    def cost(self, X: np.ndarray) -> float:
        """Relaxed cost: half the sum of squares of residuals, defects and priors."""
        end, cost = self.evaluate_values(X)
        defects = self.defects(end, X) / self.relaxation
        return cost + 0.5 * float(np.sum(defects**2)) + 0.5 * float(np.sum(self.prior_residual(X) ** 2))

    def states(self, X: np.ndarray) -> np.ndarray:
        """States ``(ns, nint, K)`` at the samples of every interval."""
        q, nodes = self.split(X)
        run = self.function.trajectory.map(self.nint, "thread", THREADS)
        found = np.asarray(run(nodes, self.data, self.theta(q))[1])
        return found.reshape(self.ns, self.nint, self.samples + 1)[:, :, : self.samples]

    def scope(self, X: np.ndarray) -> Scope:
        """Signals ``(nint, K)`` at a point, for the columns of splines."""
        rig, states = self.plant.rig, dict(zip(self.plant.states, self.states(X), strict=True))
        given = {
            name: self.data[1 + i].reshape(self.nint, self.samples) for i, name in enumerate(self.plant.inputs)
        } | states  # fmt: skip
        found = Scope(
            rig=SimpleNamespace(**self.ranges, patm=rig.patm, stroke=rig.stroke), smoothing=FINE, p=SimpleNamespace(),
            state=SimpleNamespace(),
        )  # fmt: skip
        for name in ("x", "v", "p1", "p2", "psup"):
            setattr(found, name, given.get(name))
        if "u" in given:
            found.opening = (given["u"] - rig.null) / rig.full_scale
        return found


def weights(term: Term, scope: Scope) -> np.ndarray:
    """Mean of each spline of a term over every interval ``(nint, k)``."""
    return np.stack([np.broadcast_to(column, scope.x.shape).mean(axis=1) for column in columns(term, scope)], axis=1)


@dataclass(frozen=True)
class _System:
    """The Gauss-Newton model in base variables and amplitudes at one point."""

    solver: object
    solved: np.ndarray
    cross: np.ndarray
    back: np.ndarray
    schur: np.ndarray
    slope: np.ndarray


class Probing:
    """Screens and fits unknown terms on the relaxed solution of a fit."""

    def __init__(self, fit: Fit) -> None:
        self.problem = Probed(fit)
        self.scope = self.problem.scope(self.problem.point)
        self.start_cost = self.problem.cost(self.problem.point)

    def screened(self, term: Term) -> float:
        """Predicted drop of the relaxed cost by a term."""
        system = self._system(self.problem.point, [(term, weights(term, self.scope))], [None], 0.0)
        return float(0.5 * system.slope @ np.linalg.solve(system.schur, system.slope))

    def fitted(self, terms: Sequence[Term]) -> Joint:
        """Joint fit of the terms, the base parameters and the nodes, from the relaxed solution."""
        problem = self.problem
        pairs = [(term, weights(term, self.scope)) for term in terms]
        sizes = np.concatenate([np.full(W.shape[1], self._size(term)) for term, W in pairs])
        X, c = problem.point.copy(), np.zeros(sizes.size)
        cost, damping = self._cost(X, c, pairs), 0.0
        for _ in range(ITERATIONS):
            system = self._system(X, pairs, self._parts(c, pairs), damping)
            dc = -np.linalg.solve(system.schur, system.slope)
            db = -(system.solved + system.back @ dc)
            step, better = 1.0, False
            for _ in range(4):
                trial = X.copy()
                trial[problem.base] += step * db
                q = trial[: problem.nbase]
                trial[: problem.nbase] = np.clip(q, problem.scaling.lower[: problem.nbase], problem.scaling.upper[: problem.nbase])
                found = self._cost(trial, c + step * dc * sizes, pairs)
                if np.isfinite(found) and found < cost:
                    better = True
                    break
                step *= 0.3
            if not better:
                if damping > 10.0:
                    break
                damping = max(10.0 * damping, 0.01)
                continue
            gain, X, c, cost = cost - found, trial, c + step * dc * sizes, found
            damping = 0.0 if step == 1.0 and damping < 0.02 else damping * 0.2
            if gain < SETTLED * cost:
                break
        system = self._system(X, pairs, self._parts(c, pairs), 0.0)
        values = problem.scaling.to_values(X[: problem.nq])[: problem.nbase]
        self._cost(problem.point, 0.0 * c, pairs)  # the problem is left as it was found
        return Joint(
            tuple(terms), tuple(self._parts(c, pairs)), dict(zip(problem.free[: problem.nbase], map(float, values), strict=True)),
            cost, np.linalg.inv(system.schur) * np.outer(sizes, sizes),
        )  # fmt: skip

    def _size(self, term: Term) -> float:
        return probe_size(probe_of(term), self.problem.plant.rig)

    def _parts(self, c: np.ndarray, pairs: Sequence[tuple[Term, np.ndarray]]) -> list[np.ndarray]:
        ends = np.cumsum([W.shape[1] for _, W in pairs])[:-1]
        return list(np.split(c, ends))

    def _cost(self, X: np.ndarray, c: np.ndarray, pairs: Sequence[tuple[Term, np.ndarray]]) -> float:
        problem = self.problem
        problem.added = np.zeros_like(problem.added)
        ridge = 0.0
        for (term, W), part in zip(pairs, self._parts(c, pairs), strict=True):
            problem.added[problem.probes.index(f"probe_{probe_of(term)}")] += W @ part
            ridge += 0.5 * float(np.sum((part / (10.0 * self._size(term))) ** 2))
        with np.errstate(over="ignore", invalid="ignore"):
            return problem.cost(X) + ridge

    def _system(
        self, X: np.ndarray, pairs: Sequence[tuple[Term, np.ndarray]], parts: Sequence[np.ndarray | None], damping: float
    ) -> _System:
        problem = self.problem
        at = problem.evaluate(X)
        gradient, hessian = relaxed_system(problem, X)
        H = hessian[problem.base][:, problem.base]
        solver = splu((H + sp.diags((1e-9 + damping) * H.diagonal() + 1e-12)).tocsc())
        n, w, nq, ns = problem.nint, 1.0 / problem.relaxation, problem.nq, problem.ns
        linked = np.zeros(n)
        linked[problem.linked] = w
        S = at.sensitivity * linked[:, None, None]
        defect = np.zeros((n, ns))
        defect[problem.linked] = problem.defects(at.end, X) * w
        blocks = at.gram[:, :-1, :-1] + S.transpose(0, 2, 1) @ S
        slope = at.gram[:, :-1, -1] + np.einsum("iks,ik->is", S, defect)
        place = [problem.nbase + problem.probes.index(f"probe_{probe_of(term)}") for term, _ in pairs]
        cross, slopes = [], []
        for (term, W), a, part in zip(pairs, place, parts, strict=True):
            to_nodes = blocks[:, nq:, a][:, :, None] * W[:, None, :]
            to_nodes[problem.linked + 1] -= (w * S[problem.linked, :, a])[:, :, None] * W[problem.linked][:, None, :]
            to_q = blocks[:, :nq, a].T @ W
            full = np.vstack([to_q, to_nodes.reshape(n * ns, -1)])
            cross.append(full[problem.base])
            prior = 0.0 if part is None else part / (100.0 * self._size(term))
            slopes.append(W.T @ slope[:, a] + prior)
        C, g = np.hstack(cross), np.concatenate(slopes)
        M = np.block([[W.T @ (blocks[:, a, b][:, None] * V) for (_, V), b in zip(pairs, place, strict=True)]
                      for (_, W), a in zip(pairs, place, strict=True)])  # fmt: skip
        M[np.diag_indices_from(M)] *= 1.0 + damping
        M[np.diag_indices_from(M)] += 0.01
        back, solved = solver.solve(C), solver.solve(gradient[problem.base])
        schur = M - C.T @ back
        return _System(solver, solved, C, back, 0.5 * (schur + schur.T), g - C.T @ solved)
