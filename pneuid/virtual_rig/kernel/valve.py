"""The valve: spool, metering edges, ISO 6358 orifices, leaks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import compiled

Array = NDArray[np.float64]

PATCH_FROM = 0.999  # pressure ratio above which the flow is linear in the pressure difference
JET_EXPONENT = 0.4 / 1.4  # (gamma - 1)/gamma of the isentropic expansion to the speed of a jet
CHOKED_JET = 0.528  # pressure ratio below which a jet does not become faster
JET_REFERENCE = 5.0e5 * math.sqrt(1.0 - CHOKED_JET**JET_EXPONENT)  # momentum [Pa] of a choked jet from 5 bar absolute
PLAY_RADIUS = (0.42, 0.98, 1.956)  # widths of the three plays over the hysteresis' half width
PLAY_WEIGHT = (0.40, 0.35, 0.25)  # their weighted mean width is 1


@compiled
def orifice(
    conductance: float,
    critical: float,
    patch: float,
    power: float,
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
        psi = math.sqrt(1.0 - part * part) if power == 0.5 else (1.0 - part * part) ** power
    else:
        psi = patch * (1.0 - ratio)
    flow = sign * conductance * par[at.REFERENCE_FLOW] * up * psi
    if t_up != par[at.TEMPERATURE]:
        flow *= math.sqrt(par[at.TEMPERATURE] / t_up)
    return flow


@compiled
def metered(
    opening: float, critical: float, patch: float, here: float, there: float, t_here: float, t_there: float, par: Array
) -> float:
    """Mass flow [kg/s] through an edge of the valve, whose critical ratio may fall as it opens."""
    spread, power, conductance = par[at.CRITICAL_SPREAD], par[at.PSI_POWER], par[at.CONDUCTANCE] * opening
    if spread != 0.0:
        critical += spread * (1.0 - 2.0 * min(opening, 1.0))
        part = (PATCH_FROM - critical) / (1.0 - critical)
        patch = (1.0 - part * part) ** power / (1.0 - PATCH_FROM)
    return orifice(conductance, critical, patch, power, here, there, t_here, t_there, par)


@compiled
def leak(fraction: float, here: float, there: float, t_here: float, t_there: float, par: Array) -> float:
    """Sharp-edged leak [kg/s] whose sonic conductance is a fraction of the valve's."""
    b = par[at.S_LEAK_CRITICAL]
    part = (PATCH_FROM - b) / (1.0 - b)
    patch = math.sqrt(1.0 - part * part) / (1.0 - PATCH_FROM)
    return orifice(fraction * par[at.CONDUCTANCE], b, patch, 0.5, here, there, t_here, t_there, par)


@compiled
def edge(travel: float, overlap: float, rounded: float) -> float:
    """Opening of one metering edge at a positive travel towards it; overlapped lands open over
    a part ``rounded`` of the overlap."""
    if overlap == 0.0:
        return min(travel, 1.0)
    beyond = travel - overlap
    rounding = rounded * overlap
    if beyond <= -rounding:
        return 0.0
    if beyond < rounding:
        return min((beyond + rounding) ** 2 / (4.0 * rounding), 1.0)
    return min(beyond, 1.0)


@compiled
def play(i: int, par: Array) -> float:
    """Half width of the hysteresis' play ``i`` as a fraction of full scale."""
    return (1.0 + (PLAY_RADIUS[i] - 1.0) * par[at.F_PLAY_SPREAD]) * par[at.H_HYSTERESIS]


@compiled
def spool_travel(spool: float, y: Array, par: Array) -> float:
    """Travel of the spool as a fraction of full scale, after hysteresis, offset and unequal gain."""
    travel = (spool - par[at.NULL]) / par[at.FULL_SCALE]
    if par[at.H_HYSTERESIS] != 0.0:
        command, travel = travel, 0.0
        for i in range(3):
            half = play(i, par)
            travel += PLAY_WEIGHT[i] * min(max(y[at.PLAY_0 + i], command - half), command + half)
    travel += par[at.H_OFFSET]
    return travel * (1.0 + math.copysign(par[at.H_ASYMMETRY], travel))


@compiled
def take_up_play(spool: float, y: Array, par: Array) -> None:
    """Let the plays of the hysteresis follow the spool command [V]."""
    command = (spool - par[at.NULL]) / par[at.FULL_SCALE]
    for i in range(3):
        half = play(i, par)
        y[at.PLAY_0 + i] = min(max(y[at.PLAY_0 + i], command - half), command + half)


@compiled
def jet(up: float, down: float, par: Array) -> float:
    """Momentum [Pa] that a jet between two absolute pressures carries per area of its edge, whichever way it goes."""
    if up < down:
        up, down = down, up
    critical, ratio = par[at.CRITICAL], max(down / up, CHOKED_JET)
    part = max(ratio - critical, 0.0) / (1.0 - critical)
    return up * math.sqrt(max(1.0 - part * part, 0.0)) * math.sqrt(1.0 - ratio**JET_EXPONENT)


@compiled
def pulled_back(travel: float, port_1: float, port_2: float, ps: float, exhaust: float, par: Array) -> float:
    """Travel at which the jets through the open edges and the spring balance the command, fractions of full scale."""
    force = par[at.H_FLOW_FORCE]
    travel += force * par[at.F_PORT_PUSH] * (port_1 - port_2) / 4.0e5
    filled, vented = (port_1, port_2) if travel > 0.0 else (port_2, port_1)
    jets = jet(ps, filled, par) + par[at.F_JET_EXHAUST] * jet(vented, exhaust, par)
    return travel / (1.0 + force * jets / (2.0 * JET_REFERENCE))


@compiled
def openings(travel: float, par: Array) -> tuple[float, float, float, float]:
    """Openings of the edges supply to 1, 1 to exhaust, supply to 2, 2 to exhaust, as fractions of full."""
    lap, differ, rounded = par[at.H_LAP], par[at.F_LAP_SPREAD], par[at.F_LAP_ROUNDING]
    fill_1 = vent_2 = fill_2 = vent_1 = 0.0
    if travel > 0.0:
        fill_1 = edge(travel, (1.0 + 0.08 * differ) * lap, rounded)
        vent_2 = edge(travel, (1.0 - 0.10 * differ) * lap, rounded)
    elif travel < 0.0:
        fill_2 = edge(-travel, (1.0 - 0.03 * differ) * lap, rounded)
        vent_1 = edge(-travel, (1.0 + 0.05 * differ) * lap, rounded)
    clearance = par[at.H_NULL_LEAK]
    if clearance != 0.0:
        # A land that covers its port still passes gas through the clearance, the less the further it covers.
        covered = clearance / (1.0 + abs(travel) / (par[at.F_CLEARANCE_FADE] * clearance))
        opened = math.sqrt(travel * travel + clearance * clearance) - abs(travel)
        if travel >= 0.0:
            fill_1, vent_2, fill_2, vent_1 = fill_1 + opened, vent_2 + opened, covered, covered
        else:
            fill_2, vent_1, fill_1, vent_2 = fill_2 + opened, vent_1 + opened, covered, covered
    return fill_1, vent_1, fill_2, vent_2


@compiled
def hole(height: float) -> float:
    """Area of a circle's segment of a height up to the radius, both over the radius."""
    beside = 1.0 - height
    return math.acos(beside) - beside * math.sqrt(1.0 - beside * beside)


@compiled
def through_holes(opening: float, share: float, par: Array) -> float:
    """Opening of an edge whose ports are a share of round holes, opened from their edge (or middle, if negative)."""
    if opening >= 1.0:
        return opening
    full = 1.0 / par[at.F_HOLE_RADIUS]
    if share > 0.0:
        round_part = hole(opening * full) / hole(full)
    else:
        half = 0.5 * math.pi
        round_part = (half - hole(1.0 - opening * full)) / (half - hole(1.0 - full))
    return opening + abs(share) * (round_part - opening)


@compiled
def valve_flows(
    spool: float, port_1: float, port_2: float, ps: float, exhaust: float, y: Array, par: Array
) -> tuple[float, float, float, float]:
    """Mass flows [kg/s] through the four edges: supply to 1, 1 to exhaust, supply to 2, 2 to exhaust."""
    travel = spool_travel(spool, y, par)
    if par[at.H_FLOW_FORCE] != 0.0:
        travel = pulled_back(travel, port_1, port_2, ps, exhaust, par)
    o1, e1, o2, e2 = openings(travel, par)
    if par[at.H_CURVE] != 0.0:
        filling, venting = par[at.H_CURVE], par[at.H_CURVE] * par[at.F_HOLE_VENT]
        o1, o2 = through_holes(o1, filling, par), through_holes(o2, filling, par)
        e1, e2 = through_holes(e1, venting, par), through_holes(e2, venting, par)
    c, ambient = 1.0, par[at.TEMPERATURE]
    if par[at.H_SUPPLY_GAIN] != 0.0:
        c += par[at.H_SUPPLY_GAIN] * (ps - par[at.PATM] - par[at.S_SUPPLY_REF]) / par[at.S_SUPPLY_REF]
    warm = ambient + y[at.WARMING]
    b, patch = par[at.CRITICAL], par[at.PSI_PATCH]
    fill_1 = metered(c * o1, b, patch, ps, port_1, warm, y[at.T1], par)
    fill_2 = metered(c * o2, b, patch, ps, port_2, warm, y[at.T2], par)
    b, patch = par[at.CRITICAL_VENT], par[at.PSI_PATCH_VENT]
    vent_1 = metered(c * e1, b, patch, port_1, exhaust, y[at.T1], ambient, par)
    vent_2 = metered(c * e2, b, patch, port_2, exhaust, y[at.T2], ambient, par)
    return fill_1, vent_1, fill_2, vent_2


@compiled
def supply_and_exhaust_rates(
    fills: float, vents: float, ps: float, supply: float, y: Array, par: Array, dy: Array
) -> None:
    """Rates of the pressures in front of the valve and behind its exhaust ports, and of the supply's warming."""
    ambient = par[at.TEMPERATURE]
    if par[at.H_DROOP] != 0.0:
        feed = 0.0  # the regulator does not relieve
        if supply > ps:
            c = par[at.CONDUCTANCE] / par[at.H_DROOP]
            feed = orifice(c, par[at.CRITICAL], par[at.PSI_PATCH], par[at.PSI_POWER], supply, ps, ambient, ambient, par)
        dy[at.PSUP] = 1.1 * par[at.GAS_RT] / par[at.S_TANK] * (feed - fills)
    if par[at.H_EXHAUST] != 0.0:
        out = leak(1.0 / par[at.H_EXHAUST], y[at.PEXH], par[at.PATM], ambient, ambient, par)
        dy[at.PEXH] = par[at.GAS_RT] / (par[at.F_GALLERY] * par[at.S_PORT_VOLUME]) * (vents - out)
    if par[at.H_SUPPLY_HEAT] != 0.0:
        full = par[at.CONDUCTANCE] * par[at.REFERENCE_FLOW] * supply
        dy[at.WARMING] = (par[at.H_SUPPLY_HEAT] * min(max(fills, 0.0) / (0.1 * full), 1.0) - y[at.WARMING]) / 3.0
