"""Leakage across the piston."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import RHO_REFERENCE
from pneuid.physics.leak import SOURCE, squares_power
from pneuid.rig import Rig

_REFERENCE = 1e6
"""Pressure in Pa by which the squares are scaled: about the sum of both chambers' pressures, so that a laminar gap passes about
``G_leak`` times their difference."""


class LeakageInternal(Effect):
    """Mass flow that grows with a power ``m`` of ``p1^2 - p2^2`` from chamber 1 to chamber 2.

    A compressible gas passes a laminar gap in proportion to that difference (m = 1), lands and scores like a row of throttles
    with its root (m = 1/2); a seal's leak lies between.
    """

    name = "leakage_internal"
    mechanism = "a worn piston seal lets air pass from the chamber of higher pressure to the other"
    equation = "flow_1"
    reference = SOURCE
    experiment = "dwells under load with the valve closed"
    confused_with = ("leakage_external_1", "leakage_external_2")
    rigs = ("servo",)
    guarantees = ("conserves mass",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The leak's conductance, typical scale one percent of the valve's, and its exponent."""
        scale = 0.01 * rig.conductance * RHO_REFERENCE
        return (
            Parameter("G_leak", "G_l", "kg/(s*Pa)", 0.0, 100 * scale, 0.0, scale, SOURCE, off=0.0),
            Parameter("m_leak", "m_l", "1", 0.35, 1.6, 0.7, 0.1, SOURCE, prior=0.25),
        )

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Take from one chamber what the other gets."""
        leak = scope.p.G_leak * _REFERENCE * squares_power(scope.p1, scope.p2, _REFERENCE, scope.p.m_leak)
        return mdot1 - leak, mdot2 + leak
