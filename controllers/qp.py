"""A quadratic program with the structure of optimal control, by a Riccati interior-point method, compiled.

    minimise   sum_i 1/2 x_i' Q_i x_i + q_i' x_i  +  sum_i 1/2 R u_i^2
    subject to x_0 given, x_i+1 = A_i x_i + B_i u_i + c_i,  lower_i <= x_i <= upper_i  (i >= 1)

with one command ``u``, diagonal ``Q`` and infinite bounds where there are none. A bound on state ``j`` with
``give[j] > 0`` is soft: crossing it by ``s`` costs ``s^2 / (2 give[j])``; a hard one has ``give[j] = 0`` and must be
reachable through ``u``. When the minimum without bounds respects them all, it is returned at once.

Method: Mehrotra's predictor-corrector; every iterate satisfies the dynamics, so one Riccati recursion per iteration
gives the Newton direction. A soft bound is the hard one with ``give`` added to the diagonal of its complementarity
row, since the best slack is ``give`` times the multiplier.
Sources: Rao, Wright, Rawlings, J. Optim. Theory Appl. 99 (1998) 723 (structure); Mehrotra, SIAM J. Optim. 2 (1992) 575.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_ITERATIONS = 40
_TO_BOUNDARY = 0.995
_FIRST_BARRIER = 1.0
_SMALLEST_SLACK = 0.1


class Solution(NamedTuple):
    """States ``(N+1, nx)``, commands ``(N,)``, iterations (0: no bound was active), and whether the tolerance holds."""

    x: Array
    u: Array
    iterations: int
    solved: bool


def solve(
    A: Array, B: Array, c: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, x0: Array,
    tolerance: float = 1e-8,
) -> Solution:  # fmt: skip
    """Solve it. Shapes: A (N, nx, nx); B, c (N, nx); Q, q, lower, upper (N+1, nx); give, x0 (nx,).

    The problem should be scaled so that states and commands are of order one; ``tolerance`` holds for the
    complementarity, the bounds and the last step alike.
    """
    return Solution(*_solve(A, B, c, Q, q, R, lower, upper, give, x0, tolerance))


@njit(cache=True)
def _roll_out(A: Array, B: Array, c: Array, u: Array, x: Array) -> None:
    """States under commands ``u`` from ``x[0]``, in place."""
    N, nx = B.shape
    for i in range(N):
        for a in range(nx):
            total = c[i, a] + B[i, a] * u[i]
            for b in range(nx):
                total += A[i, a, b] * x[i, b]
            x[i + 1, a] = total


@njit(cache=True)
def _factorise(A: Array, B: Array, Q: Array, R: float, gain: Array, pivot: Array) -> None:
    """Riccati recursion for the weights ``Q``: ``gain`` (N, nx) with ``u = -gain x``, ``pivot`` (N,)."""
    N, nx = B.shape
    P = np.zeros((nx, nx))
    PA = np.empty((nx, nx))
    for a in range(nx):
        P[a, a] = Q[N, a]
    for i in range(N - 1, -1, -1):
        PB = P @ B[i]
        h = R + B[i] @ PB
        pivot[i] = h
        for a in range(nx):
            for b in range(nx):
                total = 0.0
                for k in range(nx):
                    total += P[a, k] * A[i, k, b]
                PA[a, b] = total
        for a in range(nx):
            total = 0.0
            for k in range(nx):
                total += A[i, k, a] * PB[k]
            gain[i, a] = total / h
        for a in range(nx):
            for b in range(a, nx):
                total = -h * gain[i, a] * gain[i, b]
                for k in range(nx):
                    total += A[i, k, a] * PA[k, b]
                P[a, b] = total
                P[b, a] = total
            P[a, a] += Q[i, a]


@njit(cache=True)
def _direction(A: Array, B: Array, gain: Array, pivot: Array, gx: Array, gu: Array, dx: Array, du: Array) -> None:
    """Newton direction for the gradients ``gx`` (N+1, nx), ``gu`` (N,), written into ``dx`` and ``du``."""
    N, nx = B.shape
    p = gx[N].copy()
    for i in range(N - 1, -1, -1):
        h = gu[i] + B[i] @ p
        du[i] = h / pivot[i]
        new = gx[i].copy()
        for a in range(nx):
            total = -gain[i, a] * h
            for k in range(nx):
                total += A[i, k, a] * p[k]
            new[a] += total
        p = new
    dx[0] = 0.0
    for i in range(N):
        du[i] = -du[i] - gain[i] @ dx[i]
        for a in range(nx):
            total = B[i, a] * du[i]
            for k in range(nx):
                total += A[i, a, k] * dx[i, k]
            dx[i + 1, a] = total


@njit(cache=True)
def _list_bounds(lower: Array, upper: Array) -> NDArray[np.int64]:
    """Every finite bound as a row ``(stage, state, sign)``: sign +1 for an upper, -1 for a lower one."""
    rows = np.empty((2 * lower.size, 3), dtype=np.int64)
    count = 0
    for i in range(1, lower.shape[0]):
        for j in range(lower.shape[1]):
            if np.isfinite(upper[i, j]):
                rows[count] = (i, j, 1)
                count += 1
            if np.isfinite(lower[i, j]):
                rows[count] = (i, j, -1)
                count += 1
    return rows[:count]


@njit(cache=True)
def _beyond(rows: NDArray[np.int64], lower: Array, upper: Array, x: Array, out: Array) -> None:
    """By how much each bound is exceeded (negative: room left)."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        out[k] = x[i, j] - upper[i, j] if sign > 0 else lower[i, j] - x[i, j]


@njit(cache=True)
def _bound_terms(
    rows: NDArray[np.int64], give: Array, t: Array, mult: Array, violation: Array, target: Array, Qb: Array, gx: Array
) -> None:
    """Add what the bounds contribute to weights and gradient; ``target`` is the wanted ``t * mult`` of each."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        weight = 1.0 / (t[k] / mult[k] + give[j])
        Qb[i, j] += weight
        gx[i, j] = gx[i, j] + sign * (mult[k] + weight * (violation[k] - (t[k] * mult[k] - target[k]) / mult[k]))


@njit(cache=True)
def _slack_steps(
    rows: NDArray[np.int64], give: Array, dx: Array, t: Array, mult: Array, violation: Array, target: Array,
    dt: Array, dmult: Array,
) -> None:  # fmt: skip
    """Steps of slacks and multipliers that belong to the step ``dx`` of the states."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        short = t[k] * mult[k] - target[k]
        dmult[k] = (sign * dx[i, j] + violation[k] - short / mult[k]) / (t[k] / mult[k] + give[j])
        dt[k] = -(short + t[k] * dmult[k]) / mult[k]


@njit(cache=True)
def _longest(t: Array, mult: Array, dt: Array, dmult: Array) -> float:
    """Longest step that keeps slacks and multipliers positive, at most 1/0.995."""
    step = 1.0 / _TO_BOUNDARY
    for k in range(t.shape[0]):
        if dt[k] < 0.0:
            step = min(step, -t[k] / dt[k])
        if dmult[k] < 0.0:
            step = min(step, -mult[k] / dmult[k])
    return step


@njit(cache=True)
def _interior_point(
    A: Array, B: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, rows: NDArray[np.int64], x: Array,
    u: Array, tolerance: float,
) -> tuple[int, bool]:  # fmt: skip
    """Improve ``x`` and ``u`` in place from a point that satisfies the dynamics; iterations and success."""
    N, nx, m = B.shape[0], B.shape[1], rows.shape[0]
    gain, pivot, dx, du = np.empty((N, nx)), np.empty(N), np.zeros((N + 1, nx)), np.zeros(N)
    violation, target, dt, dmult = np.empty(m), np.zeros(m), np.empty(m), np.empty(m)
    _beyond(rows, lower, upper, x, violation)
    t = np.maximum(-violation, _SMALLEST_SLACK)
    mult = _FIRST_BARRIER / t
    for iteration in range(1, LARGEST_ITERATIONS + 1):
        _beyond(rows, lower, upper, x, violation)
        for k in range(m):
            violation[k] += t[k] - give[rows[k, 1]] * mult[k]
        mu = (t @ mult) / m
        # predictor: aim at zero, see how far one gets
        target[:] = 0.0
        Qb, gx = Q.copy(), Q * x + q
        _bound_terms(rows, give, t, mult, violation, target, Qb, gx)
        _factorise(A, B, Qb, R, gain, pivot)
        _direction(A, B, gain, pivot, gx, R * u, dx, du)
        _slack_steps(rows, give, dx, t, mult, violation, target, dt, dmult)
        step = min(1.0, _longest(t, mult, dt, dmult))
        ahead = ((t + step * dt) @ (mult + step * dmult)) / m
        # corrector: centre as far as the predictor fell short, second-order term included
        centre = (ahead / mu) ** 3 * mu
        for k in range(m):
            target[k] = centre - dt[k] * dmult[k]
        gx = Q * x + q
        _bound_terms(rows, give, t, mult, violation, target, Qb, gx)
        _direction(A, B, gain, pivot, gx, R * u, dx, du)
        _slack_steps(rows, give, dx, t, mult, violation, target, dt, dmult)
        step = min(1.0, _TO_BOUNDARY * _longest(t, mult, dt, dmult))
        x += step * dx
        u += step * du
        t += step * dt
        mult += step * dmult
        worst = (1.0 - step) * np.max(np.abs(violation))
        settled = step > 0.9 and np.max(np.abs(du)) < np.sqrt(tolerance)
        if settled and (t @ mult) / m < tolerance and worst < tolerance:
            return iteration, True
    return LARGEST_ITERATIONS, False


@njit(cache=True)
def _solve(
    A: Array, B: Array, c: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, x0: Array,
    tolerance: float,
) -> tuple[Array, Array, int, bool]:  # fmt: skip
    """The minimum without bounds if it respects them, else the interior-point method from there."""
    N, nx = B.shape
    x, u, dx, du = np.zeros((N + 1, nx)), np.zeros(N), np.zeros((N + 1, nx)), np.zeros(N)
    gain, pivot = np.empty((N, nx)), np.empty(N)
    x[0] = x0
    _roll_out(A, B, c, u, x)
    _factorise(A, B, Q, R, gain, pivot)
    _direction(A, B, gain, pivot, Q * x + q, R * u, dx, du)
    x, u = x + dx, u + du
    rows = _list_bounds(lower, upper)
    beyond = np.zeros(rows.shape[0] + 1)
    _beyond(rows, lower, upper, x, beyond)
    if np.max(beyond) <= 0.0:
        return x, u, 0, True
    iterations, solved = _interior_point(A, B, Q, q, R, lower, upper, give, rows, x, u, tolerance)
    return x, u, iterations, solved
