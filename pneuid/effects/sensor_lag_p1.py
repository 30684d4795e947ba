"""A pressure sensor of chamber 1 that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.rig import Rig

_SOURCE = "Doebelin, Measurement Systems (McGraw-Hill 2003), chapter 6 (pressure transducer behind a tube, first order)"

_SHORTEST = 1.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""


class SensorLagP1(Effect):
    """The sensor shows ``p1 - tau r``, ``r`` the rate of ``p1`` filtered with ``tau``: ``p1`` behind a first-order lag."""

    name = "sensor_lag_p1"
    mechanism = "a thin tube or a filter between chamber 1 and its sensor makes the pressure shown lag"
    equation = "sensor_p1"
    reference = _SOURCE
    experiment = "fast steps that fill and empty the chamber at full flow"
    confused_with = ("channel_skew", "line_delay", "valve_lag")
    rigs = ("servo",)
    states = (State("rate_p1", "Pa/s", 0.0, 5e5, 2e5),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time constant of tube and sensor; milliseconds are usual."""
        return (Parameter("tau_p1", "τ_p1", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Hold back what the pressure gained within the time constant."""
        return value - scope.p.tau_p1 * scope.state.rate_p1 if signal == "p1" else value

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The filtered rate follows the rate of the pressure."""
        return {"rate_p1": (scope.p1_rate, vanishing_lag(scope.p.tau_p1, _SHORTEST)[1])}
