"""Screening: what each effect of the catalogue would gain, without fitting any of them.

Every candidate is an extra column of the relaxed cost at its off-value. One pass of the interval Jacobian with all columns,
projected orthogonal to the fitted parameters and the nodes, predicts each one's drop of the cost (a score test; Rao,
Proc. Cambridge Phil. Soc. 44 (1948) 50). Candidates whose predicted changes are collinear cannot be told apart. The pass is
made in batches of a few effects, because the compiled code grows with the square of its columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import lsq_linear
from scipy.sparse.linalg import splu

from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import THREADS, Shooting
from pneuid.estimation.solver import relaxed_system
from pneuid.physics.smoothing import COARSE
from pneuid.plant import Plant

COLLINEAR = 0.9
"""Correlation of predicted changes above which two effects are one group."""

BATCH_COLUMNS, BATCH_STATES = 9, 3
"""Amplitudes and states of the effects that share a pass."""

TELLABLE = 3.0
"""Predicted drop below which an effect's change is noise and is grouped with nothing."""

LEADING = 0.05
"""Share of the largest predicted drop below which an effect is not looked at for its group."""

PROBE = 1e-6
"""Share of a predicted step by which its change of the residuals is taken as a difference."""


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
class _Change:
    """What one effect's best step does to the extended problem that it was screened in.

    base : inner products of the change with the fitted columns (parameters and nodes).
    """

    effect: Effect
    drop: float
    problem: Shooting
    X: np.ndarray
    columns: np.ndarray
    step: np.ndarray
    base: np.ndarray

    @property
    def start(self) -> dict[str, float]:
        """Amplitudes (SI, inside their bounds) after the step."""
        pairs = zip(self.columns, self.step, strict=True)
        return {self.problem.free[j]: _moved(self.problem, j, d) for j, d in pairs}

    def raw(self) -> np.ndarray:
        """The change of weighted outputs and scaled defects itself, stacked."""
        ahead, behind = self.X.copy(), self.X.copy()
        ahead[self.columns] += PROBE * self.step
        behind[self.columns] -= PROBE * self.step
        return (_response(self.problem, ahead) - _response(self.problem, behind)) / (2 * PROBE)


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
    fitted = _Fitted(fit)
    changes = [change for batch in _batches(fit.plant, chosen) for change in _screened(fitted, batch, order)]
    groups = _groups(fitted, changes)
    found = [
        Score(change.effect, change.drop, float(change.drop / max(fit.relaxed_cost, 1e-12)), change.columns.size,
              change.start, groups[change.effect.name])
        for change in changes
    ]  # fmt: skip
    return sorted(found, key=lambda score: -score.drop)


class _Fitted:
    """What was fitted: the free variables of the relaxed problem and a solver for their Hessian."""

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
        self.solver = splu((H + sp.diags(1e-9 * H.diagonal() + 1e-12)).tocsc())
        self.solved = self.solver.solve(self.gradient)

    def places(self, problem: Shooting) -> np.ndarray:
        """Positions of the free variables in an extended problem."""
        rows = [problem.plant.states.index(name) for name in self.fit.plant.states]
        nodes = problem.nq + problem.ns * np.arange(problem.nint)[:, None] + np.array(rows)
        return np.concatenate([np.arange(self.fit.problem.nq), nodes.ravel()])[self.free]


def _batches(plant: Plant, chosen: Sequence[Effect]) -> Iterator[list[Effect]]:
    """The candidates in their order, a few amplitudes and states at a time."""
    batch: list[Effect] = []
    columns = states = 0
    for effect in chosen:
        own = sum(item.off is not None for item in effect.parameters(plant.rig, plant.law))
        if batch and (columns + own > BATCH_COLUMNS or states + len(effect.states) > BATCH_STATES):
            yield batch
            batch, columns, states = [], 0, 0
        batch.append(effect)
        columns, states = columns + own, states + len(effect.states)
    if batch:
        yield batch


def _screened(fitted: _Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> list[_Change]:
    """Predicted changes by the effects of one batch."""
    fit = fitted.fit
    position = {name: i for i, name in enumerate(order)}
    every = sorted([*fit.plant.effects, *chosen], key=lambda effect: position.get(effect.name, len(position)))
    plant = Plant(fit.plant.rig, fit.plant.law.name, every)
    problem, X = _extended(fit, plant, chosen)
    gradient, hessian = relaxed_system(problem, X)
    columns = {effect.name: _columns(problem, plant, effect) for effect in chosen}
    extra = np.concatenate([columns[effect.name] for effect in chosen])
    row = {int(j): i for i, j in enumerate(extra)}
    cross = hessian[fitted.places(problem)][:, extra].toarray()
    # orthogonal to the fitted parameters and nodes
    M = hessian[extra][:, extra].toarray() - cross.T @ fitted.solver.solve(cross)
    M, g = 0.5 * (M + M.T), gradient[extra] - cross.T @ fitted.solved
    found = []
    for effect in chosen:
        index = columns[effect.name]
        rows = [row[int(j)] for j in index]
        step = _best_step(problem, M, g, rows, index)
        found.append(_Change(effect, _drop(M, g, rows, step), problem, X, index, step, cross[:, rows] @ step))
    return found


def _response(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """Weighted outputs and scaled defects of the relaxed problem, stacked, candidates' own states left out."""
    q, nodes = problem.split(X)
    run = problem.function.trajectory.map(problem.nint, "thread", THREADS)
    outputs, states = run(nodes, problem.data, problem.theta(q))
    shown = np.asarray(outputs) * problem.data[-len(problem.plant.outputs) :]
    ends = np.asarray(states)[:, problem.samples :: problem.samples + 1]
    base = len(problem.plant.core_states)
    defects = (ends / problem.state_scale[:, None])[:base, problem.linked] / problem.relaxation
    return np.concatenate([shown.ravel(), defects.ravel()])


def _groups(fitted: _Fitted, changes: Sequence[_Change]) -> dict[str, tuple[str, ...]]:
    """For every leading effect those whose predicted changes are collinear with its own, orthogonal to what is fitted."""
    groups: dict[str, tuple[str, ...]] = {change.effect.name: () for change in changes}
    least = max(TELLABLE, LEADING * max(change.drop for change in changes))
    leading = [change for change in changes if change.drop > least]
    if len(leading) < 2:
        return groups
    base = np.column_stack([change.base for change in leading])
    raw = np.column_stack([change.raw() for change in leading])
    M = raw.T @ raw - base.T @ fitted.solver.solve(base)
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    near = np.abs(M / np.outer(size, size)) > COLLINEAR
    for i, change in enumerate(leading):
        groups[change.effect.name] = tuple(
            other.effect.name for j, other in enumerate(leading) if j != i and near[i, j]
        )
    return groups


def _columns(problem: Shooting, plant: Plant, effect: Effect) -> np.ndarray:
    """Positions of an effect's amplitudes among the free parameters; shapes mean nothing while it is off."""
    own = plant.own_parameters(effect.name)
    return np.array([j for j, item in enumerate(problem.declared) if item.name in own], dtype=int)


def _extended(fit: Fit, plant: Plant, chosen: Sequence[Effect]) -> tuple[Shooting, np.ndarray]:
    """The relaxed problem with the candidates' amplitudes as extra parameters, at the fitted point."""
    old = fit.problem
    values = plant.starts() | fit.relaxed_values
    by_name = {item.name: item for item in plant.parameters}
    amplitudes = []
    for effect in chosen:
        for name in plant.own_parameters(effect.name):
            off = by_name[name].off
            if off is not None:
                values[name] = off
                amplitudes.append(name)
    free = [*old.free, *amplitudes]
    problem = Shooting(plant, fit.runs, free, values, fit.ranges, old.substeps, old.samples)
    problem.set_smoothing(COARSE)
    problem.relaxation = old.relaxation
    fresh = [plant.states.index(state.name) for effect in chosen for state in effect.states]
    # candidates' own states follow by themselves: on a scale far above their size their defects weigh nothing
    problem.state_scale = problem.state_scale.copy()
    problem.state_scale[fresh] *= 1e9
    _, nodes = old.split(fit.relaxed.X)
    wide = np.zeros((problem.ns, problem.nint))
    for i, name in enumerate(fit.plant.states):
        wide[plant.states.index(name)] = nodes[i]
    q = problem.scaling.to_q(np.array([values[name] for name in free]))
    _roll_out(problem, q, wide, fresh)
    return problem, problem.join(q, wide)


def _roll_out(problem: Shooting, q: np.ndarray, nodes: np.ndarray, fresh: Sequence[int]) -> None:
    """Fill the candidates' own states in place, interval after interval along the fitted trajectory."""
    if not fresh:
        return
    rows, K = list(fresh), problem.samples
    theta = problem.theta(q)
    initial = {state.name: state.initial for state in problem.plant.effect_states}
    start = np.array([initial[problem.plant.states[i]] for i in rows])
    for first, last in zip(problem.first[:-1], problem.first[1:], strict=True):
        s = start
        for i in range(first, last):
            nodes[rows, i] = s
            end, _ = problem.function.values(nodes[:, i], problem.data[:, i * K : (i + 1) * K], theta[:, i])
            s = np.asarray(end).ravel()[rows]


def _best_step(problem: Shooting, M: np.ndarray, g: np.ndarray, rows: list[int], index: np.ndarray) -> np.ndarray:
    """Step of one effect's amplitudes (scaled) that lowers the quadratic model most, within their bounds."""
    block = M[np.ix_(rows, rows)]
    size = np.sqrt(np.maximum(np.diag(block), 1e-300))
    # a direction that the data do not feel at all keeps a step of zero
    root = np.linalg.cholesky(block / np.outer(size, size) + 1e-8 * np.eye(len(rows)))
    target = -np.linalg.solve(root, g[rows] / size)
    off = np.array([problem.scaling.to_q(_at(problem, j))[j] for j in index])
    low = (problem.scaling.lower[index] - off) * size
    high = (problem.scaling.upper[index] - off) * size
    found = lsq_linear(root.T, target, (low - 1e-12, high + 1e-12))
    return np.asarray(found.x / size)


def _moved(problem: Shooting, j: int, step: float) -> float:
    """Value (SI, inside the bounds) of a parameter after a scaled step from its off-value."""
    q = problem.scaling.to_q(_at(problem, j))
    q[j] = np.clip(q[j] + step, problem.scaling.lower[j], problem.scaling.upper[j])
    return float(problem.scaling.to_values(q)[j])


def _at(problem: Shooting, j: int) -> np.ndarray:
    """Parameter values with the j-th at its off-value."""
    values = np.array([item.start for item in problem.declared])
    values[j] = problem.declared[j].off
    return values


def _drop(M: np.ndarray, g: np.ndarray, rows: list[int], step: np.ndarray) -> float:
    return float(max(0.0, -(g[rows] @ step + 0.5 * step @ M[np.ix_(rows, rows)] @ step)))
