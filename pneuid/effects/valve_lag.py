"""A spool that follows its command late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 5 (proportional valve as a first-order lag)"

_SHORTEST = 1.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""


class ValveLag(Effect):
    """The opening follows the command by a first-order lag of mean delay ``tau``."""

    name = "valve_lag"
    mechanism = "the spool's mass, spring and drive let it follow the command late"
    equation = "valve"
    reference = _SOURCE
    experiment = "steps and fast sines of the command"
    confused_with = ("line_delay", "channel_skew", "sensor_lag_p1", "sensor_lag_p2")
    rigs = ("servo",)
    states = (State("spool", "1", 0.0, 0.5, 0.01),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time constant of the spool; 2 to 10 ms for proportional valves of this size."""
        return (Parameter("tau_valve", "τ_v", "s", 0.0, 0.2, 0.0, 3e-3, _SOURCE, off=0.0),)

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Replace the command by the spool that follows it."""
        weight, _ = vanishing_lag(scope.p.tau_valve, _SHORTEST)
        return opening - weight * (opening - scope.state.spool)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The spool follows the command."""
        return {"spool": (scope.opening, vanishing_lag(scope.p.tau_valve, _SHORTEST)[1])}
