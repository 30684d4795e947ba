"""A valve whose two sides do not pass the same flow."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges, closed_part
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, clause 5 (each flow path has its own conductance); Beater, Pneumatic Drives 2007, chapter 5"

_LEAST = 0.02
"""Smallest share of an edge's conductance."""


class ValveAsymmetry(Effect):
    """Edges of ``C (1 + a (1 + e + t))`` (P-1), ``C (1 + a (1 - e - t))`` (2-R), ``C (1 - a (1 - e + t))`` (P-2) and
    ``C (1 - a (1 + e - t))`` (1-R) at full opening.

    Those used above null open by ``s (1 - c (1 + m) (1 - s))``, those below by ``s (1 + c (1 - m) (1 - s))``. ``a`` is half the
    relative difference between the edges used above null and those used below; of that size ``e`` sets the supply edges apart
    from the exhaust edges, and ``t`` those of port 1 from those of port 2. ``c`` is half the difference between the bends with
    which the notches of the two sides grow, ``m`` how much more of it one side has: with 1 the edges used above null bend
    alone, with -1 those below. Typical: a 2 to 10 %, c up to 0.2.
    """

    name = "valve_asymmetry"
    mechanism = "the metering edges for the two directions differ, so that the same command passes different flows"
    equation = "valve"
    reference = _SOURCE
    experiment = "strokes in both directions with equal commands of both signs"
    confused_with = ("valve_offset",)
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half the differences of the two sides, in conductance and in bend, and how unlike sides and the edges of one are."""
        return (
            Parameter("asymmetry", "a_v", "1", -0.8, 0.8, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("asymmetry_curve", "c_v", "1", -0.5, 0.5, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("asymmetry_bent", "m_v", "1", -1.0, 1.0, 0.0, 0.3, _SOURCE, prior=0.5),
            Parameter("asymmetry_supply", "e_v", "1", -2.0, 2.0, 0.0, 1.0, _SOURCE, prior=0.5),
            Parameter("asymmetry_port", "t_v", "1", -2.0, 2.0, 0.0, 1.0, _SOURCE, prior=0.5),
        )

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Widen the paths of one direction by what those of the other lose, and bend them the other way."""
        a, e, t = scope.p.asymmetry, scope.p.asymmetry_supply, scope.p.asymmetry_port
        c, m = scope.p.asymmetry_curve, scope.p.asymmetry_bent
        shut = closed_part(scope.opening)
        above, below = 1.0 - c * (1.0 + m) * shut, 1.0 + c * (1.0 - m) * shut
        return replace(
            edges,
            supply_1=_of(1.0 + a * (1.0 + e + t)) * edges.supply_1 * above,
            exhaust_2=_of(1.0 + a * (1.0 - e - t)) * edges.exhaust_2 * above,
            supply_2=_of(1.0 - a * (1.0 - e + t)) * edges.supply_2 * below,
            exhaust_1=_of(1.0 - a * (1.0 + e - t)) * edges.exhaust_1 * below,
        )


def _of(share: Expression) -> Expression:
    """An edge's share of the conductance, which a solver's trial point may take below zero."""
    return ca.fmax(share, _LEAST)
