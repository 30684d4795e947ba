"""A force sensor that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, two_lags
from pneuid.rig import Rig

_SOURCE = "Doebelin, Measurement Systems (McGraw-Hill 2003), section 3.3 (instruments of first and second order)"

_SHORTEST = 2.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""

_SMOOTHING = 2.0e-2
"""Time constant in s of the two lags behind which the rate of the pressure force is taken: long against samples, whose noise it
would smooth, short against the time in which a regulator fills a chamber."""


class SensorLagF(Effect):
    """The sensor shows ``F`` behind two lags in a row of mean delay ``tau``, of which the second has the share ``h``.

    The first is driven on by ``f`` times the way that the second is behind it: with ``h = 1/2`` the damping is ``sqrt(1 - f)``.
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
        State("push_smooth", "N", 0.0, 1000.0, 10.0, settled=True),
        State("push_smoother", "N", 0.0, 1000.0, 10.0, settled=True),
    )

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Delay of the amplifier, milliseconds are usual, and the share of the second lag.

        It is 0 for a filter of first order, 0.5 for one of second order: with equal roots where ``f`` is 0, of Butterworth's
        damping where it is 0.5. A running average lies between, near 0.25.
        """
        return (
            Parameter("tau_F", "τ_F", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),
            Parameter("order_F", "h_F", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("swing_F", "f_F", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
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
    def _followed(force: Expression, scope: Scope) -> tuple[Expression, tuple[Stage, Stage]]:
        p, state = scope.p, scope.state
        return two_lags(force, (state.F_between, state.F_followed), p.tau_F, p.order_F, _SHORTEST, p.swing_F)
