"""Air that enters a chamber heats it more than air that leaves cools it."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.physics.smoothing import sign
from pneuid.rig import Rig

_SOURCE = (
    "Richer, Hurmuzlu, ASME J. Dyn. Syst. Meas. Control 122 (2000) 416 (exponents of their own for charging, up to 1.4, and "
    "discharging, down to 1)"
)


class InletMixing(Effect):
    """``dp/dt += Delta_n s R T mdot / V``: exponent ``n + Delta_n`` for air that enters, ``n - Delta_n`` for air that leaves.

    ``s = mdot / sqrt(mdot^2 + (q mdot_f)^2)``: a jet stirs the gas only from some flow on, a share ``q`` of the choked flow
    ``mdot_f`` from the nominal supply through the fully open valve. The mean of both stands in the valve's conductance.
    """

    name = "inlet_mixing"
    mechanism = (
        "air enters as a jet with its own enthalpy but leaves after it has mixed and given heat to the wall, so that "
        "charging raises the pressure more than discharging lowers it"
    )
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "large steps that charge and vent either chamber at the same flows"
    confused_with = ("exhaust_restriction", "heat_transfer", "valve_critical_ratio")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half the difference of the two exponents, both between isothermal 1 and adiabatic 1.4, and the flow that stirs."""
        return (
            Parameter("mixing", "Δn", "1", 0.0, 0.4, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("mixing_flow", "q", "1", 1e-3, 1.0, 0.03, 1.0, _SOURCE, positive=True, prior=1.0),
        )

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Add to both chambers what the two exponents differ by, whichever way the air goes."""
        width, strength = scope.p.mixing_flow * scope.full_flow, scope.p.mixing * R_AIR * scope.rig.T
        one, two = (mdot * sign(mdot, width) / V for mdot, V in ((scope.mdot1, scope.V1), (scope.mdot2, scope.V2)))
        return rate1 + strength * one, rate2 + strength * two
