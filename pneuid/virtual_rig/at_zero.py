"""The sensors of a rig at zero: both chambers vented, the force sensor free."""

from __future__ import annotations

import numpy as np

from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.sensors import Array, Sensors, on_grid


def record_zero(
    hidden: Hidden, patm: float, sensors: Sensors, seed: int, seconds: float = 2.0, rate: float = 1000.0
) -> dict[str, Array]:
    """What p1, p2 [Pa absolute] and F [N] show meanwhile, ``(N,)`` each, as sampled at ``rate`` [Hz]."""
    noise = np.random.default_rng((seed, 11)).standard_normal((3, round(seconds * rate)))
    return {
        "p1": on_grid(patm + hidden.sensor_offset_p1 + sensors.p_noise * noise[0], sensors.p_grid),
        "p2": on_grid(patm + hidden.sensor_offset_p2 + sensors.p_noise * noise[1], sensors.p_grid),
        "F": on_grid(hidden.sensor_offset_F + sensors.F_noise * noise[2], sensors.F_grid),
    }
