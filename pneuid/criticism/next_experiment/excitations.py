"""The library of excitations that the next experiment is chosen from.

Servo rigs: references of position for a controller, with stretches in which the valve is closed and a lower supply
where the excitation asks for one. Bench rigs: motions that the motor imposes, with the pressures held meanwhile. Every
excitation says in a clause what the engineer will see; none knows an effect by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LOWER_SUPPLY = 0.6
"""Second supply level, as a share of the stated gauge pressure: most laws that depend on pressure change by as much."""

SLOW = 5e-3
"""Speed in m/s of slow ramps, in and below the Stribeck range of common seals."""


@dataclass(frozen=True)
class Axis:
    """Where a reference may go: positions ``low`` to ``high`` in m, and ``speed`` in m/s that the drive can reach."""

    low: float
    high: float
    speed: float

    @property
    def middle(self) -> float:
        """Centre of the range, m."""
        return 0.5 * (self.low + self.high)

    @property
    def room(self) -> float:
        """Length of the range, m."""
        return self.high - self.low


def _nowhere(s: Array) -> Array:
    return np.zeros(s.shape, dtype=bool)


def _steady(s: Array) -> Array:
    return np.zeros(s.shape)


@dataclass(frozen=True)
class Excitation:
    """One way to move the axis.

    path : ``(t, axis) -> x`` in m over times ``t`` (N,) in s from 0, for any duration; closed : where the valve is shut,
    and lowered : how far the supply (servo) or the chambers' pressures (bench) have been changed, 0 to 1, both over the
    share of the duration ``(N,)`` in 0..1.
    """

    name: str
    says: str
    path: Callable[[Array, Axis], Array]
    closed: Callable[[Array], NDArray[Any]] = _nowhere
    lowered: Callable[[Array], Array] = _steady


# --- building blocks ---


def _through(s: Array, moments: ArrayLike, places: ArrayLike) -> Array:
    """Straight lines through ``places`` at ``moments``."""
    return np.asarray(np.interp(s, np.asarray(moments, dtype=float), np.asarray(places, dtype=float)))


def _jumps(s: Array, places: ArrayLike, pause: float = 0.5) -> Array:
    """From place to place within a share ``1 - pause`` of each leg, by the smoothest polynomial, then rest."""
    legs = np.asarray(places).size - 1
    leg = np.clip(np.floor(s * legs), 0, legs - 1).astype(int)
    r = np.clip((s * legs - leg) / (1.0 - pause), 0.0, 1.0)
    here, there = np.asarray(places)[leg], np.asarray(places)[leg + 1]
    return np.asarray(here + (there - here) * r**3 * (10.0 - 15.0 * r + 6.0 * r**2))


def _share(t: Array) -> Array:
    return np.asarray(t / max(float(t[-1]), 1e-12))


def _reach(t: Array, axis: Axis, legs: int, wanted: float, fraction: float) -> float:
    """Length of a leg in m: ``wanted`` of the room, unless that takes more than ``fraction`` of the drive's speed."""
    return min(wanted * axis.room, fraction * axis.speed * float(t[-1]) / legs / 1.9)


# --- references ---


def _slow_ramps(t: Array, axis: Axis) -> Array:
    far = min(SLOW * float(t[-1]) / 4.0, 0.3 * axis.room)
    return axis.middle + _through(_share(t), (0, 0.25, 0.5, 0.75, 1), (0, far, 0, -far, 0))


def _break_away(t: Array, axis: Axis) -> Array:
    # rests of 5, 10, 15 and 20 % of the time, each followed by a slow ramp, in alternating direction
    far = min(SLOW * float(t[-1]) / 8.0, 0.2 * axis.room)
    moments = (0, 0.05, 0.175, 0.275, 0.4, 0.55, 0.675, 0.875, 1)
    return axis.middle + _through(_share(t), moments, (0, 0, far, far, 0, 0, -far, -far, 0))


def _speeds(t: Array, axis: Axis) -> Array:
    # out and back at 4, 12 and 36 % of the drive's speed, as far as the time allows
    s, length, x, moment = _share(t), float(t[-1]) / 6.0, [0.0], [0.0]
    for fraction in (0.04, 0.12, 0.36):
        far = min(fraction * axis.speed * length, 0.8 * axis.room)
        x += [far, 0.0]
        moment += [moment[-1] + 1 / 6, moment[-1] + 2 / 6]
    return axis.middle - 0.5 * max(x) + _through(s, moment, x)


def _small_steps(t: Array, axis: Axis) -> Array:
    far = _reach(t, axis, 8, 0.03, 0.2)
    return axis.middle + _jumps(_share(t), np.array((0, 1, 2, 1, 3, 1, 0, -2, 0)) * far, 0.8)


def _large_steps(t: Array, axis: Axis) -> Array:
    far = 0.5 * _reach(t, axis, 4, 0.8, 0.9)
    return axis.middle + _jumps(_share(t), (-far, far, -far, 0.5 * far, -far), 0.35)


def _hold(t: Array, axis: Axis) -> Array:
    far = 0.5 * _reach(t, axis, 4, 0.4, 0.25)
    return axis.middle + _jumps(_share(t), (0, far, -far, far, 0), 0.65)


def _hold_closed(s: Array) -> NDArray[np.bool_]:
    return np.asarray((s * 4.0) % 1.0 > 0.3)


def _reversals(t: Array, axis: Axis) -> Array:
    s = _share(t)
    part, local = np.minimum(np.floor(2.0 * s), 1.0), (2.0 * s) % 1.0
    far = 0.5 * _reach(t, axis, 8, 0.4, 0.3)
    moving = 0.75
    # the second half repeats the first at another pressure; between them the axis rests while the pressure changes
    wave = far * np.sin(4.0 * np.pi * np.clip(local / moving, 0.0, 1.0))
    return np.asarray(axis.middle + np.where((part == 1.0) & (s >= 1.0), 0.0, wave))


def _second_half(s: Array) -> Array:
    return np.clip((s - 0.39) / 0.1, 0.0, 1.0)


def _sweep(t: Array, axis: Axis) -> Array:
    lasts, low, high = float(t[-1]), 0.4, 5.0
    rate = np.log(high / low) / lasts
    angle = 2.0 * np.pi * low * np.expm1(rate * t) / rate
    pulsation = 2.0 * np.pi * low * np.exp(rate * t)
    return np.asarray(axis.middle + np.minimum(0.4 * axis.room, 0.35 * axis.speed / pulsation) * np.sin(angle))


def _ends(t: Array, axis: Axis) -> Array:
    far = 0.04 * axis.room
    near, other = axis.low + far, axis.high - far
    places = (near, near + far, near, near + far, other, other - far, other, other - far)
    half = 0.5 * _reach(t, axis, 7, 1.0, 0.7)
    return np.clip(_jumps(_share(t), places, 0.35), axis.middle - half if half < 0.4 * axis.room else axis.low, axis.high)


def _nested(t: Array, axis: Axis) -> Array:
    far = min(0.5e-3, 0.02 * axis.room)
    return axis.middle + _through(
        _share(t), np.linspace(0, 1, 9), far * np.array((0, 1, -0.2, 0.6, -1, 0.2, -0.6, 1, 0))
    )


def _travel(t: Array, axis: Axis) -> Array:
    far = min(0.96 * axis.room, 0.3 * axis.speed * float(t[-1]) / 2.0)
    return axis.middle - 0.5 * far + _through(_share(t), (0, 0.5, 1), (0, far, 0))


SERVO_LIBRARY: tuple[Excitation, ...] = (
    Excitation("slow ramps", "the axis creeps out and back at about 5 mm/s, in both directions", _slow_ramps),
    Excitation("dwell and break-away", "rests of different length, each ended by a slow ramp", _break_away),
    Excitation("strokes at several speeds", "strokes out and back, each pair three times as fast", _speeds),
    Excitation("small steps", "quick steps of a few per cent of the stroke, with rests", _small_steps),
    Excitation("large steps", "steps over most of the stroke as fast as the drive allows", _large_steps),
    Excitation("closed-valve hold", "the axis is moved, then the valve is shut while pressures are watched", _hold,
               _hold_closed),
    Excitation("reversals at two supply levels",
               "reversals; while the axis rests after 40 % of the time the supply is turned down, then the same again",
               _reversals, lowered=_second_half),
    Excitation("sine sweep", "sines from 0.4 to 5 Hz, smaller as they become faster", _sweep),
    Excitation("ends of the stroke", "short steps near one end, then near the other", _ends),
    Excitation("nested small reversals", "reversals of half a millimetre and less, one within the other", _nested),
    Excitation("whole travel", "one stroke over the whole travel, out and back, at an even speed", _travel),
)  # fmt: skip
"""Excitations of a servo rig; the same valve command for every candidate."""

BENCH_LIBRARY: tuple[Excitation, ...] = (
    *(item for item in SERVO_LIBRARY
      if item.name not in ("closed-valve hold", "reversals at two supply levels", "ends of the stroke")),
    Excitation("reversals at two pressure levels",
               "reversals; while the axis rests after 40 % of the time the chambers' pressures are exchanged, then again",
               _reversals, lowered=_second_half),
)  # fmt: skip
"""Motions of a bench, whose chambers are held at two pressures."""
