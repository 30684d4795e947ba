"""The gas: chambers, side pockets of the dead volume, volumes at the ports, end cushions, tubes between valve and chambers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import compiled
from pneuid.virtual_rig.kernel.valve import leak

Array = NDArray[np.float64]

ADIABATIC = 1.4
RING_DEAD = 0.1  # share of the dead volume that belongs to the ring
CHECK_VALVE = 0.30  # conductance into the ring over the valve's


@compiled
def chamber(
    p: float,
    temperature: float,
    volume: float,
    growth: float,
    inflow: float,
    outflow: float,
    middle_volume: float,
    warming: float,
    par: Array,
) -> tuple[float, float]:
    """Rates of pressure [Pa/s] and temperature [K/s] of one chamber; ``growth`` is dV/dt [m^3/s]."""
    ambient = par[at.TEMPERATURE]
    if par[at.H_HEAT] == 0.0:
        net = inflow - outflow
        if par[at.H_MIXING] != 0.0:
            # Fresh gas enters as a jet of its own enthalpy, gas that leaves has had time to settle.
            strength = par[at.H_MIXING] / par[at.POLYTROPIC]
            full = par[at.F_MIXING_FROM] * par[at.CONDUCTANCE] * par[at.REFERENCE_FLOW] * p
            entering, leaving = max(inflow, 0.0) + max(-outflow, 0.0), max(outflow, 0.0) + max(-inflow, 0.0)
            share = par[at.F_MIXING_LEAVING]
            net += strength * (entering * min(entering / full, 1.0) + share * leaving * min(leaving / full, 1.0))
        if warming != 0.0:
            net += max(inflow, 0.0) * warming / ambient
        return par[at.POLYTROPIC] / volume * (par[at.GAS_RT] * net - p * growth), 0.0
    r = par[at.GAS_RT] / ambient
    share = par[at.F_WALL_VOLUME]
    walls = 1.0 - share + share * volume / middle_volume
    conductance = par[at.H_HEAT] * walls * (p / 4e5) ** par[at.F_WALL_PRESSURE]
    t_in = ambient + warming if inflow >= 0.0 else temperature
    t_out = temperature if outflow >= 0.0 else ambient
    heat = conductance * (ambient - temperature)
    dp = (ADIABATIC * (r * (t_in * inflow - t_out * outflow) - p * growth) + (ADIABATIC - 1.0) * heat) / volume
    dt = temperature * (dp / p + growth / volume - r * temperature * (inflow - outflow) / (p * volume))
    return dp, dt


@compiled
def pocket_flow(side: int, y: Array, par: Array, dy: Array) -> float:
    """Mass flow [kg/s] from a chamber into the side pocket of its dead volume, whose pressure rate is set."""
    extra = par[at.H_POCKET] * (1.0 if side == 0 else par[at.F_POCKET_ROD_SIDE])
    part = par[at.F_POCKET_SHARE]
    volume = par[at.DEAD_1 + side] * part * extra / (1.0 + (1.0 - part) * extra)
    t = y[at.T1 + side]
    flow = leak(par[at.F_POCKET_BORE], y[at.P1 + side], y[at.POCKET_1 + side], t, t, par)
    dy[at.POCKET_1 + side] = par[at.POLYTROPIC] * par[at.GAS_RT] / volume * flow
    return flow


@compiled
def side_flow(side: int, y: Array, par: Array, dy: Array) -> float:
    """Mass flow [kg/s] from a chamber into a closed volume at its port, whose pressure rate is set."""
    here, there, ambient = y[at.P1 + side], y[at.SIDE_1 + side], par[at.TEMPERATURE]
    flow = leak(par[at.F_SIDE_BORE], here, there, y[at.T1 + side], ambient, par)
    volume = par[at.H_SIDE_1 + side] * par[at.DEAD_1 + side]
    dy[at.SIDE_1 + side] = par[at.F_SIDE_EXPONENT] * par[at.GAS_RT] / volume * flow
    return flow


@compiled
def ring_flow(side: int, y: Array, par: Array) -> float:
    """Mass flow [kg/s] out of the cushion's ring into the rest of the chamber: needle out, check valve in."""
    ring, rest, t = y[at.CUSHION_1 + side], y[at.P1 + side], y[at.T1 + side]
    return leak(par[at.F_CUSHION_NEEDLE] if ring >= rest else CHECK_VALVE, ring, rest, t, t, par)


@compiled
def merge_ring(side: int, room: float, y: Array, par: Array) -> None:
    """When the piston leaves the cushion, ring and rest of the chamber become one volume again; mass is kept.

    ``room`` [m] is the distance to that end.
    """
    ring, rest = y[at.CUSHION_1 + side], y[at.P1 + side]
    if room < par[at.H_CUSHION] * par[at.STROKE] or ring == rest:
        return
    dead, area = par[at.DEAD_1 + side], par[at.AREA_1 + side]
    shut = par[at.F_CUSHION_RING] * area
    inside, outside = RING_DEAD * dead + shut * room, (1.0 - RING_DEAD) * dead + (area - shut) * room
    y[at.P1 + side] = y[at.CUSHION_1 + side] = (ring * inside + rest * outside) / (inside + outside)


@compiled
def chamber_rates(
    side: int, room: float, growth_speed: float, inflow: float, outflow: float, y: Array, par: Array, dy: Array
) -> None:
    """Rates of a chamber's pressure and temperature and of its cushion ring; ``room`` [m] to its end cover."""
    dead, area, p, t = par[at.DEAD_1 + side], par[at.AREA_1 + side], y[at.P1 + side], y[at.T1 + side]
    middle = dead + 0.5 * area * par[at.STROKE]
    warming = y[at.WARMING]
    if par[at.H_CUSHION] != 0.0 and room < par[at.H_CUSHION] * par[at.STROKE]:
        flow = ring_flow(side, y, par)
        shut = par[at.F_CUSHION_RING] * area
        ring_volume = max(RING_DEAD * dead + shut * room, 0.5 * RING_DEAD * dead)
        ring, _ = chamber(
            y[at.CUSHION_1 + side], t, ring_volume, shut * growth_speed, 0.0, flow, ring_volume, 0.0, par
        )
        dy[at.CUSHION_1 + side] = ring
        volume = (1.0 - RING_DEAD) * dead + (area - shut) * room
        growth = (area - shut) * growth_speed
        dy[at.P1 + side], dy[at.T1 + side] = chamber(p, t, volume, growth, inflow + flow, outflow, middle, warming, par)
        return
    volume = dead + area * room
    dy[at.P1 + side], dy[at.T1 + side] = chamber(
        p, t, volume, area * growth_speed, inflow, outflow, middle, warming, par
    )
    dy[at.CUSHION_1 + side] = dy[at.P1 + side]


@compiled
def line_rates(side: int, from_valve: float, y: Array, par: Array, dy: Array) -> None:
    """A tube as two cells of gas, each with inertia and turbulent friction; the valve's port at its head.

    ``from_valve`` [kg/s] enters at the port; what leaves at the other end is the state LINE_MB. The last quarter of the
    tube's volume counts to the chamber.
    """
    first = at.LINE_A1 + 4 * side
    head, half_way, into, out = y[first], y[first + 1], y[first + 2], y[first + 3]
    area, length = par[at.S_LINE_AREA], par[at.S_LINE_LENGTH]
    volume = area * length
    sound = ADIABATIC * par[at.GAS_RT]
    dy[first] = sound / (0.25 * volume + par[at.S_PORT_VOLUME]) * (from_valve - into)
    dy[first + 1] = sound / (0.5 * volume) * (into - out)
    drag = par[at.F_TUBE_DRAG] * par[at.GAS_RT] / (2.0 * math.sqrt(4.0 * area / math.pi) * area)
    dy[first + 2] = 2.0 * area / length * (head - half_way) - drag / half_way * into * abs(into)
    dy[first + 3] = 2.0 * area / length * (half_way - y[at.P1 + side]) - drag / half_way * out * abs(out)
