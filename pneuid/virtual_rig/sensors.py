"""What the instruments make of the true signals: noise, then the converter's grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensors:
    """One-sigma noise and grid of each signal, SI (x [m], pressures [Pa], F [N], u [V]); zero = ideal."""

    x_noise: float = 20e-6
    x_grid: float = 5e-6
    p_noise: float = 500.0
    p_grid: float = 20.0
    F_noise: float = 0.2
    F_grid: float = 0.01
    u_grid: float = 1e-4

    def __post_init__(self) -> None:
        if min(vars(self).values()) < 0.0:
            raise ValueError(f"noise and grid must not be negative, got {self}")


SERVO_SENSORS = Sensors()
"""Identification data: 20 um on x, 0.5 kPa on the pressures."""

CONTROL_SENSORS = Sensors(x_noise=2e-6, x_grid=1e-6)
"""A good encoder for closed-loop studies."""

BENCH_SENSORS = Sensors(x_noise=0.3e-6, x_grid=0.1e-6)
"""The 2011 bench: grating and laser."""

IDEAL_SENSORS = Sensors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""No noise and no grid, for noise-free references."""


def on_grid(values: Array, grid: float) -> Array:
    """``values`` rounded to multiples of ``grid``; unchanged when the grid is zero."""
    return values if grid == 0.0 else grid * np.rint(values / grid)


RECORDED_ONLY = ("sensor_lag_p1", "sensor_lag_p2", "channel_skew", "sensor_gain_drift", "encoder_bow", "solenoid_crosstalk")
"""Hidden effects of sensors that act in recordings only, because they need the signal's past or the record's clock."""


def delayed(values: Array, samples: float) -> Array:
    """``values`` some ``samples``, not necessarily whole, ago; the first value before the start."""
    if samples == 0.0:
        return values
    k = np.arange(values.size, dtype=np.float64)
    return np.interp(k - samples, k, values)


def averaged(values: Array, samples: float, times: int = 2) -> Array:
    """Running averages in a row, ``times`` of one length, so that what comes out is ``samples`` old on the mean."""
    if samples == 0.0:
        return values
    k = np.arange(values.size, dtype=np.float64)
    length = 2.0 * samples / times
    for _ in range(times):
        # exact for straight lines between samples; before the start the signal is held
        area = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))))
        ago = k - length
        whole = np.floor(np.maximum(ago, 0.0)).astype(np.int64)
        part = np.maximum(ago, 0.0) - whole
        after = values[np.minimum(whole + 1, values.size - 1)]
        then = area[whole] + part * (values[whole] + 0.5 * part * (after - values[whole]))
        values = (area - then - np.minimum(ago, 0.0) * values[0]) / length
    return values
