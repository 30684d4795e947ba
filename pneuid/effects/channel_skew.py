"""Position and pressure channels sampled late against the command."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Ljung, System Identification: Theory for the User (Prentice Hall 1999), section 14.1 (data and their time stamps)"
)


class ChannelSkew(Effect):
    """Position and pressures are shown as they were some time earlier: ``p - tau dp/dt``, ``x - tau v + tau^2 dv/dt / 2``.

    A logger that reads its channels in turn gives each an age of its own: ``tau_x``, ``tau_p`` for p1 and ``tau_p + tau_21``
    for p2. What all have in common is like a late command. A piston that sets out at 10 m/s^2 is 80 um off within
    4 ms, so ``x`` is taken back to the second order.
    """

    name = "channel_skew"
    mechanism = (
        "the logger reads its channels in turn or filters some of them, so that command, position and pressures of one row "
        "do not belong together"
    )
    equation = "sensor_p1"
    reference = _SOURCE
    experiment = "fast steps that fill and empty both chambers at full flow"
    confused_with = ("sensor_lag_p1", "sensor_lag_p2", "valve_lag", "line_delay")
    contains = ("sensor_lag_p1", "sensor_lag_p2")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Ages of position and pressures against the command's time stamp, negative when ahead of it, and of p2 beyond p1."""
        return (
            Parameter("skew_x", "τ_x", "s", -0.02, 0.02, 0.0, 1e-3, _SOURCE, off=0.0),
            Parameter("skew_p", "τ_p", "s", -0.02, 0.02, 0.0, 1e-3, _SOURCE, off=0.0),
            Parameter("skew_p2", "τ_21", "s", -0.02, 0.02, 0.0, 1e-3, _SOURCE, off=0.0),
        )

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Take back what the signal gained in that time."""
        p = scope.p
        if signal == "x":
            return value - p.skew_x * (scope.v - 0.5 * p.skew_x * scope.acceleration)
        gained = {"p1": p.skew_p * scope.p1_rate, "p2": (p.skew_p + p.skew_p2) * scope.p2_rate}
        return value - gained.get(signal, 0.0)
