"""Silencers or throttles behind the valve's exhaust ports."""

from __future__ import annotations

from dataclasses import replace

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.valve import Edges, series_share
from pneuid.rig import Rig

_SOURCE = (
    "ISO 6358-3:2014 (conductances in series); Beater, Pneumatic Drives 2007, chapter 3: 1/C^2 = 1/C_1^2 + 1/C_2^2"
)


class ExhaustRestriction(Effect):
    """Exhaust edge of opening ``s`` in series with a silencer: ``s / sqrt(1 + r s^2)``, ``r = (C / C_silencer)^2``."""

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
        r = scope.p.r_exhaust
        return replace(edges, exhaust_1=one * series_share(one, r), exhaust_2=two * series_share(two, r))
