"""A spool that follows its command late."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, two_lags
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 5 (proportional valve as a lag of first or second order)"

_FASTEST = "Jelali, Kroll, Hydraulic Servo-systems (Springer 2003), chapter 4 (spool of limited speed)"

_UNLIKE = "ISO 12238:2001 (shifting times of a valve, on and off measured apart)"

_SHORTEST = 1.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""

_NEAR = 0.01
"""Way behind, as a share of full scale, from which on the spring acts in full."""


class ValveLag(Effect):
    """The opening follows the command behind two lags in a row of mean delay ``tau``; the second has the share ``h`` of it.

    The first is driven on by ``f`` times the way that the second is behind it, so that a spool of less than critical damping
    ``sqrt(1 - f) / (2 sqrt(h (1 - h)))`` swings. It moves no faster than ``g`` full scales per time constant ``T``, what a
    drive's current and spring allow: ``T ds/dt = e / sqrt(1 + (e/g)^2)`` with ``e`` the way it is behind.
    A return spring at one end makes it ``exp(w)`` times as quick to where chamber 1 fills, and as much slower back; with
    ``w < 0`` the other way round.
    """

    name = "valve_lag"
    mechanism = "the spool's mass, spring and drive let it follow the command late"
    equation = "valve"
    reference = _SOURCE
    experiment = "steps and fast sines of the command"
    confused_with = ("line_delay", "channel_skew", "sensor_lag_p1", "sensor_lag_p2")
    rigs = ("servo",)
    states = (State("spool_drive", "1", 0.0, 0.5, 0.01), State("spool", "1", 0.0, 0.5, 0.01))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Mean delay of the spool, 2 to 10 ms for valves of this size, shape of the lag, how far behind it slews, spring.

        The share is 0 for a lag of first order, 0.5 for one of second order with equal roots, as a well damped spool is; with
        ``f`` 0.5 beside that the damping is 0.7.
        """
        return (
            Parameter("tau_valve", "τ_v", "s", 0.0, 0.2, 0.0, 3e-3, _SOURCE, off=0.0),
            Parameter("order_valve", "h_v", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("swing_valve", "f_v", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
            Parameter("slew_valve", "g", "1", 0.02, 50.0, 2.0, 1.0, _FASTEST, positive=True, prior=1.0),
            Parameter("spring_valve", "w", "1", -1.5, 1.5, 0.0, 0.1, _UNLIKE, prior=0.3),
        )

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Replace the command by the spool that follows it."""
        return self._followed(opening, scope)[0]

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The drive follows the command, the spool the drive."""
        (drive, T1), spool = self._followed(scope.opening, scope)[1]
        way = drive - scope.state.spool_drive
        behind = way / scope.p.slew_valve
        with_spring = ca.exp(-scope.p.spring_valve * ca.tanh(way / _NEAR))
        return {"spool_drive": (drive, T1 * with_spring * ca.sqrt(1.0 + behind * behind)), "spool": spool}

    @staticmethod
    def _followed(opening: Expression, scope: Scope) -> tuple[Expression, tuple[Stage, Stage]]:
        p, state = scope.p, scope.state
        return two_lags(opening, (state.spool_drive, state.spool), p.tau_valve, p.order_valve, _SHORTEST, p.swing_valve)
