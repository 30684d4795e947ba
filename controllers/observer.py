"""The observer all model-based controllers share: bristle, chambers and motion one sample ahead.

Between samples the identified plant itself is stepped with the command that acts: the bristle by its exact
exponential at the friction coefficients of the present pressures (`pneuid.step`), effect states likewise. At a
sample the measured pressures and the extended state observer correct it. What leaves is the estimate at the *next*
sample, when the command computed now begins to act.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

from controllers.base import Measurement
from controllers.control_model import EFFECTS, P1, P2, ControlModel, KnownFriction, V, X, Z
from controllers.eso import corrected, correction_gains
from pneuid.plant import Plant
from pneuid.step import substep, substeps_needed

FASTEST = 20.0
"""Speeds beyond it [m/s] are not motions of a cylinder; estimates stop there."""


@dataclass(frozen=True)
class ObserverGains:
    """bandwidth : of the extended state observer, rad/s; pressure_trust : share of a pressure innovation that is
    believed, 0..1; alpha : share of the model's friction that is believed from the start; learning : rate in 1/s at
    which the residual force that looks like friction moves this share, down by at most ``1 - alpha`` and up by at most
    twice that (0: never)."""

    bandwidth: Any
    pressure_trust: Any
    alpha: Any
    learning: Any


def memory_size(model: ControlModel) -> int:
    """Length of the observer's memory: the plant's state, the residual force, the learned share of friction."""
    return model.states + 2


def start_memory(model: ControlModel, measurement: Measurement) -> np.ndarray:
    """The memory at rest where the sensors say; no residual, nothing learned."""
    return np.concatenate([model.rest(measurement.x, measurement.p1, measurement.p2), np.zeros(2)])


def observed(
    model: ControlModel,
    memory: Any,
    measurement: Any,
    applied: Any,
    gains: ObserverGains,
    sample_time: float,
    theta: Any,
) -> Any:
    """Memory (plant state, residual force [N], learned share) at the next sample.

    memory : prediction for this sample; measurement : x, p1, p2, psup as in ``base.Measurement``; applied : the
    command acting now, V. The result is kept in the range a cylinder can reach, whatever the sensors show.
    """
    s, residual, share = memory[: model.states], memory[model.states], memory[model.states + 1]
    psup = measurement[3]
    size = correction_gains(gains.bandwidth, sample_time)
    x, v, residual = corrected(s[X], s[V], residual, measurement[0] - s[X], model.moving_mass(theta), size)
    p1 = s[P1] + gains.pressure_trust * (measurement[1] - s[P1])
    p2 = s[P2] + gains.pressure_trust * (measurement[2] - s[P2])
    s, residual = _limited(model, ca.vertcat(x, v, p1, p2, s[Z:]), residual, psup, theta)
    residual, share = _learned(model, s, residual, share, gains, sample_time, theta)
    # the step needs the plant's evaluation alone
    plant = cast("Plant", KnownFriction(model, gains.alpha + share, residual))
    count = substeps_needed(model.plant, model.theta, sample_time)
    for _ in range(count):
        s = substep(plant, s, ca.vertcat(applied, psup), ca.DM.zeros(2), sample_time / count, theta)
    s, residual = _limited(model, s, residual, psup, theta)
    return ca.vertcat(s, residual, share)


def _learned(
    model: ControlModel, s: Any, residual: Any, share: Any, gains: ObserverGains, sample_time: float, theta: Any
) -> tuple[Any, Any]:
    """Residual and share of friction after one sample; what the share gains the residual loses.

    A residual in proportion to the model's friction turns round with the motion and an integrating observer sees it
    too late. It is learned in sliding only, where friction is near its steady value, and as far above the model's friction
    as ``alpha`` is below it: friction that has grown and may not be learned is left to the residual, which sticks and slips.
    Nothing is learned for a model that is not believed at all (``alpha = 0``).
    """
    stages = model.plant.evaluate(s, [model.neutral, model.named(theta, "patm")], theta)
    force, level = stages.friction, stages.coefficients.Fc
    limit = ca.fmin(gains.alpha, 1.0 - gains.alpha)
    fit = residual * force / (force**2 + level**2)
    sliding = ca.fabs(force) > 0.8 * level
    wanted = share + ca.if_else(sliding, ca.fmin(gains.learning * sample_time, 1.0) * fit, 0.0)
    new = ca.fmin(ca.fmax(wanted, -limit), 2.0 * limit)
    return residual - (new - share) * force, new


def _limited(model: ControlModel, s: Any, residual: Any, psup: Any, theta: Any) -> tuple[Any, Any]:
    """The state and the residual inside what is physically possible."""

    def between(value: Any, low: Any, high: Any) -> Any:
        return ca.fmin(ca.fmax(value, low), high)

    patm, stroke = model.named(theta, "patm"), model.named(theta, "stroke")
    highest = 2.0 * ca.fmax(psup, patm)
    force = highest * ca.fmax(model.named(theta, "A1"), model.named(theta, "A2"))
    parts = [
        between(s[X], -0.01 * stroke, 1.01 * stroke),
        between(s[V], -FASTEST, FASTEST),
        between(s[P1], 0.2 * patm, highest),
        between(s[P2], 0.2 * patm, highest),
        between(s[Z], -stroke, stroke),
    ]
    if model.states > EFFECTS:
        parts.append(s[EFFECTS:])
    return ca.vertcat(*parts), between(residual, -force, force)
