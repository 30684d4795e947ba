"""Banded algebra of Whittaker's smoother: measurements against a derivative that is small or random.

``y = f + noise`` with noise of spread one and ``D f`` of a variance per row leads to ``(1 + D' D / variance) f = y``
(Whittaker, Proc. Edinburgh Math. Soc. 41 (1922) 63). A row of ``D`` stands at its own sample and those that follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

Array = NDArray[np.float64]


def differences(s: Array, order: int) -> Array:
    """Rows (N - order, order + 1): the weights with which neighbours at ``s`` (N,), of any spacing, give the derivative of
    that order."""
    rows = s.size - order
    weights = np.full((rows, order + 1), float(np.prod(np.arange(1, order + 1))))
    for j in range(order + 1):
        for k in range(order + 1):
            if k != j:
                weights[:, j] /= s[j : rows + j] - s[k : rows + k]
    return weights


def times(D: Array, y: Array) -> Array:
    """``D y`` (rows,) for ``D`` (rows, width) and ``y`` (N,)."""
    return np.asarray(sum(D[:, j] * y[j : j + len(D)] for j in range(D.shape[1])))


def transposed(D: Array, weights: Array) -> Array:
    """``D' weights`` (N,) for ``weights`` (rows,)."""
    found = np.zeros(len(D) + D.shape[1] - 1)
    for j in range(D.shape[1]):
        found[j : j + len(D)] += D[:, j] * weights
    return found


def factor(counts: Array, parts: Sequence[tuple[Array, Array]]) -> tuple[Array, bool]:
    """Cholesky factor of ``diag(counts) + sum D' diag(weights) D`` over ``parts`` (D, weights), as ``cho_solve_banded`` takes
    it; counts (N,) are 1 for a measurement, 0 where there is none."""
    width = max(D.shape[1] for D, _ in parts)
    band = np.zeros((width, counts.size))
    band[-1] = counts
    for D, weights in parts:
        for i in range(D.shape[1]):
            for j in range(i, D.shape[1]):
                band[width - 1 + i - j, j : j + len(D)] += D[:, i] * D[:, j] * weights
    return cholesky_banded(band), False
