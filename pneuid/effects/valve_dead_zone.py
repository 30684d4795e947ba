"""Dead zone of an overlapped spool."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import positive_part
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

_SOURCE = "Valdiero, Ritter, Rios, Rafikov, Math. Problems in Engineering 2011, 351456, eq. (1)"

_MOST = 0.9
"""Largest share of full scale that a lap takes at a solver's trial point."""


class ValveDeadZone(Effect):
    """No edge is open while ``-d (1 - a) < s < d (1 + a)``, beyond each is in proportion to what is left, rounded over ``e d``.

    Laps are never quite equal, nor sharp: a port is round, an edge chamfered. Those of the edges are ``d (1 + a + f + t)``
    (P-1), ``d (1 + a - f - t)`` (2-R), ``d (1 - a + f - t)`` (P-2) and ``d (1 - a - f + t)`` (1-R): ``a`` sets above null apart
    from below, ``f`` supply from exhaust, ``t`` port 1 from port 2. At full command all are open as far, by ``1 - d``.
    """

    name = "valve_dead_zone"
    mechanism = "the spool's lands overlap the ports, so that small commands open nothing"
    equation = "valve"
    reference = _SOURCE
    experiment = "small steps of the command around null"
    confused_with = ("valve_hysteresis",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Mean half-width relative to full scale; by which share of it the laps differ from it, and are rounded."""
        return (
            Parameter("dead_zone", "d", "1", 0.0, 0.5, 0.0, 0.02, _SOURCE, off=0.0),
            Parameter("lap_skew", "a", "1", -0.5, 0.5, 0.0, 0.1, _SOURCE, prior=0.15),
            Parameter("lap_supply", "f", "1", -0.5, 0.5, 0.0, 0.1, _SOURCE, prior=0.1),
            Parameter("lap_port", "t", "1", -0.5, 0.5, 0.0, 0.1, _SOURCE, prior=0.1),
            Parameter("lap_edge", "e", "1", 1e-3, 1.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.0),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """The mean of the two edges of a side: a soft threshold, exact at ``d = 0`` where the two parts cancel."""
        skew = scope.p.lap_skew
        return _past(opening, 1.0 + skew, scope) - _past(-opening, 1.0 - skew, scope)

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """By how much each edge is open more than the mean of its side."""
        p, s = scope.p, ca.fmin(ca.fmax(scope.opening, -1.0), 1.0)
        one, two = p.lap_supply + p.lap_port, p.lap_supply - p.lap_port

        def more(towards: Expression, mean: Expression, beyond: Expression) -> Expression:
            return _past(towards, mean + beyond, scope) - _past(towards, mean, scope)

        up, down = 1.0 + p.lap_skew, 1.0 - p.lap_skew
        # the mean of a side is a rounded corner less what the other side has of its own: near null that is below zero
        return Edges(
            supply_1=ca.fmax(edges.supply_1 + more(s, up, one), 0.0),
            exhaust_2=ca.fmax(edges.exhaust_2 + more(s, up, -one), 0.0),
            supply_2=ca.fmax(edges.supply_2 + more(-s, down, two), 0.0),
            exhaust_1=ca.fmax(edges.exhaust_1 + more(-s, down, -two), 0.0),
        )


def _past(towards: Expression, lap: Expression, scope: Scope) -> Expression:
    """Opening of an edge whose lap is ``lap`` times the mean half-width, ``1 - d`` at full command."""
    d = scope.p.dead_zone
    covered = ca.fmin(d * lap, _MOST)
    width = ca.sqrt(scope.smoothing.opening**2 + (scope.p.lap_edge * d) ** 2)
    return (1.0 - d) / (1.0 - covered) * positive_part(towards - covered, width)
