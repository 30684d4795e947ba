"""The sparse Gauss-Newton system of a shooting problem, put together from the blocks of its intervals."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import scipy.sparse as sp

from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import Evaluation, Shooting

PATTERNS = 4
"""Patterns that are kept: those of a relaxed, a chained and an exact problem, which one fit after the other needs again."""


class Pattern:
    """Which entries of Hessian and Jacobian are not zero, and where the blocks of intervals go among them.

    linked : intervals whose end meets the next node; known : variables with a prior; ncon : inequalities among parameters.
    """

    def __init__(
        self, nq: int, ns: int, nint: int, ncon: int, linked: np.ndarray, known: np.ndarray, relaxed: bool
    ) -> None:
        width, size = nq + ns, nq + ns * nint
        node = nq + ns * np.arange(nint)
        local = np.concatenate([np.tile(np.arange(nq), (nint, 1)), node[:, None] + np.arange(ns)], axis=1)
        cols, rows = np.tril_indices(width)
        self.triangle = (rows, cols)
        parameter_pair = cols < nq
        self.shared, self.own = np.flatnonzero(parameter_pair), np.flatnonzero(~parameter_pair)
        row_parts = [rows[self.shared], local[:, rows[self.own]].ravel()]
        col_parts = [cols[self.shared], local[:, cols[self.own]].ravel()]
        self.following = node[linked + 1][:, None] + np.arange(ns)
        if relaxed:
            row_parts += [np.repeat(local[linked], ns, axis=1).ravel(), self.following.ravel()]
            col_parts += [np.tile(self.following, (1, width)).ravel(), self.following.ravel()]
        row_parts.append(known)
        col_parts.append(known)
        self.hess_slots, self.hess_sparsity = _slots(row_parts, col_parts, size, size)
        self.hess_diagonal = np.asarray(self.hess_sparsity.colind()[1:]) - 1
        # Jacobian: continuity rows (exact stage only), then the parameter inequalities (dense in q)
        self.ncon, self.ndef = ncon, 0 if relaxed else linked.size * ns
        row_parts, col_parts = [], []
        if not relaxed:
            defect = np.arange(self.ndef).reshape(-1, ns)
            row_parts += [np.repeat(defect, width, axis=1).ravel(), defect.ravel()]
            col_parts += [np.tile(local[linked], (1, ns)).ravel(), self.following.ravel()]
        row_parts.append(np.repeat(self.ndef + np.arange(ncon), nq))
        col_parts.append(np.tile(np.arange(nq), ncon))
        self.jac_slots, self.jac_sparsity = _slots(row_parts, col_parts, self.ndef + ncon, size)


@lru_cache(PATTERNS)
def _pattern(nq: int, ns: int, nint: int, ncon: int, linked: bytes, known: bytes, relaxed: bool) -> Pattern:
    return Pattern(nq, ns, nint, ncon, np.frombuffer(linked, dtype=int), np.frombuffer(known, dtype=int), relaxed)


class Assembly:
    """Hessian and Jacobian of one problem in their sparse pattern, filled from the blocks of an evaluation."""

    def __init__(self, problem: Shooting, relaxed: bool) -> None:
        self.problem, self.relaxed = problem, relaxed
        known, *_ = problem.priors
        self.pattern = _pattern(
            problem.nq, problem.ns, problem.nint, problem.ncon, problem.linked.tobytes(), known.tobytes(), relaxed
        )

    def gradient_and_hessian(self, at: Evaluation, X: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Dense gradient and Hessian nonzeros of ``scale * (cost + relaxed penalty + priors)``."""
        problem = self.problem
        nq, _ns, width = problem.nq, problem.ns, problem.nq + problem.ns
        pattern = self.pattern
        rows, cols = pattern.triangle
        blocks = at.gram[:, :width, :width]
        slope = at.gram[:, :width, width]
        gradient = np.zeros(problem.size)
        pieces: list[np.ndarray] = []
        if self.relaxed:
            weight = 1.0 / problem.relaxation
            defect = problem.defects(at.end, X) * weight
            S = at.sensitivity[problem.linked] * weight
            blocks = blocks.copy()
            blocks[problem.linked] += S.transpose(0, 2, 1) @ S
            slope = slope.copy()
            slope[problem.linked] += np.einsum("iks,ik->is", S, defect)
            cross = -S.transpose(0, 2, 1) * weight
            pieces = [cross.ravel(), np.full(pattern.following.size, weight**2)]
            gradient[pattern.following] -= weight * defect
        gradient[:nq] += slope[:, :nq].sum(axis=0)
        gradient[nq:] += slope[:, nq:].ravel()
        triangle = blocks[:, rows, cols]
        pieces = [triangle[:, pattern.shared].sum(axis=0), triangle[:, pattern.own].ravel(), *pieces]
        index, _, inverse = problem.priors
        np.add.at(gradient, index, problem.prior_residual(X) * inverse)
        pieces.append(inverse**2)
        values = np.bincount(pattern.hess_slots, weights=np.concatenate(pieces), minlength=pattern.hess_sparsity.nnz())
        return scale * gradient, scale * values

    def jacobian(self, at: Evaluation, slope: np.ndarray) -> np.ndarray:
        """Nonzeros of the constraint Jacobian; ``slope`` ``(nc, nq)`` is that of the inequalities."""
        pattern, pieces = self.pattern, []
        if not self.relaxed:
            pieces += [at.sensitivity[self.problem.linked].ravel(), np.full(pattern.ndef, -1.0)]
        values = np.concatenate([*pieces, slope.ravel()])
        return np.bincount(pattern.jac_slots, weights=values, minlength=pattern.jac_sparsity.nnz())

    def hessian_matrix(self, values: np.ndarray) -> sp.csc_matrix:
        """The full symmetric matrix from upper-triangle nonzeros."""
        n = self.problem.size
        sparsity = self.pattern.hess_sparsity
        upper = sp.csc_matrix((values, sparsity.row(), sparsity.colind()), shape=(n, n))
        return (upper + sp.triu(upper, 1).T).tocsc()

    def jacobian_matrix(self, values: np.ndarray) -> sp.csc_matrix:
        """The sparse constraint Jacobian from its nonzeros."""
        sparsity = self.pattern.jac_sparsity
        return sp.csc_matrix((values, sparsity.row(), sparsity.colind()), shape=sparsity.shape)


def _slots(row_parts: list, col_parts: list, nrow: int, ncol: int) -> tuple[np.ndarray, ca.Sparsity]:
    """Where each contribution lands among the nonzeros, and the CCS sparsity."""
    rows, cols = np.concatenate(row_parts).astype(np.int64), np.concatenate(col_parts).astype(np.int64)
    keys, slots = np.unique(cols * max(nrow, 1) + rows, return_inverse=True)
    colind = np.searchsorted(keys // max(nrow, 1), np.arange(ncol + 1))
    sparsity = ca.Sparsity(nrow, ncol, colind.tolist(), (keys % max(nrow, 1)).tolist())
    return slots, sparsity


def window_hessian(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """Gauss-Newton Hessian (unscaled, priors included) of the cost by ``q`` and the state at the start of every stretch.

    ``X`` is continuous, so what happens at the nodes between follows from those by the chain rule.
    """
    whole = Chained(problem)
    at = problem.evaluate(X)
    joined = whole.linked_up(at, at.end[:, whole.starts + whole.lengths - 1])
    assembly = Assembly(whole, relaxed=True)
    _, hessian = assembly.gradient_and_hessian(joined, whole.from_base(X), 1.0)
    return assembly.hessian_matrix(hessian).toarray()


def relaxed_system(problem: Shooting, X: np.ndarray) -> tuple[np.ndarray, sp.csc_matrix]:
    """Gradient and Gauss-Newton Hessian (unscaled) of the relaxed cost at ``X``."""
    assembly = Assembly(problem, relaxed=True)
    gradient, hessian = assembly.gradient_and_hessian(problem.evaluate(X), X, 1.0)
    return gradient, assembly.hessian_matrix(hessian)
