"""A constant force along the axis: weight on an incline, a counterweight, a preloaded spring."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Janot, Gautier, Brunot, EMPS benchmark 2019, eq. (1) (offset)"


class Gravity(Effect):
    """A constant force ``F_g`` against +x, on top of the incline that the rig declares."""

    name = "gravity"
    mechanism = "the load's weight has a component along the axis, or something pulls with a constant force"
    equation = "force"
    reference = _SOURCE
    experiment = "slow strokes in both directions, and again with the axis tilted by a known angle"
    confused_with = ("friction_direction", "sensor_offset_p1", "sensor_offset_p2", "sensor_offset_F")
    constant = True

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The constant force."""
        scale = max(5.0, 0.02 * rig.A1 * 1e6)
        return (Parameter("F_g", "F_g", "N", -1e3 * scale, 1e3 * scale, 0.0, scale, _SOURCE, off=0.0),)

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Subtract it from the forces in +x."""
        return force - scope.p.F_g
