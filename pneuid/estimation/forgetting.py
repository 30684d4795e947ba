"""How much of what an effect remembers is new after one interval: what drifts slowly may jump but little."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pneuid.estimation.first_guess import bristle, followed_effects
from pneuid.estimation.preparation import Run
from pneuid.plant import Plant

LEAST = 1e-3
"""Share that is taken for new at least: that of what lasts for hours."""


def renewed(plant: Plant, runs: Sequence[Run], interval: float) -> np.ndarray:
    """Share ``(ne,)`` of the spread of each effect's state that is new after ``interval`` s, from 0 to 1.

    A first-order state driven by white noise, of rate ``r``, keeps its spread if each step adds the share
    ``sqrt(1 - exp(-2 r T))`` of it. Gillespie, Physical Review E 54 (1996) 2084, eq. (1.9b). The rate is the mean along the
    measured motion, with the parameters where they are declared to start.
    """
    if not plant.effect_states:
        return np.zeros(0)
    rates = np.mean([_rates(plant, run) for run in runs], axis=0)
    share = np.sqrt(-np.expm1(-2.0 * rates * interval))
    # a state too fast for the sampling runs away, rate and all; one that nothing moves keeps a scale that can be divided by
    return np.clip(np.nan_to_num(share, nan=1.0), LEAST, 1.0)


@lru_cache(maxsize=16)
def _rates(plant: Plant, run: Run) -> np.ndarray:
    """Mean rates ``(ne,)`` at which the states forget along one run, 1/s; one fit asks for them several times."""
    values = plant.starts()
    return np.asarray(followed_effects(plant, run, run.motion, bristle(plant, run, run.motion, values), values)[1].mean(axis=1))
