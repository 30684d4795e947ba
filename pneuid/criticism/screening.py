"""Screening: what each effect of the catalogue would gain, without fitting any of them.

Every candidate is an extra column of the relaxed cost at its off-value: how the weighted outputs and the defects change
with each of its amplitudes. Projected orthogonal to the fitted parameters and the nodes, the columns predict each
one's drop of the cost (a score test; Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50). Candidates whose predicted changes
are collinear cannot be told apart. The columns are differences of forward simulations, which compile in a fraction
of the time that derivatives by every effect of the catalogue take.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pneuid.effect import Effect, Parameter
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Scaling, threads
from pneuid.interval import trajectory_function
from pneuid.mapped import Mapped
from pneuid.plant import Plant

COLLINEAR = 0.9
"""Correlation of predicted changes above which two effects are one group."""

BATCH_COLUMNS, BATCH_STATES = 12, 4
"""Amplitudes and states of the effects that share one compiled plant."""

TELLABLE = 3.0
"""Predicted drop below which an effect's change is noise and is grouped with nothing."""

LEADING = 0.05
"""Share of the largest predicted drop below which an effect is not looked at for its group."""

STEP = 1e-8
"""Step of an amplitude, in units of its scale, by which a column is taken as a difference: stick makes the response curve
within 1e-6, rounding disturbs it by 1e-4 of a sensor's noise at this step."""


@dataclass(frozen=True)
class Score:
    """Predicted gain of one effect: drop of half the sum of squares, degrees of freedom, start values for a refit (SI)."""

    effect: Effect
    drop: float
    gain: float
    freedom: int
    start: dict[str, float]
    group: tuple[str, ...]


@dataclass(frozen=True)
class Change:
    """What one effect's best step does.

    raw : change of the stacked residuals; base : its inner products with the fitted columns (parameters and nodes).
    """

    effect: Effect
    drop: float
    start: dict[str, float]
    raw: np.ndarray
    base: np.ndarray


def screen(fit: Fit, candidates: Sequence[Effect], order: Sequence[str]) -> list[Score]:
    """Scores of ``candidates`` on the relaxed solution of ``fit``, best first.

    ``order`` is the catalogue's order of effect names, which is the order of maps at a shared port.
    """
    present = {effect.name for effect in fit.plant.effects}
    chosen = [
        effect
        for effect in candidates
        if fit.plant.rig.kind in effect.rigs and fit.plant.law.name in effect.laws and effect.name not in present
    ]
    if not chosen:
        return []
    fitted = Fitted(fit)
    changes = screened(fitted, chosen, order)
    groups = _groups(fitted, changes)
    found = [
        Score(change.effect, change.drop, float(change.drop / max(fit.relaxed_cost, 1e-12)), len(change.start),
              change.start, groups[change.effect.name])
        for change in changes
    ]  # fmt: skip
    return sorted(found, key=lambda score: -score.drop)


def screened(fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> list[Change]:
    """Predicted changes by every effect, in batches that share a compiled plant."""
    return [change for batch in batches(fitted.fit.plant, chosen) for change in _screened(fitted, batch, order)]


class Fitted:
    """What was fitted: residuals, their Jacobian and a solver for the Hessian of the free variables.

    Residuals are stacked: weighted outputs of every interval, sample by sample, then the defects in units of their
    allowed spread.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        problem, X = fit.problem, fit.relaxed.X
        q = X[: problem.nq]
        width = problem.scaling.upper - problem.scaling.lower
        held = (q - problem.scaling.lower < 1e-3 * width) | (problem.scaling.upper - q < 1e-3 * width)
        self.free = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
        gradient, hessian = relaxed_system(problem, X)
        H = hessian[self.free][:, self.free]
        self.gradient = gradient[self.free]
        self.solver = factorised(H)
        self.rows, self.ends = problem.jacobian(X)
        self.ends = self.ends[problem.linked] / problem.relaxation
        values = dict(zip(problem.free, problem.scaling.to_values(q), strict=True))
        self.values = problem.values | values
        self.nodes = problem.split(X)[1]
        shown = self.response(self.runner(problem.plant), problem.plant, self.nodes, self.values)
        ny = len(problem.plant.outputs)
        measured = problem.data[-2 * ny : -ny] * problem.data[-ny:]
        defect = -(self.nodes / problem.state_scale[:, None])[:, problem.linked + 1].T / problem.relaxation
        self.residual = shown + np.concatenate([-measured.T.ravel(), defect.ravel()])

    def runner(self, plant: Plant) -> Mapped:
        """Trajectories of ``plant`` over all intervals."""
        problem = self.fit.problem
        return Mapped(trajectory_function(plant, problem.samples, problem.substeps), problem.nint, threads())

    def response(self, run: Mapped, plant: Plant, nodes: np.ndarray, values: dict[str, float]) -> np.ndarray:
        """Weighted outputs and end states of ``plant``, stacked; states that the fitted plant lacks are left out."""
        problem = self.fit.problem
        outputs, states = run(nodes, problem.data, problem.theta_of(values, plant))
        shown = outputs * problem.data[-len(plant.outputs) :]
        own = [plant.states.index(name) for name in problem.plant.states]
        ends = states[own, problem.samples :: problem.samples + 1] / problem.state_scale[:, None]
        return np.concatenate([shown.T.ravel(), ends[:, problem.linked].T.ravel() / problem.relaxation])

    def cross(self, change: np.ndarray) -> np.ndarray:
        """Inner products ``(free, k)`` of stacked changes ``(m, k)`` with the columns of the free variables."""
        problem = self.fit.problem
        k, split = change.shape[1], self.rows.shape[0] * self.rows.shape[1]
        defects = change[split:].reshape(problem.linked.size, problem.ns, k)
        blocks = self.rows.transpose(0, 2, 1) @ change[:split].reshape(problem.nint, -1, k)
        blocks[problem.linked] += self.ends.transpose(0, 2, 1) @ defects
        nodes = blocks[:, problem.nq :]
        nodes[problem.linked + 1] -= defects / problem.relaxation
        found = np.concatenate([blocks[:, : problem.nq].sum(axis=0), nodes.reshape(-1, k)])
        return np.asarray(found[self.free])

    def projected(self, change: Change) -> np.ndarray:
        """The stacked change orthogonal to the fitted parameters and nodes: what is left of it once they have followed."""
        problem = self.fit.problem
        follow = np.zeros(problem.size)
        follow[self.free] = -self.solver.solve(change.base)
        nodes = follow[problem.nq :].reshape(problem.nint, problem.ns)
        local = np.hstack([np.tile(follow[: problem.nq], (problem.nint, 1)), nodes])
        rows = np.einsum("ikw,iw->ik", self.rows, local)
        ends = np.einsum("ikw,iw->ik", self.ends, local[problem.linked]) - nodes[problem.linked + 1] / problem.relaxation
        return np.asarray(change.raw + np.concatenate([rows.ravel(), ends.ravel()]))


def batches(plant: Plant, chosen: Sequence[Effect]) -> Iterator[list[Effect]]:
    """The candidates in their order, a few amplitudes and states at a time."""
    batch: list[Effect] = []
    columns = states = 0
    for effect in chosen:
        own = len(_amplitudes(plant, effect))
        if batch and (columns + own > BATCH_COLUMNS or states + len(effect.states) > BATCH_STATES):
            yield batch
            batch, columns, states = [], 0, 0
        batch.append(effect)
        columns, states = columns + own, states + len(effect.states)
    if batch:
        yield batch


def _amplitudes(plant: Plant, effect: Effect) -> list[Parameter]:
    """Parameters that are zero while the effect is off; shapes mean nothing then."""
    return [item for item in effect.parameters(plant.rig, plant.law) if item.off is not None]


def _screened(fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> list[Change]:
    """Predicted changes by the effects of one batch."""
    batch = Batch(fitted, chosen, order)
    plant, amplitudes = batch.plant, batch.amplitudes
    scaling = Scaling(amplitudes)
    at = scaling.to_q(np.array(list(batch.off.values())))
    columns = np.empty((batch.before.size, len(amplitudes)))
    for j, item in enumerate(amplitudes):
        q = at.copy()
        q[j] += STEP
        columns[:, j] = batch.change({item.name: float(scaling.to_values(q)[j])}, batch.nodes) / STEP
    cross = fitted.cross(columns)
    prior = np.array([_prior(item) for item in amplitudes])
    solved = fitted.solver.solve(cross)
    # orthogonal to the fitted parameters and nodes
    M = columns.T @ columns - cross.T @ solved + np.diag(prior[:, 0] ** 2)
    g = columns.T @ fitted.residual - solved.T @ fitted.gradient + prior[:, 0] ** 2 * (at - prior[:, 1])
    found = []
    for effect in chosen:
        rows = [j for j, item in enumerate(amplitudes) if item.name in plant.own_parameters(effect.name)]
        step = _best_step(M[np.ix_(rows, rows)], g[rows], (scaling.lower - at)[rows], (scaling.upper - at)[rows])
        q = at.copy()
        q[rows] = np.clip(at[rows] + step, scaling.lower[rows], scaling.upper[rows])
        start = {amplitudes[j].name: float(scaling.to_values(q)[j]) for j in rows}
        drop = float(max(0.0, -(g[rows] @ step + 0.5 * step @ M[np.ix_(rows, rows)] @ step)))
        found.append(Change(effect, drop, start, columns[:, rows] @ step, cross[:, rows] @ step))
    return found


class Batch:
    """The fitted plant with some effects more, all of them off: how it responds when they are not."""

    def __init__(self, fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> None:
        old = fitted.fit.plant
        position = {name: i for i, name in enumerate(order)}
        every = sorted([*old.effects, *chosen], key=lambda effect: position.get(effect.name, len(position)))
        self.fitted, self.plant = fitted, Plant(old.rig, old.law.name, every)
        self.amplitudes = [item for effect in chosen for item in _amplitudes(self.plant, effect)]
        self.off = {item.name: float(item.off or 0.0) for item in self.amplitudes}
        self.values = self.plant.starts() | fitted.values | self.off
        self.nodes = self.followed({})
        self._run = fitted.runner(self.plant)
        self.before = fitted.response(self._run, self.plant, self.nodes, self.values)

    def followed(self, moved: Mapping[str, float]) -> np.ndarray:
        """Nodes ``(ns, nint)`` with the effects' own states as they come out with the values ``moved``."""
        return _rolled_out(self.fitted, self.plant, self.values | dict(moved))

    def change(self, moved: Mapping[str, float], nodes: np.ndarray) -> np.ndarray:
        """Change of the stacked residuals when some values (SI) are moved."""
        return self.fitted.response(self._run, self.plant, nodes, self.values | dict(moved)) - self.before


def _prior(item: Parameter) -> tuple[float, float]:
    """Inverse spread (0 where there is none) and centre of a parameter's prior in search units."""
    centre = float(Scaling([item]).to_q(np.array([item.start]))[0])
    if item.prior is None:
        return 0.0, centre
    return 1.0 / (item.prior if item.positive else item.prior / item.scale), centre


def _groups(fitted: Fitted, changes: Sequence[Change]) -> dict[str, tuple[str, ...]]:
    """For every leading effect those whose predicted changes are collinear with its own, orthogonal to what is fitted."""
    groups: dict[str, tuple[str, ...]] = {change.effect.name: () for change in changes}
    least = max(TELLABLE, LEADING * max(change.drop for change in changes))
    leading = [change for change in changes if change.drop > least]
    if len(leading) < 2:
        return groups
    base = np.column_stack([change.base for change in leading])
    raw = np.column_stack([change.raw for change in leading])
    M = raw.T @ raw - base.T @ fitted.solver.solve(base)
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    near = np.abs(M / np.outer(size, size)) > COLLINEAR
    for i, change in enumerate(leading):
        groups[change.effect.name] = tuple(
            other.effect.name for j, other in enumerate(leading) if j != i and near[i, j]
        )
    return groups


def _rolled_out(fitted: Fitted, plant: Plant, values: dict[str, float]) -> np.ndarray:
    """Nodes of ``plant``: the fitted states, and the candidates' own filled in by following the fitted trajectory."""
    problem = fitted.fit.problem
    nodes = np.zeros((len(plant.states), problem.nint))
    for name, row in zip(problem.plant.states, fitted.nodes, strict=True):
        nodes[plant.states.index(name)] = row
    fresh = [i for i, name in enumerate(plant.states) if name not in problem.plant.states]
    if not fresh:
        return nodes
    initial = {state.name: state.initial for state in plant.effect_states}
    step = Mapped(trajectory_function(plant, problem.samples, problem.substeps), 1)
    theta, K = problem.theta_of(values, plant), problem.samples
    for first, last in zip(problem.first[:-1], problem.first[1:], strict=True):
        own = np.array([initial[plant.states[i]] for i in fresh])
        for i in range(first, last):
            nodes[fresh, i] = own
            _, states = step(nodes[:, i], problem.data[:, i * K : (i + 1) * K], theta[:, i])
            own = states[fresh, -1]
    return nodes


def _best_step(M: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Step of one effect's amplitudes (scaled) that lowers the quadratic model most, between ``low`` and ``high``."""
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    # a direction that the data do not feel at all keeps a step of zero
    root = np.linalg.cholesky(M / np.outer(size, size) + 1e-8 * np.eye(size.size))
    target = -np.linalg.solve(root, g / size)
    found = lsq_linear(root.T, target, (low * size - 1e-12, high * size + 1e-12))
    return np.asarray(found.x / size)
