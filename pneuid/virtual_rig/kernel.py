"""The truth's equations and their integrator, compiled.

States and parameters are the flat arrays of ``layout``. Everything here is written without
smoothing: the sign of the velocity, the valve opening, the metering edges, the ISO 6358 flow
(with the laminar patch above a pressure ratio of 0.999 that the contract fixes) and the stops.

Integrator. With ``B`` the bristle equation at frozen velocity and pressures, which has an exact
exponential solution, and ``A`` everything else at a frozen bristle, one step is the Strang
product ``B(h/2) A(h) B(h/2)``, where ``A`` is the explicit trapezoidal (Heun) rule and
neighbouring half steps of ``B`` are joined. The product is of second order; the stiff rate
``sigma0 |v| / g`` (2e4 1/s and more) never limits the step.

All compiled code shares this one file because numba's cache watches only the file of the function
it compiled: a callee edited elsewhere would leave stale machine code behind. For the same reason
the indices of ``layout`` are frozen into it: delete ``__pycache__`` after changing ``layout.py``.

Sources: Canudas de Wit et al. 1995 (LuGre); ISO 6358-1:2013 eq. 3 to 5; Strang 1968.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at

Array = NDArray[np.float64]

ADIABATIC = 1.4
PATCH_FROM = 0.999  # pressure ratio above which the flow is linear in the pressure difference
LEAST_FRICTION = 0.05  # N; keeps the bristle rate finite whatever a hidden effect does to Fc
LEAST_STRIBECK_SPEED = 2e-4  # m/s, the floor of the contract


@njit(cache=True, error_model="numpy")
def friction_coefficients(x: float, p1: float, p2: float, par: Array) -> tuple[float, float, float, float]:
    """Fc [N], Fs [N], vs [m/s], sigma2 [N s/m] at a place and at absolute chamber pressures."""
    fc, fs, vs, viscous = par[at.FC], par[at.FS], par[at.VS], par[at.SIGMA2]
    gauge_1, gauge_2 = p1 - par[at.PATM], p2 - par[at.PATM]
    slope_1, slope_d = gauge_1, gauge_1 - gauge_2
    fc += par[at.FC_P] * slope_1 + par[at.FC_D] * slope_d
    fs += par[at.FS_P] * slope_1 + par[at.FS_D] * slope_d
    vs += par[at.VS_P] * slope_1 + par[at.VS_D] * slope_d
    viscous += par[at.SIGMA2_P] * slope_1 + par[at.SIGMA2_D] * slope_d
    if par[at.H_PRESSURE] != 0.0:
        # Lip seals: the cap side follows a power law, the rod side saturates; 1 at the reference.
        cap = (max(gauge_1, 0.0) / par[at.S_PRESSURE_REF]) ** 0.85
        rod = math.tanh(max(gauge_2, 0.0) / par[at.S_PRESSURE_SAT]) / math.tanh(
            par[at.S_PRESSURE_REF] / par[at.S_PRESSURE_SAT]
        )
        load = par[at.H_PRESSURE] * (0.6 * cap + 0.4 * rod - 1.0)
        excess = (fs - fc) * max(1.0 + par[at.H_PRESSURE] * (1.3 * (0.35 * cap + 0.65 * rod) - 1.3), 0.02)
        fc *= max(1.0 + load, 0.05)
        fs = fc + excess
        vs *= max(1.0 - 0.4 * load, 0.2)
        viscous *= max(1.0 + 0.5 * load, 0.1)
    if par[at.H_POSITION] != 0.0:
        # A worn patch and a smaller one on the way out, on top of a bore that tapers slightly.
        place = x / par[at.STROKE]
        first = (place - par[at.S_BUMP_AT]) / par[at.S_BUMP_WIDTH]
        second = (place - par[at.S_BUMP_AT] - 0.27) / (0.7 * par[at.S_BUMP_WIDTH])
        shape = math.exp(-0.5 * first * first) - 0.45 * math.exp(-0.5 * second * second)
        factor = max(1.0 + par[at.H_POSITION] * (shape + par[at.S_TAPER] * (place - 0.5)), 0.05)
        fc *= factor
        fs *= factor
    fc = max(fc + par[at.H_ROLLING], LEAST_FRICTION)
    fs = max(fs + par[at.H_ROLLING], fc)
    return fc, fs, max(vs, LEAST_STRIBECK_SPEED), max(viscous, 0.0)


@njit(cache=True, error_model="numpy")
def stribeck(v: float, fc: float, fs: float, vs: float) -> float:
    """Steady bristle force g(v) [N]."""
    ratio = v / vs
    return fc + (fs - fc) * math.exp(-ratio * ratio)


@njit(cache=True, error_model="numpy")
def friction_force(x: float, v: float, z: float, p1: float, p2: float, par: Array) -> float:
    """Friction force [N], positive against positive motion."""
    fc, fs, vs, viscous = friction_coefficients(x, p1, p2, par)
    if par[at.H_VISCOUS] != 0.0:
        viscous *= 1.0 + par[at.H_VISCOUS] * math.sqrt(abs(v) / 0.5)
    rate = v - par[at.SIGMA0] * abs(v) / stribeck(v, fc, fs, vs) * z
    force = par[at.SIGMA0] * z + par[at.SIGMA1] * rate + viscous * v
    if par[at.H_DIRECTION] != 0.0:
        # The lip flips over with the bristle, so direction is read from the deflection.
        force *= 1.0 + par[at.H_DIRECTION] * min(max(par[at.SIGMA0] * z / fc, -1.0), 1.0)
    return force


@njit(cache=True, error_model="numpy")
def bristle(x: float, v: float, z: float, p1: float, p2: float, h: float, par: Array) -> float:
    """Deflection after ``h`` seconds at constant velocity and pressures: the exact solution."""
    speed = abs(v)
    if speed == 0.0:
        return z
    fc, fs, vs, _ = friction_coefficients(x, p1, p2, par)
    g = stribeck(v, fc, fs, vs)
    steady = math.copysign(g / par[at.SIGMA0], v)
    return z - (steady - z) * math.expm1(-par[at.SIGMA0] * speed * h / g)


@njit(cache=True, error_model="numpy")
def orifice(
    conductance: float,
    critical: float,
    patch: float,
    here: float,
    there: float,
    t_here: float,
    t_there: float,
    par: Array,
) -> float:
    """ISO 6358 mass flow [kg/s] from ``here`` to ``there`` (absolute Pa); negative when it turns."""
    if conductance <= 0.0:
        return 0.0
    if here >= there:
        up, down, t_up, sign = here, there, t_here, 1.0
    else:
        up, down, t_up, sign = there, here, t_there, -1.0
    ratio = down / up
    if ratio <= critical:
        psi = 1.0
    elif ratio < PATCH_FROM:
        part = (ratio - critical) / (1.0 - critical)
        psi = math.sqrt(1.0 - part * part)
    else:
        psi = patch * (1.0 - ratio)
    flow = sign * conductance * par[at.REFERENCE_FLOW] * up * psi
    if t_up != par[at.TEMPERATURE]:
        flow *= math.sqrt(par[at.TEMPERATURE] / t_up)
    return flow


@njit(cache=True, error_model="numpy")
def edge(travel: float, overlap: float) -> float:
    """Opening of one metering edge at a positive travel towards it; overlapped lands open rounded."""
    if overlap == 0.0:
        return min(travel, 1.0)
    beyond = travel - overlap
    rounding = 0.6 * overlap
    if beyond <= -rounding:
        return 0.0
    if beyond < rounding:
        return min((beyond + rounding) ** 2 / (4.0 * rounding), 1.0)
    return min(beyond, 1.0)


@njit(cache=True, error_model="numpy")
def valve_flows(
    spool: float, p1: float, p2: float, ps: float, t1: float, t2: float, par: Array
) -> tuple[float, float, float, float]:
    """Mass flows [kg/s] through the four edges: supply to 1, 1 to ambient, supply to 2, 2 to ambient."""
    travel = (spool - par[at.NULL]) / par[at.FULL_SCALE] + par[at.H_OFFSET]
    travel *= 1.0 + math.copysign(par[at.H_ASYMMETRY], travel)
    lap = par[at.H_LAP]
    c, b, patch, warm, patm = (
        par[at.CONDUCTANCE],
        par[at.CRITICAL],
        par[at.PSI_PATCH],
        par[at.TEMPERATURE],
        par[at.PATM],
    )
    fill_1 = vent_2 = fill_2 = vent_1 = 0.0
    if travel > 0.0:
        fill_1 = orifice(c * edge(travel, 1.08 * lap), b, patch, ps, p1, warm, t1, par)
        vent_2 = orifice(c * edge(travel, 0.90 * lap), b, patch, p2, patm, t2, warm, par)
    elif travel < 0.0:
        fill_2 = orifice(c * edge(-travel, 0.97 * lap), b, patch, ps, p2, warm, t2, par)
        vent_1 = orifice(c * edge(-travel, 1.05 * lap), b, patch, p1, patm, t1, warm, par)
    return fill_1, vent_1, fill_2, vent_2


@njit(cache=True, error_model="numpy")
def leak(fraction: float, here: float, there: float, t_here: float, t_there: float, par: Array) -> float:
    """Sharp-edged leak [kg/s] whose sonic conductance is a fraction of the valve's."""
    b = par[at.S_LEAK_CRITICAL]
    part = (PATCH_FROM - b) / (1.0 - b)
    patch = math.sqrt(1.0 - part * part) / (1.0 - PATCH_FROM)
    return orifice(fraction * par[at.CONDUCTANCE], b, patch, here, there, t_here, t_there, par)


@njit(cache=True, error_model="numpy")
def stop_force(x: float, v: float, par: Array) -> float:
    """Push of the end stops [N], positive in +x; a hard spring and damper that never pulls."""
    if x < 0.0:
        return max(-par[at.STOP_STIFFNESS] * x - par[at.STOP_DAMPING] * v, 0.0)
    if x > par[at.STROKE]:
        return min(par[at.STOP_STIFFNESS] * (par[at.STROKE] - x) - par[at.STOP_DAMPING] * v, 0.0)
    return 0.0


@njit(cache=True, error_model="numpy")
def load_force(x: float, par: Array) -> float:
    """Weight, cable pull and return spring [N], positive against +x."""
    force = par[at.MASS] * par[at.GRAVITY]
    if par[at.H_PULL] != 0.0:
        force += par[at.H_PULL] * (1.0 + 0.06 * (x / par[at.STROKE] - 0.5))  # a constant-force spring is not quite
    if par[at.H_SPRING] != 0.0:
        from_middle = x / par[at.STROKE] - 0.5
        force += par[at.H_SPRING] * par[at.STROKE] * from_middle * (1.0 + from_middle * from_middle)
    return force


@njit(cache=True, error_model="numpy")
def chamber(
    p: float,
    temperature: float,
    volume: float,
    growth: float,
    inflow: float,
    outflow: float,
    middle_volume: float,
    par: Array,
) -> tuple[float, float]:
    """Rates of pressure [Pa/s] and temperature [K/s] of one chamber; ``growth`` is dV/dt [m^3/s]."""
    if par[at.H_HEAT] == 0.0:
        return par[at.POLYTROPIC] / volume * (par[at.GAS_RT] * (inflow - outflow) - p * growth), 0.0
    ambient = par[at.TEMPERATURE]
    r = par[at.GAS_RT] / ambient
    conductance = par[at.H_HEAT] * (0.4 + 0.6 * volume / middle_volume) * (p / 4e5) ** 0.6
    t_in = ambient if inflow >= 0.0 else temperature
    t_out = temperature if outflow >= 0.0 else ambient
    heat = conductance * (ambient - temperature)
    dp = (ADIABATIC * (r * (t_in * inflow - t_out * outflow) - p * growth) + (ADIABATIC - 1.0) * heat) / volume
    dt = temperature * (dp / p + growth / volume - r * temperature * (inflow - outflow) / (p * volume))
    return dp, dt


@njit(cache=True, error_model="numpy")
def rates(y: Array, u: float, supply: float, par: Array, dy: Array) -> None:
    """Time derivatives of all states but the bristle, written into ``dy``."""
    x, v, p1, p2 = y[at.X], y[at.V], y[at.P1], y[at.P2]
    ps = y[at.PSUP] if par[at.H_DROOP] != 0.0 else supply
    spool = y[at.SPOOL] if par[at.H_LAG] != 0.0 else u
    fill_1, vent_1, fill_2, vent_2 = valve_flows(spool, p1, p2, ps, y[at.T1], y[at.T2], par)
    dy[at.SPOOL] = 0.0
    dy[at.PSUP] = 0.0
    if par[at.H_DROOP] != 0.0:
        feed = 0.0  # the regulator does not relieve
        if supply > ps:
            warm = par[at.TEMPERATURE]
            c = par[at.CONDUCTANCE] / par[at.H_DROOP]
            feed = orifice(c, par[at.CRITICAL], par[at.PSI_PATCH], supply, ps, warm, warm, par)
        dy[at.PSUP] = 1.1 * par[at.GAS_RT] / par[at.S_TANK] * (feed - fill_1 - fill_2)
    if par[at.H_LAG] != 0.0:
        fastest = 0.5 * par[at.FULL_SCALE] / par[at.H_LAG]
        dy[at.SPOOL] = min(max((u - spool) / par[at.H_LAG], -fastest), fastest)
    out_1, out_2 = vent_1, vent_2
    if par[at.H_LEAK] != 0.0:
        across = leak(par[at.H_LEAK], p1, p2, y[at.T1], y[at.T2], par)
        out_1 += across
        fill_2 += across
    if par[at.H_LEAK_1] != 0.0:
        out_1 += leak(par[at.H_LEAK_1], p1, par[at.PATM], y[at.T1], par[at.TEMPERATURE], par)
    if par[at.H_LEAK_2] != 0.0:
        out_2 += leak(par[at.H_LEAK_2], p2, par[at.PATM], y[at.T2], par[at.TEMPERATURE], par)
    volume_1 = par[at.DEAD_1] + par[at.AREA_1] * x
    volume_2 = par[at.DEAD_2] + par[at.AREA_2] * (par[at.STROKE] - x)
    middle_1 = par[at.DEAD_1] + 0.5 * par[at.AREA_1] * par[at.STROKE]
    middle_2 = par[at.DEAD_2] + 0.5 * par[at.AREA_2] * par[at.STROKE]
    dy[at.P1], dy[at.T1] = chamber(p1, y[at.T1], volume_1, par[at.AREA_1] * v, fill_1, out_1, middle_1, par)
    dy[at.P2], dy[at.T2] = chamber(p2, y[at.T2], volume_2, -par[at.AREA_2] * v, fill_2, out_2, middle_2, par)
    drive = (p1 - par[at.PATM]) * par[at.AREA_1] - (p2 - par[at.PATM]) * par[at.AREA_2]
    friction = friction_force(x, v, y[at.Z], p1, p2, par)
    dy[at.X] = v
    dy[at.V] = (drive - friction - load_force(x, par) + stop_force(x, v, par)) / par[at.MASS]
    dy[at.Z] = 0.0


@njit(cache=True, error_model="numpy")
def heun(y: Array, u_start: float, u_end: float, supply: float, h: float, par: Array, work: Array) -> None:
    """One step of the explicit trapezoidal rule in place, the command running linearly over it."""
    before, after, guess = work[0], work[1], work[2]
    rates(y, u_start, supply, par, before)
    for i in range(at.STATES):
        guess[i] = y[i] + h * before[i]
    rates(guess, u_end, supply, par, after)
    for i in range(at.STATES):
        y[i] += 0.5 * h * (before[i] + after[i])


@njit(cache=True, error_model="numpy")
def advance(y: Array, u_start: float, u_end: float, supply: float, duration: float, substeps: int, par: Array) -> None:
    """Move the state ``y`` in place by ``duration`` seconds in ``substeps`` equal steps.

    The command [V] runs linearly from ``u_start`` to ``u_end``; ``supply`` is the regulated supply
    pressure (absolute Pa). Callable from compiled controllers.
    """
    work = np.empty((3, at.STATES))
    h = duration / substeps
    slope = (u_end - u_start) / substeps
    if par[at.H_LAG] == 0.0:
        y[at.SPOOL] = u_end
    if par[at.H_DROOP] == 0.0:
        y[at.PSUP] = supply
    y[at.Z] = bristle(y[at.X], y[at.V], y[at.Z], y[at.P1], y[at.P2], 0.5 * h, par)
    for k in range(substeps):
        heun(y, u_start + k * slope, u_start + (k + 1) * slope, supply, h, par, work)
        part = h if k < substeps - 1 else 0.5 * h
        y[at.Z] = bristle(y[at.X], y[at.V], y[at.Z], y[at.P1], y[at.P2], part, par)


@njit(cache=True, error_model="numpy")
def run_commands(y: Array, u: Array, supply: Array, ramp: bool, duration: float, substeps: int, par: Array) -> Array:
    """Open loop: states ``[samples, STATES]`` under a command array, one state per sample."""
    samples = u.shape[0]
    states = np.empty((samples, at.STATES))
    states[0] = y
    for k in range(samples - 1):
        u_end = u[k + 1] if ramp else u[k]
        advance(y, u[k], u_end, supply[k], duration, substeps, par)
        states[k + 1] = y
        if not math.isfinite(y[at.X] + y[at.V] + y[at.P1] + y[at.P2] + y[at.Z]):
            return states[: k + 2]
    return states


@njit(cache=True, error_model="numpy")
def rounded(value: float, step: float) -> float:
    """``value`` on the grid of a converter; a step of zero is an ideal one."""
    return value if step == 0.0 else step * np.rint(value / step)


@njit(cache=True, error_model="numpy")
def run_closed_loop(
    y: Array,
    reference: Array,
    speed: Array,
    dither: Array,
    noise: Array,
    gain: float,
    integral: float,
    feed_forward: float,
    u_step: float,
    x_step: float,
    supply: float,
    ramp: bool,
    duration: float,
    substeps: int,
    par: Array,
) -> tuple[Array, Array]:
    """Follow a reference as an engineer's logger does: measure, compute, apply one sample later.

    ``u[k+1] = null + feed_forward speed[k+1] + gain (e[k] + integral sum(e) duration) + dither[k+1]``
    with ``e = reference - measured x``, limited to full scale, the integral to a tenth of it.
    Returns the applied commands and the states at the samples.
    """
    samples = reference.shape[0]
    states = np.empty((samples, at.STATES))
    u = np.empty(samples)
    u[0] = par[at.NULL]
    states[0] = y
    held = 0.0
    for k in range(samples - 1):
        error = reference[k] - rounded(y[at.X] + noise[k], x_step)
        held = min(max(held + gain * integral * error * duration, -0.1 * par[at.FULL_SCALE]), 0.1 * par[at.FULL_SCALE])
        wanted = feed_forward * speed[k + 1] + gain * error + held + dither[k + 1]
        u[k + 1] = rounded(par[at.NULL] + min(max(wanted, -par[at.FULL_SCALE]), par[at.FULL_SCALE]), u_step)
        advance(y, u[k], u[k + 1] if ramp else u[k], supply, duration, substeps, par)
        states[k + 1] = y
        if not math.isfinite(y[at.X] + y[at.V] + y[at.P1] + y[at.P2] + y[at.Z]):
            return u[: k + 2], states[: k + 2]
    return u, states


@njit(cache=True, error_model="numpy")
def run_imposed(
    x: Array, v: Array, a: Array, p1: Array, p2: Array, duration: float, substeps: int, par: Array
) -> tuple[Array, Array]:
    """Friction and external driving force [N] at the samples of an imposed motion.

    Between samples the velocity is the cubic through the velocities and accelerations at both
    ends; position and chamber pressures run linearly. The bristle starts unstrained.
    """
    samples = x.shape[0]
    friction = np.empty(samples)
    drive = np.empty(samples)
    z = 0.0
    h = duration / substeps
    for k in range(samples):
        friction[k] = friction_force(x[k], v[k], z, p1[k], p2[k], par)
        pressure = (p1[k] - par[at.PATM]) * par[at.AREA_1] - (p2[k] - par[at.PATM]) * par[at.AREA_2]
        drive[k] = par[at.MASS] * a[k] + friction[k] + load_force(x[k], par) - pressure
        if k == samples - 1:
            break
        for i in range(substeps):
            s = (i + 0.5) / substeps
            r = 1.0 - s
            here = (1.0 + 2.0 * s) * r * r * v[k] + s * s * (3.0 - 2.0 * s) * v[k + 1]
            here += duration * s * r * (r * a[k] - s * a[k + 1])
            q1 = r * p1[k] + s * p1[k + 1]
            q2 = r * p2[k] + s * p2[k + 1]
            z = bristle(r * x[k] + s * x[k + 1], here, z, q1, q2, h, par)
    return friction, drive
