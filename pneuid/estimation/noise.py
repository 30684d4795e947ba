"""Sensor noise, from the rig file or from the data's own roughness."""

from __future__ import annotations

import numpy as np

_THIRD_DIFFERENCE = np.sqrt(20.0)
"""Standard deviation of the third difference of white noise of standard deviation one (1, 3, 3, 1)."""


def noise_from_roughness(y: np.ndarray) -> float:
    """1-sigma of the white noise on a smooth signal ``y`` (N,), in the unit of ``y``.

    Median absolute third difference, so that steps and stick-slip do not count; not less than the rounding of the
    record. Source: Hall, Kay, Titterington, Biometrika 77 (1990) 521 (difference-based variance).
    """
    if y.size < 8:
        return 0.0
    third = y[3:] - 3 * y[2:-1] + 3 * y[1:-2] - y[:-3]
    # where most differences are zero the record is coarser than its noise: rounding is what is left
    spread = float(np.median(np.abs(third))) / 0.6745 / _THIRD_DIFFERENCE
    return max(spread, _grid(y) / np.sqrt(12.0))


def _grid(y: np.ndarray) -> float:
    """Step of the converter when every value is a multiple of one, else 0."""
    gaps = np.diff(np.unique(y))
    if gaps.size == 0:
        return 0.0
    # values closer than rounding of the file are one value
    gaps = gaps[gaps > 1e-3 * float(np.median(gaps))]
    step = float(gaps.min())
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if float(off.max()) < 0.02 else 0.0


def sensor_noise(declared: dict[str, float], measured: dict[str, list[np.ndarray]]) -> dict[str, float]:
    """1-sigma per signal (SI): the declared value, else the median over runs of the roughness estimate."""
    found = {}
    for name, runs in measured.items():
        if name in declared:
            found[name] = declared[name]
        else:
            found[name] = float(np.median([noise_from_roughness(run) for run in runs]))
    return found
