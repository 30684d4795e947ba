"""Constant-velocity sections of a bench run, found from x(t) alone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

NOISE_MULTIPLE = 8.0
"""Deviation from a straight line, in 1-sigma of the position, that noise alone does not reach."""

CURVED = 0.01
"""Or, as a share of the travel, that the ripple of a drive does not reach: a speed changing by 8 %."""

LEAST_SAMPLES = 24
LEAST_TRAVEL = 200.0
"""Least travel of a section in 1-sigma of the position: less is not sliding yet."""

DRIFT = 0.03
"""Largest change of speed along a section, as a share of the speed; more is an acceleration."""

TRIMMED = 0.1
"""Share of a section at either end in which it may still hold a piece of a ramp."""

OUTLASTS = 0.5
"""Least duration of a section over that of the unsteady motion beside it: the top of a sine is no stroke."""

MIDDLE = (0.25, 0.75)
"""Part of the travel over which force and pressures are averaged: the drive and the friction have settled by then."""


@dataclass(frozen=True)
class Section:
    """Samples ``first`` to ``last`` (exclusive) at constant speed ``v`` (m/s, signed); ``middle`` is averaged over."""

    first: int
    last: int
    v: float
    middle: slice


def constant_velocity_sections(t: np.ndarray, x: np.ndarray, noise: float) -> list[Section]:
    """Sections in which ``x`` (N,) in m is straight over ``t`` (N,) in s, any spacing, within ``noise`` (m, 1-sigma).

    The record is split where it departs most from the chord of a stretch until every stretch is straight (Ramer,
    Computer Graphics and Image Processing 1 (1972) 244); dwells, accelerations and reversals are dropped.
    """
    stretches = list(pairwise(_corners(t, x, noise)))
    made = [_section(t, x, noise, a, b + 1) for a, b in stretches]
    # a rest is as calm as a stroke; what lies between two calm stretches is a ramp
    still = [b - a >= LEAST_SAMPLES and abs(x[b] - x[a]) <= NOISE_MULTIPLE * noise for a, b in stretches]
    calm = [k for k, section in enumerate(made) if section is not None or still[k]]
    kept = []
    for place, k in enumerate(calm):
        section = made[k]
        if section is None:
            continue
        a, b = stretches[k]
        before = t[a] - t[stretches[calm[place - 1]][1] if place else 0]
        after = t[stretches[calm[place + 1]][0] if place + 1 < len(calm) else t.size - 1] - t[b]
        if t[b] - t[a] >= OUTLASTS * max(before, after):
            kept.append(section)
    return kept


def _corners(t: np.ndarray, x: np.ndarray, noise: float) -> list[int]:
    """Sample numbers between which ``x`` is straight, first and last included."""
    ends = {0, t.size - 1}
    open_stretches = [(0, t.size - 1)]
    while open_stretches:
        a, b = open_stretches.pop()
        if b - a < LEAST_SAMPLES:
            continue
        chord = x[a] + (x[b] - x[a]) * (t[a : b + 1] - t[a]) / (t[b] - t[a])
        away = np.abs(x[a : b + 1] - chord)
        at = int(np.argmax(away))
        if away[at] > max(NOISE_MULTIPLE * noise, CURVED * abs(x[b] - x[a])) and 0 < at < b - a:
            ends.add(a + at)
            open_stretches += [(a, a + at), (a + at, b)]
    return _joined(t, x, noise, sorted(ends))


def _joined(t: np.ndarray, x: np.ndarray, noise: float, corners: list[int]) -> list[int]:
    """Corners without those across which the motion goes straight on: a long stretch may ripple more than a short one."""
    at = 1
    while at < len(corners) - 1:
        whole = slice(corners[at - 1], corners[at + 1] + 1)
        s = t[whole] - t[whole.start]
        line = np.polynomial.Polynomial.fit(s, x[whole], 1)
        away = float(np.max(np.abs(x[whole] - line(s))))
        if away <= max(NOISE_MULTIPLE * noise, CURVED * abs(x[corners[at + 1]] - x[corners[at - 1]])):
            del corners[at]
            at = max(at - 1, 1)
        else:
            at += 1
    return corners


def _section(t: np.ndarray, x: np.ndarray, noise: float, first: int, last: int) -> Section | None:
    """The stretch as a section, None where it is too short, at rest or not of one speed."""
    if last - first < LEAST_SAMPLES or abs(x[last - 1] - x[first]) < LEAST_TRAVEL * noise:
        return None
    duration = t[last - 1] - t[first]
    low, high = np.searchsorted(t, t[first] + np.array(MIDDLE) * duration)
    middle = slice(int(low), max(int(high), int(low) + 2))
    whole = _slope(t, x, middle)
    inner = slice(*(int(k) for k in np.searchsorted(t, t[first] + np.array([TRIMMED, 1.0 - TRIMMED]) * duration)))
    s = (t[inner] - t[first]) / duration
    bend = np.polynomial.polynomial.polyfit(s, x[inner], 2)[2]
    # standard error of the quadratic term over the unit interval: sqrt(180 / n)
    error = noise * np.sqrt(180.0 / s.size)
    if 2.0 * abs(bend) > max(DRIFT * abs(whole) * duration, 8.0 * error):
        return None
    return Section(first, last, whole, middle)


def _slope(t: np.ndarray, x: np.ndarray, part: slice) -> float:
    """Slope of the straight line through a stretch, m/s."""
    s = t[part] - np.mean(t[part])
    return float(s @ x[part] / (s @ s))
