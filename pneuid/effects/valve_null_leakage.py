"""Leakage of the spool around its null."""

from __future__ import annotations

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

_SOURCE = "Eryilmaz, Wilson, J. Franklin Institute 343 (2006) 48 (leakage of a spool's edges, falling with overlap)"


class ValveNullLeakage(Effect):
    """All four edges open by ``l / (1 + (s/w)^2)`` more, ``s`` the signed opening."""

    name = "valve_null_leakage"
    mechanism = "the clearance of the spool lets air pass all four edges while it is near null"
    equation = "valve"
    reference = _SOURCE
    experiment = "dwells with the valve at null, one chamber vented and one under pressure before"
    confused_with = ("leakage_external_1", "leakage_external_2", "leakage_internal", "valve_dead_zone")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Opening at null, half a percent to a few percent, and the opening at which half of it is left."""
        return (
            Parameter("null_leak", "l_n", "1", 0.0, 0.3, 0.0, 5e-3, _SOURCE, off=0.0),
            Parameter("null_width", "w_n", "1", 5e-3, 1.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.0),
        )

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Open every edge a little."""
        ratio = (scope.opening_1 - scope.opening_2) / scope.p.null_width
        leak = scope.p.null_leak / (1.0 + ratio * ratio)
        return Edges(edges.supply_1 + leak, edges.supply_2 + leak, edges.exhaust_1 + leak, edges.exhaust_2 + leak)
