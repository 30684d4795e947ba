"""Hysteresis between command and spool."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Brokate, Sprekels, Hysteresis and Phase Transitions (Springer 1996), sections 2.1, 2.4 (play operator; Prandtl-Ishlinskii "
    "operator of several plays); hysteresis of proportional valves: Beater, Pneumatic Drives 2007, chapter 5"
)

_DAHL = "Dahl, A Solid Friction Model, Aerospace Corp. TOR-0158(3107-18)-1 (1968)"

_NARROWEST = 5.0e-3
"""Half-width, relative to full scale, of the play whose position is followed while the amplitude is off."""

_CATCH = 1.0e-3
"""Time in s within which the spool is carried along once the play is used up."""

_FOLLOWING = 2.0e-3
"""Time in s within which the command is followed, whose speed turns Dahl's friction round."""

_STILL = 1.0e-5
"""Speed of the command in full scales per second below which Dahl's force is given back, over minutes and longer."""

_ROUNDING = 0.02
"""Share of the half-width over which carrying along sets in."""


def _beyond(gap: Expression, half_width: Expression) -> Expression:
    """``gap`` less ``half_width`` towards zero, exactly zero within, its slope continuous."""
    over, under = ca.fmax(gap - half_width, 0.0), ca.fmax(-gap - half_width, 0.0)
    corner = _ROUNDING * half_width
    return over * over / (over + corner) - under * under / (under + corner)


def _followed(scope: Scope) -> Expression:
    """Half-width, as a share of full scale, of what is followed, also while the amplitude is off."""
    return ca.sqrt(scope.p.play * scope.p.play + _NARROWEST * _NARROWEST)


class ValveHysteresis(Effect):
    """A part ``1 - k`` of two plays of the command, of half-widths ``d (1 - a)`` and ``d (1 + a)``, and ``k`` of a friction.

    Within the plays' mean the spool stays until the command has run through the narrow one, follows at half the slope, and
    wholly beyond the wide one. By Dahl's friction it is held back by ``d z``, ``dz/ds = (sgn(ds) - z) / (l d)`` over the
    command ``s``: after a reversal it follows little by little, and, unlike a play, forgets in small motions what came before.
    """

    name = "valve_hysteresis"
    mechanism = "stiction and magnetic hysteresis hold the spool where it is until the command has moved far enough"
    equation = "valve"
    reference = _SOURCE
    experiment = "slow small triangles of the command around several openings"
    confused_with = ("valve_dead_zone", "valve_lag")
    rigs = ("servo",)
    states = (
        State("spool_play_narrow", "1", 0.0, 0.5, 0.005), State("spool_play_wide", "1", 0.0, 0.5, 0.005),
        State("spool_commanded", "1", 0.0, 0.5, 0.01), State("spool_stiction", "1", 0.0, 0.5, 0.5),
    )  # fmt: skip

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half-width relative to full scale, 0.2 to 5 percent in data sheets, and by which share of it the plays differ.

        Of the friction its part, and over how many half-widths it turns round.
        """
        return (
            Parameter("play", "d_h", "1", 0.0, 0.3, 0.0, 0.01, _SOURCE, off=0.0),
            Parameter("play_spread", "a_h", "1", 0.0, 0.9, 0.3, 0.2, _SOURCE, prior=0.3),
            Parameter("play_soft", "k_h", "1", 0.0, 1.0, 0.2, 0.2, _DAHL, prior=0.3),
            Parameter("play_way", "l_h", "1", 0.5, 10.0, 2.0, 0.5, _DAHL, positive=True, prior=0.5),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Take back the place within each play, which is -1 or 1 of its half-width while the spool is carried along, and what
        friction holds back."""
        p, hard = scope.p, 1.0 - scope.p.play_soft
        for held, half_width, share in self._plays(scope):
            gap = scope.opening - held
            opening -= 0.5 * hard * share * p.play * (gap - _beyond(gap, half_width)) / half_width
        (way, size), stays = self._to_come(scope), scope.state.spool_stiction
        turned = ca.exp(-size / (p.play_way * _followed(scope)))
        return opening - p.play_soft * p.play * (stays * turned + way / size * (1.0 - turned))

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """A play is carried along by what the command lies beyond it, and rests while the command is within.

        Friction turns round as the command moves.
        """
        carried = [held + _beyond(scope.opening - held, half_width) for held, half_width, _ in self._plays(scope)]
        way, size = self._to_come(scope)
        sticking = (way / size, scope.p.play_way * _followed(scope) * _FOLLOWING / size)
        followed = *((to, _CATCH) for to in carried), (scope.opening, _FOLLOWING), sticking
        return dict(zip((own.name for own in self.states), followed, strict=True))

    @staticmethod
    def _to_come(scope: Scope) -> tuple[Expression, Expression]:
        """Way of the command that friction has not been turned by yet, and its size, never zero."""
        way = scope.opening - scope.state.spool_commanded
        return way, ca.sqrt(way * way + (_FOLLOWING * _STILL) ** 2)

    @staticmethod
    def _plays(scope: Scope) -> list[tuple[Expression, Expression, Expression]]:
        """Place, half-width and share of the mean half-width of the narrow and the wide play."""
        followed = _followed(scope)
        shares = (1.0 - scope.p.play_spread, 1.0 + scope.p.play_spread)
        places = (scope.state.spool_play_narrow, scope.state.spool_play_wide)
        return [(place, share * followed, share) for place, share in zip(places, shares, strict=True)]
