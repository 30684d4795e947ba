"""Pressure channels sampled late against the position."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Ljung, System Identification: Theory for the User (Prentice Hall 1999), section 14.1 (data and their time stamps)"
)


class ChannelSkew(Effect):
    """Both pressures are shown as they were ``tau`` earlier: ``p - tau dp/dt``, first order in ``tau``."""

    name = "channel_skew"
    mechanism = (
        "the pressure channels are filtered or sampled later than the position, so that the two do not belong together"
    )
    equation = "sensor_p1"
    reference = _SOURCE
    experiment = "fast steps that fill and empty both chambers at full flow"
    confused_with = ("sensor_lag_p1", "sensor_lag_p2", "valve_lag", "line_delay")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time by which the pressures are late; negative when the position is."""
        return (Parameter("skew", "τ_c", "s", -0.02, 0.02, 0.0, 1e-3, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Take back what the pressures gained in that time."""
        rates = {"p1": scope.p1_rate, "p2": scope.p2_rate}
        return value - scope.p.skew * rates[signal] if signal in rates else value
