"""The rigs that play the real ones: a valve-driven cylinder and a friction bench."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from pneuid.virtual_rig.friction import FRICTION_2011, Friction

ATMOSPHERE = 101_325.0
"""Ambient pressure, absolute Pa."""


@dataclass(frozen=True)
class TruthServo:
    """A cylinder driven by a proportional 5/3 valve; SI, pressures absolute.

    Lengths [m], dead volumes [m^3] (tubing included), ``mass`` [kg] all that moves, ``incline`` [rad]
    (positive: extending lifts), ``conductance`` [m^3/(s Pa)] sonic, fully open, ``full_scale`` and
    ``null`` [V], ``supply`` regulated pressure [Pa], ``temperature`` [K]. A through-rod cylinder
    sets ``rod_1``.
    """

    bore: float = 0.032
    rod_1: float = 0.0
    rod_2: float = 0.012
    stroke: float = 0.5
    dead_volume_1: float = 12e-6
    dead_volume_2: float = 14e-6
    mass: float = 2.4
    incline: float = 0.0
    conductance: float = 1.2e-8
    critical_ratio: float = 0.30
    full_scale: float = 10.0
    null: float = 0.0
    supply: float = 600e3 + ATMOSPHERE
    patm: float = ATMOSPHERE
    temperature: float = 293.15
    polytropic: float = 1.2
    friction: Friction = field(default_factory=Friction)

    def __post_init__(self) -> None:
        lengths = (self.stroke, self.dead_volume_1, self.dead_volume_2, self.mass, self.conductance, self.full_scale)
        if not (0.0 <= max(self.rod_1, self.rod_2) < self.bore and min(lengths) > 0.0):
            raise ValueError(f"sizes, mass, conductance and full_scale must be positive and rods thinner: {self}")
        if not (0.0 < self.critical_ratio < 0.9 and 1.0 <= self.polytropic <= 1.4 and self.supply > self.patm > 0.0):
            raise ValueError(f"needs 0 < critical_ratio < 0.9, 1 <= polytropic <= 1.4, supply > patm > 0: {self}")

    @property
    def area_1(self) -> float:
        """Piston area on the cap side [m^2]."""
        return math.pi / 4.0 * (self.bore**2 - self.rod_1**2)

    @property
    def area_2(self) -> float:
        """Piston area on the rod side [m^2]."""
        return math.pi / 4.0 * (self.bore**2 - self.rod_2**2)

    @property
    def top_speed(self) -> float:
        """Speed [m/s] near which the fully open valve settles an unloaded piston; for planning only."""
        gas = 287.05 * self.temperature
        return 1.4 * self.conductance * 1.185 * gas * math.sqrt(293.15 / self.temperature) / self.area_1

    def scaled(
        self,
        bore: float,
        rod: float | None = None,
        stroke: float | None = None,
        mass: float | None = None,
        supply: float | None = None,
    ) -> TruthServo:
        """A rig of another bore [m], everything else in proportion.

        Rod and friction forces scale with the bore, valve and dead volumes with its square; the load
        scales with the square too unless ``mass`` [kg] is given.
        """
        ratio = bore / self.bore
        seal = self.friction
        return replace(
            self,
            bore=bore,
            rod_1=self.rod_1 * ratio,
            rod_2=self.rod_2 * ratio if rod is None else rod,
            stroke=self.stroke if stroke is None else stroke,
            dead_volume_1=self.dead_volume_1 * ratio**2,
            dead_volume_2=self.dead_volume_2 * ratio**2,
            mass=self.mass * ratio**2 if mass is None else mass,
            conductance=self.conductance * ratio**2,
            supply=self.supply if supply is None else supply,
            friction=replace(
                seal,
                **{
                    name: getattr(seal, name) * ratio
                    for name in (
                        "Fc", "Fs", "sigma0", "sigma1", "sigma2", "Fc_ps", "Fc_dp", "Fs_ps", "Fs_dp", "sigma2_ps",
                        "sigma2_dp",
                    )
                },
            ),
        )  # fmt: skip


@dataclass(frozen=True)
class TruthBench:
    """The 2011 bench: a servo motor imposes the motion, regulators hold the chambers; SI.

    ``regulator_droop`` [Pa s/m] is by how much chamber 1 falls and chamber 2 rises per unit of
    extending speed, because a real regulator is not stiff. The rod diameter is not in the source.
    """

    bore: float = 0.032
    rod_1: float = 0.0
    rod_2: float = 0.012
    stroke: float = 0.5
    mass: float = 0.6
    incline: float = 0.0
    patm: float = ATMOSPHERE
    regulator_droop: float = 5e3
    friction: Friction = FRICTION_2011

    def as_servo(self) -> TruthServo:
        """The same cylinder as a servo rig, which is how its parameters are packed."""
        return TruthServo(
            bore=self.bore, rod_1=self.rod_1, rod_2=self.rod_2, stroke=self.stroke, mass=self.mass,
            incline=self.incline, patm=self.patm, supply=self.patm + 7e5, friction=self.friction,
        )  # fmt: skip
