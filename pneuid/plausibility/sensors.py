"""Sanity checks of single channels: a sensor at the end of its range, and a sample rate too low for the friction law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from pneuid.plausibility.finding import Finding
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import to_display

FloatArray = NDArray[np.float64]

_CLIPPED = ("p1", "p2", "v", "F")
"""Signals looked at. u saturates by the controller's intent, psup is constant, x rests at stops and set points."""
_STRETCH = 6
"""Samples of exactly the same extreme value in a row that count as one stretch."""
_BESIDE = 8
"""Samples beside a stretch that show how the signal moves where it is not clipped."""
_STEPS = 3.0
"""Movement beside a stretch, in steps of the sensor's resolution, below which the signal may really rest there."""
_OUTRUN = 0.02
"""Share of a recorded speed by which the position outruns one that is clipped."""
_PRESLIDING = 100e-6
"""Travel after a reversal within which a bristle is strained [m]: twice a usual Fs/sigma0."""
_FEWEST = 4
"""Samples within that travel that a law with pre-sliding needs."""


def clipped_sensor(_rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Stretches where a moving or noisy signal stands still at exactly its largest or smallest value."""
    for run in runs:
        for signal in _CLIPPED:
            if signal not in run.recorded:
                continue
            values = run.signals[signal]
            for extreme, end in ((float(values.max()), "largest"), (float(values.min()), "smallest")):
                stretches = _stretches(values, extreme, run.weights[signal] > 0.0)
                if stretches and (signal != "v" or _outrun(run, extreme, end, stretches)):
                    return _clipped(run, signal, extreme, end, stretches)
    return None


def _stretches(values: FloatArray, extreme: float, measured: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last sample of each stretch at ``extreme`` that the signal reaches in full motion or noise."""
    at = (values == extreme) & measured
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(int)))
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    if not moving.size:
        return []
    resolution = float(moving.min())
    found = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        beside = np.concatenate(
            [steps[max(0, first - _BESIDE) : max(0, first - 1)], steps[after : after + _BESIDE - 1]]
        )
        if after - first >= _STRETCH and beside.size >= 4 and float(np.median(beside)) >= _STEPS * resolution:
            found.append((int(first), int(after) - 1))
    return found


def _outrun(run: Recording, extreme: float, end: str, stretches: list[tuple[int, int]]) -> bool:
    """Whether the position moves faster than a speed that stands at its extreme: a bench may well hold its largest speed."""
    travel = sum(float(run.signals["x"][last] - run.signals["x"][first]) for first, last in stretches)
    speed = travel / sum(float(run.t[last] - run.t[first]) for first, last in stretches)
    beyond = speed - extreme if end == "largest" else extreme - speed
    return beyond > _OUTRUN * abs(extreme)


def _clipped(run: Recording, signal: str, extreme: float, end: str, stretches: list[tuple[int, int]]) -> Finding:
    unit = SIGNALS[signal].display_unit
    size = to_display(extreme, SIGNALS[signal].unit, unit)
    unit += " absolute" if signal in PRESSURES else ""
    samples = sum(last - first + 1 for first, last in stretches)
    first, last = max(stretches, key=lambda one: one[1] - one[0])
    seen = (
        f"{run.name}: {samples} samples in {len(stretches)} stretches stand at exactly the {end} value, {size:.6g} {unit}, "
        f"the longest from {run.t[first]:.4g} to {run.t[last]:.4g} s"
    )
    do = "use a sensor or an input of a larger range, or leave the stretches empty and set [files] gaps = true in rig.toml"
    return Finding("clipped_sensor", signal, seen, "the sensor or its input is at the end of its range", do)


def sample_rate(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Too few samples while the bristles are strained: a law with pre-sliding cannot be seen in these data."""
    if rig.friction not in ("lugre", "dahl"):
        return None
    counts, slowest = [], runs[0]
    for run in runs:
        found = _samples_at_reversals(run, max(_PRESLIDING, 6.0 * rig.noise.get("x", 0.0)))
        if found:
            counts += found
            slowest = run if run.rate < slowest.rate else slowest
    if len(counts) < 3:
        return None
    median = float(np.median(counts))
    if median >= _FEWEST:
        return None
    needed = slowest.rate * 3 * _FEWEST / max(median, 1.0)
    return Finding(
        "sample_rate", "t",
        f"{slowest.rate:.4g} Hz leaves {median:.0f} samples within {_PRESLIDING * 1e6:.0f} um of a reversal "
        f"(median of {len(counts)} reversals; {_FEWEST} or more are needed)",
        f"the sample rate is too low for the pre-sliding of friction = \"{rig.friction}\"",
        f'record at {needed:.2g} Hz or more or add slow reversals, else use friction = "stribeck" or "coulomb"',
    )  # fmt: skip


def _samples_at_reversals(run: Recording, near: float) -> list[int]:
    """Samples in a row within ``near`` [m] of each turning point of x."""
    x = run.signals["x"]
    counts = []
    for side in (x, -x):
        peaks, _ = find_peaks(side, prominence=10.0 * near)
        for peak in peaks:
            away = np.flatnonzero(side < side[peak] - near)
            place = int(np.searchsorted(away, peak))
            before = int(away[place - 1]) if place > 0 else -1
            after = int(away[place]) if place < away.size else x.size
            counts.append(after - before - 1)
    return counts
