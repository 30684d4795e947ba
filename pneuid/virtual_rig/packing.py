"""From the described truth to the flat parameter array of the compiled equations."""

from __future__ import annotations

import math

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
STOP_STIFFNESS = 1.0e6  # N/m
STOP_DAMPING_RATIO = 0.3


def pack(truth: TruthServo, hidden: Hidden) -> NDArray[np.float64]:
    """Parameter vector ``float64[layout.PARAMETERS]``, SI.

    Raises ``ValueError`` when one is not finite.
    """
    par = np.full(at.PARAMETERS, np.nan)
    _pack_body(par, truth, hidden)
    _pack_gas_and_valve(par, truth)
    _pack_friction(par, truth)
    _pack_hidden(par, hidden)
    if not np.all(np.isfinite(par)):
        raise ValueError(f"the rig has a parameter that is not finite: {truth}, {hidden}")
    return par


def _pack_body(par: NDArray[np.float64], truth: TruthServo, hidden: Hidden) -> None:
    mass = truth.mass + hidden.load_mass
    par[at.AREA_1], par[at.AREA_2], par[at.STROKE] = truth.area_1, truth.area_2, truth.stroke
    par[at.DEAD_1], par[at.DEAD_2] = truth.dead_volume_1, truth.dead_volume_2
    par[at.MASS] = mass
    extra = 0.0
    if hidden.gravity != 0.0:
        extra = hidden.gravity_incline_share * hidden.gravity / truth.mass  # the incline acts on any payload as well
    par[at.GRAVITY] = GRAVITATION * math.sin(truth.incline) + extra
    par[at.STOP_STIFFNESS] = STOP_STIFFNESS
    par[at.STOP_DAMPING] = 2.0 * STOP_DAMPING_RATIO * math.sqrt(STOP_STIFFNESS * mass)


def _pack_gas_and_valve(par: NDArray[np.float64], truth: TruthServo) -> None:
    part = (PATCH_FROM - truth.critical_ratio) / (1.0 - truth.critical_ratio)
    par[at.PATM], par[at.TEMPERATURE], par[at.POLYTROPIC] = truth.patm, truth.temperature, truth.polytropic
    par[at.GAS_RT] = GAS_CONSTANT * truth.temperature
    par[at.REFERENCE_FLOW] = NORMAL_DENSITY * math.sqrt(NORMAL_TEMPERATURE / truth.temperature)
    par[at.CONDUCTANCE], par[at.CRITICAL] = truth.conductance, truth.critical_ratio
    par[at.PSI_PATCH] = math.sqrt(1.0 - part * part) / (1.0 - PATCH_FROM)
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
