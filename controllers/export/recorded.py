"""Closed loops on the identified model, recorded: what an export is checked against, here and on the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.base import Array, Controller, Measurement
from controllers.control_model import ControlModel
from controllers.loop import Stepped
from controllers.references import Smooth, Steps


@dataclass(frozen=True)
class Recorded:
    """A loop: ``t`` (samples,) s; ``seen`` (samples, 4) as ``Measurement``; ``target`` (samples + preview - 1, 4);
    ``u`` (samples,) V, the command computed at each sample."""

    t: Array
    seen: Array
    target: Array
    u: Array

    def csv(self) -> str:
        """The recording as the harness reads it; every number reads back exactly."""
        rows = [
            "t [s],x [m],p1 [Pa],p2 [Pa],psup [Pa],position [m],velocity [m/s],acceleration [m/s^2],jerk [m/s^3],u [V]"
        ]
        interval, missing = self.t[1] - self.t[0], [float("nan")] * 4
        for k, target in enumerate(self.target):
            inside = k < self.t.size
            known = [*self.seen[k], *target, self.u[k]] if inside else [*missing, *target, float("nan")]
            rows.append(",".join(repr(float(value)) for value in (k * interval, *known)))
        return "\n".join(rows) + "\n"


def hard_track(model: ControlModel, sample_time: float, seconds: float, preview: int, lasts: float = 0.0) -> Array:
    """A reference ``(samples + preview, 4)`` that keeps every part of a controller busy.

    A random track over a tenth of the stroke, then, half-way, an eighth of the stroke in ``lasts`` seconds: a jump that
    no axis can follow where that is zero, so that the valve reaches its limits. Not for the predictive controller: on a
    jump one iteration per sample does not settle, and a rounding grows to volts within a few samples.
    """
    stroke = model.value("stroke")
    count = round(seconds / sample_time)
    t = sample_time * np.arange(count + preview, dtype=np.float64)
    middle, reach = 0.5 * stroke, 0.125 * stroke
    track = Smooth("random", middle, 0.5 * seconds, 0.05 * stroke, 3.0, 0.05, seed=11).samples(t)
    late = t >= 0.5 * seconds
    if lasts > 0.0:
        move = Steps("move", middle, lasts, (reach,), lasts, 1e3, shortest=lasts)
        track[late] = move.samples(t[late] - 0.5 * seconds)
    else:
        track[late] = np.array([middle + reach, 0.0, 0.0, 0.0])
    return track


def record(
    controller: Controller,
    plant: Stepped,
    track: Array,
    supply: float,
    seed: int | None = 0,
    samples: int | None = None,
) -> Recorded:
    """One closed loop along ``track`` ``(samples + preview, 4)``, the supply in Pa absolute."""
    count = track.shape[0] - controller.preview if samples is None else samples
    rng = None if seed is None else np.random.default_rng(seed)
    T = controller.sample_time
    plant.reset(float(track[0, 0]), supply)
    seen, u = np.empty((count, 4)), np.empty(count)
    for k in range(count):
        now = Measurement(**plant.measure(rng), psup=supply)
        if k == 0:
            controller.reset(now, track[: controller.preview])
        acting = controller.applied
        seen[k] = now
        u[k] = controller.step(now, track[k : k + controller.preview])
        plant.step(acting, T)
    return Recorded(T * np.arange(count, dtype=np.float64), seen, track[: count + controller.preview - 1], u)
