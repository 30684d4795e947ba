"""Play between command and spool."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Brokate, Sprekels, Hysteresis and Phase Transitions (Springer 1996), section 2.1 (play operator); hysteresis of "
    "proportional valves: Beater, Pneumatic Drives 2007, chapter 5"
)

_NARROWEST = 5.0e-3
"""Half-width, relative to full scale, of the play whose position is followed while the amplitude is off."""

_CATCH = 1.0e-3
"""Time in s within which the spool is carried along once the play is used up."""

_ROUNDING = 0.02
"""Share of the half-width over which carrying along sets in."""


def _beyond(gap: Expression, half_width: Expression) -> Expression:
    """``gap`` less ``half_width`` towards zero, exactly zero within, its slope continuous."""
    over, under = ca.fmax(gap - half_width, 0.0), ca.fmax(-gap - half_width, 0.0)
    corner = _ROUNDING * half_width
    return over * over / (over + corner) - under * under / (under + corner)


class ValveHysteresis(Effect):
    """Play operator of half-width ``d`` on the command: the opening stays until the command has run through ``2 d``."""

    name = "valve_hysteresis"
    mechanism = "stiction and magnetic hysteresis hold the spool where it is until the command has moved far enough"
    equation = "valve"
    reference = _SOURCE
    experiment = "slow small triangles of the command around several openings"
    confused_with = ("valve_dead_zone", "valve_lag")
    rigs = ("servo",)
    states = (State("spool_play", "1", 0.0, 0.5, 0.005),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half-width relative to full scale; data sheets state 0.2 to 5 percent."""
        return (Parameter("play", "d_h", "1", 0.0, 0.3, 0.0, 0.01, _SOURCE, off=0.0),)

    def _half_width(self, scope: Scope) -> Expression:
        return ca.sqrt(scope.p.play * scope.p.play + _NARROWEST * _NARROWEST)

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Take back ``d`` times the place within the play, which is -1 or 1 while the spool is carried along."""
        gap, half_width = opening - scope.state.spool_play, self._half_width(scope)
        return opening - scope.p.play * (gap - _beyond(gap, half_width)) / half_width

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The spool is carried along by what the command lies beyond the play, and rests within it."""
        carried = _beyond(scope.opening - scope.state.spool_play, self._half_width(scope))
        return {"spool_play": (scope.state.spool_play + carried, _CATCH)}
