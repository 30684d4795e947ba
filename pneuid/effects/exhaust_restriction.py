"""Silencers or throttles behind the valve's exhaust ports."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.physics.valve import Edges, squared_share
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, eq. (1) and (2), with ISO 6358-3:2014 for components in series"

_LEVEL = 1.0e-3
"""Squared share of the choked flow below which an edge's flow counts as that between nearly equal pressures."""


_SHORTEST = 1.0e-3
"""Time constant in s with which the back-pressure is followed; below it the lag keeps its delay alone."""


class ExhaustRestriction(Effect):
    """Exhaust edge of opening ``s`` behind which a silencer lets a pressure ``p_b`` build up, ``r = (C / C_silencer)^2``.

    In the long run ``p_b^2 = (r s^2 p^2 + patm^2) / (1 + r s^2)``, where both let flow ``C sqrt(p_up^2 - p_down^2)`` through
    (ISO 6358 with b = 0), and once more with each one's own flow at that pressure; ``p_b^2`` follows with the time constant
    ``tau`` in which the silencer's volume fills. The edge keeps the share ``psi(p_b/p) / psi(patm/p)`` of its flow: all of it
    while ``p_b`` leaves it choked.
    """

    name = "exhaust_restriction"
    mechanism = "a clogged silencer or a throttle builds up back-pressure while a chamber is vented at high flow"
    equation = "valve"
    reference = _SOURCE
    experiment = "large fast steps that vent either chamber from high pressure"
    confused_with = ("supply_droop", "valve_critical_ratio", "inlet_mixing")
    rigs = ("servo",)
    states = (State("back_pressure", "1", 0.0, 10.0, 5.0),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Squared ratio of the valve's conductance to the silencer's, 0.05 to 0.3 when clean, and the time it takes to fill."""
        return (
            Parameter("r_exhaust", "r_e", "1", 0.0, 25.0, 0.0, 0.1, _SOURCE, off=0.0),
            Parameter("tau_exhaust", "τ_e", "s", 1e-4, 0.5, 2e-3, 1.0, _SOURCE, positive=True, prior=1.5),
        )

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Narrow both exhaust edges."""
        weight, _ = vanishing_lag(scope.p.tau_exhaust, _SHORTEST)
        aim = _steady(scope)
        risen = scope.p.r_exhaust * (aim - weight * (aim - scope.state.back_pressure))
        back = scope.rig.patm * ca.sqrt(ca.fmax(1.0 + risen, 0.25))
        one, two = (_share(p, back, scope) for p in (scope.p1, scope.p2))
        return replace(edges, exhaust_1=edges.exhaust_1 * one, exhaust_2=edges.exhaust_2 * two)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The squared back-pressure follows what the flow through the silencer needs."""
        return {"back_pressure": (_steady(scope), vanishing_lag(scope.p.tau_exhaust, _SHORTEST)[1])}


def _steady(scope: Scope) -> Expression:
    """``((p_b / patm)^2 - 1) / r`` in the long run; of both edges' air, as one silencer takes it."""
    return _risen(scope.opening_2, scope.p1, scope) + _risen(scope.opening_1, scope.p2, scope)


def _risen(opening: Expression, p: Expression, scope: Scope) -> Expression:
    """``((p_b / patm)^2 - 1) / r`` where an edge and the silencer let the same flow through, finite where ``r`` is zero."""
    patm, r = scope.rig.patm, scope.p.r_exhaust

    def squares(edge: Expression, silencer: Expression) -> tuple[Expression, Expression]:
        """``p_b^2`` at which ``r edge (p^2 - p_b^2)`` and ``silencer (p_b^2 - patm^2)`` are equal, and what it has risen by."""
        risen = edge * (p * p - patm * patm) / (r * edge + silencer)
        return patm * patm + r * risen, risen

    through = opening * opening
    first = ca.sqrt(squares(through, 1.0)[0])
    edge, silencer = through * _over_zero_ratio(first / p, scope), _over_zero_ratio(patm / first, scope)
    return squares(edge, silencer)[1] / (patm * patm)


def _over_zero_ratio(ratio: Expression, scope: Scope) -> Expression:
    """Squared flow at a pressure ratio over that for a critical ratio of zero, ``1 - ratio^2``; finite where both vanish."""
    b = scope.b
    subsonic, choked = ca.fmax(ratio, b), ca.fmin(ratio, b)
    return (1.0 + subsonic - 2.0 * b) / (1.0 + subsonic) * (1.0 + b) / (1.0 - b) / (1.0 - choked * choked)


def _share(p: Expression, back: Expression, scope: Scope) -> Expression:
    """Flow of an edge from pressure ``p`` into the pressure ``back``, over its flow into the open."""
    b = scope.b
    return ca.sqrt((squared_share(back / p, b) + _LEVEL) / (squared_share(scope.rig.patm / p, b) + _LEVEL))
