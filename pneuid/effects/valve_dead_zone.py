"""Dead zone of an overlapped spool."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import positive_part
from pneuid.rig import Rig

_SOURCE = "Valdiero, Ritter, Rios, Rafikov, Math. Problems in Engineering 2011, 351456, eq. (1)"


class ValveDeadZone(Effect):
    """Opening 0 while ``-d (1 - a) < s < d (1 + a)``, beyond in proportion to what is left, edges rounded over ``e d``.

    Laps are never quite equal, nor sharp: a port is round, an edge chamfered. At full command both sides are open as far, by
    ``1 - d``.
    """

    name = "valve_dead_zone"
    mechanism = "the spool's lands overlap the ports, so that small commands open nothing"
    equation = "valve"
    reference = _SOURCE
    experiment = "small steps of the command around null"
    confused_with = ("valve_hysteresis",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Mean half-width relative to full scale; by which share of it the two laps differ from it, and are rounded."""
        return (
            Parameter("dead_zone", "d", "1", 0.0, 0.5, 0.0, 0.02, _SOURCE, off=0.0),
            Parameter("lap_skew", "a", "1", -0.5, 0.5, 0.0, 0.1, _SOURCE, prior=0.15),
            Parameter("lap_edge", "e", "1", 1e-3, 1.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.0),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Soft threshold, exact at ``d = 0`` where the two parts cancel."""
        p = scope.p
        width = ca.sqrt(scope.smoothing.opening**2 + (p.lap_edge * p.dead_zone) ** 2)
        above, below = p.dead_zone * (1.0 + p.lap_skew), p.dead_zone * (1.0 - p.lap_skew)
        up, down = positive_part(opening - above, width), positive_part(-opening - below, width)
        return (1.0 - p.dead_zone) * (up / (1.0 - above) - down / (1.0 - below))
