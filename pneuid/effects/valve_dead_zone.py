"""Dead zone of an overlapped spool."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import positive_part
from pneuid.rig import Rig

_SOURCE = "Valdiero, Ritter, Rios, Rafikov, Math. Problems in Engineering 2011, 351456, eq. (1)"


class ValveDeadZone(Effect):
    """Opening 0 while ``|s| < d``, ``|s| - d`` beyond."""

    name = "valve_dead_zone"
    mechanism = "the spool's lands overlap the ports, so that small commands open nothing"
    equation = "valve"
    reference = _SOURCE
    experiment = "small steps of the command around null"
    confused_with = ("valve_hysteresis",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half-width relative to full scale."""
        return (Parameter("dead_zone", "d", "1", 0.0, 0.5, 0.0, 0.02, _SOURCE, off=0.0),)

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Soft threshold, exact at ``d = 0`` where the two parts cancel."""
        width, d = scope.smoothing.opening, scope.p.dead_zone
        return positive_part(opening - d, width) - positive_part(-opening - d, width)
