"""Tubes between valve and chambers."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.rig import Rig

_SOURCE = (
    "Richer, Hurmuzlu, J. Dyn. Syst. Meas. Control 122 (2000) 416, part 1, section on the connecting tubes (delay L/c)"
)

_SHORTEST = 1.0e-3
"""Time constant in s with which the delay is screened; below it the lag keeps its delay alone."""


class LineDelay(Effect):
    """The flow into a chamber follows the valve's flow by a first-order lag of mean delay ``tau``, about ``L/c``."""

    name = "line_delay"
    mechanism = "air needs time to run through the tubes between the valve and the chambers"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "fast steps of the command at several supply pressures"
    confused_with = ("valve_lag", "channel_skew", "dead_volume")
    rigs = ("servo",)
    states = (State("flow_behind_1", "1", 0.0, 0.3, 0.01), State("flow_behind_2", "1", 0.0, 0.3, 0.01))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Delay of both tubes: 3 ms for each metre."""
        return (Parameter("tau_line", "τ_l", "s", 0.0, 0.2, 0.0, 3e-3, _SOURCE, off=0.0),)

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Replace the valve's flow by what arrives of it; states count in flows through the fully open valve."""
        weight, _ = vanishing_lag(scope.p.tau_line, _SHORTEST)
        held_1 = scope.valve_flow_1 - scope.state.flow_behind_1 * scope.full_flow
        held_2 = scope.valve_flow_2 - scope.state.flow_behind_2 * scope.full_flow
        return mdot1 - weight * held_1, mdot2 - weight * held_2

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """What arrives follows what the valve lets through."""
        _, time_constant = vanishing_lag(scope.p.tau_line, _SHORTEST)
        return {
            "flow_behind_1": (scope.valve_flow_1 / scope.full_flow, time_constant),
            "flow_behind_2": (scope.valve_flow_2 / scope.full_flow, time_constant),
        }
