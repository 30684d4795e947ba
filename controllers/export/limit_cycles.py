"""Where the servo hunts: standstill motion over the compensated share of friction and the loop's gain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from controllers import loop
from controllers.base import Array
from controllers.model_plant import ModelPlant
from controllers.references import Steps
from controllers.registry import FAST
from controllers.servo import Servo
from controllers.tuning import Design, cascade_gains
from pneuid.errors import ComputationError


@dataclass(frozen=True)
class LimitCycleMap:
    """``wander`` (alphas, factors): peak-to-peak motion in m at standstill, NaN where the loop diverged.

    alphas : share of the model's friction that is cancelled; factors : on the tuned bandwidth; friction : share of the
    model's friction that the simulated plant really has.
    """

    alphas: Array
    factors: Array
    friction: float
    wander: Array


def limit_cycle_map(
    servo: Servo, supply: float, alphas: Sequence[float], factors: Sequence[float], friction: float,
    on_point: Callable[[], None] = lambda: None,
) -> LimitCycleMap:  # fmt: skip
    """Play steps and dwells on the identified model for every pair; the servo's gains are put back afterwards.

    The servo learns nothing meanwhile, so that ``alpha`` is what is cancelled. supply : Pa absolute.
    """
    model, tuned = servo.model, servo.gains
    own = tuned.bandwidth / 4.0  # the cascade's, by the pattern of ``cascade_gains``
    plant = ModelPlant(model, friction=friction)
    stroke = model.value("stroke")
    steps = Steps("steps", 0.45 * stroke, 0.8, (0.04 * stroke,), 0.8, 0.4)
    wander = np.full((len(alphas), len(factors)), np.nan)
    for i, alpha in enumerate(alphas):
        for j, factor in enumerate(factors):
            design = Design(supply, alpha=alpha, hold=0.0, learning=0.0, bandwidth=own * factor)
            servo.retune(replace(cascade_gains(model, design, FAST), integral=0.0))
            try:
                wander[i, j] = loop.metrics(loop.run(servo, plant, steps, supply, seed=1)).wander
            except ComputationError:
                wander[i, j] = np.nan
            on_point()
    servo.retune(tuned)
    return LimitCycleMap(np.asarray(alphas), np.asarray(factors), friction, wander)
