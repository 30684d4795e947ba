"""A force sensor that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, further_lag, two_lags
from pneuid.rig import Rig

_SOURCE = "Doebelin, Measurement Systems (McGraw-Hill 2003), section 3.3 (instruments of first and second order)"

_SHORTEST = 2.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""

_SMOOTHING = 2.0e-2
"""Time constant in s of the two lags behind which the rate of the pressure force is taken: long against samples, whose noise it
would smooth, short against the time in which a regulator fills a chamber."""


class SensorLagF(Effect):
    """The sensor shows ``F`` behind three lags in a row of mean delay ``tau``, of which the third has the share ``t``.

    Of the rest the second has the share ``h``. The first is driven on by ``f`` times the way that the second is behind it: with
    ``h = 1/2`` the damping of these two is ``sqrt(1 - f)``.
    The lags are those of inertia, friction and weight. The pressure force is late by ``tau`` times its rate, taken behind two
    lags of 20 ms: lagging it would smooth the noise of the measured pressures and be rewarded for that alone.
    """

    name = "sensor_lag_F"
    mechanism = "the anti-aliasing filter or the amplifier of the force sensor makes the force shown lag"
    equation = "sensor_F"
    reference = _SOURCE
    experiment = "fast reversals, where the force jumps by twice the friction"
    confused_with = ("friction_lag",)
    rigs = ("bench",)
    states = (
        State("F_between", "N", 0.0, 100.0, 1.0, settled=True),
        State("F_followed", "N", 0.0, 100.0, 1.0, settled=True),
        State("F_shown", "N", 0.0, 100.0, 1.0, settled=True),
        State("push_smooth", "N", 0.0, 1000.0, 10.0, settled=True),
        State("push_smoother", "N", 0.0, 1000.0, 10.0, settled=True),
    )

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Delay of the amplifier, milliseconds are usual, and the shares of the second lag and the third.

        A filter of first order has 0 and 0, one of second order 0.5 and 0: with equal roots where ``f`` is 0, of Butterworth's
        damping where it is 0.5. Of third order Butterworth's has 0.5 and 0.5 with ``f`` 0.75, Bessel's 0.5 and 0.43 with 0.48.
        """
        return (
            Parameter("tau_F", "τ_F", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),
            Parameter("order_F", "h_F", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("swing_F", "f_F", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
            Parameter("third_F", "t_F", "1", 0.0, 0.7, 0.1, 0.1, _SOURCE, prior=0.2),
        )

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Show what followed in place of what acts."""
        if signal != "F":
            return value
        lagging = scope.F + scope.pressure_force
        push_rate = (scope.state.push_smooth - scope.state.push_smoother) / _SMOOTHING
        return value - lagging + self._followed(lagging, scope)[0] + scope.p.tau_F * push_rate

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """It follows the force without that of the pressures, of which it knows the rate."""
        stages = self._followed(scope.F + scope.pressure_force, scope)[1]
        smooth = (scope.pressure_force, _SMOOTHING), (scope.state.push_smooth, _SMOOTHING)
        return dict(zip((state.name for state in self.states), (*stages, *smooth), strict=True))

    @staticmethod
    def _followed(force: Expression, scope: Scope) -> tuple[Expression, tuple[Stage, ...]]:
        p, state = scope.p, scope.state
        behind = state.F_between, state.F_followed
        between, stages = two_lags(force, behind, p.tau_F * (1.0 - p.third_F), p.order_F, _SHORTEST, p.swing_F)
        shown, third = further_lag(between, state.F_shown, p.tau_F * p.third_F, _SHORTEST)
        return shown, (*stages, third)
