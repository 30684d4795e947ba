"""Pressure in a chamber: polytropic filling and emptying of a changing volume."""

from __future__ import annotations

from pneuid.physics.gas import R_AIR
from pneuid.physics.smoothing import Expression


def pressure_rate(
    p: Expression, V: Expression, V_rate: Expression, mdot: Expression, n: Expression, T: Expression
) -> Expression:
    """``dp/dt`` in Pa/s of a chamber with absolute pressure ``p``, volume ``V`` and inflow ``mdot`` (kg/s).

    One exponent ``n`` (1 isothermal, 1.4 adiabatic) stands for the unmodelled heat exchange; the gas that flows in
    or out is at ambient ``T``. Source: mass balance of an ideal gas with ``p V^n`` held for the work term.
    """
    return n / V * (R_AIR * T * mdot - p * V_rate)
