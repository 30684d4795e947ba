"""Proportional 5/3 valve: command to opening, opening and pressures to mass flow."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from pneuid.physics.gas import RHO_REFERENCE, T_REFERENCE
from pneuid.physics.smoothing import Expression, Smoothing, positive_part

ELLIPSE = 0.5
"""Subsonic index with which the flow function is a quarter ellipse."""


def flow_function(ratio: Expression, b: Expression, laminar: Expression, m: Expression = ELLIPSE) -> Expression:
    """ISO 6358-1 flow function ``psi`` of the pressure ratio, with a linear patch next to ratio 1.

    Parameters: ``ratio`` = p_down/p_up in 0..1; ``b`` critical pressure ratio in 0..1; ``laminar`` width of the patch;
    ``m`` subsonic index. Returns 1 in choked flow, falling to 0 at ratio 1. Source: ISO 6358-1:2013, eq. (1) and (2);
    the patch keeps the slope finite where the standard's curve is vertical.
    """
    edge = 1.0 - laminar
    per = 1.0 / (1.0 - b)

    def curve(at: Expression) -> Expression:
        inside = 1.0 - ((at - b) * per) ** 2
        return ca.sqrt(inside) if isinstance(m, float) and m == ELLIPSE else inside**m

    # the power's argument is kept positive so that the branch not taken has a finite derivative
    subsonic = curve(ca.fmin(ca.fmax(ratio, b), edge))
    return ca.if_else(ratio < edge, subsonic, curve(edge) / laminar * (1.0 - ratio))


def squared_share(ratio: Expression, b: Expression) -> Expression:
    """Squared share (0..1) of the choked flow at a pressure ratio, by the quarter ellipse of ISO 6358-1:2013, eq. (2).

    Without the patch of ``flow_function``: for quotients of flows, whose limit at ratio 1 the caller knows.
    """
    beyond = ca.fmax(ratio - b, 0.0) / (1.0 - b)
    return ca.fmax(1.0 - beyond * beyond, 0.0)


def mass_flow(
    p_from: Expression, p_to: Expression, C: Expression, b: Expression, T: Expression, laminar: Expression,
    m: Expression = ELLIPSE,
) -> Expression:  # fmt: skip
    """Mass flow in kg/s from absolute pressure ``p_from`` to ``p_to`` (Pa) through conductance ``C`` (m^3/(s Pa)).

    Negative when ``p_to`` is the higher one (back-flow). ``T`` is the upstream temperature in K; ``b`` and ``m`` as in
    ``flow_function``. Source: ISO 6358-1:2013, eq. (1).
    """
    up, down = ca.fmax(p_from, p_to), ca.fmin(p_from, p_to)
    size = C * RHO_REFERENCE * ca.sqrt(T_REFERENCE / T) * up * flow_function(down / up, b, laminar, m)
    return ca.if_else(p_from >= p_to, size, -size)


def relative_command(u: Expression, null: Expression, full_scale: Expression) -> Expression:
    """Signed relative spool command: +1 opens supply to chamber 1 fully, -1 supply to chamber 2 (u in V)."""
    return (u - null) / full_scale


@dataclass(frozen=True)
class Edges:
    """Openings of the four metering edges, 1 for the conductance ``C``: supply to chamber, chamber to exhaust."""

    supply_1: Expression
    supply_2: Expression
    exhaust_1: Expression
    exhaust_2: Expression


_ROUND = 0.01
"""Opening below which its size is rounded."""


def closed_part(opening: Expression) -> Expression:
    """By how much a spool is short of full command, 1 at null and 0 at full command, for curves that end at full opening."""
    return 1.0 - ca.sqrt((ca.fmin(opening**2, 1.0) + _ROUND**2) / (1.0 + _ROUND**2))


def edges(opening: Expression, smoothing: Smoothing) -> tuple[Expression, Expression]:
    """Openings (0..1) of the edges that pressurise chamber 1 and chamber 2, from the signed opening."""
    limited = ca.fmin(ca.fmax(opening, -1.0), 1.0)
    return positive_part(limited, smoothing.opening), positive_part(-limited, smoothing.opening)
