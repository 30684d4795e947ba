"""The predictive controller's quadratic program solved once more, by IPOPT and without its structure."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controllers import qp


def reference(program: qp.Program) -> np.ndarray:
    """Command changes ``(N,)`` of the program, states eliminated and slacks explicit, by IPOPT at its tightest."""
    A, B, c, Q, q, R, lower, upper, give, x0 = program
    stages, nx = B.shape
    soft = np.flatnonzero(give > 0.0)
    # commands and slacks of stage i, with bounds on x_i+1 written as rows of the next state
    variables, rows, low, high, cost = [], [], [], [], 0
    x = ca.DM(x0)
    for i in range(stages):
        u, slack = ca.SX.sym(f"u{i}"), ca.SX.sym(f"s{i}", soft.size)
        x = ca.DM(A[i]) @ x + ca.DM(B[i]) * u + c[i]
        variables += [u, slack]
        cost += 0.5 * R * u**2 + 0.5 * ca.dot(ca.DM(Q[i + 1]) * x, x) + ca.dot(ca.DM(q[i + 1]), x)
        cost += sum(slack[k] ** 2 / (2.0 * give[j]) for k, j in enumerate(soft))
        for j in range(nx):
            if np.isfinite(lower[i + 1, j]) or np.isfinite(upper[i + 1, j]):
                crossing = slack[int(np.flatnonzero(soft == j)[0])] if j in soft else 0.0
                rows.append(x[j] - crossing)
                low.append(lower[i + 1, j])
                high.append(upper[i + 1, j])
    z = ca.vertcat(*variables)
    options = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.tol": 1e-14}
    # bounds are not to be relaxed, and an active one is to be met to the last digit: it ends where rounding stops it
    options |= {"ipopt.bound_relax_factor": 0.0, "ipopt.compl_inf_tol": 1e-15}
    options |= {"ipopt.acceptable_iter": 0, "ipopt.max_iter": 100}
    found = ca.nlpsol("reference", "ipopt", {"x": z, "f": cost, "g": ca.vertcat(*rows)}, options)(lbg=low, ubg=high)
    return np.asarray(found["x"]).ravel()[:: 1 + soft.size]
