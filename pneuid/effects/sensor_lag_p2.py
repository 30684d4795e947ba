"""A pressure sensor of chamber 2 that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, behind_two_lags, delay_through_tube, growth_through_tube
from pneuid.rig import Rig

_SOURCE = (
    "Doebelin, Measurement Systems (McGraw-Hill 2003), section 3.3 (instruments of first and second order) and chapter 6 "
    "(pressure transducer behind a tube)"
)

_SHORTEST = 1.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""


class SensorLagP2(Effect):
    """The sensor shows ``p2`` behind two lags in a row of mean delay ``tau``, of which the second has the share ``h``.

    The first is driven on by ``f`` times the way that the second is behind it: with ``h = 1/2`` the damping is ``sqrt(1 - f)``.
    A filter's delay is the same at all pressures (``e = 0``). Through a thin tube to a sealed sensor air creeps the faster the
    denser it is: ``tau (4 bar / p2)^e``, ``e = 1``.
    """

    name = "sensor_lag_p2"
    mechanism = "a thin tube or a filter between chamber 2 and its sensor makes the pressure shown lag"
    equation = "sensor_p2"
    reference = _SOURCE
    experiment = "fast steps that fill and empty the chamber at full flow"
    confused_with = ("channel_skew", "line_delay", "valve_lag")
    rigs = ("servo",)
    states = (State("rate_p2", "Pa/s", 0.0, 5e5, 2e5), State("rate_p2_shown", "Pa/s", 0.0, 5e5, 2e5))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Mean delay of tube and sensor at 4 bar absolute, milliseconds are usual, the share of the second lag, and shapes.

        The share is 0 for a tube of first order, 0.5 for a filter of second order: with equal roots where ``f`` is 0, of
        Butterworth's damping where it is 0.5. A running average lies between, near 0.25.
        """
        return (
            Parameter("tau_p2", "τ_p2", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),
            Parameter("order_p2", "h_p2", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("tube_p2", "e_p2", "1", 0.0, 1.0, 0.1, 0.1, _SOURCE, prior=0.3),
            Parameter("swing_p2", "f_p2", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
        )

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Hold back what the pressure gained within the delay."""
        return self._behind(value, scope)[0] if signal == "p2" else value

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The filtered rates follow that of the pressure and that of what the first lag shows."""
        return dict(zip(("rate_p2", "rate_p2_shown"), self._behind(scope.p2, scope)[1], strict=True))

    @staticmethod
    def _behind(pressure: Expression, scope: Scope) -> tuple[Expression, tuple[Stage, Stage]]:
        p, rates = scope.p, (scope.state.rate_p2, scope.state.rate_p2_shown)
        delay = delay_through_tube(p.tau_p2, scope.p2, p.tube_p2)
        growth = growth_through_tube(scope.p2, scope.p2_rate, p.tube_p2)
        return behind_two_lags(pressure, scope.p2_rate, rates, delay, p.order_p2, _SHORTEST, p.swing_p2, growth)
