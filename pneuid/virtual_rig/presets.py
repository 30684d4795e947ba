"""How large the hidden effects are: weak and strong, for the default rig and in proportion for others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pneuid.virtual_rig.hidden import Hidden


def _alone(name: str, amplitude: float) -> Hidden:
    given: dict[str, Any] = {name: amplitude}
    return Hidden(**given)


def _levels(table: tuple[tuple[str, float, float], ...]) -> dict[str, dict[str, Hidden]]:
    return {name: {"weak": _alone(name, weak), "strong": _alone(name, strong)} for name, weak, strong in table}


HIDDEN_EFFECTS: dict[str, dict[str, Hidden]] = _levels(
    (
        ("friction_pressure", 0.28, 0.85),
        ("friction_direction", 0.07, 0.20),
        ("friction_position", 0.17, 0.50),
        ("gravity", 5.0, 15.0),
        ("load_mass", 0.33, 1.0),
        ("leakage_internal", 0.013, 0.04),
        ("valve_dead_zone", 0.017, 0.05),
        ("supply_droop", 1.9, 3.5),  # the fall of pressure grows with the square of the flow
        ("friction_dwell", 0.7, 2.0),
        ("friction_warmup", 0.12, 0.36),
        ("friction_viscous_nonlinear", 0.2, 0.6),
        ("friction_lag", 0.017, 0.05),
        ("friction_presliding_memory", 0.3, 0.9),
        ("load_spring", 20.0, 60.0),
        ("backlash", 0.4e-3, 1.2e-3),
        ("end_cushion", 0.025, 0.045),
        ("mounting_compliance", 7e-6, 20e-6),
        ("leakage_external_1", 0.01, 0.03),
        ("leakage_external_2", 0.01, 0.03),
        ("dead_volume", 0.7, 2.0),
        ("heat_transfer", 0.5, 2.5),  # little conduction looks like an exponent n near 1.4
        ("line_delay", 0.5, 1.5),
        ("exhaust_restriction", 1.2, 1.8),
        ("inlet_mixing", 0.04, 0.12),
        ("valve_offset", 0.007, 0.02),
        ("valve_asymmetry", 0.05, 0.15),
        ("valve_lag", 2e-3, 6e-3),
        ("valve_hysteresis", 0.007, 0.02),
        ("valve_critical_ratio", 0.07, 0.2),
        ("valve_null_leakage", 0.01, 0.03),
        ("sensor_offset_p1", 3e3, 10e3),
        ("sensor_offset_p2", 3e3, 10e3),
        ("sensor_lag_p1", 5e-3, 15e-3),
        ("sensor_lag_p2", 5e-3, 15e-3),
        ("channel_skew", 1e-3, 3e-3),
        ("valve_flow_force", 0.08, 0.24),
        ("side_volume_1", 1.0, 3.0),
        ("side_volume_2", 1.0, 3.0),
        ("valve_curve", 0.1, 0.3),
    )
)
"""Presets of the default 32 mm servo rig by catalogue name, then ``"weak"`` (a third in effect) or ``"strong"``."""

BENCH_EFFECTS: dict[str, dict[str, Hidden]] = _levels(
    (
        ("friction_pressure", 0.1, 0.3),
        ("friction_direction", 0.04, 0.12),
        ("friction_position", 0.08, 0.25),
        ("friction_dwell", 0.3, 1.0),
        ("friction_warmup", 0.07, 0.2),
        ("friction_viscous_nonlinear", 0.25, 0.75),
        ("friction_lag", 0.01, 0.03),
        ("friction_presliding_memory", 0.15, 0.45),
        ("gravity", 1.0, 3.0),
        ("load_mass", 0.2, 0.6),
        ("load_spring", 8.0, 25.0),
        ("sensor_offset_F", 1.0, 3.0),
        ("sensor_offset_p1", 1e3, 3e3),
        ("sensor_offset_p2", 1e3, 3e3),
        ("sensor_lag_F", 3e-3, 10e-3),
    )
)
"""Presets of the friction bench with the default friction, in a force that is measured to 0.2 N."""


@dataclass(frozen=True)
class Outside:
    """An effect that the catalogue does not hold: where it enters, on what it depends, and two presets.

    ``equations`` and ``signals`` are those that a verdict ``unknown`` may rightly name, by the contract's names; both
    balances of a chamber's gas are right for a flow.
    """

    equations: tuple[str, ...]
    signals: tuple[str, ...]
    weak: Hidden
    strong: Hidden
    rigs: tuple[str, ...] = ("servo",)


def _outside(
    name: str, weak: float, strong: float, equations: str, signals: str, rigs: tuple[str, ...] = ("servo",)
) -> Outside:
    return Outside(
        tuple(equations.split()), tuple(signals.split()), _alone(name, weak), _alone(name, strong), rigs
    )


_BOTH = ("servo", "bench")
_GAS = "flow_1 flow_2 pressure_1 pressure_2"

OUTSIDE_EFFECTS: dict[str, Outside] = {
    "cogging": _outside("cogging", 3.0, 9.0, "force", "x", _BOTH),
    "drag_chain": _outside("drag_chain", 30.0, 90.0, "force friction", "x v", _BOTH),
    "magnetic_detent": _outside("magnetic_detent", 5.0, 15.0, "force", "x", _BOTH),
    "rod_seal_clamp": _outside("rod_seal_clamp", 2e-5, 6e-5, "friction force", "p2", _BOTH),
    "relief_leak": _outside("relief_leak", 0.02, 0.06, "flow_1 pressure_1", "p1"),
    "scored_bore": _outside("scored_bore", 0.02, 0.06, _GAS, "x"),
    "lifting_lips": _outside("lifting_lips", 0.02, 0.06, _GAS, "v"),
    "valve_supply_gain": _outside("valve_supply_gain", 0.1, 0.3, f"valve {_GAS}", "psup"),
    "supply_heating": _outside("supply_heating", 15.0, 45.0, _GAS, "t u"),
    "sensor_gain_drift": _outside("sensor_gain_drift", 0.02, 0.06, "sensor_p1 pressure_1 force", "p1 t"),
    "encoder_bow": _outside("encoder_bow", 0.15e-3, 0.45e-3, "sensor_x force", "x"),
    "solenoid_crosstalk": _outside("solenoid_crosstalk", 2e3, 6e3, "sensor_p2", "u"),
}
"""Effects outside the catalogue by name, for the default rig."""

_WITH_AREA = ("gravity", "load_mass", "load_spring", "supply_tank", "cogging", "drag_chain", "magnetic_detent")
_WITH_BORE = ("heat_transfer", "rod_seal_clamp", "sensor_offset_F")
_AGAINST_AREA = ("mounting_compliance",)


def in_proportion(hidden: Hidden, bore: float) -> Hidden:
    """``hidden``, made for the default rig, for another bore [m].

    Loads, payloads and the supply's tank grow with the piston's area, walls and seals with the bore; a bracket is as much
    stiffer as the piston is larger. Fractions, times and lengths stay.
    """
    ratio = bore / 0.032
    powers = dict.fromkeys(_WITH_AREA, 2) | dict.fromkeys(_WITH_BORE, 1) | dict.fromkeys(_AGAINST_AREA, -2)
    return replace(hidden, **{name: getattr(hidden, name) * ratio**power for name, power in powers.items()})


def preset(name: str, level: str = "strong", bore: float = 0.032) -> Hidden:
    """A servo preset, of the catalogue's names or of those outside it, for another bore [m]; see ``in_proportion``.

    Raises ``KeyError`` listing what there is for an unknown name or level.
    """
    if level in ("weak", "strong"):
        if name in HIDDEN_EFFECTS:
            return in_proportion(HIDDEN_EFFECTS[name][level], bore)
        if name in OUTSIDE_EFFECTS:
            return in_proportion(getattr(OUTSIDE_EFFECTS[name], level), bore)
    known = [*sorted(HIDDEN_EFFECTS), *sorted(OUTSIDE_EFFECTS)]
    raise KeyError(f"no preset {level!r} of {name!r}; there are weak and strong of {known}")
