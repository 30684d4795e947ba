"""Frictional memory: sliding friction answers late to a change of speed."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, two_lags
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
    """The Stribeck curve is read at ``|v|`` delayed by ``tau_L``, behind two lags in a row, in place of ``|v|``.

    The magnitude, since a film carries over a reversal: it is as thick just after as just before. Oil is drawn in faster than
    it is squeezed out, so a film that shrinks lags ``r_L`` times as long. Typical: 1 to 50 ms, longer with thicker oil.
    The second lag has the share ``h_L`` of the delay, and the first is driven on by ``f_L`` times the way that the second is
    behind it: a film of first order has ``h = 0``; near to ``h = f = 1/2`` it is late by a pure delay, as measured in 1990.
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
    states = (State("v_drawn", "m/s", 0.0, 0.1, 1e-2), State("v_lagged", "m/s", 0.0, 0.1, 1e-2))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The delay of a film that grows, that of one that shrinks over it, and the shape of the lag."""
        return (
            Parameter("tau_L", "τ_L", "s", 0.0, 0.5, 0.0, 5e-3, _SOURCE, off=0.0),
            Parameter("shrink_L", "r_L", "1", 0.3, 30.0, 2.0, 1.0, _SHRINKING, positive=True, prior=1.0),
            Parameter("order_L", "h_L", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("swing_L", "f_L", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
        )

    def stribeck_speed(self, v: Expression, scope: Scope) -> Expression:
        """The delayed speed; the bristle itself moves with the piston."""
        size = ca.fabs(scope.v)
        # not rounded: the curve is even, so that without a delay it is read at v to the last digit; with one the kinks cancel
        return ca.fabs(v) - (size - self._followed(size, scope)[0])

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The delayed speed follows the magnitude of the speed."""
        stages = self._followed(absolute(scope.v, scope.smoothing.speed), scope)[1]
        return dict(zip((state.name for state in self.states), stages, strict=True))

    @staticmethod
    def _followed(size: Expression, scope: Scope) -> tuple[Expression, tuple[Stage, Stage]]:
        p, own = scope.p, scope.state
        behind = size - own.v_drawn
        shrinks = 0.5 * (1.0 - behind / ca.sqrt(behind * behind + _TURN**2))
        delay = p.tau_L * (1.0 + (p.shrink_L - 1.0) * shrinks)
        return two_lags(size, (own.v_drawn, own.v_lagged), delay, p.order_L, _SHORTEST, p.swing_L)
