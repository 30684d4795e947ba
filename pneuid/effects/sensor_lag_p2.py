"""A pressure sensor of chamber 2 that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.rig import Rig

_SOURCE = "Doebelin, Measurement Systems (McGraw-Hill 2003), chapter 6 (pressure transducer behind a tube, first order)"

_SHORTEST = 1.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""


class SensorLagP2(Effect):
    """The sensor shows ``p2 - tau r``, ``r`` the rate of ``p2`` filtered with ``tau``: ``p2`` behind a first-order lag."""

    name = "sensor_lag_p2"
    mechanism = "a thin tube or a filter between chamber 2 and its sensor makes the pressure shown lag"
    equation = "sensor_p2"
    reference = _SOURCE
    experiment = "fast steps that fill and empty the chamber at full flow"
    confused_with = ("channel_skew", "line_delay", "valve_lag")
    rigs = ("servo",)
    states = (State("rate_p2", "Pa/s", 0.0, 5e5, 2e5),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time constant of tube and sensor; milliseconds are usual."""
        return (Parameter("tau_p2", "τ_p2", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Hold back what the pressure gained within the time constant."""
        return value - scope.p.tau_p2 * scope.state.rate_p2 if signal == "p2" else value

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The filtered rate follows the rate of the pressure."""
        return {"rate_p2": (scope.p2_rate, vanishing_lag(scope.p.tau_p2, _SHORTEST)[1])}
