"""Running a model forward: intervals in a row, for one run or many windows at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneuid.interval import IntervalFunction
from pneuid.mapped import Slopes, Trajectories

STUCK = 1e5
"""Damping of a search beyond which no step from where it is lowers the cost."""


@dataclass(frozen=True)
class Trajectory:
    """Outputs ``(W, ny, N)`` at the samples and states ``(W, ns, N)`` of W windows simulated side by side (SI)."""

    outputs: np.ndarray
    states: np.ndarray
    end: np.ndarray


def simulate(function: IntervalFunction, start: np.ndarray, data: np.ndarray, theta: np.ndarray) -> Trajectory:
    """Simulate W windows of equal length from their start states.

    start : ``(W, ns)``; data : ``(W, rows, N)`` sample columns, N a multiple of the interval; theta : ``(W, ntheta)``.
    Windows run side by side, intervals one after the other; a window that diverges is NaN from there on.
    """
    W, _rows, N = data.shape
    K = function.samples
    intervals = N // K
    run = Trajectories(function.trajectory, np.full(W, intervals))
    shown, passed = run(start.T, _side_by_side(data), np.repeat(theta.T, intervals, axis=1))
    outputs, states = (item.reshape(W, N, -1).transpose(0, 2, 1) for item in (shown, passed[:, :K]))
    return Trajectory(outputs, states, passed[intervals - 1 :: intervals, K])


@np.errstate(over="ignore", invalid="ignore")  # a window may diverge; it counts as infinitely bad
def estimate_start(
    function: IntervalFunction,
    guess: np.ndarray,
    data: np.ndarray,
    theta: np.ndarray,
    prior: np.ndarray,
    scale: np.ndarray,
    iterations: int = 15,
) -> tuple[np.ndarray, np.ndarray]:
    """Start states ``(W, ns)`` of W windows that fit the windows' measurements best, and their costs ``(W,)``.

    Parameters frozen; Levenberg-Marquardt on all windows side by side until each has settled. ``guess`` is ``(W, ns)``;
    ``prior`` its 1-sigma ``(ns,)`` or ``(W, ns)`` (inf: none); ``scale`` ``(ns,)`` makes the search dimensionless; data and
    theta as in ``simulate``. The interval function must have been built without parameter derivatives.
    """
    W, ns = guess.shape
    every = np.broadcast_to(prior, guess.shape)
    inverse = np.where(np.isfinite(every), scale / every, 0.0) ** 2
    best, damping = guess.copy(), np.full(W, 1e-2)
    cost, H, g = _gauss_newton(function, best, data, theta, scale)
    cost = cost + 0.0
    moving = np.arange(W)
    for _ in range(iterations):
        offset = (best[moving] - guess[moving]) / scale
        known = inverse[moving]
        hessian = H[moving] + np.eye(ns) * known[:, None, :]
        gradient = g[moving] + known * offset
        damped = hessian + damping[moving, None, None] * np.einsum("wii->wi", hessian)[:, :, None] * np.eye(ns)
        damped += 1e-12 * np.trace(damped, axis1=1, axis2=2)[:, None, None] * np.eye(ns)
        step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        trial = best[moving] + step * scale
        now, H_new, g_new = _gauss_newton(function, trial, data[moving], theta[moving], scale)
        before = cost[moving] + 0.5 * np.sum(known * offset**2, axis=1)
        after = now + 0.5 * np.sum(known * ((trial - guess[moving]) / scale) ** 2, axis=1)
        better = np.isfinite(after) & (after < before)
        taken = moving[better]
        best[taken], cost[taken], H[taken], g[taken] = trial[better], now[better], H_new[better], g_new[better]
        damping[moving] = np.where(better, damping[moving] * 0.2, damping[moving] * 6.0)
        settled = better & (before - after < 1e-4 * np.maximum(before, 1e-9))
        moving = moving[~settled & (damping[moving] < STUCK)]
        if moving.size == 0:
            break
    return best, cost + 0.5 * np.sum(inverse * ((best - guess) / scale) ** 2, axis=1)


def _gauss_newton(
    function: IntervalFunction, start: np.ndarray, data: np.ndarray, theta: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cost ``(W,)``, Hessian ``(W, ns, ns)`` and gradient ``(W, ns)`` in units of ``scale``."""
    W, ns = start.shape
    intervals = data.shape[2] // function.samples
    run = Slopes(function.derivatives, np.full(W, intervals))
    _, _, packed = run(start.T, _side_by_side(data), np.repeat(theta.T, intervals, axis=1))
    cols, rows = np.tril_indices(ns + 1)
    total, both = np.empty((W, ns + 1, ns + 1)), np.append(scale, 1.0)
    total[:, rows, cols] = total[:, cols, rows] = packed[intervals - 1 :: intervals, 0]
    total *= np.outer(both, both)
    finite = np.all(np.isfinite(total), axis=(1, 2))
    total[~finite] = np.eye(ns + 1)
    cost = np.where(finite, 0.5 * total[:, ns, ns], np.inf)
    return cost, total[:, :ns, :ns], total[:, :ns, ns]


def _side_by_side(data: np.ndarray) -> np.ndarray:
    """``(rows, W * N)`` of windows ``(W, rows, N)``."""
    return data.transpose(1, 0, 2).reshape(data.shape[1], -1)
