"""The sparse Gauss-Newton system of a shooting problem, put together from the blocks of its intervals."""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp

from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import Evaluation, Shooting


class Assembly:
    """Sparse structure of Hessian and Jacobian, computed once, filled from the blocks of an evaluation."""

    def __init__(self, problem: Shooting, relaxed: bool) -> None:
        self.problem, self.relaxed = problem, relaxed
        nq, ns, nint = problem.nq, problem.ns, problem.nint
        width = nq + ns
        node = nq + ns * np.arange(nint)
        local = np.concatenate([np.tile(np.arange(nq), (nint, 1)), node[:, None] + np.arange(ns)], axis=1)
        cols, rows = np.tril_indices(width)
        self.triangle = (rows, cols)
        parameter_pair = cols < nq
        self.shared, self.own = np.flatnonzero(parameter_pair), np.flatnonzero(~parameter_pair)
        row_parts = [rows[self.shared], local[:, rows[self.own]].ravel()]
        col_parts = [cols[self.shared], local[:, cols[self.own]].ravel()]
        self.linked, self.local = problem.linked, local
        following = node[self.linked + 1][:, None] + np.arange(ns)
        if relaxed:
            row_parts += [np.repeat(local[self.linked], ns, axis=1).ravel(), following.ravel()]
            col_parts += [np.tile(following, (1, width)).ravel(), following.ravel()]
        index = problem.priors[0]
        row_parts.append(index)
        col_parts.append(index)
        self.hess_slots, self.hess_sparsity = _slots(row_parts, col_parts, problem.size, problem.size)
        self.following = following
        self.hess_diagonal = np.asarray(self.hess_sparsity.colind()[1:]) - 1
        # Jacobian: continuity rows (exact stage only), then the parameter inequalities (dense in q)
        self.ncon = problem.constraints(problem.scaling.to_q(self._starts()))[0].size
        self.ndef = 0 if relaxed else self.linked.size * ns
        row_parts, col_parts = [], []
        if not relaxed:
            defect = np.arange(self.ndef).reshape(-1, ns)
            row_parts += [np.repeat(defect, width, axis=1).ravel(), defect.ravel()]
            col_parts += [np.tile(local[self.linked], (1, ns)).ravel(), following.ravel()]
        row_parts.append(np.repeat(self.ndef + np.arange(self.ncon), nq))
        col_parts.append(np.tile(np.arange(nq), self.ncon))
        self.jac_slots, self.jac_sparsity = _slots(row_parts, col_parts, self.ndef + self.ncon, problem.size)

    def _starts(self) -> np.ndarray:
        return np.array([parameter.start for parameter in self.problem.declared])

    def gradient_and_hessian(self, at: Evaluation, X: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Dense gradient and Hessian nonzeros of ``scale * (cost + relaxed penalty + priors)``."""
        problem = self.problem
        nq, _ns, width = problem.nq, problem.ns, problem.nq + problem.ns
        rows, cols = self.triangle
        blocks = at.gram[:, :width, :width]
        slope = at.gram[:, :width, width]
        gradient = np.zeros(problem.size)
        pieces: list[np.ndarray] = []
        if self.relaxed:
            weight = 1.0 / problem.relaxation
            defect = problem.defects(at.end, X) * weight
            S = at.sensitivity[self.linked] * weight
            blocks = blocks.copy()
            blocks[self.linked] += S.transpose(0, 2, 1) @ S
            slope = slope.copy()
            slope[self.linked] += np.einsum("iks,ik->is", S, defect)
            cross = -S.transpose(0, 2, 1) * weight
            pieces = [cross.ravel(), np.full(self.following.size, weight**2)]
            gradient[self.following] -= weight * defect
        gradient[:nq] += slope[:, :nq].sum(axis=0)
        gradient[nq:] += slope[:, nq:].ravel()
        triangle = blocks[:, rows, cols]
        pieces = [triangle[:, self.shared].sum(axis=0), triangle[:, self.own].ravel(), *pieces]
        index, _, inverse = problem.priors
        np.add.at(gradient, index, problem.prior_residual(X) * inverse)
        pieces.append(inverse**2)
        values = np.bincount(self.hess_slots, weights=np.concatenate(pieces), minlength=self.hess_sparsity.nnz())
        return scale * gradient, scale * values

    def jacobian(self, at: Evaluation, X: np.ndarray) -> np.ndarray:
        """Nonzeros of the constraint Jacobian."""
        pieces = []
        if not self.relaxed:
            pieces += [at.sensitivity[self.linked].ravel(), np.full(self.ndef, -1.0)]
        _, slope = self.problem.constraints(X[: self.problem.nq])
        pieces.append(slope.ravel())
        values = np.concatenate(pieces)
        return np.bincount(self.jac_slots, weights=values, minlength=self.jac_sparsity.nnz())

    def hessian_matrix(self, values: np.ndarray) -> sp.csc_matrix:
        """The full symmetric matrix from upper-triangle nonzeros."""
        n = self.problem.size
        upper = sp.csc_matrix((values, self.hess_sparsity.row(), self.hess_sparsity.colind()), shape=(n, n))
        return (upper + sp.triu(upper, 1).T).tocsc()

    def jacobian_matrix(self, values: np.ndarray) -> sp.csc_matrix:
        """The sparse constraint Jacobian from its nonzeros."""
        shape = (self.ndef + self.ncon, self.problem.size)
        return sp.csc_matrix((values, self.jac_sparsity.row(), self.jac_sparsity.colind()), shape=shape)


def _slots(row_parts: list, col_parts: list, nrow: int, ncol: int) -> tuple[np.ndarray, ca.Sparsity]:
    """Where each contribution lands among the nonzeros, and the CCS sparsity."""
    rows, cols = np.concatenate(row_parts).astype(np.int64), np.concatenate(col_parts).astype(np.int64)
    keys, slots = np.unique(cols * max(nrow, 1) + rows, return_inverse=True)
    colind = np.searchsorted(keys // max(nrow, 1), np.arange(ncol + 1))
    sparsity = ca.Sparsity(nrow, ncol, [int(i) for i in colind], [int(i) for i in keys % max(nrow, 1)])
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
