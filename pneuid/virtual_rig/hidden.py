"""What a rig has beyond its base model, in forms unlike those of the estimator's catalogue.

Each effect has one amplitude; zero means exactly absent. The other fields are shapes, which do
nothing while their amplitude is zero. Names are those of the catalogue.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace


@dataclass(frozen=True)
class Hidden:
    """Amplitudes and shapes of hidden effects; all amplitudes default to absent.

    friction_pressure
        Relative growth of seal friction with chamber pressure, neutral at ``pressure_reference``
        [Pa gauge] in both chambers. Cap side to the power 0.85, rod side saturating (tanh over
        ``pressure_saturation`` [Pa]); Fs grows more than Fc, vs falls, sigma2 grows half as much.
    friction_direction
        Relative asymmetry of the whole friction force, read from the bristle and not from v.
    friction_position
        Relative height of a Gaussian patch at ``bump_at`` of ``bump_width`` (fractions of the stroke),
        a smaller dip behind it and a slight taper.
    gravity
        Total constant load against extension [N]: ``gravity_incline_share`` of it by inclining the
        rig, the rest by a spring balancer that pulls, within 3 %, with constant force.
    load_mass
        Payload [kg] on rollers, which adds ``rolling_coefficient`` of its weight to Fc and Fs.
    leakage_internal, leakage_external_1, leakage_external_2
        Sonic conductance of a sharp-edged leak (ISO 6358, ``leak_critical_ratio``) as a fraction of the valve's.
    valve_dead_zone
        Overlap as a fraction of full scale; the four edges differ by up to 10 % and open quadratically.
    supply_droop
        Valve conductance over that of the restriction between the regulator and a ``supply_tank``
        [m^3] in front of the valve; the regulator does not relieve.
    valve_lag
        Spool time constant [s], with a slew limit of half the full scale per time constant.
    valve_offset
        Spool shift as a fraction of full scale.
    valve_asymmetry
        Relative surplus of the opening towards chamber 1, and lack towards chamber 2.
    friction_viscous_nonlinear
        Relative increase of sigma2 at 0.5 m/s, growing with the root of the speed.
    heat_transfer
        Wall conductance [W/K] at mid-stroke and 4 bar; replaces the polytropic chambers by energy
        balances with gas temperatures (gamma 1.4), the wall growing with the chamber.
    load_spring
        Stiffness [N/m] of a slightly hardening spring centred at mid-stroke.
    sensor_offset_p1, sensor_offset_p2
        Added to the recorded pressure [Pa]; ``sensor_offset_F`` [N] to the recorded force.
    """

    friction_pressure: float = 0.0
    friction_direction: float = 0.0
    friction_position: float = 0.0
    gravity: float = 0.0
    load_mass: float = 0.0
    leakage_internal: float = 0.0
    valve_dead_zone: float = 0.0
    supply_droop: float = 0.0
    valve_lag: float = 0.0
    valve_offset: float = 0.0
    valve_asymmetry: float = 0.0
    leakage_external_1: float = 0.0
    leakage_external_2: float = 0.0
    friction_viscous_nonlinear: float = 0.0
    heat_transfer: float = 0.0
    load_spring: float = 0.0
    sensor_offset_p1: float = 0.0
    sensor_offset_p2: float = 0.0
    sensor_offset_F: float = 0.0

    pressure_reference: float = 3.0e5
    pressure_saturation: float = 6.0e5
    bump_at: float = 0.42
    bump_width: float = 0.07
    taper: float = 0.3
    gravity_incline_share: float = 0.6
    rolling_coefficient: float = 0.008
    leak_critical_ratio: float = 0.25
    supply_tank: float = 0.4e-3

    def __post_init__(self) -> None:
        for name in ("load_mass", "leakage_internal", "valve_dead_zone", "supply_droop", "valve_lag",
                     "leakage_external_1", "leakage_external_2", "heat_transfer", "load_spring"):  # fmt: skip
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        for item in fields(self):
            if not math.isfinite(getattr(self, item.name)):
                raise ValueError(f"{item.name} must be finite, got {getattr(self, item.name)}")

    def also(self, other: Hidden) -> Hidden:
        """Both sets of effects at once: the amplitudes and shapes in which ``other`` differs from absent win."""
        nothing = Hidden()
        changed = {
            item.name: getattr(other, item.name)
            for item in fields(other)
            if getattr(other, item.name) != getattr(nothing, item.name)
        }
        return replace(self, **changed)


NOTHING = Hidden()
"""A rig that is exactly its base model."""

HIDDEN_EFFECTS: dict[str, dict[str, Hidden]] = {
    name: {"weak": Hidden(**{name: weak}), "strong": Hidden(**{name: strong})}
    for name, weak, strong in (
        ("friction_pressure", 0.28, 0.85),
        ("friction_direction", 0.07, 0.20),
        ("friction_position", 0.17, 0.50),
        ("gravity", 5.0, 15.0),
        ("load_mass", 0.33, 1.0),
        ("leakage_internal", 0.013, 0.04),
        ("valve_dead_zone", 0.017, 0.05),
        ("supply_droop", 1.9, 3.5),  # the fall of pressure grows with the square of the flow
    )
}
"""Presets for the default 32 mm rig by catalogue name, then ``"weak"`` (a third in effect) or ``"strong"``."""


def preset(name: str, level: str = "strong", bore: float = 0.032) -> Hidden:
    """A preset for another bore [m]: constant load and payload grow with the piston area, the tank too.

    Raises ``KeyError`` listing what there is for an unknown name or level.
    """
    if name not in HIDDEN_EFFECTS or level not in ("weak", "strong"):
        raise KeyError(f"no preset {level!r} of {name!r}; there are weak and strong of {sorted(HIDDEN_EFFECTS)}")
    chosen = HIDDEN_EFFECTS[name][level]
    area = (bore / 0.032) ** 2
    return replace(
        chosen, gravity=chosen.gravity * area, load_mass=chosen.load_mass * area, supply_tank=chosen.supply_tank * area
    )
