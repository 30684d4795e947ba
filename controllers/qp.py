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
def _roll_out(A, B, c, u, x):
    """States under commands ``u`` from ``x[0]``, in place."""
    N, nx = B.shape
    for i in range(N):
        for a in range(nx):
            total = c[i, a] + B[i, a] * u[i]
            for b in range(nx):
                total += A[i, a, b] * x[i, b]
            x[i + 1, a] = total


@njit(cache=True)
def _factorise(A, B, Q, R, gain, pivot):
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
def _direction(A, B, gain, pivot, gx, gu, dx, du):
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
def _list_bounds(lower, upper):
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
def _beyond(rows, lower, upper, x, out):
    """By how much each bound is exceeded (negative: room left)."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        out[k] = x[i, j] - upper[i, j] if sign > 0 else lower[i, j] - x[i, j]


@njit(cache=True)
def _bound_terms(rows, give, t, mult, violation, target, Qb, gx):
    """Add what the bounds contribute to weights and gradient; ``target`` is the wanted ``t * mult`` of each."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        weight = 1.0 / (t[k] / mult[k] + give[j])
        Qb[i, j] += weight
        gx[i, j] = gx[i, j] + sign * (mult[k] + weight * (violation[k] - (t[k] * mult[k] - target[k]) / mult[k]))


@njit(cache=True)
def _slack_steps(rows, give, dx, t, mult, violation, target, dt, dmult):
    """Steps of slacks and multipliers that belong to the step ``dx`` of the states."""
    for k in range(rows.shape[0]):
        i, j, sign = rows[k]
        short = t[k] * mult[k] - target[k]
        dmult[k] = (sign * dx[i, j] + violation[k] - short / mult[k]) / (t[k] / mult[k] + give[j])
        dt[k] = -(short + t[k] * dmult[k]) / mult[k]


@njit(cache=True)
def _longest(t, mult, dt, dmult):
    """Longest step that keeps slacks and multipliers positive, at most 1/0.995."""
    step = 1.0 / _TO_BOUNDARY
    for k in range(t.shape[0]):
        if dt[k] < 0.0:
            step = min(step, -t[k] / dt[k])
        if dmult[k] < 0.0:
            step = min(step, -mult[k] / dmult[k])
    return step


@njit(cache=True)
def _solve(A, B, c, Q, q, R, lower, upper, give, x0, tolerance):
    N, nx = B.shape
    x, u = np.zeros((N + 1, nx)), np.zeros(N)
    dx, du = np.zeros((N + 1, nx)), np.zeros(N)
    gain, pivot = np.empty((N, nx)), np.empty(N)
    gx = np.empty((N + 1, nx))
    x[0] = x0
    _roll_out(A, B, c, u, x)
    _factorise(A, B, Q, R, gain, pivot)
    _direction(A, B, gain, pivot, Q * x + q, R * u, dx, du)
    rows = _list_bounds(lower, upper)
    m = rows.shape[0]
    beyond = np.empty(m)
    _beyond(rows, lower, upper, x + dx, beyond)
    if m == 0 or np.max(beyond) <= 0.0:
        return x + dx, u + du, 0, True
    # the free minimum is a good start, it satisfies the dynamics
    x, u = x + dx, u + du
    t, mult = np.empty(m), np.empty(m)
    for k in range(m):
        t[k] = max(-beyond[k], _SMALLEST_SLACK)
        mult[k] = _FIRST_BARRIER / t[k]
    violation, target = np.empty(m), np.zeros(m)
    dt, dmult = np.empty(m), np.empty(m)
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
        if (t @ mult) / m < tolerance and worst < tolerance and np.max(np.abs(du)) < tolerance ** 0.5 and step > 0.9:
            return x, u, iteration, True
    return x, u, LARGEST_ITERATIONS, False
