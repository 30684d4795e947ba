"""The predictive controller's quadratic program solved once more: dense, states eliminated, by qpOASES's active sets."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from controllers import qp


def reference(program: qp.Program) -> np.ndarray:
    """Command changes ``(N,)`` of the program; slacks of the soft bounds are variables of their own.

    An active-set method ends on the bounds themselves, where an interior-point method such as IPOPT stays beside those that
    are active by a hair. Raises ``RuntimeError`` where it does not converge.
    """
    A, B, c, Q, q, R, lower, upper, give, x0 = program
    stages, nx = B.shape
    soft = list(np.flatnonzero(give > 0.0))
    # x_i = by[i] u + free[i]
    by, free = np.zeros((stages + 1, nx, stages)), np.zeros((stages + 1, nx))
    free[0] = x0
    for i in range(stages):
        by[i + 1], free[i + 1] = A[i] @ by[i], A[i] @ free[i] + c[i]
        by[i + 1][:, i] += B[i]
    size = stages * (1 + len(soft))
    H, h = np.zeros((size, size)), np.zeros(size)
    H[:stages, :stages] = R * np.eye(stages)
    H[range(stages, size), range(stages, size)] = np.tile([1.0 / give[j] for j in soft], stages)
    rows, low, high = [], [], []
    for i in range(1, stages + 1):
        H[:stages, :stages] += by[i].T @ (Q[i][:, None] * by[i])
        h[:stages] += by[i].T @ (Q[i] * free[i] + q[i])
        for j in range(nx):
            if np.isfinite(lower[i, j]) or np.isfinite(upper[i, j]):
                row = np.zeros(size)
                row[:stages] = by[i, j]
                if j in soft:
                    row[stages + (i - 1) * len(soft) + soft.index(j)] = -1.0
                rows.append(row)
                low.append(lower[i, j] - free[i, j])
                high.append(upper[i, j] - free[i, j])
    found = _solver(size, len(rows))(h=H, g=h, a=np.array(rows), lba=low, uba=high)
    return np.asarray(found["x"]).ravel()[:stages]


@cache
def _solver(size: int, rows: int) -> ca.Function:
    """qpOASES for programs of this shape; it prints its licence whenever one is made."""
    shape = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
    return ca.conic("reference", "qpoases", shape, {"printLevel": "none", "nWSR": 5000})
