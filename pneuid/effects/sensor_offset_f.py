"""A constant error of the force sensor of a bench."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "ISO/IEC Guide 99 (VIM) 2007, clause 4.20 (instrument bias)"


class SensorOffsetF(Effect):
    """The sensor shows ``F + o``."""

    name = "sensor_offset_F"
    mechanism = "the zero of the force sensor has drifted, or its amplifier was not balanced"
    equation = "sensor_F"
    reference = _SOURCE
    experiment = "the sensor read while nothing pulls on it, then slow strokes in both directions"
    confused_with = ("gravity", "friction_direction")
    constant = True
    rigs = ("bench",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The offset."""
        scale = max(1.0, 0.005 * rig.A1 * 1e6)
        return (Parameter("offset_F", "o_F", "N", -1e3 * scale, 1e3 * scale, 0.0, scale, _SOURCE, off=0.0),)

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """Add it to what the force sensor shows."""
        return value + scope.p.offset_F if signal == "F" else value
