"""The factor of an arrow-shaped Hessian solves what a dense solver solves, and does not fill in."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pneuid.estimation.factor import factorised


def _arrow(border: int, blocks: int, size: int) -> sp.csc_matrix:
    """Positive definite: ``border`` parameters, then a band of node blocks each coupled to the next."""
    rng = np.random.default_rng(7)
    n = border + blocks * size
    A = np.zeros((n, n))
    for i in range(blocks - 1):
        at = np.r_[0:border, border + i * size : border + (i + 2) * size]
        J = rng.standard_normal((at.size + 2, at.size))
        A[np.ix_(at, at)] += J.T @ J
    return sp.csc_matrix(A)


def test_the_same_solution_as_a_dense_solver():
    H = _arrow(6, 30, 5)
    b = np.random.default_rng(1).standard_normal((H.shape[0], 3))
    np.testing.assert_allclose(factorised(H, 6).solve(b[:, 0]), np.linalg.solve(H.toarray(), b[:, 0]), rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(factorised(H, 6).solve(b), np.linalg.solve(H.toarray(), b), rtol=1e-5, atol=1e-8)


def test_it_hardly_fills_in():
    H = _arrow(8, 300, 5)
    assert factorised(H, 8).lu.L.nnz < 1.5 * sp.tril(H).nnz


def test_its_time_grows_with_the_record_and_not_with_its_square():
    """By counts, not by the clock: nothing but the band and the border is filled, however long the band."""
    short, long = (factorised(_arrow(4, blocks, 3), 4).lu.L.nnz / blocks for blocks in (50, 400))
    assert long == pytest.approx(short, rel=0.05)


def test_a_direction_that_nothing_sees_is_no_failure():
    H = sp.block_diag([_arrow(3, 4, 2), sp.csc_matrix((1, 1))]).tocsc()
    assert np.all(np.isfinite(factorised(H, 3).solve(np.append(np.ones(H.shape[0] - 1), 0.0))))
