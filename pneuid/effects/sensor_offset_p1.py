"""A constant error of the pressure sensor of chamber 1."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "ISO/IEC Guide 99 (VIM) 2007, clause 4.20 (instrument bias)"


class SensorOffsetP1(Effect):
    """The sensor shows ``p1 + o``; on a bench the driving force is ``A1 o`` more than it makes one expect."""

    name = "sensor_offset_p1"
    mechanism = "the zero of the pressure sensor of chamber 1 has drifted, or its amplifier was not balanced"
    equation = "sensor_p1"
    reference = _SOURCE
    experiment = "both chambers vented for a few seconds, where the sensor must show ambient pressure, then strokes"
    confused_with = ("gravity", "friction_direction", "sensor_offset_F", "sensor_offset_p2")
    constant = True

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The offset; a percent of a 10 bar range is 10 kPa."""
        return (Parameter("offset_p1", "o_p1", "Pa", -2e5, 2e5, 0.0, 1e4, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Add it to what the sensor of chamber 1 shows, and to the force that belongs to what it shows."""
        if signal == "F":
            return value + scope.rig.A1 * scope.p.offset_p1
        return value + scope.p.offset_p1 if signal == "p1" else value
