"""Screening: what each effect of the catalogue would gain, without fitting any of them.

Every candidate is an extra column of the relaxed cost at its off-value. One pass of the interval Jacobian with all columns,
projected orthogonal to the fitted parameters and the nodes, predicts each one's drop of the cost (a score test; Rao,
Proc. Cambridge Phil. Soc. 44 (1948) 50). Candidates whose predicted changes are collinear cannot be told apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import lsq_linear
from scipy.sparse.linalg import splu

from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import relaxed_system
from pneuid.physics.smoothing import COARSE
from pneuid.plant import Plant

COLLINEAR = 0.9
"""Correlation of predicted changes above which two effects are one group."""


@dataclass(frozen=True)
class Score:
    """Predicted gain of one effect: drop of half the sum of squares, degrees of freedom, start values for a refit (SI)."""

    effect: Effect
    drop: float
    gain: float
    freedom: int
    start: dict[str, float]
    group: tuple[str, ...]


def screen(fit: Fit, candidates: Sequence[Effect], order: Sequence[str]) -> list[Score]:
    """Scores of ``candidates`` on the relaxed solution of ``fit``, best first.

    ``order`` is the catalogue's order of effect names, which is the order of maps at a shared port.
    """
    chosen = [
        effect
        for effect in candidates
        if fit.plant.rig.kind in effect.rigs
        and fit.plant.law.name in effect.laws
        and effect not in fit.plant.effects
    ]
    if not chosen:
        return []
    position = {name: i for i, name in enumerate(order)}
    every = sorted([*fit.plant.effects, *chosen], key=lambda effect: position.get(effect.name, len(position)))
    plant = Plant(fit.plant.rig, fit.plant.law.name, every)
    problem, X = _extended(fit, plant, chosen)
    gradient, hessian = relaxed_system(problem, X)
    columns = {effect.name: _columns(problem, plant, effect) for effect in chosen}
    extra = np.concatenate([columns[effect.name] for effect in chosen])
    M, g, place = _projected(problem, X, gradient, hessian, extra)
    steps = {name: _best_step(problem, M, g, [place[j] for j in index], index) for name, index in columns.items()}
    drops = {name: _drop(M, g, [place[j] for j in columns[name]], step) for name, step in steps.items()}
    found = []
    for effect in chosen:
        name = effect.name
        mates = [
            other.name
            for other in chosen
            if other is not effect
            and drops[other.name] > 0.0
            and drops[name] > 0.0
            and _collinear(M, place, columns, steps, name, other.name) > COLLINEAR
        ]
        start = {problem.free[j]: _moved(problem, j, d) for j, d in zip(columns[name], steps[name], strict=True)}
        gain = drops[name] / max(fit.relaxed_cost, 1e-12)
        found.append(Score(effect, drops[name], float(gain), len(columns[name]), start, tuple(mates)))
    return sorted(found, key=lambda score: -score.drop)


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
    _, nodes = old.split(fit.relaxed.X)
    wide = np.zeros((problem.ns, problem.nint))
    for i, name in enumerate(fit.plant.states):
        wide[plant.states.index(name)] = nodes[i]
    fresh = [plant.states.index(state.name) for effect in chosen for state in effect.states]
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


def _projected(
    problem: Shooting, X: np.ndarray, gradient: np.ndarray, hessian: sp.csc_matrix, extra: np.ndarray
) -> tuple[np.ndarray, np.ndarray, dict[int, int]]:
    """Gram matrix and gradient of the extra columns, orthogonal to base parameters and nodes; column -> row there."""
    q = X[: problem.nq]
    width = problem.scaling.upper - problem.scaling.lower
    held = (q - problem.scaling.lower < 1e-3 * width) | (problem.scaling.upper - q < 1e-3 * width)
    held[extra] = True
    base = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
    H = hessian.tocsc()
    Hbb, Hbc = H[base][:, base], H[base][:, extra].toarray()
    diagonal = Hbb.diagonal()
    solver = splu((Hbb + sp.diags(1e-9 * diagonal + 1e-12)).tocsc())
    solved = solver.solve(np.column_stack([Hbc, gradient[base]]))
    M = H[extra][:, extra].toarray() - Hbc.T @ solved[:, :-1]
    g = gradient[extra] - Hbc.T @ solved[:, -1]
    return 0.5 * (M + M.T), g, {int(j): i for i, j in enumerate(extra)}


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


def _collinear(M: np.ndarray, place: dict, columns: dict, steps: dict, a: str, b: str) -> float:
    """Correlation of the predicted changes of the residuals by two effects."""
    ra, rb = [place[j] for j in columns[a]], [place[j] for j in columns[b]]
    both = steps[a] @ M[np.ix_(ra, rb)] @ steps[b]
    one = steps[a] @ M[np.ix_(ra, ra)] @ steps[a]
    two = steps[b] @ M[np.ix_(rb, rb)] @ steps[b]
    return float(abs(both) / np.sqrt(max(one * two, 1e-300)))
