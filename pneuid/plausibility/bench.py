"""Sanity checks of a friction bench: friction takes work, and the pressures push with their areas.

At a steady speed the driving force is ``F = friction * sign(v) - (p1-patm)*A1 + (p2-patm)*A2 + weight``. Half the sum of F in
the two directions shows the pressures, half the difference the friction, whatever the friction law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.plausibility.finding import Finding
from pneuid.plausibility.units import factors_into
from pneuid.recording import Recording
from pneuid.rig import Rig

_GRAVITY = 9.80665
_PARTS = 400
"""Windows that a run is cut into to tell its directions; much longer than the sensor's noise needs."""
_LEAST_PRESSURE = 0.3e5
"""A slip must shift the force by at least this pressure on the larger area [Pa] to be told from weight, spring or offset."""


@dataclass(frozen=True)
class Level:
    """One run at a steady pressure: half the sum and half the difference of F in the two directions [N], medians."""

    middle: float
    friction: float
    scatter: float
    p1: float
    p2: float


def _levels(rig: Rig, runs: Sequence[Recording]) -> list[Level]:
    """The runs of a bench that move in both directions."""
    found = []
    for run in runs if rig.kind == "bench" else ():
        step = max(1, run.n // _PARTS)
        x, force = run.signals["x"][::step], run.signals["F"]
        mean = np.add.reduceat(force, np.arange(0, run.n, step)) / np.diff([*range(0, run.n, step), run.n])
        travel = np.diff(x)
        there, back = travel > 0.3 * np.max(np.abs(travel)), travel < -0.3 * np.max(np.abs(travel))
        if min(there.sum(), back.sum()) < 5:
            continue
        out, home = mean[:-1][there], mean[:-1][back]
        scatter = float(np.mean([np.median(np.abs(side - np.median(side))) for side in (out, home)]))
        middle, half = 0.5 * float(np.median(out) + np.median(home)), 0.5 * float(np.median(out) - np.median(home))
        p1, p2 = (float(np.median(run.signals[name])) for name in ("p1", "p2"))
        found.append(Level(middle, half, scatter, p1, p2))
    return found


def _expected(rig: Rig, p1: float, p2: float) -> float:
    """Mean driving force over both directions [N]."""
    return -(p1 - rig.patm) * rig.A1 + (p2 - rig.patm) * rig.A2 + rig.mass * _GRAVITY * float(np.sin(rig.incline))


def reversed_force(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """F the wrong way round: the rig seems to be driven by its friction, and the pressures seem to pull."""
    return _backwards(rig, runs, force=True)


def reversed_bench_position(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """x the wrong way round: the rig seems to be driven by its friction, while the pressures push as they should."""
    return _backwards(rig, runs, force=False)


def _backwards(rig: Rig, runs: Sequence[Recording], force: bool) -> Finding | None:
    levels = _levels(rig, runs)
    if not levels or any(level.friction > -1.5 * level.scatter for level in levels):
        return None
    expected = np.array([_expected(rig, level.p1, level.p2) for level in levels])
    middle = np.array([level.middle for level in levels])
    told = float(np.max(np.abs(expected))) > _LEAST_PRESSURE * max(rig.A1, rig.A2) and max(rig.A1, rig.A2) > 0.0
    turned = bool(np.sum((middle + expected) ** 2) < np.sum((middle - expected) ** 2))
    # without pressures to tell by, the force is the usual one
    if force != (turned or not told):
        return None
    friction = float(np.mean([level.friction for level in levels]))
    seen = (
        f"F is {-2 * friction:.3g} N smaller when x grows than when it falls, so that friction would drive the motion"
    )
    either = "" if told else ", or that of x"
    slip = f"the sign of {'F' if force else 'x'} is reversed{either}"
    do = f'F > 0 pushes towards +x, x grows as the rod extends; give {"F" if force else "x"} gain = "-1" in [columns]'
    return Finding("reversed_force" if force else "reversed_bench_position", "F" if force else "x", seen, slip, do)


def bench_chambers(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """p1 and p2 exchanged: the mean force fits the pressures the other way round."""
    levels = _upright(rig, runs)
    if not levels or rig.A2 == 0.0:
        return None
    seen = _fits_better(rig, levels, lambda level: _expected(rig, level.p2, level.p1), "p1 and p2 exchanged")
    do = "p1 belongs to the cap side; exchange the columns in [columns] in rig.toml"
    return None if seen is None else Finding("bench_chambers", "p1, p2", seen, "p1 and p2 are swapped", do)


def bench_reference(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Gauge taken for absolute or the reverse: below ambient where no regulator goes, or one atmosphere in the mean force."""
    levels = _upright(rig, runs)
    recorded = {name for run in runs for name in run.recorded}
    named = [name for name in ("p1", "p2") if name in recorded]
    if not levels or not named:
        return None
    gauge = rig.pressure_convention == "gauge"
    told, meant, change = ("gauge", "abs", -rig.patm) if gauge else ("abs", "gauge", rig.patm)
    lowest = min(getattr(level, name) for level in levels for name in named)
    seen: str | None
    if not gauge and lowest < 0.7 * rig.patm:
        seen = f"a chamber is held at {lowest / 1e3:.4g} kPa absolute, which no regulator does"
    else:
        shift = [change if name in named else 0.0 for name in ("p1", "p2")]
        seen = _fits_better(
            rig, levels, lambda level: _expected(rig, level.p1 + shift[0], level.p2 + shift[1]),
            f"pressures {change / 1e3:+.1f} kPa",
        )  # fmt: skip
    do = f'compare a vented chamber with ambient, then set [conventions] pressure = "{meant}" or an offset in [columns]'
    slip = f"{meant} pressures declared as {told}"
    return None if seen is None else Finding("bench_reference", ", ".join(named), seen, slip, do)


def bench_unit(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Pressures in another unit than stated: the mean force is several times too large or too small for them."""
    levels = _upright(rig, runs)
    if not levels:
        return None
    weight = _expected(rig, rig.patm, rig.patm)
    pushed = np.array([_expected(rig, level.p1, level.p2) - weight for level in levels])
    middle = np.array([level.middle - weight for level in levels])
    ratio = float(middle @ pushed / (pushed @ pushed)) if np.any(pushed) else 0.0
    names = factors_into(1.0 / ratio, 0.85, 1.18) if ratio > 0.0 and not 0.2 < ratio < 5.0 else ""
    if not names:
        return None
    seen = _fits_better(
        rig, levels, lambda level: ratio * (_expected(rig, level.p1, level.p2) - weight) + weight,
        f"them times {ratio:.3g}",
    )  # fmt: skip
    do = "compare the units of p1, p2 and F in the header and in [columns] with the sensors' data sheets"
    slip = f"the unit of p1 and p2, or that of F, is wrong ({names})"
    return None if seen is None else Finding("bench_unit", "p1, p2", seen, slip, do)


def _upright(rig: Rig, runs: Sequence[Recording]) -> list[Level]:
    """The runs where friction takes work; empty where one gives work, since then signs come first."""
    levels = _levels(rig, runs)
    return levels if all(level.friction > 0.0 for level in levels) else []


def _fits_better(rig: Rig, levels: Sequence[Level], other: Callable[[Level], float], words: str) -> str | None:
    """What was seen where the mean force fits ``other`` and not the pressures as recorded."""
    middle = np.array([level.middle for level in levels])
    now = np.array([_expected(rig, level.p1, level.p2) for level in levels])
    then = np.array([other(level) for level in levels])
    shift = float(np.sqrt(np.mean((then - now) ** 2)))
    friction = float(np.mean([level.friction for level in levels]))
    if shift < max(_LEAST_PRESSURE * max(rig.A1, rig.A2), friction):
        return None
    off_now, off_then = (float(np.sqrt(np.mean((middle - value) ** 2))) for value in (now, then))
    if off_then > 0.25 * shift or off_now < 0.75 * shift:
        return None
    misses = f"the mean of F over both directions misses the pressures' force by {off_now:.3g} N"
    return f"{misses}; with {words} by {off_then:.3g} N"
