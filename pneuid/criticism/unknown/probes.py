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
from scipy.linalg import cho_solve_banded, cholesky_banded

from pneuid.cores import threads
from pneuid.effect import Effect, Parameter, Scope
from pneuid.effects._spline import LEAST_FRICTION, Term, columns
from pneuid.estimation.curves import known_ranges
from pneuid.estimation.first_guess import BREAK_AWAY
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Shooting, relaxed_smoothing
from pneuid.mapped import Mapped
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import FINE, Expression
from pneuid.plant import Plant
from pneuid.rig import Rig

SERVO_PROBES = (
    "force", "level", "flow_1", "flow_2", "opening", "gain", "sensor_x", "sensor_p1", "sensor_p2", "scale_x", "scale_p1",
    "scale_p2",
)  # fmt: skip
BENCH_PROBES = ("force", "level")
"""Where a constant is added: a sensor of force cannot be told from a force, the rate of a pressure not from a flow.

``scale`` is what a sensor shows too much relative to its value: where the piston moves far within an interval, the error of an
encoder over ``x`` is no constant in it, and changes what looks like the speed.
"""

_SIZES = {
    "opening": 0.02, "gain": 0.02, "sensor_x": 1e-4, "sensor_p1": 1e3, "sensor_p2": 1e3,
    "scale_x": 1e-3, "scale_p1": 1e-3, "scale_p2": 1e-3,
}  # fmt: skip

STILL = 1e-20
"""Variance of a signal within an interval, in its unit squared, that keeps the share of a signal at rest finite."""

RIDGE = 10.0
"""Spread of the amplitudes' weak prior, in units of their typical size."""

UNSEEN = 1e-13
"""What is added to every diagonal element, as a share of the largest: beside an unknown friction a viscous one had no effect at
all on a printed cylinder, and its row was zero. There it came to a thousandth of the amplitudes' weak prior."""

LARGEST_DAMPING = 5.0
SHARES = (1.0, 0.4, 0.15, 0.05)
"""Shares of a Newton step that are tried one after the other: steps across the kinks of stick-slip have to be shortened."""

ITERATIONS = 25
SETTLED = 5e-4
"""Relative fall of the cost by which the joint fit ends."""


class Probe(Effect):
    """A constant in every equation, zero when off; it differs from interval to interval."""

    name, equation, mechanism = "probe", "force", "a value of its own in every interval is added to every equation"
    reference, experiment = "score test, Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50", ""

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:  # noqa: ARG002 - the same for every law
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
        """Adds to what the sensors of a servo rig show, and to their scales."""
        return value * (1.0 + getattr(scope.p, f"probe_scale_{signal}", 0.0)) + getattr(scope.p, f"probe_sensor_{signal}", 0.0)


def probe_size(name: str, rig: Rig) -> float:
    """Typical size of a probe, SI."""
    equation = {"level": "friction"}.get(name, name)
    return _SIZES.get(name) or Term(equation, "p1").size(rig)


def probe_of(term: Term) -> str:
    """The probe through which a term acts."""
    if term.equation == "friction":
        return "force" if term.signal == "v" else "level"
    if term.equation == "valve":
        return "opening" if term.opens else "gain"
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
        self.set_smoothing(relaxed_smoothing(plant))
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
        if plant.servo and not plant.law.static:
            # jumps between intervals take up a break-away, so a fit with loose ones would move it for nothing: Fs from 19 to
            # 62 N (20 were right) for 0.1 % of the cost
            self.fixed |= np.isin(old.free, BREAK_AWAY)

    def theta_of(self, changed: Mapping[str, float], plant: Plant | None = None) -> np.ndarray:
        """As in ``Shooting``, with every interval's own values of the probes."""
        found = super().theta_of(changed, plant)
        found[self._rows] = self.added
        return found

    def cost(self, X: np.ndarray) -> float:
        """Relaxed cost: half the sum of squares of residuals, defects and priors."""
        end, cost = self.evaluate_values(X)
        defects = self.defects(end, X) / self.relaxation
        return cost + 0.5 * float(np.sum(defects**2)) + 0.5 * float(np.sum(self.prior_residual(X) ** 2))

    def states(self, X: np.ndarray) -> np.ndarray:
        """States ``(ns, nint, K)`` at the samples of every interval."""
        q, nodes = self.split(X)
        run = Mapped(self.function.trajectory, self.nint, threads())
        found = run(nodes, self.data, self.theta(q))[1]
        return found.reshape(self.ns, self.nint, self.samples + 1)[:, :, : self.samples]

    @property
    def times(self) -> np.ndarray:
        """Time ``(nint, K)`` in s since its run began at the samples of every interval, held where a run has ended."""
        missing = np.diff(self.first) * self.samples - [run.n for run in self.runs]
        each = [np.pad(run.t, (0, int(more)), mode="edge") for run, more in zip(self.runs, missing, strict=True)]
        return np.concatenate(each).reshape(self.nint, self.samples)

    def scope(self, X: np.ndarray) -> Scope:
        """Signals ``(nint, K)`` at a point, for the columns of splines."""
        rig, states = self.plant.rig, dict(zip(self.plant.states, self.states(X), strict=True))
        given = {
            name: self.data[1 + i].reshape(self.nint, self.samples) for i, name in enumerate(self.plant.inputs)
        } | states  # fmt: skip
        found = Scope(
            rig=SimpleNamespace(**known_ranges(self.plant, self.ranges), stroke=rig.stroke), smoothing=FINE,
            p=SimpleNamespace(), state=SimpleNamespace(),
        )  # fmt: skip
        for name in ("x", "v", "p1", "p2", "psup"):
            setattr(found, name, given.get(name))
        found.t = self.times
        if "u" in given:
            found.opening = (given["u"] - rig.null) / rig.full_scale
        return found


Actions = tuple[tuple[str, np.ndarray], ...]
"""Probes with the weights ``(nint, k)`` of a term's splines."""


def weights(term: Term, scope: Scope) -> np.ndarray:
    """Mean of each spline of a term over every interval ``(nint, k)``."""
    return _values(term, scope).mean(axis=1)


def actions(term: Term, scope: Scope) -> Actions:
    """The probes through which a term acts, and how each of its splines moves them in every interval ``(nint, k)``.

    The error of a sensor over its own signal moves two: within an interval it is a constant and a share of the signal.
    """
    if f"sensor_{term.signal}" != term.equation or term.factor:
        return ((probe_of(term), weights(term, scope)),)
    values, signal = _values(term, scope), np.asarray(getattr(scope, term.signal))[:, :, None]
    middle = signal.mean(axis=1, keepdims=True)
    spread = np.maximum(np.mean((signal - middle) ** 2, axis=1), STILL)
    share = np.mean((signal - middle) * values, axis=1) / spread
    return (term.equation, values.mean(axis=1) - share * middle[:, 0]), (f"scale_{term.signal}", share)


def _values(term: Term, scope: Scope) -> np.ndarray:
    """Every spline of a term at the samples of every interval, ``(nint, K, k)``."""
    return np.stack([np.broadcast_to(column, scope.x.shape) for column in columns(term, scope)], axis=2)


@dataclass(frozen=True)
class _Blocks:
    """The Gauss-Newton model at one point, nodes eliminated by a banded Cholesky factor.

    band : factor of the nodes' Hessian; blocks ``(nint, width, width)`` and slope ``(nint, width)`` of every interval, defects
    included; following : coupling of an interval to the next node ``(nint, ns, width)``; node_slope ``(nint ns,)``.
    """

    band: np.ndarray
    blocks: np.ndarray
    slope: np.ndarray
    following: np.ndarray
    node_slope: np.ndarray


Columns = tuple[tuple[int, np.ndarray], ...]
"""Rows of the blocks ``(nint, width, width)`` that move together, each with its weights ``(nint, k)``."""

Pair = tuple[Term, Actions]
"""A term and what it moves."""


class Probing:
    """Screens and fits unknown terms on the relaxed solution of a fit."""

    def __init__(self, fit: Fit) -> None:
        self.problem = Probed(fit)
        self.scope = self.problem.scope(self.problem.point)
        self.start_cost = self.problem.cost(self.problem.point)
        self._start = self._blocks(self.problem.point, 0.0)

    def screened(self, *terms: Term) -> float:
        """Predicted drop of the relaxed cost by terms: that of one Newton step in amplitudes, parameters and nodes."""
        pairs = [(term, actions(term, self.scope)) for term in terms]
        matrix, slope, _ = self._reduced(self._start, pairs, [np.zeros(term.knots) for term in terms], 0.0)
        base = int((~self.problem.fixed).sum())
        both = slope @ np.linalg.solve(matrix, slope)
        return float(0.5 * (both - slope[:base] @ np.linalg.solve(matrix[:base, :base], slope[:base])))

    def fitted(self, terms: Sequence[Term]) -> Joint:
        """Joint fit of the terms, the base parameters and the nodes, from the relaxed solution."""
        problem = self.problem
        pairs = [(term, actions(term, self.scope)) for term in terms]
        free, sizes = np.flatnonzero(~problem.fixed), np.concatenate([np.full(t.knots, self._size(t)) for t in terms])
        X, c, damping = problem.point.copy(), np.zeros(sizes.size), 0.0
        cost, at = self._cost(X, c, pairs), self._start
        for _ in range(ITERATIONS):
            matrix, slope, to_nodes = self._reduced(at, pairs, _parts(c, pairs), damping)
            dense = -np.linalg.solve(matrix, slope)
            nodes = -cho_solve_banded((at.band, True), at.node_slope + to_nodes @ dense)
            for share in SHARES:
                trial, c_trial = X.copy(), c + share * dense[free.size :] * sizes
                moved = X[free] + share * dense[: free.size]
                trial[free] = np.clip(moved, problem.scaling.lower[free], problem.scaling.upper[free])
                trial[problem.nq :] += share * nodes
                found = self._cost(trial, c_trial, pairs)
                if found < cost:
                    break
            if found < cost:
                gain, X, c, cost = cost - found, trial, c_trial, found
                damping = 0.2 * damping if share == 1.0 and damping > 0.01 else damping if share < 1.0 else 0.0
                if gain < SETTLED * cost and share > 0.5:
                    break
            else:
                damping = max(5.0 * damping, 0.02)
                if damping > LARGEST_DAMPING:
                    break
                self._cost(X, c, pairs)
            at = self._blocks(X, damping)
        self._cost(X, c, pairs)
        matrix, _, _ = self._reduced(self._blocks(X, 0.0), pairs, _parts(c, pairs), 0.0)
        covariance = np.linalg.inv(matrix)[free.size :, free.size :] * np.outer(sizes, sizes)
        values = problem.scaling.to_values(X[: problem.nq])[: problem.nbase]
        problem.added = np.zeros_like(problem.added)
        named = {name: float(value) for name, value in zip(problem.free[: problem.nbase], values, strict=True)}
        return Joint(tuple(terms), tuple(_parts(c, pairs)), named, cost, covariance)

    def _size(self, term: Term) -> float:
        return probe_size(probe_of(term), self.problem.plant.rig)

    def _cost(self, X: np.ndarray, c: np.ndarray, pairs: Sequence[Pair]) -> float:
        """Cost at a point and amplitudes (SI), which the problem keeps."""
        problem = self.problem
        problem.added = np.zeros_like(problem.added)
        ridge = 0.0
        for (term, moved), part in zip(pairs, _parts(c, pairs), strict=True):
            for name, W in moved:
                problem.added[problem.probes.index(f"probe_{name}")] += W @ part
            ridge += 0.5 * float(np.sum((part / (RIDGE * self._size(term))) ** 2))
        with np.errstate(over="ignore", invalid="ignore"):  # a trial point may lie anywhere
            return problem.cost(X) + ridge

    def _blocks(self, X: np.ndarray, damping: float) -> _Blocks:
        problem = self.problem
        at = problem.evaluate(X)
        n, w, nq, ns = problem.nint, 1.0 / problem.relaxation, problem.nq, problem.ns
        linked, after = problem.linked, problem.linked + 1
        S, defect = np.zeros_like(at.sensitivity), np.zeros((n, ns))
        S[linked], defect[linked] = w * at.sensitivity[linked], w * problem.defects(at.end, X)
        blocks = at.gram[:, :-1, :-1] + S.transpose(0, 2, 1) @ S
        slope = at.gram[:, :-1, -1] + np.einsum("iks,ik->is", S, defect)
        index, _, inverse = problem.priors
        prior = np.zeros(problem.size)
        np.add.at(prior, index, inverse**2)
        pull = np.zeros(problem.size)
        np.add.at(pull, index, problem.prior_residual(X) * inverse)
        own = blocks[:, nq:, nq:].copy()
        own[after] += w**2 * np.eye(ns)
        own[:, np.arange(ns), np.arange(ns)] += prior[nq:].reshape(n, ns)
        own[:, np.arange(ns), np.arange(ns)] *= 1.0 + 1e-9 + damping
        node_slope = slope[:, nq:] + pull[nq:].reshape(n, ns)
        node_slope[after] -= w * defect[linked]
        # rows of the next node: minus the interval's end, in units of the allowed spread
        band = cholesky_banded(_banded(own, -w * S[:, :, nq:]), lower=True)
        blocks[0, np.arange(nq), np.arange(nq)] += prior[:nq]
        slope[0, :nq] += pull[:nq]
        return _Blocks(band, blocks, slope, -w * S, node_slope.ravel())

    def _reduced(
        self, at: _Blocks, pairs: Sequence[Pair], parts: Sequence[np.ndarray], damping: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix and slope in ``[free parameters, amplitudes]`` with the nodes eliminated, and their coupling to the nodes."""
        problem = self.problem
        n, ns, nq = problem.nint, problem.ns, problem.nq
        free = np.flatnonzero(~problem.fixed)
        columns: list[Columns] = [((int(j), np.ones((n, 1))),) for j in free]
        rig, first = problem.plant.rig, problem.nbase
        for term, moved in pairs:
            size = self._size(term)  # of an amplitude; blocks are in units of each probe's own
            columns.append(
                tuple(
                    (first + problem.probes.index(f"probe_{name}"), W * (size / probe_size(name, rig))) for name, W in moved
                )
            )
        coupling = []
        for group in columns:
            found = np.zeros((n, ns, group[0][1].shape[1]))
            for j, W in group:
                found += at.blocks[:, nq:, j][:, :, None] * W[:, None, :]
                found[1:] += at.following[:-1, :, j][:, :, None] * W[:-1, None, :]
            coupling.append(found.reshape(n * ns, -1))
        to_nodes = np.hstack(coupling)
        matrix = np.block([[_product(at.blocks, one, other) for other in columns] for one in columns])
        slope = np.concatenate([sum(W.T @ at.slope[:, j] for j, W in group) for group in columns])
        # the amplitudes' weak prior, in units of their sizes
        amplitudes = np.arange(free.size, slope.size)
        matrix[amplitudes, amplitudes] += RIDGE**-2
        scaled = [part / (RIDGE**2 * self._size(term)) for (term, _), part in zip(pairs, parts, strict=True)]
        slope[amplitudes] += np.concatenate(scaled)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + 1e-9 + damping
        back = cho_solve_banded((at.band, True), np.column_stack([to_nodes, at.node_slope]))
        matrix = matrix - to_nodes.T @ back[:, :-1]
        # a parameter that these runs do not see at all would leave nothing to divide by
        matrix[np.diag_indices_from(matrix)] += UNSEEN * np.abs(np.diag(matrix)).max()
        return 0.5 * (matrix + matrix.T), slope - to_nodes.T @ back[:, -1], to_nodes


def _parts(c: np.ndarray, pairs: Sequence[Pair]) -> list[np.ndarray]:
    """Amplitudes of all terms, cut into those of each."""
    return list(np.split(c, np.cumsum([term.knots for term, _ in pairs])[:-1]))


def _product(blocks: np.ndarray, one: Columns, other: Columns) -> np.ndarray:
    """Inner products of two groups of columns: of each a row of the blocks and its weights in every interval."""
    return np.asarray(sum(W.T @ (blocks[:, i, j][:, None] * V) for i, W in one for j, V in other))


def _banded(own: np.ndarray, to_next: np.ndarray) -> np.ndarray:
    """Lower banded form of a symmetric block tridiagonal matrix: diagonal blocks ``(n, s, s)`` and those below them."""
    n, s, _ = own.shape
    band = np.zeros((2 * s, n * s))
    for j in range(s):
        for i in range(j, s):
            band[i - j, j::s] = own[:, i, j]
        for i in range(s):
            band[s + i - j, j::s][: n - 1] = to_next[:-1, i, j]
    return band
