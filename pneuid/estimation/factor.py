"""Factor of the sparse Hessian of a relaxed problem, for steps and covariances of parameters and nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu


@dataclass(frozen=True)
class Factor:
    """Factor of a Hessian ``(n, n)`` whose first ``border`` variables were taken last."""

    lu: SuperLU
    border: int

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution ``(n,)`` or ``(n, m)`` for right sides of the same shape."""
        return np.roll(self.lu.solve(np.roll(right, -self.border, axis=0)), self.border, axis=0)


def factorised(hessian: sp.spmatrix, border: int, ridge: float = 1e-9) -> Factor:
    """Factor of a positive semidefinite ``hessian``, its diagonal raised by the share ``ridge``.

    The pattern is an arrow: a band of nodes bordered by parameters, the first ``border`` variables. With these last and the
    nodes as they follow one another in time nothing but the band and the border fills in. An order sought for that (minimum
    degree) takes a time that grows with the square of a record's length: at 27,000 variables 9 s, the factor itself 0.06 s.
    Raises ``RuntimeError`` where it is singular all the same.
    """
    H = sp.csc_matrix(hessian)
    raised = (H + sp.diags(ridge * H.diagonal() + 1e-3 * ridge)).tocsc()
    order = np.roll(np.arange(H.shape[0]), -border)
    arrow = raised[order][:, order].tocsc()
    return Factor(splu(arrow, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}), border)
