"""Leakage across the piston."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import RHO_REFERENCE
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 4 (laminar gap flow between chambers)"


class LeakageInternal(Effect):
    """Mass flow ``G (p1 - p2)`` from chamber 1 to chamber 2."""

    name = "leakage_internal"
    mechanism = "a worn piston seal lets air pass from the chamber of higher pressure to the other"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "dwells under load with the valve closed"
    confused_with = ("leakage_external_1", "leakage_external_2")
    rigs = ("servo",)
    guarantees = ("conserves mass",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The leak's conductance; typical scale one percent of the valve's."""
        scale = 0.01 * rig.conductance * RHO_REFERENCE
        return (Parameter("G_leak", "G_l", "kg/(s*Pa)", 0.0, 100 * scale, 0.0, scale, _SOURCE, off=0.0),)

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Take from one chamber what the other gets."""
        leak = scope.p.G_leak * (scope.p1 - scope.p2)
        return mdot1 - leak, mdot2 + leak
