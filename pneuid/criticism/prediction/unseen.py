"""Whole runs of a bench predicted without anything of their own force: what a run does not forget starts as in other runs.

The warmth of a seal that lasts for minutes is one free level of friction per run, if it is read off the run that is predicted:
with it, friction that follows the pressure of each run passes for friction that warms up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import Prediction, free_run
from pneuid.estimation.first_guess import bristle, followed_effects
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run

FORGOTTEN = 1.0
"""Integral of a state's decay over a run below which the run does not forget where the state started."""


def unseen(found: Fit, held: Sequence[Run]) -> list[Prediction]:
    """Each run of ``held`` from its estimated start, but what it does not forget from the mean start of the runs fitted to."""
    model, plant = Frozen.of(found), found.plant
    function, own = model.function(held), slice(plant.explicit_count + 1, None)
    typical = _starts(found)
    predictions = []
    for run in held:
        predicted, start = free_run(model, function, run, run.data)
        if plant.effect_states:
            kept, lasting = start[:, own].copy(), _lasting(model, run)
            start[:, own] = np.where(lasting, typical, kept)
            if np.any(lasting):
                predicted, _ = free_run(model, function, run, run.data, start)
        predictions.append(predicted)
    return predictions


def _starts(found: Fit) -> np.ndarray:
    """Mean over the runs fitted to of the effects' states at their start, ``(ne,)``."""
    problem = found.problem
    if found.simulated is not None:
        starts = np.array(found.simulated.starts)
    else:
        starts = problem.split(found.relaxed.X)[1][:, problem.first[:-1]]
    return np.asarray(starts[found.plant.explicit_count + 1 :].mean(axis=1))


def _lasting(model: Frozen, run: Run) -> np.ndarray:
    """Which of the effects' states a run does not forget, ``(ne,)``."""
    values = dict(model.values)
    _, decay = followed_effects(model.plant, run, run.motion, bristle(model.plant, run, run.motion, values), values)
    return np.asarray(decay @ run.data[0] < FORGOTTEN)
