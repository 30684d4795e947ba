"""A spring between load and frame."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Hooke 1678; spring-return cylinders: Beater, Pneumatic Drives (Springer 2007), chapter on linear drives"

_LONGEST = 3.0
"""Largest distance in m of the force-free position from the cap end."""


class LoadSpring(Effect):
    """A force ``k (x - x_free)`` against +x.

    Far from its force-free position it is a constant force.
    Typical: return springs pull with 5 to 10 % of the force at 6 bar, hoses and cables with 10 to 200 N/m.
    """

    name = "load_spring"
    mechanism = "a return spring, a hose or a cable pulls the load back the more the further it is moved"
    equation = "force"
    reference = _SOURCE
    experiment = "slow strokes over the whole travel in both directions"
    confused_with = ("gravity", "friction_position")
    contains = ("gravity", "sensor_offset_F", "sensor_offset_p1", "sensor_offset_p2")

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Stiffness, and the position without force: midway until data say otherwise."""
        middle = 0.5 * rig.stroke if rig.kind == "servo" else 0.0
        scale = max(10.0, 0.02 * rig.A1 * 1e6 / 0.3)
        return (
            Parameter("k_spring", "k_s", "N/m", 0.0, 1e4 * scale, 0.0, scale, _SOURCE, off=0.0),
            Parameter("x_free", "x_0", "m", -_LONGEST, _LONGEST, middle, 0.1, _SOURCE, prior=1.0),
        )

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Subtract the spring's pull."""
        return force - scope.p.k_spring * (scope.x - scope.p.x_free)
