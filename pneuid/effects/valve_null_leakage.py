"""Leakage of the spool around its null."""

from __future__ import annotations

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

_SOURCE = "Eryilmaz, Wilson, J. Franklin Institute 343 (2006) 48 (leakage of a spool's edges, falling with overlap)"


class ValveNullLeakage(Effect):
    """Each edge opens by ``l / (1 + (o/w)^2)`` more, ``o`` its opening, and while it is covered by ``l / (1 + (c/k)^2)``.

    ``c`` is how far the spool covers it, the opening of the other side. The clearance of an open edge, ``sqrt(o^2 + l^2)``
    beside ``o``, is soon lost in the opening itself; the gap under a land that covers its port only becomes longer, so ``k``
    exceeds ``w``. The edges of the supply have ``1 + a`` times that, those of the exhaust ``1 - a`` times.
    """

    name = "valve_null_leakage"
    mechanism = "the clearance of the spool lets air pass all four edges while it is near null"
    equation = "valve"
    reference = _SOURCE
    experiment = "dwells with the valve at null, one chamber vented and one under pressure before"
    confused_with = ("leakage_external_1", "leakage_external_2", "leakage_internal", "valve_dead_zone")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Opening at null, half a percent to a few, the opening and cover at which half is left, how the edges differ."""
        return (
            Parameter("null_leak", "l_n", "1", 0.0, 0.3, 0.0, 5e-3, _SOURCE, off=0.0),
            Parameter("null_width", "w_n", "1", 5e-3, 1.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("null_cover", "k_n", "1", 5e-3, 1.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("null_skew", "a_n", "1", -0.9, 0.9, 0.0, 0.2, _SOURCE, prior=0.3),
        )

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Open every edge a little."""
        p, opened = scope.p, (scope.opening_1, scope.opening_2)
        one, two = (
            p.null_leak / ((1.0 + (own / p.null_width) ** 2) * (1.0 + (other / p.null_cover) ** 2))
            for own, other in (opened, opened[::-1])
        )
        more, less = 1.0 + p.null_skew, 1.0 - p.null_skew
        return Edges(
            edges.supply_1 + more * one, edges.supply_2 + more * two, edges.exhaust_1 + less * two, edges.exhaust_2 + less * one
        )  # fmt: skip
