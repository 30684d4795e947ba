"""Silencers or throttles behind the valve's exhaust ports."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, eq. (1) and (2), with ISO 6358-3:2014 for components in series"

_LEVEL = 1.0e-3
"""Squared share of the choked flow below which an edge's flow counts as that between nearly equal pressures."""


class ExhaustRestriction(Effect):
    """Exhaust edge of opening ``s`` behind which a silencer lets a pressure ``p_b`` build up, ``r = (C / C_silencer)^2``.

    ``p_b^2 = (r s^2 p^2 + patm^2) / (1 + r s^2)``, where both let flow ``C sqrt(p_up^2 - p_down^2)`` through (ISO 6358 with
    b = 0), and once more with each one's own flow at that pressure. The edge keeps the share
    ``psi(p_b/p) / psi(patm/p)`` of its flow: all of it while ``p_b`` leaves it choked.
    """

    name = "exhaust_restriction"
    mechanism = "a clogged silencer or a throttle builds up back-pressure while a chamber is vented at high flow"
    equation = "valve"
    reference = _SOURCE
    experiment = "large fast steps that vent either chamber from high pressure"
    confused_with = ("supply_droop", "valve_critical_ratio", "inlet_mixing")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Squared ratio of the valve's conductance to the silencer's; 0.05 to 0.3 when clean."""
        return (Parameter("r_exhaust", "r_e", "1", 0.0, 25.0, 0.0, 0.1, _SOURCE, off=0.0),)

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Narrow both exhaust edges."""
        one, two = edges.exhaust_1, edges.exhaust_2
        return replace(edges, exhaust_1=one * _share(one, scope.p1, scope), exhaust_2=two * _share(two, scope.p2, scope))


def _share(opening: Expression, p: Expression, scope: Scope) -> Expression:
    """Flow of an edge from pressure ``p`` into the back-pressure, over its flow into the open."""
    patm, b = scope.rig.patm, scope.rig.b
    load = scope.p.r_exhaust * opening * opening

    def squared(down: Expression, up: Expression) -> Expression:
        beyond = ca.fmax(down / up - b, 0.0) / (1.0 - b)
        return ca.fmax(1.0 - beyond * beyond, 0.0) + _LEVEL

    def between(edge: Expression, silencer: Expression) -> Expression:
        """Pressure at which ``edge (p^2 - p_b^2)`` and ``silencer (p_b^2 - patm^2)`` are equal."""
        return ca.sqrt((edge * p * p + silencer * patm * patm) / (edge + silencer))

    first = between(load, 1.0)
    edge = load * squared(first, p) / (1.0 - (first / p) ** 2 + _LEVEL)
    silencer = squared(patm, first) / (1.0 - (patm / first) ** 2 + _LEVEL)
    return ca.sqrt(squared(between(edge, silencer), p) / squared(patm, p))
