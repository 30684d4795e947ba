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


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the search variables ``q`` ``(nq, nq)``, standard errors in SI and correlations."""

    std: np.ndarray
    correlation: np.ndarray
    at_bound: np.ndarray


def uncertainty(problem: Shooting, X: np.ndarray, margin: float = 1e-4) -> Uncertainty:
    """Gauss-Newton covariance of the free parameters at an exact solution, node states eliminated by continuity.

    The upper left block of the inverse of the Karush-Kuhn-Tucker matrix of the equality-constrained problem;
    Bock, Kostina, Schloeder, GAMM-Mitteilungen 30 (2007) 376, eq. (12). Parameters on a bound are held there.
    """
    q = X[: problem.nq]
    width = np.maximum(problem.scaling.upper - problem.scaling.lower, 1e-12)
    at_bound = (q - problem.scaling.lower < margin * width) | (problem.scaling.upper - q < margin * width)
    H, J = constraint_system(problem, X)
    free = np.concatenate([np.flatnonzero(~at_bound), np.arange(problem.nq, problem.size)])
    H, J = H[free][:, free], J[:, free]
    # continuity is scaled so that both blocks of the matrix are of one size
    weight = float(np.sqrt(H.diagonal().mean()))
    below = sp.hstack([weight * J, sp.csc_matrix((J.shape[0], J.shape[0]))])
    system = sp.csc_matrix(sp.vstack([sp.hstack([H, weight * J.T]), below]))
    count = int((~at_bound).sum())
    right = np.zeros((system.shape[0], count))
    right[:count, :count] = np.eye(count)
    solution = splu(system).solve(right)[:count]
    covariance = np.zeros((problem.nq, problem.nq))
    covariance[np.ix_(~at_bound, ~at_bound)] = 0.5 * (solution + solution.T)
    std_q = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(std_q > 0, std_q, 1.0)
    return Uncertainty(std_q * problem.scaling.slope(q), covariance / np.outer(safe, safe), at_bound)


def verdicts(problem: Shooting, X: np.ndarray, found: Uncertainty) -> list[str]:
    """One of ``well determined``, ``weakly determined``, ``on its bound``, ``not visible`` per free parameter."""
    words = []
    values = problem.scaling.to_values(X[: problem.nq])
    for j, parameter in enumerate(problem.declared):
        std = found.std[j]
        size = max(abs(values[j]), 0.0 if parameter.positive else 0.3 * parameter.scale)
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
