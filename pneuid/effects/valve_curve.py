"""Ports whose area is not in proportion to the spool's travel."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges, closed_part
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives 2007, chapter 5 (flow characteristics of proportional valves: round holes, notches, slots)"

_LEAST = 0.02
"""Smallest share of its proportional opening that an edge keeps."""


class ValveCurve(Effect):
    """An edge opens by ``s (1 - c (1 + e) (1 - s) (1 + q (2 s - 1)))`` (supply; exhaust with ``1 - e``), both sides alike.

    ``s`` is the opening of a valve with slots, in proportion to the command; all end at full opening. With ``c > 0`` the curve
    is progressive, as of round holes opened from their edge and of notches; with ``c < 0`` degressive, as of holes opened from
    their middle. ``q`` moves the bend towards null (below zero) or towards full command. Typical: c up to 0.3 either way.
    """

    name = "valve_curve"
    mechanism = "the ports are no slots: their area grows faster, or slower, than in proportion to the command, both ways alike"
    equation = "valve"
    reference = _SOURCE
    experiment = "the same strokes at a tenth, half and full command, both ways"
    confused_with = ("valve_dead_zone", "valve_flow_force", "line_delay", "exhaust_restriction", "supply_droop")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Bend of the curve, how far supply and exhaust edges differ in it, and whether it bends near null or near full."""
        return (
            Parameter("curve", "c_u", "1", -0.9, 0.9, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("curve_supply", "e_u", "1", -1.0, 1.0, 0.0, 0.3, _SOURCE, prior=0.3),
            Parameter("curve_shape", "q_u", "1", -1.0, 1.0, 0.0, 0.3, _SOURCE, prior=0.5),
        )

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Open every edge by less or more than in proportion, until full command."""
        p, short = scope.p, closed_part(scope.opening)
        bend = p.curve * short * (1.0 + p.curve_shape * (1.0 - 2.0 * short))
        supply, exhaust = (ca.fmax(1.0 - (1.0 + side) * bend, _LEAST) for side in (p.curve_supply, -p.curve_supply))
        return replace(
            edges,
            supply_1=supply * edges.supply_1,
            supply_2=supply * edges.supply_2,
            exhaust_1=exhaust * edges.exhaust_1,
            exhaust_2=exhaust * edges.exhaust_2,
        )
