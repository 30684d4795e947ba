"""Flow through the gaps of a seal: a power of the difference of the squared pressures."""

from __future__ import annotations

from pneuid.physics.gas import RHO_REFERENCE
from pneuid.physics.smoothing import Expression

SOURCE = (
    "Beater, Pneumatic Drives (Springer 2007), chapter 4 (laminar gap, m = 1); Stodola, Steam and Gas Turbines (1927), "
    "flow through rows of throttles (m = 1/2)"
)

_LAMINAR = 0.01
"""Difference of the squares, scaled, below which every leak is laminar: some 12 kPa between chambers at 4 bar for 1 MPa."""

_OUTSIDE = 5e5
"""Absolute pressure in Pa at which a leak to the outside passes about what a choked orifice of its conductance does."""


def leak_outside(p: Expression, patm: Expression, C: Expression, m: Expression) -> Expression:
    """Mass flow in kg/s from a chamber at ``p`` to the outside at ``patm`` (Pa, absolute), of exponent ``m``.

    C : m^3/(s Pa), sonic conductance of an orifice (ISO 6358-1) that passes as much at 5 bar absolute.
    """
    return C * RHO_REFERENCE * _OUTSIDE * squares_power(p, patm, _OUTSIDE, m)


def squares_power(p_from: Expression, p_to: Expression, reference: float, m: Expression) -> Expression:
    """``(p_from^2 - p_to^2) / reference^2`` to the power ``m``, signed, and in proportion to that difference next to zero.

    Pressures and ``reference`` in Pa, absolute. A gas passes a laminar gap in proportion to the difference (m = 1),
    lands and scores like a row of throttles, or an orifice, with its root (m = 1/2); a lip that the pressure lifts, faster.
    """
    apart = (p_from - p_to) * (p_from + p_to) / reference**2
    return apart * (apart * apart + _LAMINAR**2) ** (0.5 * (m - 1.0))
