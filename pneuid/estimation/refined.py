"""Continuous paths at a fine time step whose derivatives come from a coarser one.

The step's error moves an optimum by many standard errors, because it adds up in the residual; of the derivatives it is a
small share. So the path and the residual are those of the fine step and the slopes along it those of the coarse one, at a
fraction of the cost. The fit settles where the residual is orthogonal to slopes that are off by a small share, which moves
its estimate by about that share of a standard error.
"""

from __future__ import annotations

import numpy as np

from pneuid.cores import threads
from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import Evaluation, Shooting
from pneuid.mapped import Mapped


class Refined(Chained):
    """``base`` with its intervals chained, and the derivatives of ``slopes``, the same problem with fewer substeps."""

    def __init__(self, base: Shooting, slopes: Shooting) -> None:
        super().__init__(base)
        self.slopes = slopes
        self._shown, self._shown_coarsely = (
            Mapped(one.function.trajectory, base.nint, threads()) for one in (base, slopes)
        )

    def evaluate(self, X: np.ndarray) -> Evaluation:
        """End states and residuals of the fine step, sensitivities and Gram blocks with the coarse one's slopes."""
        walked = self.walked(X)
        q = X[: self.nq]
        at = walked.path, self.data, self.base.theta(q)
        (fine, _), (coarse, _) = self._shown(*at), self._shown_coarsely(*at)
        ny = len(self.plant.outputs)
        # measured values moved by the difference: the coarse step's residual to them is the fine step's to the true ones
        data = self.data.copy()
        data[-2 * ny : -ny] += coarse - fine
        return self.linked_up(self.slopes.evaluate_on(self.base.join(q, walked.path), data), walked.end)
