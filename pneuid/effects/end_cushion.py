"""Pneumatic end-position cushioning: near an end the air leaves through a throttle."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import positive_part
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter on linear drives (end-position cushioning)"

_EDGE = 0.15
"""Share of the cushion's length over which the spigot closes the free passage."""


class EndCushion(Effect):
    """Outflow of the chamber that the piston runs into times ``1 - a s``, ``s`` rising to 1 within ``L`` of the end.

    ``s = 1/(1 + exp((distance - L)/(0.15 L)))``; a check valve lets air in unhindered. ``a1`` acts at the cap end (chamber
    1), ``a2`` at the rod end (chamber 2). Typical: a 0.7 to 0.98, L 10 to 30 mm.
    """

    name = "end_cushion"
    mechanism = "near the end of stroke a spigot shuts the port and the air can leave through a needle throttle alone"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "fast strokes into both ends"
    confused_with = ("valve_asymmetry",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Share of the outflow that is shut off at each end, and the length over which it is."""
        return (
            Parameter("cushion_1", "a_1", "1", 0.0, 0.999, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("cushion_2", "a_2", "1", 0.0, 0.999, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("L_cushion", "L", "m", 2e-3, 0.1, 0.025, 1.0, _SOURCE, positive=True, prior=0.7),
        )

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Give back to each chamber the share of its outflow that the throttle stops."""
        length, rounding = scope.p.L_cushion, scope.smoothing.opening * scope.full_flow

        def stopped(share: Expression, distance: Expression, mdot: Expression) -> Expression:
            shut = 0.5 * (1.0 - ca.tanh((distance - length) / (2 * _EDGE * length)))
            return share * shut * positive_part(-mdot, rounding)

        return (
            mdot1 + stopped(scope.p.cushion_1, scope.x, mdot1),
            mdot2 + stopped(scope.p.cushion_2, scope.rig.stroke - scope.x, mdot2),
        )
