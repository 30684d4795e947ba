"""The structured quadratic program against IPOPT and qpOASES, independent solvers, with bounds active and not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_qp import reference

from controllers import qp

N, NX = 8, 4


def problem(seed, bound, soft):
    """A random chain; ``bound`` limits, hard, the last state, which is the command, and softly on demand the first."""
    rng = np.random.default_rng(seed)
    A = np.eye(NX) + 0.1 * rng.standard_normal((N, NX, NX))
    A[:, -1] = 0.0
    A[:, -1, -1] = 1.0
    B = 0.3 * rng.standard_normal((N, NX))
    B[:, -1] = 1.0
    Q, q = rng.uniform(0.0, 2.0, (N + 1, NX)), rng.standard_normal((N + 1, NX))
    lower, upper = np.full((N + 1, NX), -np.inf), np.full((N + 1, NX), np.inf)
    lower[:, -1], upper[:, -1] = -bound, bound
    give = np.zeros(NX)
    if soft:
        upper[:, 0], give[0] = 0.3 * bound, 1e-2
    x0 = 0.2 * rng.standard_normal(NX)
    x0[-1] = 0.0
    return A, B, 0.1 * rng.standard_normal((N, NX)), Q, q, 0.1, lower, upper, give, x0


def oracle(A, B, c, Q, q, R, lower, upper, give, x0):
    """The same program with explicit slacks, by IPOPT; the commands."""
    X, U, S = ca.MX.sym("X", NX, N + 1), ca.MX.sym("U", N), ca.MX.sym("S", NX, N + 1)
    cost, rows, low, high = 0, [X[:, 0] - x0], [np.zeros(NX)], [np.zeros(NX)]
    for i in range(N):
        rows.append(X[:, i + 1] - ca.DM(A[i]) @ X[:, i] - ca.DM(B[i]) * U[i] - c[i])
        low.append(np.zeros(NX))
        high.append(np.zeros(NX))
        cost += 0.5 * R * U[i] ** 2
    for i in range(N + 1):
        cost += 0.5 * ca.dot(ca.DM(Q[i]) * X[:, i], X[:, i]) + ca.dot(ca.DM(q[i]), X[:, i])
        for j in range(NX):
            slack = S[j, i]
            cost += slack**2 / (2.0 * give[j]) if give[j] > 0.0 else slack**2
            if i == 0:
                continue
            if give[j] == 0.0:
                slack = 0.0
            rows += [X[j, i] - slack, X[j, i] + slack]
            low += [[-np.inf], [lower[i, j]]]
            high += [[upper[i, j]], [np.inf]]
    variables = ca.vertcat(ca.vec(X), U, ca.vec(S))
    options = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.tol": 1e-11}
    solver = ca.nlpsol("oracle", "ipopt", {"x": variables, "f": cost, "g": ca.vertcat(*rows)}, options)
    found = solver(x0=0.0, lbg=np.concatenate(low), ubg=np.concatenate(high))
    return found["x"].full().ravel()[(N + 1) * NX : (N + 1) * NX + N]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("bound", [0.1, 0.5, 50.0])
def test_same_commands_as_ipopt(seed, bound, soft):
    given_problem = problem(seed, bound, soft)
    found = qp.solve(*given_problem)
    assert found.solved
    # what IPOPT's own tolerance leaves
    np.testing.assert_allclose(found.u, oracle(*given_problem), atol=1e-6)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
@pytest.mark.parametrize("soft", [False, True])
def test_what_the_interior_point_leaves_is_taken_to_the_last_digit(tolerance, soft):
    """Active sets found by a method that has nothing in common with it; bounds active by a hair are among them."""
    iterations = 0
    for seed in range(40):
        given_problem = problem(seed, 0.05 * (1 + seed % 7), soft)
        found = qp.solve(*given_problem, tolerance)
        iterations += found.iterations
        np.testing.assert_allclose(found.u, reference(qp.Program(*given_problem)), atol=1e-9)
    assert iterations > 100, "bounds are active"


def test_a_program_without_active_bounds_takes_no_iteration():
    assert qp.solve(*problem(0, 1e6, soft=False)).iterations == 0
    assert qp.solve(*problem(0, 0.1, soft=False)).iterations > 0


@given(st.integers(0, 10_000), st.floats(0.05, 2.0), st.booleans())
def test_solutions_satisfy_dynamics_and_hard_bounds(seed, bound, soft):
    A, B, c, Q, q, R, lower, upper, give, x0 = problem(seed, bound, soft)
    found = qp.solve(A, B, c, Q, q, R, lower, upper, give, x0)
    assert found.solved
    after = np.einsum("iab,ib->ia", A, found.x[:-1]) + B * found.u[:, None] + c
    np.testing.assert_allclose(found.x[1:], after, atol=1e-9)
    assert np.all(np.abs(found.x[1:, -1]) <= bound + 1e-6)


def test_what_cannot_be_met_is_reported_and_stays_finite():
    A, B, c, Q, q, R, lower, upper, give, x0 = problem(0, 0.5, soft=False)
    # a hard bound on a state that the command cannot hold there
    lower[1, 1] = 100.0
    found = qp.solve(A, B, c, Q, q, R, lower, upper, give, x0)
    assert not found.solved
