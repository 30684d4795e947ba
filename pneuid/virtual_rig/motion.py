"""Motions that the servo motor of a friction bench imposes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STUDY_SPEEDS = (0.0004, 0.0006, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.1, 0.15)
"""Steady speeds [m/s] that cover the range of the 2011 study."""


@dataclass(frozen=True)
class Motion:
    """An imposed motion: t [s], uniformly sampled, x [m], v [m/s], a [m/s^2], all of one shape."""

    t: Array
    x: Array
    v: Array
    a: Array


def strokes(
    speeds: Sequence[float] = STUDY_SPEEDS,
    start: float = 0.15,
    travel: float = 0.2,
    longest: float = 1.0,
    dwell: float = 0.1,
    acceleration: float = 2.0,
    rate: float = 1000.0,
) -> Motion:
    """For each speed [m/s] one stroke out and one back, with dwells [s] between them.

    A stroke covers ``travel`` [m] unless that takes more than ``longest`` [s]; speeds are reached
    through half a cosine at a mean ``acceleration`` [m/s^2], in not less than 20 ms.
    """
    pieces = [(0.0, dwell, 0.0)]
    for speed in speeds:
        ramp = max(speed / acceleration, 0.02)
        hold = max(min(travel / speed, longest) - ramp, 0.0)
        pieces += [(speed, hold, ramp), (0.0, dwell, 0.0), (-speed, hold, ramp), (0.0, dwell, 0.0)]
    return _pieced(pieces, start, rate)


def reciprocation(
    amplitude: float = 1.5e-3,
    speed: float = 0.5e-3,
    cycles: int = 2,
    start: float = 0.25,
    turning: float = 0.01,
    rate: float = 2000.0,
) -> Motion:
    """To and fro by ``amplitude`` [m] about ``start`` [m] at a steady ``speed`` [m/s], for pre-sliding.

    Every reversal takes ``turning`` [s].
    """
    quarter = amplitude / speed
    pieces = [(speed, quarter - turning, turning)]
    for cycle in range(cycles):
        last = quarter if cycle == cycles - 1 else 2.0 * quarter
        pieces += [(-speed, 2.0 * quarter - turning, turning), (speed, last - turning, turning)]
    return _pieced([(0.0, 0.05, 0.0), *pieces, (0.0, 0.05, 0.0)], start, rate)


def sine(
    amplitude: float = 0.03, frequency: float = 0.5, cycles: int = 4, start: float = 0.25, rate: float = 1000.0
) -> Motion:
    """A sine of ``amplitude`` [m] and ``frequency`` [Hz] about ``start`` [m], from one end of it."""
    t = np.arange(round(cycles / frequency * rate)) / rate
    w = 2.0 * np.pi * frequency
    x = start - amplitude * np.cos(w * t)
    return Motion(t, x, amplitude * w * np.sin(w * t), amplitude * w * w * np.cos(w * t))


MOTIONS: dict[str, Callable[[], Motion]] = {"strokes": strokes, "reciprocation": reciprocation, "sine": sine}
"""The bench's motions by name, with their default settings."""


def _pieced(pieces: Sequence[tuple[float, float, float]], start: float, rate: float) -> Motion:
    """Join (speed, hold time, ramp time) pieces; each piece ramps up, holds and ramps down to rest."""
    moments, speeds, gains, lengths = [], [], [], []
    clock = 0.0
    for speed, hold, ramp in pieces:
        for before, after, lasts in ((0.0, speed, ramp), (speed, speed, hold), (speed, 0.0, ramp)):
            if lasts > 0.0:
                moments.append(clock)
                speeds.append(before)
                gains.append(after - before)
                lengths.append(lasts)
                clock += lasts
    begin, base, gain, length = (np.array(values) for values in (moments, speeds, gains, lengths))
    t = np.arange(int(np.floor(clock * rate)) + 1) / rate
    index = np.clip(np.searchsorted(begin, t, side="right") - 1, 0, begin.size - 1)
    reached = start + np.concatenate(([0.0], np.cumsum((base + 0.5 * gain) * length)))
    s = np.clip((t - begin[index]) / length[index], 0.0, 1.0)
    v = base[index] + 0.5 * gain[index] * (1.0 - np.cos(np.pi * s))
    x = reached[index] + length[index] * (base[index] * s + 0.5 * gain[index] * (s - np.sin(np.pi * s) / np.pi))
    return Motion(t, x, v, 0.5 * np.pi * gain[index] / length[index] * np.sin(np.pi * s))
