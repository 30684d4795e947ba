"""Standard errors from the exact fit, and what they say in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneuid.estimation.assembly import window_hessian
from pneuid.estimation.shooting import Shooting

WELL = 0.1
"""Relative standard error (or share of the typical size) below which a parameter is well determined."""

VISIBLE = 0.7
"""Share of the prior's spread above which the data said nothing about a parameter."""


ACTIVE = 1e-4
"""Value of an inequality, in units of its typical size, below which it holds with equality."""

NOTHING = 1e-14
"""Share of a parameter's own information that counts as none."""

HELD = 0.5
"""Share of its own standard error below which an active inequality, not the data, fixes a parameter."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors in SI ``(nq,)``, correlations ``(nq, nq)``, and which parameters a bound or an inequality fixes."""

    std: np.ndarray
    correlation: np.ndarray
    at_bound: np.ndarray


def uncertainty(problem: Shooting, X: np.ndarray) -> Uncertainty:
    """Gauss-Newton covariance of the free parameters at an exact solution, node states eliminated by continuity.

    The upper left block of the inverse of the Karush-Kuhn-Tucker matrix of the equality-constrained problem, condensed by
    continuity to the parameters and the first states; Bock, Kostina, Schloeder, GAMM-Mitteilungen 30 (2007) 376, eq. (12).
    Parameters on a bound are held there, and inequalities that hold with equality count as such.
    """
    q = X[: problem.nq]
    at_bound = problem.scaling.on_bound(q)
    H = window_hessian(problem, X)
    value, slope = problem.constraints(q)
    active = value < ACTIVE
    covariance = _covariance(H, slope[:0], at_bound)
    if active.any():
        before = np.diag(covariance)
        covariance = _covariance(H, slope[active], at_bound)
        at_bound = at_bound | ((before > 0) & (np.diag(covariance) < HELD**2 * before))
    std_q = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(std_q > 0, std_q, 1.0)
    return Uncertainty(std_q * problem.scaling.slope(q), covariance / np.outer(safe, safe), at_bound)


def _covariance(H: np.ndarray, rows: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Covariance ``(nq, nq)`` of the search variables, zero where ``held``, under constraints with ``rows`` ``(m, nq)``."""
    nq, m = held.size, rows.shape[0]
    free = np.concatenate([np.flatnonzero(~held), np.arange(nq, H.shape[0])])
    count, n = int((~held).sum()), free.size
    # all in units of the diagonal, so that position and stiffness are of one size
    diagonal = np.diag(H)[free]
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    # what nothing sees, and a constraint among what is held, must not make the matrix singular
    system = np.diag(np.append(np.full(n, NOTHING), np.full(m, -NOTHING)))
    system[:n, :n] += H[np.ix_(free, free)] / np.outer(size, size)
    wide = np.zeros((m, n))
    wide[:, :count] = rows[:, ~held] / size[:count]
    wide /= np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-300)
    system[n:, :n], system[:n, n:] = wide, wide.T
    right = np.eye(n + m)[:, :count]
    solution = np.linalg.solve(system, right)[:count] / np.outer(size[:count], size[:count])
    covariance = np.zeros((nq, nq))
    covariance[np.ix_(~held, ~held)] = 0.5 * (solution + solution.T)
    return covariance


def verdicts(problem: Shooting, X: np.ndarray, found: Uncertainty) -> list[str]:
    """One of ``well determined``, ``weakly determined``, ``on its bound``, ``not visible`` per free parameter."""
    words = []
    values = problem.scaling.to_values(X[: problem.nq])
    for j, parameter in enumerate(problem.declared):
        std = found.std[j]
        size = abs(values[j])
        if not parameter.positive:
            # what can only vary within narrow bounds is known before any data: a share of that range is what counts
            size = min(max(size, 0.3 * parameter.scale), 0.25 * (parameter.upper - parameter.lower))
        spread = np.inf if parameter.prior is None else parameter.prior * (values[j] if parameter.positive else 1.0)
        if found.at_bound[j]:
            words.append("on its bound")
        elif std > VISIBLE * spread or std > 2.0 * size:
            words.append("not visible")
        elif std <= WELL * size:
            words.append("well determined")
        else:
            words.append("weakly determined")
    return words
