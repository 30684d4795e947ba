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
_NODES = "Incropera, DeWitt, Fundamentals of Heat and Mass Transfer (6th ed., Wiley 2007), section 5.1 (lumped capacitances)"

_SPEED = 0.1
"""Speed in m/s at which the reference power is dissipated."""

_LARGEST_FALL = 4.0
"""Fall of the logarithm of friction beyond which it stays (2 % are left)."""


class FrictionWarmup(Effect):
    """``Fc, Fs, sigma2`` times ``exp(-w ((1 - a) q + a l))``, ``dq/dt = (F v / P0 - q) / tau`` the power dissipated, averaged
    over ``tau``, and ``l`` the same over ``tau / r``.

    The lip of a seal warms up within seconds, the seal and the wall beneath it within minutes; ``a`` is the share of the lip.
    ``P0`` is the power of the rig's typical friction (a tenth of the force at one bar, at least 3 N) at 0.1 m/s, so that
    ``w`` is the relative fall that such use causes. Typical: friction falls by 10 to 50 % over minutes.
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
    states = (State("warmth", "1", 0.0, 1.0, 1.0), State("lip_warmth", "1", 0.0, 1.0, 1.0))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Fall of the logarithm of friction at the reference power, the time over which power is averaged, share of the lip
        and how much sooner it is warm."""
        return (
            Parameter("w_warm", "w", "1", 0.0, 2.0, 0.0, 0.05, _SOURCE, off=0.0),
            Parameter("tau_warm", "τ_w", "s", 0.2, 7200.0, 20.0, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("lip_warm", "a", "1", 0.0, 0.9, 0.2, 0.1, _NODES, prior=0.3),
            Parameter("sooner_warm", "r", "1", 1.5, 50.0, 6.0, 1.0, _NODES, positive=True, prior=1.0),
        )

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Scale all levels of sliding friction alike."""
        # a solver's trial point may be colder than cold, or so warm that no friction would be left
        lip = scope.p.lip_warm
        warm = (1.0 - lip) * scope.state.warmth + lip * scope.state.lip_warmth
        fall = ca.fmin(scope.p.w_warm * ca.fmax(warm, 0.0), _LARGEST_FALL)
        factor = ca.exp(-fall)
        return replace(k, Fc=k.Fc * factor, Fs=k.Fs * factor, sigma2=k.sigma2 * factor)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The averages follow the power dissipated."""
        power = scope.friction * scope.v / (_SPEED * ca.fmax(3.0, 1e4 * scope.rig.A1))
        return {"warmth": (power, scope.p.tau_warm), "lip_warmth": (power, scope.p.tau_warm / scope.p.sooner_warm)}
