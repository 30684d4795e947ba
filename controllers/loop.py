"""The closed loop: a controller on a plant that is stepped and measured, and what counts in the result.

The plant is anything with ``reset(x0, supply)``, ``step(u, dt)``, ``measure(rng)`` and ``array``: the virtual rig's
``ServoPlant``, or the identified model itself (`model_plant`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from controllers.base import Array, Controller, Measurement
from controllers.references import Reference


class Stepped(Protocol):
    """A plant in a loop; SI, absolute pressures."""

    def reset(self, x0: float, supply: float | None = None) -> None:
        """At rest at ``x0`` [m] under a regulated supply pressure [Pa]."""

    def step(self, u: float, dt: float) -> None:
        """``dt`` seconds under the held command ``u`` [V]."""

    def measure(self, rng: np.random.Generator | None = None) -> dict[str, float]:
        """x, p1, p2 as the sensors see them."""

    @property
    def array(self) -> Array:
        """The true state; the position comes first."""


@dataclass(frozen=True)
class Run:
    """Signals of one closed loop, one row per sample: ``t`` [s], ``reference`` (samples, 4), true ``x`` [m], ``u`` [V]
    as applied from that sample on; ``step_seconds`` is what each controller step cost."""

    t: Array
    reference: Array
    x: Array
    u: Array
    step_seconds: Array = field(repr=False)

    @property
    def error(self) -> Array:
        """Reference minus true position, m."""
        return self.reference[:, 0] - self.x


@dataclass(frozen=True)
class Metrics:
    """What a run is judged by.

    rms, peak : tracking error, m; steady : mean absolute error in dwells, m; worst_steady : largest of a dwell's mean
    errors, m; wander : largest peak-to-peak motion in a dwell, m (NaN without a dwell); travel : valve movement, V/s;
    step_median, step_99 : seconds per controller step.
    """

    rms: float
    peak: float
    steady: float
    worst_steady: float
    wander: float
    travel: float
    step_median: float
    step_99: float


SETTLING = 0.3
"""Seconds after a move ends before its dwell counts."""


def run(
    controller: Controller,
    plant: Stepped,
    reference: Reference,
    supply: float,
    seed: int | None = 0,
) -> Run:
    """One closed loop over ``reference.duration``, from rest at its start.

    supply : Pa absolute, given to the plant and, as its supply sensor, to the controller; seed : of the sensors'
    noise, None for ideal sensors.
    """
    T = controller.sample_time
    count = round(reference.duration / T)
    track = reference.samples(T * np.arange(count + controller.preview + 1, dtype=np.float64))
    rng = None if seed is None else np.random.default_rng(seed)
    plant.reset(float(track[0, 0]), supply)
    x, u, cost = np.empty(count), np.empty(count), np.empty(count)
    controller.reset(Measurement(**plant.measure(rng), psup=supply), track[: controller.preview])
    for k in range(count):
        x[k], u[k] = plant.array[0], controller.applied
        seen = Measurement(**plant.measure(rng), psup=supply)
        began = time.perf_counter()
        controller.step(seen, track[k : k + controller.preview])
        cost[k] = time.perf_counter() - began
        plant.step(u[k], T)
    return Run(T * np.arange(count, dtype=np.float64), track[:count], x, u, cost)


def metrics(run: Run) -> Metrics:
    """Judge a run."""
    error = run.error
    T = run.t[1] - run.t[0]
    dwells = _dwells(run.reference, round(SETTLING / T))
    means = [float(np.mean(error[part])) for part in dwells]
    return Metrics(
        rms=float(np.sqrt(np.mean(error**2))),
        peak=float(np.max(np.abs(error))),
        steady=float(np.mean(np.abs(np.concatenate([error[part] for part in dwells])))) if dwells else np.nan,
        worst_steady=max(map(abs, means)) if dwells else np.nan,
        wander=max(float(np.ptp(run.x[part])) for part in dwells) if dwells else np.nan,
        travel=float(np.sum(np.abs(np.diff(run.u))) / run.t[-1]),
        step_median=float(np.median(run.step_seconds)),
        step_99=float(np.quantile(run.step_seconds, 0.99)),
    )


def _dwells(reference: Array, settling: int) -> list[slice]:
    """Stretches in which the reference stands still for longer than the settling time, without that time."""
    still = np.concatenate([[False], (reference[:, 1] == 0.0) & (reference[:, 2] == 0.0), [False]])
    begins, ends = np.flatnonzero(~still[:-1] & still[1:]), np.flatnonzero(still[:-1] & ~still[1:])
    return [slice(a + settling, b) for a, b in zip(begins, ends, strict=True) if b - a > 2 * settling]
