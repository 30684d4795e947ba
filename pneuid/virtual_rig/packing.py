"""From the described truth to the flat parameter array of the compiled equations."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.truth import TruthServo

GRAVITATION = 9.80665  # m/s^2
GAS_CONSTANT = 287.05  # J/(kg K)
NORMAL_DENSITY = 1.185  # kg/m^3, ISO 6358-1
NORMAL_TEMPERATURE = 293.15  # K, ISO 6358-1
PATCH_FROM = 0.999  # as in kernel
STOP_STIFFNESS = 1.0e6  # N/m, of cylinders up to the piston area below, in proportion of larger ones
STOP_DAMPING_RATIO = 0.3
TUBE_CONDUCTANCE = 1.2e-8  # m^3/(s Pa), of the valve that the tubes below belong to
TUBE_AREA = math.pi / 4.0 * 4e-3**2  # m^2
PORT_VOLUME = 2e-6  # m^3, of the valve's port and fitting
BODY_AREA = 8.04e-4  # m^2, of the piston whose cylinder's mass the form states

_WITH_STATES = (
    "valve_hysteresis", "exhaust_restriction", "dead_volume", "line_delay", "friction_dwell", "friction_warmup",
    "friction_lag", "friction_presliding_memory", "backlash", "end_cushion", "mounting_compliance", "supply_heating",
    "side_volume_1", "side_volume_2",
)  # fmt: skip


def pack(truth: TruthServo, hidden: Hidden) -> NDArray[np.float64]:
    """Parameter vector ``float64[layout.PARAMETERS]``, SI.

    Raises ``ValueError`` when one is not finite.
    """
    par = np.full(at.PARAMETERS, np.nan)
    _pack_body(par, truth, hidden)
    _pack_gas_and_valve(par, truth, hidden)
    _pack_friction(par, truth)
    _pack_hidden(par, hidden)
    _pack_parts(par, truth, hidden)
    _pack_outside(par, truth, hidden)
    for item in fields(hidden.form):
        par[getattr(at, f"F_{item.name.upper()}")] = getattr(hidden.form, item.name)
    par[at.EXTENDED] = float(any(getattr(hidden, name) != 0.0 for name in _WITH_STATES))
    if not np.all(np.isfinite(par)):
        raise ValueError(f"the rig has a parameter that is not finite: {truth}, {hidden}")
    return par


def _pack_body(par: NDArray[np.float64], truth: TruthServo, hidden: Hidden) -> None:
    mass = truth.mass + hidden.load_mass
    par[at.AREA_1], par[at.AREA_2], par[at.STROKE] = truth.area_1, truth.area_2, truth.stroke
    rigid = (1.0 - hidden.form.pocket_share) * hidden.dead_volume  # the rest is a side pocket
    tube = 0.75 * _tube_area(truth, hidden) * hidden.line_delay  # the last quarter of a tube counts to the chamber
    par[at.DEAD_1] = max(truth.dead_volume_1 - tube, 0.3 * truth.dead_volume_1) * (1.0 + rigid)
    par[at.DEAD_2] = max(truth.dead_volume_2 - tube, 0.3 * truth.dead_volume_2) * (1.0 + hidden.form.pocket_rod_side * rigid)
    behind = hidden.backlash_load_share * mass if hidden.backlash != 0.0 else 0.0
    par[at.MASS], par[at.S_LOAD_MASS] = mass - behind, behind
    extra = 0.0
    if hidden.gravity != 0.0:
        extra = hidden.gravity_incline_share * hidden.gravity / truth.mass  # the incline acts on any payload as well
    par[at.GRAVITY] = GRAVITATION * math.sin(truth.incline) + extra
    stiffness = par[at.STOP_STIFFNESS] = STOP_STIFFNESS * max(truth.area_1 / BODY_AREA, 1.0)
    par[at.STOP_DAMPING] = 2.0 * STOP_DAMPING_RATIO * math.sqrt(stiffness * mass)


def _tube_area(truth: TruthServo, hidden: Hidden) -> float:
    """Bore area [m^2] of tubes that suit the valve."""
    return hidden.form.tube_area * TUBE_AREA * truth.conductance / TUBE_CONDUCTANCE


def _patch(critical: float, power: float) -> float:
    """Slope of the laminar patch that continues the subsonic curve."""
    part = (PATCH_FROM - critical) / (1.0 - critical)
    curve = math.sqrt(1.0 - part * part) if power == 0.5 else (1.0 - part * part) ** power
    return curve / (1.0 - PATCH_FROM)


def _pack_gas_and_valve(par: NDArray[np.float64], truth: TruthServo, hidden: Hidden) -> None:
    more = hidden.valve_critical_ratio
    fill, vent = (min(max(truth.critical_ratio + share * more, 0.05), 0.85) for share in (1.0, hidden.form.critical_vent))
    power, par[at.CRITICAL_SPREAD] = 0.5 + 0.25 * abs(more), 0.25 * more
    par[at.PATM], par[at.TEMPERATURE], par[at.POLYTROPIC] = truth.patm, truth.temperature, truth.polytropic
    par[at.GAS_RT] = GAS_CONSTANT * truth.temperature
    par[at.REFERENCE_FLOW] = NORMAL_DENSITY * math.sqrt(NORMAL_TEMPERATURE / truth.temperature)
    par[at.CONDUCTANCE], par[at.CRITICAL], par[at.CRITICAL_VENT] = truth.conductance, fill, vent
    par[at.PSI_PATCH], par[at.PSI_PATCH_VENT], par[at.PSI_POWER] = _patch(fill, power), _patch(vent, power), power
    par[at.FULL_SCALE], par[at.NULL] = truth.full_scale, truth.null


def _pack_friction(par: NDArray[np.float64], truth: TruthServo) -> None:
    seal = truth.friction
    par[at.FC], par[at.FS], par[at.VS] = seal.Fc, seal.Fs, seal.vs
    par[at.SIGMA0], par[at.SIGMA1], par[at.SIGMA2] = seal.sigma0, seal.sigma1, seal.sigma2
    par[at.FC_P], par[at.FC_D], par[at.FS_P], par[at.FS_D] = seal.Fc_ps, seal.Fc_dp, seal.Fs_ps, seal.Fs_dp
    par[at.VS_P], par[at.VS_D] = seal.vs_ps, seal.vs_dp
    par[at.SIGMA2_P], par[at.SIGMA2_D] = seal.sigma2_ps, seal.sigma2_dp


def _pack_hidden(par: NDArray[np.float64], hidden: Hidden) -> None:
    par[at.H_PRESSURE], par[at.H_DIRECTION] = hidden.friction_pressure, hidden.friction_direction
    par[at.H_POSITION] = hidden.friction_position
    par[at.H_PULL] = (1.0 - hidden.gravity_incline_share) * hidden.gravity
    par[at.H_ROLLING] = hidden.rolling_coefficient * GRAVITATION * hidden.load_mass
    par[at.H_LEAK], par[at.H_LAP], par[at.H_DROOP] = (
        hidden.leakage_internal,
        hidden.valve_dead_zone,
        hidden.supply_droop,
    )
    par[at.H_LAG], par[at.H_OFFSET], par[at.H_ASYMMETRY] = hidden.valve_lag, hidden.valve_offset, hidden.valve_asymmetry
    par[at.H_LEAK_1], par[at.H_LEAK_2] = hidden.leakage_external_1, hidden.leakage_external_2
    par[at.H_VISCOUS], par[at.H_HEAT] = hidden.friction_viscous_nonlinear, hidden.heat_transfer
    par[at.H_SPRING] = hidden.load_spring
    par[at.S_PRESSURE_REF], par[at.S_PRESSURE_SAT] = hidden.pressure_reference, hidden.pressure_saturation
    par[at.S_BUMP_AT], par[at.S_BUMP_WIDTH], par[at.S_TAPER] = hidden.bump_at, hidden.bump_width, hidden.taper
    par[at.S_LEAK_CRITICAL], par[at.S_TANK] = hidden.leak_critical_ratio, hidden.supply_tank


def _pack_parts(par: NDArray[np.float64], truth: TruthServo, hidden: Hidden) -> None:
    par[at.H_HYSTERESIS], par[at.H_NULL_LEAK] = hidden.valve_hysteresis, hidden.valve_null_leakage
    par[at.H_EXHAUST], par[at.H_POCKET], par[at.H_MIXING] = (
        hidden.exhaust_restriction,
        hidden.dead_volume,
        hidden.inlet_mixing,
    )
    par[at.H_LINE], par[at.S_LINE_LENGTH], par[at.S_LINE_AREA] = hidden.line_delay, hidden.line_delay, _tube_area(truth, hidden)
    par[at.S_PORT_VOLUME] = PORT_VOLUME * truth.conductance / TUBE_CONDUCTANCE
    par[at.H_DWELL], par[at.H_WARMUP], par[at.H_FILM] = (
        hidden.friction_dwell,
        hidden.friction_warmup,
        hidden.friction_lag,
    )
    par[at.S_WARMUP_WORK] = hidden.form.run_in_strokes * truth.friction.Fc * truth.stroke
    par[at.H_MAXWELL], par[at.H_BACKLASH], par[at.H_CUSHION] = (
        hidden.friction_presliding_memory,
        hidden.backlash,
        hidden.end_cushion,
    )
    par[at.H_SIDE_1], par[at.H_SIDE_2] = hidden.side_volume_1, hidden.side_volume_2
    par[at.H_COMPLIANCE], par[at.H_FLOW_FORCE] = hidden.mounting_compliance, hidden.valve_flow_force
    par[at.H_CURVE] = hidden.valve_curve
    par[at.S_BODY_MASS] = hidden.form.body_mass * truth.area_1 / BODY_AREA


def _pack_outside(par: NDArray[np.float64], truth: TruthServo, hidden: Hidden) -> None:
    par[at.H_COGGING], par[at.S_PITCH] = hidden.cogging, hidden.cogging_pitch * truth.stroke
    par[at.H_DRAG_CHAIN], par[at.H_DETENT] = hidden.drag_chain, hidden.magnetic_detent
    par[at.H_CLAMP], par[at.S_CLAMP_AT] = hidden.rod_seal_clamp, hidden.clamp_at
    par[at.H_RELIEF], par[at.S_RELIEF_AT] = hidden.relief_leak, hidden.relief_at
    par[at.H_SCORE], par[at.H_SUPPLY_HEAT] = hidden.scored_bore, hidden.supply_heating
    par[at.H_LIFT] = hidden.lifting_lips
    par[at.H_SUPPLY_GAIN], par[at.S_SUPPLY_REF] = hidden.valve_supply_gain, hidden.supply_reference
