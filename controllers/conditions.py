"""Rigs that differ from the one a controller was made for: what a robustness study varies."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from pneuid.virtual_rig.friction import Friction
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.sensors import Sensors
from pneuid.virtual_rig.truth import TruthServo

FORCES = ("Fc", "Fs", "sigma2")


@dataclass(frozen=True)
class Condition:
    """One deviation of the rig; the defaults change nothing.

    friction : factor on the friction force (Fc, Fs, sigma2 and their slopes; the bristle stays); valve_gain : factor on
    the valve's conductance; x_noise : 1-sigma of the position sensor instead of the study's, m; hidden : what else the rig has.
    """

    name: str
    friction: float = 1.0
    valve_gain: float = 1.0
    x_noise: float | None = None
    hidden: Hidden = NOTHING


AS_KNOWN = Condition("as known")
"""The rig that the controllers were made for."""


@dataclass(frozen=True)
class Played:
    """A virtual rig as it is played: parameters, hidden effects, sensors."""

    truth: TruthServo
    hidden: Hidden
    sensors: Sensors

    def under(self, condition: Condition) -> Played:
        """The rig under ``condition``."""
        truth = replace(
            self.truth,
            friction=scaled(self.truth.friction, condition.friction),
            conductance=condition.valve_gain * self.truth.conductance,
        )
        noise = self.sensors.x_noise if condition.x_noise is None else condition.x_noise
        return Played(truth, self.hidden.also(condition.hidden), replace(self.sensors, x_noise=noise))


def scaled(friction: Friction, factor: float) -> Friction:
    """``friction`` with its forces times ``factor``, at every pressure."""
    names = [item.name for item in fields(Friction) if item.name.split("_")[0] in FORCES]
    return replace(friction, **{name: factor * getattr(friction, name) for name in names})
