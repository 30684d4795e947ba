"""All rates of change together, and the step that integrates them.

Integrator. With ``B`` friction's memories at frozen velocity and pressures, which have exact solutions (the bristle a
stiff exponential), and ``A`` everything else at frozen memories, one step is the Strang product ``B(h/2) A(h) B(h/2)``,
where ``A`` is the explicit trapezoidal (Heun) rule and neighbouring half steps of ``B`` are joined. The product is of
second order; the stiff rate ``sigma0 |v| / g`` (2e4 1/s and more) never limits the step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import compiled, entry
from pneuid.virtual_rig.kernel.friction import friction_force, remember
from pneuid.virtual_rig.kernel.gas import chamber_rates, line_rates, merge_ring, pocket_flow, side_flow
from pneuid.virtual_rig.kernel.load import body_rates, flank_force, load_force, load_rates, stop_force
from pneuid.virtual_rig.kernel.valve import leak, supply_and_exhaust_rates, take_up_play, valve_flows

Array = NDArray[np.float64]

RELIEF_RANGE = 0.4e5  # Pa above the set pressure at which a relief leak is fully open
LIFTING = 0.15  # m/s at which lips have lifted half way
SCORE_FROM, SCORE_TO = 0.55, 0.68  # of the stroke, where the bore is scored


@compiled
def leaks(x: float, v: float, y: Array, par: Array) -> tuple[float, float, float]:
    """Mass flows [kg/s] from chamber 1 to 2, from 1 to ambient and from 2 to ambient."""
    across = out_1 = out_2 = 0.0
    p1, p2, t1, t2, patm, ambient = y[at.P1], y[at.P2], y[at.T1], y[at.T2], par[at.PATM], par[at.TEMPERATURE]
    if par[at.H_LEAK] != 0.0:
        across = leak(par[at.H_LEAK], p1, p2, t1, t2, par)
    if par[at.H_SCORE] != 0.0:
        place = x / par[at.STROKE]
        open_share = min(max(min(place - SCORE_FROM, SCORE_TO - place) / 0.02, 0.0), 1.0)
        across += leak(par[at.H_SCORE] * open_share, p1, p2, t1, t2, par)
    if par[at.H_LIFT] != 0.0:
        lifted = v * v / (v * v + LIFTING * LIFTING)
        across += leak(par[at.H_LIFT] * lifted, p1, p2, t1, t2, par)
    if par[at.H_LEAK_1] != 0.0:
        out_1 = leak(par[at.H_LEAK_1], p1, patm, t1, ambient, par)
    if par[at.H_RELIEF] != 0.0:
        lift = min(max((p1 - patm - par[at.S_RELIEF_AT]) / RELIEF_RANGE, 0.0), 1.0)
        out_1 += leak(par[at.H_RELIEF] * lift, p1, patm, t1, ambient, par)
    if par[at.H_LEAK_2] != 0.0:
        out_2 = leak(par[at.H_LEAK_2], p2, patm, t2, ambient, par)
    return across, out_1, out_2


@compiled
def gas_rates(u: float, supply: float, y: Array, par: Array, dy: Array) -> None:
    """Rates of every pressure, temperature and line flow, and of the spool."""
    x, v = y[at.X] - y[at.BODY_X], y[at.V] - y[at.BODY_V]
    ps = y[at.PSUP] if par[at.H_DROOP] != 0.0 else supply
    spool = y[at.SPOOL] if par[at.H_LAG] != 0.0 else u
    exhaust = y[at.PEXH] if par[at.H_EXHAUST] != 0.0 else par[at.PATM]
    piped = par[at.H_LINE] != 0.0
    port_1, port_2 = (y[at.LINE_A1], y[at.LINE_A2]) if piped else (y[at.P1], y[at.P2])
    fill_1, vent_1, fill_2, vent_2 = valve_flows(spool, port_1, port_2, ps, exhaust, y, par)
    supply_and_exhaust_rates(fill_1 + fill_2, vent_1 + vent_2, ps, supply, y, par, dy)
    if par[at.H_LAG] != 0.0:
        fastest, with_spring = par[at.F_SLEW] * par[at.FULL_SCALE] / par[at.H_LAG], math.sqrt(par[at.F_SPOOL_RETURN])
        dy[at.SPOOL] = min(max((u - spool) / par[at.H_LAG], -fastest), fastest)
        dy[at.SPOOL] *= with_spring if u < spool else 1.0 / with_spring
    if piped:
        line_rates(0, fill_1 - vent_1, y, par, dy)
        line_rates(1, fill_2 - vent_2, y, par, dy)
        fill_1, vent_1 = max(y[at.LINE_MB1], 0.0), max(-y[at.LINE_MB1], 0.0)
        fill_2, vent_2 = max(y[at.LINE_MB2], 0.0), max(-y[at.LINE_MB2], 0.0)
    across, lost_1, lost_2 = leaks(x, v, y, par)
    out_1, out_2 = vent_1 + across + lost_1, vent_2 + lost_2
    if par[at.H_POCKET] != 0.0:
        out_1 += pocket_flow(0, y, par, dy)
        out_2 += pocket_flow(1, y, par, dy)
    if par[at.H_SIDE_1] != 0.0:
        out_1 += side_flow(0, y, par, dy)
    if par[at.H_SIDE_2] != 0.0:
        out_2 += side_flow(1, y, par, dy)
    chamber_rates(0, x, v, fill_1, out_1, y, par, dy)
    chamber_rates(1, par[at.STROKE] - x, -v, fill_2 + across, out_2, y, par, dy)


@compiled
def force_rates(y: Array, par: Array, dy: Array) -> None:
    """Accelerations of the piston, of a load behind play and of the cylinder's body."""
    x, v, patm = y[at.X] - y[at.BODY_X], y[at.V] - y[at.BODY_V], par[at.PATM]
    drive = (y[at.P1] - patm) * par[at.AREA_1] - (y[at.P2] - patm) * par[at.AREA_2]
    if par[at.H_CUSHION] != 0.0:
        ring_1, ring_2 = y[at.CUSHION_1] - y[at.P1], y[at.CUSHION_2] - y[at.P2]
        drive += par[at.F_CUSHION_RING] * (par[at.AREA_1] * ring_1 - par[at.AREA_2] * ring_2)
    friction, stop = friction_force(x, v, y, par), stop_force(x, v, par)
    flank = 0.0
    if par[at.H_BACKLASH] != 0.0:
        flank = flank_force(y, par)
        load_rates(flank, y, par, dy)
    if par[at.H_COMPLIANCE] != 0.0:
        body_rates(friction - drive - stop, y, par, dy)
    dy[at.X] = y[at.V]
    dy[at.V] = (drive - friction - load_force(y[at.X], y[at.V], par) + stop + flank) / par[at.MASS]


@compiled
def heun(y: Array, u_start: float, u_end: float, supply: float, h: float, count: int, par: Array, work: Array) -> None:
    """One step of the explicit trapezoidal rule in place for the first ``count`` states, the command running linearly."""
    before, after, guess = work[0], work[1], work[2]
    gas_rates(u_start, supply, y, par, before)
    force_rates(y, par, before)
    for i in range(count):
        guess[i] = y[i] + h * before[i]
    for i in range(count, at.STATES):
        guess[i] = y[i]
    gas_rates(u_end, supply, guess, par, after)
    force_rates(guess, par, after)
    for i in range(count):
        y[i] += 0.5 * h * (before[i] + after[i])


@compiled
def memories(y: Array, h: float, par: Array) -> None:
    """Friction's memories over ``h`` seconds at the piston's place and speed in the bore."""
    remember(y[at.X] - y[at.BODY_X], y[at.V] - y[at.BODY_V], y, h, par)


@entry
def advance(y: Array, u_start: float, u_end: float, supply: float, duration: float, substeps: int, par: Array) -> None:
    """Move the state ``y`` in place by ``duration`` seconds in ``substeps`` equal steps.

    The command [V] runs linearly from ``u_start`` to ``u_end``; ``supply`` is the regulated supply
    pressure (absolute Pa). Callable from compiled controllers.
    """
    work = np.zeros((3, at.STATES))
    count = at.FLOWING_STATES if par[at.EXTENDED] != 0.0 else at.PLAIN_STATES
    h = duration / substeps
    slope = (u_end - u_start) / substeps
    if par[at.H_LAG] == 0.0:
        y[at.SPOOL] = u_end
    if par[at.H_DROOP] == 0.0:
        y[at.PSUP] = supply
    memories(y, 0.5 * h, par)
    for k in range(substeps):
        heun(y, u_start + k * slope, u_start + (k + 1) * slope, supply, h, count, par, work)
        if par[at.H_HYSTERESIS] != 0.0:
            take_up_play(y[at.SPOOL] if par[at.H_LAG] != 0.0 else u_start + (k + 1) * slope, y, par)
        if par[at.H_CUSHION] != 0.0:
            merge_ring(0, y[at.X] - y[at.BODY_X], y, par)
            merge_ring(1, par[at.STROKE] - y[at.X] + y[at.BODY_X], y, par)
        memories(y, h if k < substeps - 1 else 0.5 * h, par)
