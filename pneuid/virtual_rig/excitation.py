"""Motions an engineer would command to identify a servo rig, as position references.

Every reference keeps to a fraction of the speed that the valve allows, so that a simple position controller can follow it
on any rig, and all but ``travel`` keep to the middle of the stroke.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LOWEST, HIGHEST = 0.20, 0.80
"""Range of every reference but ``travel`` as fractions of the stroke."""


@dataclass(frozen=True)
class Excitation:
    """A reference and the dither on top of it.

    ``reference(t, stroke, top_speed, rng)`` returns position [m] and speed [m/s], each of the shape
    of ``t`` [s]; ``dither`` is the amplitude of the added random command as a fraction of full scale;
    ``integral`` [1/s] is the rate at which the controller integrates its error.
    """

    name: str
    reference: Callable[[Array, float, float, np.random.Generator], tuple[Array, Array]]
    dither: float
    integral: float = 0.0


def _multisine(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Ten sines from 0.15 to 2 Hz with random phases, falling with frequency."""
    frequency = np.geomspace(0.15, 2.0, 10) * rng.uniform(0.93, 1.07, 10)
    phase = rng.uniform(0.0, 2.0 * np.pi, 10)
    weight = frequency**-0.8
    angle = 2.0 * np.pi * frequency[:, None] * t + phase[:, None]
    shape = weight @ np.sin(angle)
    slope = (2.0 * np.pi * frequency * weight) @ np.cos(angle)
    room = (HIGHEST - LOWEST) * stroke / float(np.ptp(shape))
    scale = min(room, 0.35 * top_speed / float(np.max(np.abs(slope))))
    middle = 0.5 * (float(np.max(shape)) + float(np.min(shape)))
    return 0.5 * (LOWEST + HIGHEST) * stroke + scale * (shape - middle), scale * slope


def _steps(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Minimum-jerk moves, long and short in turn, with dwells of 0.15 to 0.4 s."""
    position = np.empty_like(t)
    speed = np.zeros_like(t)
    low, high = LOWEST * stroke, HIGHEST * stroke
    here, clock, long_move = float(rng.uniform(low, high)), 0.0, True
    position[:] = here
    while clock < t[-1]:
        reach = rng.uniform(0.25, 0.60) * stroke if long_move else rng.uniform(0.01, 0.06) * stroke
        there = here + reach if rng.random() < 0.5 else here - reach
        if not low <= there <= high:
            there = 2.0 * here - there
        there = float(np.clip(there, low, high))
        peak = rng.uniform(0.08, 0.50) * top_speed
        lasts = max(1.875 * abs(there - here) / peak, 0.06)
        s = np.clip((t - clock) / lasts, 0.0, 1.0)
        moving = t >= clock
        position[moving] = here + (there - here) * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[moving]
        speed[moving] = (there - here) / lasts * (30.0 * s**2 * (1.0 - s) ** 2)[moving]
        clock += lasts + rng.uniform(0.15, 0.40)
        here, long_move = there, not long_move
    return position, speed


def _slow(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Ramps of 1 to 20 mm/s up and down with short dwells, where the rig may stick and slip."""
    speed = np.zeros_like(t)
    clock, sign = 0.05, float(rng.choice((-1.0, 1.0)))
    while clock < t[-1]:
        lasts = rng.uniform(0.6, 1.4)
        speed[(t >= clock) & (t < clock + lasts)] = sign * min(
            10.0 ** rng.uniform(-3.0, np.log10(0.02)), 0.1 * top_speed
        )
        clock += lasts + rng.uniform(0.05, 0.25)
        sign = -sign if rng.random() < 0.6 else sign
    travel = np.concatenate(([0.0], np.cumsum(np.diff(t) * speed[:-1])))
    room = (HIGHEST - LOWEST) * stroke
    scale = min(1.0, room / max(float(np.ptp(travel)), 1e-12))
    free = room - scale * float(np.ptp(travel))
    start = LOWEST * stroke + free * rng.uniform(0.0, 1.0) - scale * float(np.min(travel))
    return start + scale * travel, scale * speed


def _sine(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """One sine of 0.5 to 1 Hz over up to half of the stroke."""
    rate = 2.0 * np.pi * rng.uniform(0.5, 1.0)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    amplitude = min(rng.uniform(0.15, 0.25) * stroke, 0.35 * top_speed / rate)
    centre = rng.uniform(0.46, 0.54) * stroke
    return centre + amplitude * np.sin(rate * t + phase), amplitude * rate * np.cos(rate * t + phase)


def _travel(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Minimum-jerk moves anywhere in the stroke, every other one to just before an end, with rests of 0.05 to 2 s."""
    position, speed = np.empty_like(t), np.zeros_like(t)
    low, high = 0.01 * stroke, 0.99 * stroke
    here, clock, to_end = float(rng.uniform(0.3, 0.7)) * stroke, 0.0, False
    position[:] = here
    while clock < t[-1]:
        there = (low if rng.random() < 0.5 else high) if to_end else float(rng.uniform(low, high))
        if abs(there - here) < 0.05 * stroke:
            there = 0.5 * stroke
        lasts = max(1.875 * abs(there - here) / (10.0 ** rng.uniform(-0.9, -0.25) * top_speed), 0.08)
        s = np.clip((t - clock) / lasts, 0.0, 1.0)
        moving = t >= clock
        position[moving] = here + (there - here) * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[moving]
        speed[moving] = (there - here) / lasts * (30.0 * s**2 * (1.0 - s) ** 2)[moving]
        clock += lasts + 10.0 ** rng.uniform(np.log10(0.05), np.log10(2.0))
        here, to_end = there, not to_end
    return position, speed


def _chirp(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sine that sweeps from 0.2 to some 4 Hz, its logarithm at a steady rate, the slower the wider."""
    low, high = 0.2, rng.uniform(3.0, 5.0)
    growth = np.log(high / low) / t[-1]
    rate = 2.0 * np.pi * low * np.exp(growth * t)
    angle = rate / growth + rng.uniform(0.0, 2.0 * np.pi)
    width = np.minimum(rng.uniform(0.15, 0.28) * stroke, 0.35 * top_speed / rate)
    position = 0.5 * (LOWEST + HIGHEST) * stroke + width * np.sin(angle)
    return position, np.gradient(position, t)


def _stairs(t: Array, stroke: float, top_speed: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Jumps of the reference, up to a quarter of the stroke, each held for 0.3 to 0.9 s: the valve opens at once."""
    position, clock = np.empty_like(t), 0.0
    here = rng.uniform(LOWEST, HIGHEST)
    while clock < t[-1]:
        position[t >= clock] = here * stroke
        step = min(0.8, top_speed / stroke) * rng.uniform(0.03, 0.33) * rng.choice((-1.0, 1.0))
        here = here + step if LOWEST <= here + step <= HIGHEST else here - step
        clock += rng.uniform(0.3, 0.9)
    return position, np.zeros_like(t)


EXCITATIONS: dict[str, Excitation] = {
    item.name: item
    for item in (
        Excitation("multisine", _multisine, dither=0.03),
        Excitation("steps", _steps, dither=0.01),
        Excitation("slow", _slow, dither=0.002, integral=3.0),
        Excitation("sine", _sine, dither=0.02),
        Excitation("travel", _travel, dither=0.01),
        Excitation("chirp", _chirp, dither=0.01),
        Excitation("stairs", _stairs, dither=0.01),
    )
}
"""The excitations by name."""


def dither(t: Array, amplitude: float, rng: np.random.Generator) -> Array:
    """Random corner values every 25 ms joined by straight lines; ``amplitude`` and result [V]."""
    corners = np.arange(t[0], t[-1] + 0.05, 0.025)
    return np.interp(t, corners, amplitude * rng.uniform(-1.0, 1.0, corners.size))
