"""Leakage of chamber 2 to the outside."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.leak import SOURCE, leak_outside
from pneuid.rig import Rig


class LeakageExternal2(Effect):
    """Mass flow from chamber 2 to the atmosphere that grows with a power ``m_l2`` of ``p2^2 - patm^2``.

    An orifice or a scratch passes its root (m = 1/2), a laminar gap as much as the difference (m = 1), a lip that the pressure
    lifts more steeply. ``C_l2`` is the sonic conductance of an orifice that passes as much at 5 bar absolute.
    """

    name = "leakage_external_2"
    mechanism = "the rod seal, a fitting or a tube of the rod-side chamber lets air out to the surroundings"
    equation = "flow_2"
    reference = SOURCE
    experiment = "dwells with the valve closed and the chamber under pressure"
    confused_with = ("leakage_internal", "valve_null_leakage")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Conductance of the leak, typical scale one percent of the valve's, and its exponent."""
        scale = 0.01 * rig.conductance
        return (
            Parameter("C_leak_2", "C_l2", "m^3/(s*Pa)", 0.0, 100 * scale, 0.0, scale, SOURCE, off=0.0),
            Parameter("m_leak_2", "m_l2", "1", 0.35, 1.6, 0.7, 0.1, SOURCE, prior=0.25),
        )

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Take the leak from the flow into chamber 2."""
        leak = leak_outside(scope.p2, scope.rig.patm, scope.p.C_leak_2, scope.p.m_leak_2)
        return mdot1, mdot2 - leak
