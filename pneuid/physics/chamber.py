"""Pressure in a chamber: polytropic filling and emptying of a changing volume."""

from __future__ import annotations

import casadi as ca

from pneuid.physics.gas import CV_AIR, GAMMA_AIR, R_AIR
from pneuid.physics.smoothing import Expression


def pressure_rate(
    p: Expression, V: Expression, V_rate: Expression, mdot: Expression, n: Expression, T: Expression
) -> Expression:
    """``dp/dt`` in Pa/s of a chamber with absolute pressure ``p``, volume ``V`` and inflow ``mdot`` (kg/s).

    One exponent ``n`` (1 isothermal, 1.4 adiabatic) stands for the unmodelled heat exchange; the gas that flows in
    or out is at ambient ``T``. Source: mass balance of an ideal gas with ``p V^n`` held for the work term.
    """
    return n / V * (R_AIR * T * mdot - p * V_rate)


def wall_area(V: Expression, A: Expression) -> Expression:
    """Wall of a cylindrical chamber of volume ``V`` (m^3) and bore area ``A`` (m^2): both ends and the mantle, m^2."""
    return 2.0 * A + 2.0 * ca.sqrt(ca.pi / A) * V


def temperature_relaxation(
    excess: Expression,
    p: Expression,
    V: Expression,
    V_rate: Expression,
    filling: Expression,
    emptying: Expression,
    wall: Expression,
    T: Expression,
) -> tuple[Expression, Expression]:
    """Source (K/s) and decay (1/s, positive) of the gas temperature's ``excess`` (K) over that of the surroundings, ``T``.

    ``d excess/dt = source - decay excess``. filling, emptying : mass flows in (at ``T``) and out, kg/s, both positive; wall :
    conductance to walls at ``T``, W/K; p, V, V_rate : Pa, m^3, m^3/s. Source: mass and energy balance of an ideal gas in an
    open volume, the full-order model of Carneiro and de Almeida, Proc. IMechE Part I 220 (2006) 301.
    """
    absolute = ca.fmax(T + excess, 0.3 * T)
    mass = p * V / (R_AIR * absolute)
    warming = (GAMMA_AIR - 1.0) * (T * (filling - emptying) / mass - absolute * V_rate / V)
    return warming, (filling + (GAMMA_AIR - 1.0) * emptying) / mass + wall / (mass * CV_AIR)


def temperature_pressure_rate(excess: Expression, V: Expression, emptying: Expression, wall: Expression) -> Expression:
    """What ``excess`` of the gas temperature adds to the adiabatic ``pressure_rate`` (n = 1.4, gas at ambient), Pa/s.

    Air leaves at its own temperature and heat passes to the wall; arguments as in ``temperature_relaxation``.
    """
    return -(GAMMA_AIR * R_AIR * emptying + (GAMMA_AIR - 1.0) * wall) * excess / V


_STATED_AT, _LEAST, _TURBULENT = 4.0e5, 1.0e4, 1.0e4
"""Absolute pressure in Pa at which a throttle's time constant is stated, the least that counts, and the difference in Pa beyond
which an orifice lets through less than in proportion to it."""


def through_throttle(p: Expression, gap: Expression, tau: Expression, orifice: Expression) -> Expression:
    """Rate in 1/s at which a closed volume behind a throttle makes up the ``gap`` (Pa) by which it is behind ``p`` (Pa).

    1/tau (s) at 4 bar and a small gap. orifice : 0 for a capillary, whose flow goes with the difference of the squares; 1 for a
    sharp edge, whose flow goes with the roots of pressure and difference.
    """
    dense = ca.fmax(p - 0.5 * gap, _LEAST) / _STATED_AT
    return dense ** (1.0 - 0.5 * orifice) / (1.0 + (gap / _TURBULENT) ** 2) ** (0.25 * orifice) / tau
