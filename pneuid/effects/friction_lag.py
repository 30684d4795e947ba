"""Frictional memory: sliding friction answers late to a change of speed."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import vanishing_lag
from pneuid.physics.smoothing import absolute
from pneuid.rig import Rig

_SOURCE = (
    "Hess, Soom, ASME J. Tribology 112 (1990) 147 (delay 3 to 9 ms); Tran, Yanada, Intelligent Control and "
    "Automation 4 (2013) 180 (cylinders: the thickness of the oil film is a state that follows the magnitude of the speed)"
)

_SHRINKING = "Yanada, Sekikawa, Mechatronics 18 (2008) 330 (time constants of a film that grows and that shrinks)"

_TURN = 1.0e-3
"""Difference of speed and film in m/s across which the one time constant turns into the other."""

_SHORTEST = 2.0e-3
"""Delay in s above which the lag is a plain first-order one."""


class FrictionLag(Effect):
    """The Stribeck curve is read at ``|v|`` delayed by ``tau_L``: ``g(v_l)``, first-order lag, in place of ``g(v)``.

    The magnitude, since a film carries over a reversal: it is as thick just after as just before. Oil is drawn in faster than
    it is squeezed out, so a film that shrinks lags ``r_L`` times as long. Typical: 1 to 50 ms, longer with thicker oil.
    """

    name = "friction_lag"
    mechanism = (
        "the oil film needs time to grow or shrink after a change of speed, so friction lags behind its steady curve"
    )
    equation = "friction"
    reference = _SOURCE
    experiment = "sines of speed around the Stribeck velocity without reversal, at several frequencies"
    confused_with = ("friction_dwell", "valve_lag", "line_delay")
    guarantees = ("dissipative",)
    laws = ("lugre", "stribeck")
    states = (State("v_lagged", "m/s", 0.0, 0.1, 1e-2),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The delay of a film that grows, and that of one that shrinks over it."""
        return (
            Parameter("tau_L", "τ_L", "s", 0.0, 0.5, 0.0, 5e-3, _SOURCE, off=0.0),
            Parameter("shrink_L", "r_L", "1", 0.3, 30.0, 2.0, 1.0, _SHRINKING, positive=True, prior=1.0),
        )

    def stribeck_speed(self, v: Expression, scope: Scope) -> Expression:
        """The delayed speed; the bristle itself moves with the piston."""
        weight, _ = vanishing_lag(scope.p.tau_L, _SHORTEST)
        # not rounded: the curve is even, so that without a delay it is read at v to the last digit; with one the kinks cancel
        return ca.fabs(v) - weight * (ca.fabs(scope.v) - scope.state.v_lagged)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The delayed speed follows the magnitude of the speed."""
        size = absolute(scope.v, scope.smoothing.speed)
        shrinks = 0.5 * (1.0 - (size - scope.state.v_lagged) / ca.sqrt((size - scope.state.v_lagged) ** 2 + _TURN**2))
        delay = scope.p.tau_L * (1.0 + (scope.p.shrink_L - 1.0) * shrinks)
        return {"v_lagged": (size, vanishing_lag(delay, _SHORTEST)[1])}
