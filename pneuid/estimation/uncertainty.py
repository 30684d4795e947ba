"""Standard errors from the exact fit, and what they say in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import constraint_system

WELL = 0.1
"""Relative standard error (or share of the typical size) below which a parameter is well determined."""

VISIBLE = 0.7
"""Share of the prior's spread above which the data said nothing about a parameter."""


ACTIVE = 1e-4
"""Value of an inequality, in units of its typical size, below which it holds with equality."""

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

    The upper left block of the inverse of the Karush-Kuhn-Tucker matrix of the equality-constrained problem;
    Bock, Kostina, Schloeder, GAMM-Mitteilungen 30 (2007) 376, eq. (12). Parameters on a bound are held there, and
    inequalities that hold with equality count as such.
    """
    q = X[: problem.nq]
    at_bound = problem.scaling.on_bound(q)
    H, J = constraint_system(problem, X)
    covariance = _covariance(problem, H, J, at_bound)
    value, slope = problem.constraints(q)
    active = value < ACTIVE
    if active.any():
        free = covariance
        rows = sp.hstack([sp.csc_matrix(slope[active]), sp.csc_matrix((int(active.sum()), problem.size - problem.nq))])
        covariance = _covariance(problem, H, sp.csc_matrix(sp.vstack([J, rows])), at_bound)
        before, after = np.diag(free), np.diag(covariance)
        at_bound = at_bound | ((before > 0) & (after < HELD**2 * before))
    std_q = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(std_q > 0, std_q, 1.0)
    return Uncertainty(std_q * problem.scaling.slope(q), covariance / np.outer(safe, safe), at_bound)


def _covariance(problem: Shooting, H: sp.csc_matrix, J: sp.csc_matrix, held: np.ndarray) -> np.ndarray:
    """Covariance ``(nq, nq)`` of the search variables under ``J dX = 0``, zero where ``held``."""
    free = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
    H, J = H[free][:, free], J[:, free]
    # the equalities are scaled so that both blocks of the matrix are of one size
    weight = float(np.sqrt(H.diagonal().mean()))
    below = sp.hstack([weight * J, sp.csc_matrix((J.shape[0], J.shape[0]))])
    system = sp.csc_matrix(sp.vstack([sp.hstack([H, weight * J.T]), below]))
    count = int((~held).sum())
    right = np.zeros((system.shape[0], count))
    right[:count, :count] = np.eye(count)
    solution = splu(system).solve(right)[:count]
    covariance = np.zeros((problem.nq, problem.nq))
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
