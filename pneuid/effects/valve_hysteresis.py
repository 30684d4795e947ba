"""Play between command and spool."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Brokate, Sprekels, Hysteresis and Phase Transitions (Springer 1996), sections 2.1, 2.4 (play operator; Prandtl-Ishlinskii "
    "operator of several plays); hysteresis of proportional valves: Beater, Pneumatic Drives 2007, chapter 5"
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
    """Mean of two plays of the command, of half-widths ``d (1 - a)`` and ``d (1 + a)``.

    The spool stays until the command has run through the narrow one, follows at half the slope, and wholly beyond the wide one.
    """

    name = "valve_hysteresis"
    mechanism = "stiction and magnetic hysteresis hold the spool where it is until the command has moved far enough"
    equation = "valve"
    reference = _SOURCE
    experiment = "slow small triangles of the command around several openings"
    confused_with = ("valve_dead_zone", "valve_lag")
    rigs = ("servo",)
    states = (State("spool_play_narrow", "1", 0.0, 0.5, 0.005), State("spool_play_wide", "1", 0.0, 0.5, 0.005))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Mean half-width relative to full scale, 0.2 to 5 percent in data sheets; by which share of it the plays differ."""
        return (
            Parameter("play", "d_h", "1", 0.0, 0.3, 0.0, 0.01, _SOURCE, off=0.0),
            Parameter("play_spread", "a_h", "1", 0.0, 0.9, 0.3, 0.2, _SOURCE, prior=0.3),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Take back the place within each play, which is -1 or 1 of its half-width while the spool is carried along by it."""
        for held, half_width, share in self._plays(scope):
            gap = scope.opening - held
            opening -= 0.5 * share * scope.p.play * (gap - _beyond(gap, half_width)) / half_width
        return opening

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """A play is carried along by what the command lies beyond it, and rests while the command is within."""
        carried = [held + _beyond(scope.opening - held, half_width) for held, half_width, _ in self._plays(scope)]
        return {own.name: (to, _CATCH) for own, to in zip(self.states, carried, strict=True)}

    @staticmethod
    def _plays(scope: Scope) -> list[tuple[Expression, Expression, Expression]]:
        """Place, half-width and share of the mean half-width of the narrow and the wide play."""
        followed = ca.sqrt(scope.p.play * scope.p.play + _NARROWEST * _NARROWEST)
        shares = (1.0 - scope.p.play_spread, 1.0 + scope.p.play_spread)
        places = (scope.state.spool_play_narrow, scope.state.spool_play_wide)
        return [(place, share * followed, share) for place, share in zip(places, shares, strict=True)]
