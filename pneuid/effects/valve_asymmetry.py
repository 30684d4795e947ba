"""A valve whose two sides do not pass the same flow."""

from __future__ import annotations

from dataclasses import replace

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, clause 5 (each flow path has its own conductance); Beater, Pneumatic Drives 2007, chapter 5"


class ValveAsymmetry(Effect):
    """Conductance ``C (1 + a)`` of the edges used above null, ``C (1 - a)`` of those used below, up to full opening."""

    name = "valve_asymmetry"
    mechanism = "the metering edges for the two directions differ, so that the same command passes different flows"
    equation = "valve"
    reference = _SOURCE
    experiment = "strokes in both directions with equal commands of both signs"
    confused_with = ("valve_offset",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half the relative difference of the two sides."""
        return (Parameter("asymmetry", "a_v", "1", -0.8, 0.8, 0.0, 0.05, _SOURCE, off=0.0),)

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Widen the paths of one direction by what those of the other lose."""
        up, down = 1.0 + scope.p.asymmetry, 1.0 - scope.p.asymmetry
        return replace(
            edges,
            supply_1=up * edges.supply_1,
            exhaust_2=up * edges.exhaust_2,
            supply_2=down * edges.supply_2,
            exhaust_1=down * edges.exhaust_1,
        )
