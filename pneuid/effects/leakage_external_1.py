"""Leakage of chamber 1 to the outside."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics import valve
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, eq. (1); Beater, Pneumatic Drives (Springer 2007), chapter 4 (leakage)"

_NOZZLE = 0.528
"""Critical pressure ratio of an ideal nozzle; a leak's own is not known and hardly matters."""


class LeakageExternal1(Effect):
    """Mass flow of an orifice of conductance ``C_l1`` from chamber 1 to the atmosphere."""

    name = "leakage_external_1"
    mechanism = "a fitting, a tube or the cap gasket of the cap-side chamber lets air out to the surroundings"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "dwells with the valve closed and the chamber under pressure"
    confused_with = ("leakage_internal", "valve_null_leakage")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Sonic conductance of the leak; typical scale one percent of the valve's."""
        scale = 0.01 * rig.conductance
        return (Parameter("C_leak_1", "C_l1", "m^3/(s*Pa)", 0.0, 100 * scale, 0.0, scale, _SOURCE, off=0.0),)

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Take the leak from the flow into chamber 1."""
        rig = scope.rig
        leak = valve.mass_flow(scope.p1, rig.patm, scope.p.C_leak_1, _NOZZLE, rig.T, scope.smoothing.laminar)
        return mdot1 - leak, mdot2
