"""A force sensor that follows late."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.rig import Rig

_SOURCE = "Doebelin, Measurement Systems (McGraw-Hill 2003), section 3.3 (first-order instrument)"

_SHORTEST = 2.0e-3
"""Time constant in s with which the lag is screened; below it the lag keeps its delay alone."""


class SensorLagF(Effect):
    """The sensor shows ``F`` behind a first-order lag of mean delay ``tau``.

    The lag is that of inertia, friction and weight. Regulators hold the chambers, so that the pressure force hardly changes
    within ``tau``; lagging it would smooth the noise of the measured pressures and be rewarded for that alone.
    """

    name = "sensor_lag_F"
    mechanism = "the anti-aliasing filter or the amplifier of the force sensor makes the force shown lag"
    equation = "sensor_F"
    reference = _SOURCE
    experiment = "fast reversals, where the force jumps by twice the friction"
    confused_with = ("friction_lag",)
    rigs = ("bench",)
    states = (State("F_followed", "N", 0.0, 100.0, 1.0),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time constant of the amplifier; milliseconds are usual."""
        return (Parameter("tau_F", "τ_F", "s", 0.0, 0.2, 0.0, 2e-3, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Show what followed in place of what acts."""
        if signal != "F":
            return value
        weight, _ = vanishing_lag(scope.p.tau_F, _SHORTEST)
        return value - weight * (scope.F + scope.pressure_force - scope.state.F_followed)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """It follows the force without that of the pressures."""
        return {"F_followed": (scope.F + scope.pressure_force, vanishing_lag(scope.p.tau_F, _SHORTEST)[1])}
