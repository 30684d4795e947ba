"""Parameters whose simulation follows whole runs of a bench best, where no exact fit stands behind the model.

A bench imposes the motion, so that a simulation never goes astray, and what a model leaves need not be excused by jumps. With
those a force that is averaged over 16 ms, named as a lag beside an offset, made sigma1 6100 N s/m where 260 were right and left
4.1 floors of the held-out runs; simulated it left 1.9, with all parameters but that one within a tenth of the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.estimation.chained import Chained
from pneuid.estimation.growing import walked
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import USUAL, Monitor
from pneuid.estimation.stages import Relaxed, finely
from pneuid.estimation.task import values_at
from pneuid.estimation.uncertainty import uncertainty


@dataclass(frozen=True)
class Simulated:
    """values : parameters, SI; cost : half the sum of squares of what their simulation leaves of the runs; starts : states at
    the start of every run, ``ns`` lists of as many numbers as runs, SI; covariance : of the free parameters, ``nq`` lists of
    ``nq`` numbers, SI, as if what is left were noise of its own size.
    """

    values: Mapping[str, float]
    cost: float
    starts: Sequence[Sequence[float]]
    covariance: Sequence[Sequence[float]]


def simulated(problem: Shooting, soft: Relaxed, monitor: Monitor | None) -> Simulated | None:
    """The simulation that follows the runs best, from the relaxed solution; None on a servo rig, or where it diverges.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    if problem.plant.servo or not np.isfinite(soft.outcome.cost + soft.outcome.penalty):
        return None
    fine = finely(problem, soft.outcome.X, problem.substeps)
    path = walked(Chained(fine), soft.outcome.X, monitor, USUAL)
    if not path.success:
        return None
    starts = fine.split(path.X)[1][:, fine.first[:-1]]
    spread, misfit = uncertainty(fine, path.X), 2 * path.cost / max(fine.weighted, 1)
    covariance = max(misfit, 1.0) * spread.correlation * np.outer(spread.std, spread.std)
    return Simulated(values_at(fine, path.X), path.cost, starts.tolist(), covariance.tolist())
