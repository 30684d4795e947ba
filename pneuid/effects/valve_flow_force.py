"""Forces of flow and pressures on a spool whose position nobody controls."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Lee, Blackburn, Trans. ASME 74 (1952) 1005 (the momentum of the jets closes the spool, in proportion to opening and "
    "pressure drop); Beater, Pneumatic Drives 2007, chapter 5 (directly operated valves)"
)

_STATED_AT = 4.0e5
"""Pressure in Pa by which drops and differences are measured."""

_ROUND = 0.02
"""Opening below which the sides that are open pass into one another."""

_LEAST = 5.0e3
"""Drop in Pa below which its power is rounded."""


class ValveFlowForce(Effect):
    """The spool stands at ``(s + k (p1 - p2)/4 bar) / (1 + f (D/4 bar)^e)``, ``s`` its commanded opening.

    ``D = (1 + a) D_s + (1 - a) D_e`` has the drops over the two edges that are open: with ``s > 0`` those from the supply to
    chamber 1, ``psup - p1``, and from chamber 2 to the exhaust. Their jets pull the spool back against the magnet's force.
    ``k`` is what the pressures at the ports push on unequal faces of it. A valve that controls the position of its spool has
    neither. Typical: f 2 to 20 %, k up to 3 %.
    """

    name = "valve_flow_force"
    mechanism = "jets through the open edges pull back a spool without position control, and pressures at its ports push it"
    equation = "valve"
    reference = _SOURCE
    experiment = "the same strokes at low and high supply pressure, at half and full command"
    confused_with = ("leakage_internal", "valve_critical_ratio", "exhaust_restriction", "valve_asymmetry")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """How far jets close and a difference of 4 bar shifts the spool, the power of the drop, how the edges differ."""
        return (
            Parameter("flow_force", "f_v", "1", 0.0, 3.0, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("port_push", "k_v", "1", -0.5, 0.5, 0.0, 0.01, _SOURCE, off=0.0),
            Parameter("flow_force_power", "e_f", "1", 0.3, 3.0, 1.0, 1.0, _SOURCE, positive=True, prior=0.3),
            Parameter("flow_force_edges", "a_f", "1", -1.0, 1.0, 0.0, 0.3, _SOURCE, prior=0.5),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Shift the spool by the ports' pressures, and draw it back by the jets."""
        p, middle, apart = scope.p, 0.5 * (scope.p1 + scope.p2), 0.5 * (scope.p1 - scope.p2)
        pushed = opening + 2.0 * p.port_push * apart / _STATED_AT
        side = pushed / ca.sqrt(pushed * pushed + _ROUND**2)
        from_supply, to_exhaust = scope.psup - middle - side * apart, middle - scope.rig.patm - side * apart
        drop = (1.0 + p.flow_force_edges) * from_supply + (1.0 - p.flow_force_edges) * to_exhaust
        drop = 0.5 * (drop + ca.sqrt(drop * drop + _LEAST**2))
        return pushed / (1.0 + p.flow_force * (drop / _STATED_AT) ** p.flow_force_power)
