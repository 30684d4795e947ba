"""Friction that falls while it dissipates power: warming grease and run-in."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Armstrong-Helouvry, Control of Machines with Friction (Kluwer 1991), chapter 4 (friction falling with use); "
    "lumped heat balance: Bittencourt, Wernholt, ASME J. Dynamic Systems 134 (2012) 051013 (friction and temperature)"
)
_SPEED = 0.1
"""Speed in m/s at which the reference power is dissipated."""

_LARGEST_FALL = 4.0
"""Fall of the logarithm of friction beyond which it stays (2 % are left)."""

_LEAST = 0.01
"""Weight w that is added in the state, and divided out of it, so that at zero it is absent and felt whatever the state is."""


class FrictionWarmup(Effect):
    """``Fc, Fs`` times ``exp(-q)``, ``sigma2`` times ``exp(-g q)``; ``dq/dt = (w F v / P0 - q) / tau`` is ``w`` times the
    dissipated power averaged over ``tau``.

    ``P0`` is the power of the rig's typical friction (a tenth of the force at one bar, at least 3 N) at 0.1 m/s, so that
    ``w`` is the relative fall that such use causes. Grease thins, so that viscous friction may fall ``g`` times as fast as lips
    soften. Typical: friction falls by 10 to 50 % over minutes.
    """

    name = "friction_warmup"
    mechanism = (
        "friction heats seal and grease, whose viscosity falls, and runs the surfaces in, so friction falls with use"
    )
    equation = "friction"
    reference = _SOURCE
    experiment = "one long run of equal strokes from a cold start"
    confused_with = ("friction_dwell", "friction_pressure")
    guarantees = ("dissipative",)
    states = (State("fall", "1", 0.0, 0.3, 0.1),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Fall of the logarithm of friction at the reference power, the time over which power is averaged, and how many times
        as fast viscous friction falls."""
        return (
            Parameter("w_warm", "w", "1", 0.0, 2.0, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("tau_warm", "τ_w", "s", 0.2, 7200.0, 20.0, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("g_warm", "g", "1", 0.2, 5.0, 1.0, 0.3, _SOURCE, positive=True, prior=0.5),
        )

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Scale the levels of friction, and viscous friction by a fall of its own."""
        # a solver's trial point may be colder than cold, or so warm that no friction would be left
        fall = ca.fmax(scope.state.fall, 0.0) * scope.p.w_warm / (scope.p.w_warm + _LEAST)
        factor, thinner = (ca.exp(-ca.fmin(one, _LARGEST_FALL)) for one in (fall, scope.p.g_warm * fall))
        return replace(k, Fc=k.Fc * factor, Fs=k.Fs * factor, sigma2=k.sigma2 * thinner)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The fall follows the power dissipated.

        It, not the warmth, is the state: the jumps that a relaxed fit allows it then cost about the same whatever ``w`` is. Of
        a warmth they cost the less the larger ``w``; on two benches that rose to 2 beside a time of minutes, and friction no
        longer followed the use (1.10 floors held out on one, now 0.9).
        """
        typical = _SPEED * ca.fmax(3.0, 1e4 * scope.rig.A1)
        return {"fall": ((scope.p.w_warm + _LEAST) * scope.friction * scope.v / typical, scope.p.tau_warm)}
