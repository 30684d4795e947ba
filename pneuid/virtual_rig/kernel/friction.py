"""Friction of the piston: LuGre, what its coefficients depend on, and what it remembers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import compiled, entry

Array = NDArray[np.float64]

LEAST_FRICTION = 0.05  # N; keeps the bristle rate finite whatever a hidden effect does to Fc
LEAST_STRIBECK_SPEED = 2e-4  # m/s, the floor of the contract
MAXWELL_YIELD = (0.25, 0.6, 1.3, 3.0, 8.0)  # deflections at which the elements slip, over the bristle's g / sigma0
MAXWELL_SHARE = (0.15, 0.25, 0.25, 0.20, 0.15)  # shares of the force that they carry when all slip
AT_REST = 1e-4  # m/s; slower motion counts as rest
DWELL_LIMIT = 3.0  # the growth saturates at three times that of one second


@compiled
def pressure_factors(gauge_1: float, gauge_2: float, par: Array) -> tuple[float, float]:
    """Relative growth of Fc and of Fs - Fc with chamber pressure: power law at the cap, saturation at the rod."""
    reference, saturation = par[at.S_PRESSURE_REF], par[at.S_PRESSURE_SAT]
    cap = (max(gauge_1, 0.0) / reference) ** par[at.F_PRESSURE_POWER]
    rod = math.tanh(max(gauge_2, 0.0) / saturation) / math.tanh(reference / saturation)
    growth, share = par[at.H_PRESSURE], par[at.F_PRESSURE_ROD_SHARE]
    return growth * ((1.0 - share) * cap + share * rod - 1.0), growth * (1.3 * (0.35 * cap + 0.65 * rod) - 1.3)


@compiled
def place_factor(x: float, par: Array) -> float:
    """Friction over the stroke: a worn patch and a smaller one on the way out, in a bore that tapers slightly."""
    place = x / par[at.STROKE]
    first = (place - par[at.S_BUMP_AT]) / par[at.S_BUMP_WIDTH]
    second = (place - par[at.S_BUMP_AT] - 0.27) / (0.7 * par[at.S_BUMP_WIDTH])
    shape = math.exp(-0.5 * first * first) - 0.45 * math.exp(-0.5 * second * second)
    return max(1.0 + par[at.H_POSITION] * (shape + par[at.S_TAPER] * (place - 0.5)), 0.05)


@compiled
def run_in_factor(work: float, par: Array) -> float:
    """Fall of friction with the work dissipated so far [J]: two exponentials, a fast and a slow one."""
    done = work / par[at.S_WARMUP_WORK]
    fast = par[at.F_RUN_IN_FAST_SHARE]
    fall = fast * (1.0 - math.exp(-done)) + (1.0 - fast) * (1.0 - math.exp(-done / par[at.F_RUN_IN_SLOWER]))
    return max(1.0 - par[at.H_WARMUP] * fall, 0.1)


@entry
def friction_coefficients(x: float, y: Array, par: Array) -> tuple[float, float, float, float]:
    """Fc [N], Fs [N], vs [m/s], sigma2 [N s/m] at a place in the bore, with pressures and memories of the state."""
    fc, fs, vs, viscous = par[at.FC], par[at.FS], par[at.VS], par[at.SIGMA2]
    gauge_1, gauge_2 = y[at.P1] - par[at.PATM], y[at.P2] - par[at.PATM]
    slope_1, slope_d = gauge_1, gauge_1 - gauge_2
    fc += par[at.FC_P] * slope_1 + par[at.FC_D] * slope_d
    fs += par[at.FS_P] * slope_1 + par[at.FS_D] * slope_d
    vs += par[at.VS_P] * slope_1 + par[at.VS_D] * slope_d
    viscous += par[at.SIGMA2_P] * slope_1 + par[at.SIGMA2_D] * slope_d
    if par[at.H_PRESSURE] != 0.0:
        load, break_away = pressure_factors(gauge_1, gauge_2, par)
        excess = (fs - fc) * max(1.0 + break_away, 0.02)
        fc *= max(1.0 + load, 0.05)
        fs = fc + excess
        vs *= max(1.0 - 0.4 * load, 0.2)
        viscous *= max(1.0 + 0.5 * load, 0.1)
    if par[at.H_POSITION] != 0.0:
        factor = place_factor(x, par)
        fc *= factor
        fs *= factor
    if par[at.H_WARMUP] != 0.0:
        factor = run_in_factor(y[at.WORK], par)
        fc *= factor
        fs *= factor
        viscous *= factor * factor  # the lubricant thins more than the seal softens
    if par[at.H_DWELL] != 0.0:
        fs += (fs - fc) * par[at.H_DWELL] * min(y[at.REST] ** par[at.F_DWELL_POWER], DWELL_LIMIT)
    fc += par[at.H_ROLLING]
    fs += par[at.H_ROLLING]
    if par[at.H_CLAMP] != 0.0:
        clamp = par[at.H_CLAMP] * max(gauge_2 - par[at.S_CLAMP_AT], 0.0)
        fc += clamp
        fs += clamp
    fc = max(fc, LEAST_FRICTION)
    return fc, max(fs, fc), max(vs, LEAST_STRIBECK_SPEED), max(viscous, 0.0)


@entry
def stribeck(v: float, fc: float, fs: float, vs: float) -> float:
    """Steady bristle force g(v) [N]."""
    ratio = v / vs
    return fc + (fs - fc) * math.exp(-ratio * ratio)


@compiled
def slip_level(v: float, y: Array, fc: float, fs: float, vs: float, par: Array) -> float:
    """g [N] at the speed that the lubricating film knows of."""
    return stribeck(y[at.FILM] if par[at.H_FILM] != 0.0 else v, fc, fs, vs)


@compiled
def friction_force(x: float, v: float, y: Array, par: Array) -> float:
    """Friction force [N] at the piston's place and speed in the bore, positive against positive motion."""
    fc, fs, vs, viscous = friction_coefficients(x, y, par)
    if par[at.H_VISCOUS] != 0.0:
        viscous *= 1.0 + par[at.H_VISCOUS] * (abs(v) / 0.5) ** par[at.F_VISCOUS_POWER]
    z = y[at.Z]
    elastic = par[at.SIGMA0] * z
    rate = v - par[at.SIGMA0] * abs(v) / slip_level(v, y, fc, fs, vs, par) * z
    if par[at.H_MAXWELL] != 0.0:
        elements = 0.0
        for i in range(5):
            elements += MAXWELL_SHARE[i] / MAXWELL_YIELD[i] ** par[at.F_MAXWELL_SPREAD] * y[at.MAXWELL_0 + i]
        elastic = (1.0 - par[at.H_MAXWELL]) * elastic + par[at.H_MAXWELL] * par[at.SIGMA0] * elements
    force = elastic + par[at.SIGMA1] * rate + viscous * v
    if par[at.H_DIRECTION] != 0.0:
        # The lip flips over with the bristle, so direction is read from the deflection.
        force *= 1.0 + par[at.H_DIRECTION] * min(max(par[at.SIGMA0] * z / fc, -1.0), 1.0)
    return force


@entry
def friction_of(y: Array, par: Array) -> float:
    """Friction force [N] of a whole state."""
    return friction_force(y[at.X] - y[at.BODY_X], y[at.V] - y[at.BODY_V], y, par)


@compiled
def remember(x: float, v: float, y: Array, h: float, par: Array) -> None:
    """Move the bristle and friction's memories by ``h`` seconds at frozen velocity and pressures: exact solutions."""
    speed = abs(v)
    if par[at.H_FILM] != 0.0:
        lag = par[at.H_FILM] if speed > y[at.FILM] else par[at.F_FILM_SQUEEZE] * par[at.H_FILM]
        y[at.FILM] += (y[at.FILM] - speed) * math.expm1(-h / lag)
    if par[at.H_DWELL] != 0.0:
        if speed < AT_REST:
            y[at.REST] += h
        else:
            y[at.REST] *= math.exp(-speed * h / par[at.F_DWELL_WEAR])
    if par[at.H_WARMUP] != 0.0:
        y[at.WORK] += max(friction_force(x, v, y, par) * v, 0.0) * h
    if speed == 0.0:
        return
    fc, fs, vs, _ = friction_coefficients(x, y, par)
    g = slip_level(v, y, fc, fs, vs, par)
    steady = math.copysign(g / par[at.SIGMA0], v)
    y[at.Z] -= (steady - y[at.Z]) * math.expm1(-par[at.SIGMA0] * speed * h / g)
    if par[at.H_MAXWELL] != 0.0:
        for i in range(5):
            most = MAXWELL_YIELD[i] ** par[at.F_MAXWELL_SPREAD] * g / par[at.SIGMA0]
            y[at.MAXWELL_0 + i] = min(max(y[at.MAXWELL_0 + i] + v * h, -most), most)
