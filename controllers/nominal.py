"""The virtual rig as its own builder would model it: exact numbers in the estimator's structure.

Studies without an identified model use it, to show what a controller reaches when identification is perfect.
"""

from __future__ import annotations

import numpy as np

from pneuid.effects import effects_by_name
from pneuid.plant import Plant
from pneuid.rig import Rig
from pneuid.virtual_rig.truth import TruthServo

_SLOPES = {
    "k1": "Fc_ps", "k2": "Fc_dp", "k3": "Fs_ps", "k4": "Fs_dp", "k5": "vs_ps", "k6": "vs_dp", "k7": "sigma2_ps",
    "k8": "sigma2_dp",
}  # fmt: skip


def rig_of(truth: TruthServo) -> Rig:
    """The rig file that states the virtual rig's data sheet."""
    return Rig.from_dict(
        {
            "kind": "servo",
            "conventions": {"pressure": "gauge"},
            "cylinder": {
                "bore": f"{truth.bore!r} m", "rod_1": f"{truth.rod_1!r} m", "rod_2": f"{truth.rod_2!r} m",
                "stroke": f"{truth.stroke!r} m", "dead_volume_1": f"{truth.dead_volume_1!r} m^3",
                "dead_volume_2": f"{truth.dead_volume_2!r} m^3",
            },
            "load": {"mass": f"{truth.mass!r} kg", "incline": f"{truth.incline!r} rad"},
            "valve": {
                "conductance": f"{truth.conductance!r} m^3/(s*Pa)", "critical_ratio": truth.critical_ratio,
                "full_scale": f"{truth.full_scale!r} V", "null": f"{truth.null!r} V",
            },
            "supply": {"pressure": f"{truth.supply - truth.patm!r} Pa"},
            "ambient": {"pressure": f"{truth.patm!r} Pa", "temperature": f"{truth.temperature!r} K"},
        },
        where="virtual rig",
    )  # fmt: skip


HIGHEST_GAUGE = 8.5e5
"""Highest chamber pressure, Pa gauge, that the laws are taken to hold for: a 7 bar supply and what compression adds."""

MARGIN = 0.1
"""Share of the stroke at either end that recordings leave out."""


def _ranges(truth: TruthServo) -> dict[str, float]:
    """Pressures [Pa, absolute] and positions [m] as recordings of this rig would cover; they also decide the time step."""
    ranges = {f"{name}_low": truth.patm for name in ("p1", "p2")}
    ranges |= {f"{name}_high": truth.patm + HIGHEST_GAUGE for name in ("p1", "p2")}
    return ranges | {"x_low": MARGIN * truth.stroke, "x_high": (1.0 - MARGIN) * truth.stroke}


def nominal_model(truth: TruthServo, frozen_at: float | None = None) -> tuple[Plant, np.ndarray]:
    """Plant and theta with the virtual rig's own numbers.

    frozen_at : None for the pressure laws as they are, else the supply pressure (Pa, absolute) at which friction was
    found and taken to be constant: both chambers at 60 % of it (gauge).
    """
    seal = truth.friction
    values = {"n": truth.polytropic, "C": truth.conductance, "sigma0": seal.sigma0, "sigma1": seal.sigma1}
    values |= {name: getattr(seal, name) for name in ("Fc", "Fs", "vs", "sigma2")}
    pressure = any(getattr(seal, slope) != 0.0 for slope in _SLOPES.values())
    if pressure and frozen_at is not None:
        level = 0.6 * (frozen_at - truth.patm)
        for name in ("Fc", "Fs", "vs", "sigma2"):
            values[name] += getattr(seal, f"{name}_ps") * level
    lawful = pressure and frozen_at is None
    plant = Plant(rig_of(truth), "lugre", effects_by_name(["friction_pressure"] if lawful else []))
    if lawful:
        values |= {name: getattr(seal, slope) for name, slope in _SLOPES.items()}
    return plant, plant.theta(values, _ranges(truth))
