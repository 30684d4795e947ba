"""A quadratic program with the structure of optimal control, by a Riccati interior-point method, compiled.

    minimise   sum_i 1/2 x_i' Q_i x_i + q_i' x_i  +  sum_i 1/2 R u_i^2
    subject to x_0 given, x_i+1 = A_i x_i + B_i u_i + c_i,  lower_i <= x_i <= upper_i  (i >= 1)

with one command ``u``, diagonal ``Q`` and infinite bounds where there are none. A bound on state ``j`` with
``give[j] > 0`` is soft: crossing it by ``s`` costs ``s^2 / (2 give[j])``; a hard one has ``give[j] = 0`` and must be
reachable through ``u``. When the minimum without bounds respects them all, it is returned at once.

Method: Mehrotra's predictor-corrector; every iterate satisfies the dynamics, so one Riccati recursion per iteration
gives the Newton direction. A soft bound is the hard one with ``give`` added to the diagonal of its complementarity
row, since the best slack is ``give`` times the multiplier. What it finds is taken to the last digit by Newton steps on the
active bounds.
Sources: Rao, Wright, Rawlings, J. Optim. Theory Appl. 99 (1998) 723 (structure); Mehrotra, SIAM J. Optim. 2 (1992) 575;
Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2003) 865 (active sets by Newton steps).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

LARGEST_ITERATIONS = 40
_TO_BOUNDARY = 0.995
_FIRST_BARRIER = 1.0
_SMALLEST_SLACK = 0.1

_ENOUGH = 1e-11
"""Complementarity at which the interior point's own end is taken, where no set of active bounds settles."""

_POLISHES = 8
"""Newton steps at most on the active bounds, of which two are enough where the interior point has told them right."""

_YIELD = 1e-8
"""Softness of a hard bound in these steps, in the program's units: what it leaves is taken away by the next one."""

_EXACT = 1e-10
"""Largest change of a command in the last of these steps, and of a bound crossed that still counts as none."""


class Solution(NamedTuple):
    """States ``(N+1, nx)``, commands ``(N,)``, iterations (0: no bound was active), and whether the tolerance holds."""

    x: Array
    u: Array
    iterations: int
    solved: bool


class Program(NamedTuple):
    """The arguments of ``solve`` but its tolerance."""

    A: Array
    B: Array
    c: Array
    Q: Array
    q: Array
    R: float
    lower: Array
    upper: Array
    give: Array
    x0: Array


def solve(
    A: Array, B: Array, c: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, x0: Array,
    tolerance: float = 1e-5,
) -> Solution:  # fmt: skip
    """Solve it. Shapes: A (N, nx, nx); B, c (N, nx); Q, q, lower, upper (N+1, nx); give, x0 (nx,).

    The problem should be scaled so that states and commands are of order one. ``tolerance`` holds for the interior point's
    complementarity, bounds and last step alike; below it the active bounds are tried as equations, and their minimum is exact.
    """
    N, nx = B.shape
    x, u = np.zeros((N + 1, nx)), np.zeros(N)
    x[0] = x0
    iterations, solved = _solve(A, B, c, Q, q, R, lower, upper, give, x, u, tolerance)
    return Solution(x, u, iterations, solved)


# Loops instead of array expressions throughout: as fast at these sizes, and numba compiles them several times faster.


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
    P, PA, PB = np.zeros((nx, nx)), np.zeros((nx, nx)), np.zeros(nx)
    for a in range(nx):
        P[a, a] = Q[N, a]
    for i in range(N - 1, -1, -1):
        h = R
        for a in range(nx):
            PB[a] = 0.0
            for b in range(nx):
                PB[a] += P[a, b] * B[i, b]
                PA[a, b] = 0.0
                for k in range(nx):
                    PA[a, b] += P[a, k] * A[i, k, b]
            h += B[i, a] * PB[a]
        pivot[i] = h
        for a in range(nx):
            gain[i, a] = 0.0
            for k in range(nx):
                gain[i, a] += A[i, k, a] * PB[k] / h
        for a in range(nx):
            for b in range(a, nx):
                total = -h * gain[i, a] * gain[i, b]
                for k in range(nx):
                    total += A[i, k, a] * PA[k, b]
                P[a, b] = total
                P[b, a] = total
            P[a, a] += Q[i, a]


@njit(cache=True)
def _direction(
    A: Array, B: Array, gain: Array, pivot: Array, gx: Array, R: float, u: Array, dx: Array, du: Array
) -> None:
    """Newton direction for the gradients ``gx`` (N+1, nx) and ``R u``, written into ``dx`` and ``du``."""
    N, nx = B.shape
    p, new = np.zeros(nx), np.zeros(nx)
    for a in range(nx):
        p[a] = gx[N, a]
    for i in range(N - 1, -1, -1):
        h = R * u[i]
        for a in range(nx):
            h += B[i, a] * p[a]
        du[i] = h / pivot[i]
        for a in range(nx):
            new[a] = gx[i, a] - gain[i, a] * h
            for k in range(nx):
                new[a] += A[i, k, a] * p[k]
        for a in range(nx):
            p[a] = new[a]
    for a in range(nx):
        dx[0, a] = 0.0
    for i in range(N):
        du[i] = -du[i]
        for a in range(nx):
            du[i] -= gain[i, a] * dx[i, a]
        for a in range(nx):
            total = B[i, a] * du[i]
            for k in range(nx):
                total += A[i, a, k] * dx[i, k]
            dx[i + 1, a] = total


@njit(cache=True)
def _list_bounds(lower: Array, upper: Array, rows: Rows) -> int:
    """Write every finite bound as a row ``(stage, state, sign)``, +1 for an upper, -1 for a lower one; their number."""
    count = 0
    for i in range(1, lower.shape[0]):
        for j in range(lower.shape[1]):
            for sign in (1, -1):
                if (sign > 0 and upper[i, j] < np.inf) or (sign < 0 and lower[i, j] > -np.inf):
                    rows[count, 0] = i
                    rows[count, 1] = j
                    rows[count, 2] = sign
                    count += 1
    return count


@njit(cache=True)
def _beyond(rows: Rows, m: int, lower: Array, upper: Array, x: Array, out: Array) -> float:
    """By how much each bound is exceeded (negative: room left); returns the largest."""
    worst = -np.inf
    for k in range(m):
        i, j = rows[k, 0], rows[k, 1]
        out[k] = x[i, j] - upper[i, j] if rows[k, 2] > 0 else lower[i, j] - x[i, j]
        worst = max(worst, out[k])
    return worst


@njit(cache=True)
def _gradient(Q: Array, q: Array, x: Array, gx: Array) -> None:
    """``Q x + q``, written into ``gx``."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            gx[i, j] = Q[i, j] * x[i, j] + q[i, j]


@njit(cache=True)
def _bound_terms(
    rows: Rows, m: int, give: Array, t: Array, mult: Array, violation: Array, target: Array, Qb: Array, gx: Array
) -> None:
    """Add what the bounds contribute to weights and gradient; ``target`` is the wanted ``t * mult`` of each."""
    for k in range(m):
        i, j, sign = rows[k, 0], rows[k, 1], rows[k, 2]
        weight = 1.0 / (t[k] / mult[k] + give[j])
        Qb[i, j] += weight
        gx[i, j] += sign * (mult[k] + weight * (violation[k] - (t[k] * mult[k] - target[k]) / mult[k]))


@njit(cache=True)
def _slack_steps(
    rows: Rows, m: int, give: Array, dx: Array, t: Array, mult: Array, violation: Array, target: Array, dt: Array,
    dmult: Array,
) -> float:  # fmt: skip
    """Steps of slacks and multipliers that belong to ``dx``; returns the longest that keeps them positive."""
    step = 1.0 / _TO_BOUNDARY
    for k in range(m):
        i, j, sign = rows[k, 0], rows[k, 1], rows[k, 2]
        short = t[k] * mult[k] - target[k]
        dmult[k] = (sign * dx[i, j] + violation[k] - short / mult[k]) / (t[k] / mult[k] + give[j])
        dt[k] = -(short + t[k] * dmult[k]) / mult[k]
        if dt[k] < 0.0:
            step = min(step, -t[k] / dt[k])
        if dmult[k] < 0.0:
            step = min(step, -mult[k] / dmult[k])
    return step


@njit(cache=True)
def _complementarity(m: int, t: Array, mult: Array, step: float, dt: Array, dmult: Array) -> float:
    """Mean of slack times multiplier after a step."""
    total = 0.0
    for k in range(m):
        total += (t[k] + step * dt[k]) * (mult[k] + step * dmult[k])
    return total / m


@njit(cache=True)
def _move(x: Array, u: Array, dx: Array, du: Array, step: float) -> float:
    """Add a step to states and commands; returns the largest change of a command."""
    largest = 0.0
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[i, j] += step * dx[i, j]
    for i in range(u.shape[0]):
        u[i] += step * du[i]
        largest = max(largest, abs(step * du[i]))
    return largest


@njit(cache=True)
def _active_terms(
    rows: Rows, m: int, give: Array, active: Rows, mult: Array, room: Array, Qb: Array, gx: Array
) -> None:
    """Add what the active bounds, taken for equations, contribute to weights and gradient."""
    for k in range(m):
        if active[k]:
            i, j, sign = rows[k, 0], rows[k, 1], rows[k, 2]
            weight = 1.0 / (_YIELD + give[j])
            Qb[i, j] += weight
            gx[i, j] += sign * (mult[k] + weight * (room[k] - give[j] * mult[k]))


@njit(cache=True)
def _active_after(
    rows: Rows, m: int, give: Array, dx: Array, active: Rows, mult: Array, room: Array
) -> bool:
    """Multipliers after a step, True if the active bounds stay what they were: one that pulls is let go, one crossed joins."""
    same = True
    for k in range(m):
        i, j, sign = rows[k, 0], rows[k, 1], rows[k, 2]
        after = room[k] + sign * dx[i, j]
        if active[k]:
            mult[k] += (after - give[j] * mult[k]) / (_YIELD + give[j])
            if mult[k] < 0.0:
                mult[k], active[k], same = 0.0, 0, False
        elif after > _EXACT:
            active[k], same = 1, False
    return same


@njit(cache=True)
def _polish(
    A: Array, B: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, rows: Rows, m: int,
    x: Array, u: Array, t: Array, mult: Array,
) -> bool:  # fmt: skip
    """The exact minimum from one whose active bounds show in slacks ``t`` and ``mult``, in place.

    Where the steps do not settle nothing is changed, and False is returned.
    """
    N, nx = B.shape
    gain, pivot, dx, du = np.zeros((N, nx)), np.zeros(N), np.zeros((N + 1, nx)), np.zeros(N)
    Qb, gx, room = np.zeros((N + 1, nx)), np.zeros((N + 1, nx)), np.zeros(m)
    old_x, old_u, active, pull = x.copy(), u.copy(), np.zeros(m, np.int64), np.zeros(m)
    for k in range(m):
        active[k] = mult[k] > t[k]
        pull[k] = mult[k] * active[k]
    for _ in range(_POLISHES):
        _beyond(rows, m, lower, upper, x, room)
        Qb[:] = Q
        _gradient(Q, q, x, gx)
        _active_terms(rows, m, give, active, pull, room, Qb, gx)
        _factorise(A, B, Qb, R, gain, pivot)
        _direction(A, B, gain, pivot, gx, R, u, dx, du)
        change = _move(x, u, dx, du, 1.0)
        if _active_after(rows, m, give, dx, active, pull, room) and change < _EXACT:
            return True
    x[:], u[:] = old_x, old_u
    return False


@njit(cache=True)
def _interior_point(
    A: Array, B: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, rows: Rows, m: int,
    x: Array, u: Array, tolerance: float,
) -> tuple[int, bool]:  # fmt: skip
    """Improve ``x`` and ``u`` in place from a point that satisfies the dynamics; iterations and success."""
    N, nx = B.shape
    gain, pivot, dx, du = np.zeros((N, nx)), np.zeros(N), np.zeros((N + 1, nx)), np.zeros(N)
    violation, target, dt, dmult = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    t, mult, Qb, gx = np.zeros(m), np.zeros(m), np.zeros((N + 1, nx)), np.zeros((N + 1, nx))
    _beyond(rows, m, lower, upper, x, violation)
    for k in range(m):
        t[k] = max(-violation[k], _SMALLEST_SLACK)
        mult[k] = _FIRST_BARRIER / t[k]
    for iteration in range(1, LARGEST_ITERATIONS + 1):
        _beyond(rows, m, lower, upper, x, violation)
        worst = 0.0
        for k in range(m):
            violation[k] += t[k] - give[rows[k, 1]] * mult[k]
            worst = max(worst, abs(violation[k]))
            # predictor: aim at zero, see how far one gets
            target[k] = 0.0
        for i in range(N + 1):
            for j in range(nx):
                Qb[i, j] = Q[i, j]
        _gradient(Q, q, x, gx)
        _bound_terms(rows, m, give, t, mult, violation, target, Qb, gx)
        _factorise(A, B, Qb, R, gain, pivot)
        _direction(A, B, gain, pivot, gx, R, u, dx, du)
        step = min(1.0, _slack_steps(rows, m, give, dx, t, mult, violation, target, dt, dmult))
        # corrector: centre as far as the predictor fell short, second-order term included
        mu = _complementarity(m, t, mult, 0.0, dt, dmult)
        centre = (_complementarity(m, t, mult, step, dt, dmult) / mu) ** 3 * mu
        for k in range(m):
            target[k] = centre - dt[k] * dmult[k]
        _gradient(Q, q, x, gx)
        _bound_terms(rows, m, give, t, mult, violation, target, Qb, gx)
        _direction(A, B, gain, pivot, gx, R, u, dx, du)
        step = min(1.0, _TO_BOUNDARY * _slack_steps(rows, m, give, dx, t, mult, violation, target, dt, dmult))
        change = _move(x, u, dx, du, step)
        for k in range(m):
            t[k] += step * dt[k]
            mult[k] += step * dmult[k]
        settled = step > 0.9 and change < np.sqrt(tolerance) and (1.0 - step) * worst < tolerance
        mu = _complementarity(m, t, mult, 0.0, dt, dmult)
        if not settled or mu >= tolerance:
            continue
        if _polish(A, B, Q, q, R, lower, upper, give, rows, m, x, u, t, mult) or mu < _ENOUGH:
            return iteration, True
    return LARGEST_ITERATIONS, False


@njit(cache=True)
def _solve(
    A: Array, B: Array, c: Array, Q: Array, q: Array, R: float, lower: Array, upper: Array, give: Array, x: Array,
    u: Array, tolerance: float,
) -> tuple[int, bool]:  # fmt: skip
    """The minimum without bounds if it respects them, else the interior-point method from there; from ``x[0]``."""
    N, nx = B.shape
    dx, du, gx = np.zeros((N + 1, nx)), np.zeros(N), np.zeros((N + 1, nx))
    gain, pivot = np.zeros((N, nx)), np.zeros(N)
    _roll_out(A, B, c, u, x)
    _factorise(A, B, Q, R, gain, pivot)
    _gradient(Q, q, x, gx)
    _direction(A, B, gain, pivot, gx, R, u, dx, du)
    _move(x, u, dx, du, 1.0)
    rows, room = np.zeros((2 * (N + 1) * nx, 3), np.int64), np.zeros(2 * (N + 1) * nx)
    m = _list_bounds(lower, upper, rows)
    if _beyond(rows, m, lower, upper, x, room) <= 0.0:
        return 0, True
    return _interior_point(A, B, Q, q, R, lower, upper, give, rows, m, x, u, tolerance)
