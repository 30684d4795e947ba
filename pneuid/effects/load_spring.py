"""A spring between load and frame."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Hooke 1678; spring-return cylinders: Beater, Pneumatic Drives (Springer 2007), chapter on linear drives"

_LONGEST = 3.0
"""Largest distance in m of the force-free position from the cap end."""


class LoadSpring(Effect):
    """A force ``k (x - x_free + s (b y^2 + h y^3))`` against +x, ``y = (x - x_middle)/s`` in half ranges ``s`` of the data.

    Coils close and rubber stiffens (``h``), more at one end than at the other (``b``); both are zero for Hooke's law. Far from
    its force-free position it is a constant force.
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
        """Stiffness, the position without force (midway until data say otherwise), and how far the spring is from Hooke's."""
        middle = 0.5 * rig.stroke if rig.kind == "servo" else 0.0
        scale = max(10.0, 0.02 * rig.A1 * 1e6 / 0.3)
        return (
            Parameter("k_spring", "k_s", "N/m", 0.0, 1e4 * scale, 0.0, scale, _SOURCE, off=0.0),
            Parameter("x_free", "x_0", "m", -_LONGEST, _LONGEST, middle, 0.1, _SOURCE, prior=1.0),
            Parameter("bend_spring", "b_s", "1", -1.0, 1.0, 0.0, 0.1, _SOURCE, prior=0.3),
            Parameter("hard_spring", "h_s", "1", -1.0, 1.0, 0.0, 0.1, _SOURCE, prior=0.3),
        )

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Subtract the spring's pull."""
        p, low, high = scope.p, scope.rig.x_low, scope.rig.x_high
        half = 0.5 * (high - low)
        y = (scope.x - 0.5 * (low + high)) / half
        return force - p.k_spring * (scope.x - p.x_free + half * y**2 * (p.bend_spring + p.hard_spring * y))
