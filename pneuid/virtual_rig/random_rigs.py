"""Rigs drawn at random within what is built and sold, each with the rig file that its engineer would write."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pneuid.virtual_rig.friction import Friction
from pneuid.virtual_rig.sensors import Sensors
from pneuid.virtual_rig.truth import ATMOSPHERE, TruthBench, TruthServo

SIX_BAR = 6e5


@dataclass(frozen=True)
class Sheet:
    """What the rig file says over what is true: relative errors of what the engineer looked up rather than measured.

    ``conductance`` is a start value of the fit; mass and dead volumes are held there, and so is the critical ratio, in error by
    the absolute ``critical_ratio``.
    """

    conductance: float = 1.0
    mass: float = 1.0
    dead_volume_1: float = 1.0
    dead_volume_2: float = 1.0
    critical_ratio: float = 0.0


@dataclass(frozen=True)
class RandomServo:
    """A servo rig: the truth, its sensors, its logger's rate [Hz] and its data sheet."""

    truth: TruthServo
    sensors: Sensors
    rate: float
    sheet: Sheet

    def rig_toml(self, supplies: dict[str, float]) -> str:
        """The rig file; ``supplies`` is the supply [Pa gauge] by file name of a run."""
        truth, sheet = self.truth, self.sheet
        runs = [f'[runs."{name}"]\nsupply = "{value!r} Pa"' for name, value in supplies.items()]
        return "\n".join(
            (
                'kind = "servo"', "[conventions]", 'pressure = "gauge"', "[cylinder]", *_cylinder(truth),
                f'dead_volume_1 = "{truth.dead_volume_1 * sheet.dead_volume_1!r} m^3"',
                f'dead_volume_2 = "{truth.dead_volume_2 * sheet.dead_volume_2!r} m^3"',
                "[load]", f'mass = "{truth.mass * sheet.mass!r} kg"', f'incline = "{truth.incline!r} rad"',
                "[valve]", f'conductance = "{truth.conductance * sheet.conductance!r} m^3/(s*Pa)"',
                f"critical_ratio = {truth.critical_ratio + sheet.critical_ratio!r}",
                f'full_scale = "{truth.full_scale!r} V"', f'null = "{truth.null!r} V"',
                "[supply]", f'pressure = "{truth.supply - truth.patm!r} Pa"',
                *_ambient(truth.patm, truth.temperature), *_sensors(self.sensors, ("p1", "p2")), *runs, "",
            )
        )  # fmt: skip


@dataclass(frozen=True)
class RandomBench:
    """A friction bench: the truth, its sensors and its data sheet."""

    truth: TruthBench
    sensors: Sensors
    sheet: Sheet

    def rig_toml(self, friction: str = "lugre") -> str:
        """The rig file with a friction law."""
        truth = self.truth
        return "\n".join(
            (
                'kind = "bench"', f'friction = "{friction}"', "[conventions]", 'pressure = "gauge"',
                "[cylinder]", *_cylinder(truth), "[load]", f'mass = "{truth.mass * self.sheet.mass!r} kg"',
                f'incline = "{truth.incline!r} rad"', *_ambient(truth.patm, 293.15),
                *_sensors(self.sensors, ("p1", "p2", "F")), "",
            )
        )  # fmt: skip


def random_servo(seed: int, sheet_error: float = 0.0) -> RandomServo:
    """A servo rig of any size: bore 10 to 200 mm, mass 0.1 to 100 kg, 4 to 10 bar, sampled at 100 Hz to 10 kHz.

    Friction is 2 to 15 % of the piston force at 6 bar, the valve is sized to 0.2 to 1.5 m/s. The sheet's conductance is
    up to a quarter off; ``sheet_error`` (one sigma, relative) is the error of what a fit holds: mass, dead volumes,
    critical ratio.
    """
    rng = np.random.default_rng((seed, 1))
    bore = _log_uniform(rng, 0.010, 0.200)
    rod = bore * rng.uniform(0.3, 0.5)
    stroke = float(np.clip(bore * _log_uniform(rng, 4.0, 16.0), 0.05, 1.0))
    area = math.pi / 4.0 * bore**2
    mass = float(np.clip(SIX_BAR * area / _log_uniform(rng, 30.0, 300.0), 0.1, 100.0))
    supply = rng.uniform(4e5, 10e5)
    temperature = rng.uniform(283.0, 305.0)
    speed = _log_uniform(rng, 0.2, 1.5)
    full_scale, null = ((10.0, 0.0), (5.0, 5.0), (4.0, 0.0))[rng.integers(3)]
    truth = TruthServo(
        bore=bore, rod_1=0.0, rod_2=rod, stroke=stroke,
        dead_volume_1=area * stroke * rng.uniform(0.04, 0.15), dead_volume_2=area * stroke * rng.uniform(0.04, 0.15),
        mass=mass, conductance=speed * area / (1.4 * 1.185 * 287.05 * temperature), critical_ratio=rng.uniform(0.2, 0.45),
        full_scale=full_scale, null=null, supply=supply + ATMOSPHERE, temperature=temperature,
        polytropic=rng.uniform(1.05, 1.35), friction=_friction(rng, SIX_BAR * area, mass),
    )  # fmt: skip
    x_noise, p_noise = stroke * _log_uniform(rng, 5e-6, 1e-4), _log_uniform(rng, 2e-4, 1.5e-3) * supply
    sensors = Sensors(x_noise, 0.25 * x_noise, p_noise, 0.1 * p_noise, u_grid=full_scale / 2**15)
    rate = float(round(_log_uniform(rng, 100.0, 10e3), -1))
    return RandomServo(truth, sensors, rate, _sheet(rng, sheet_error))


def random_bench(seed: int, sheet_error: float = 0.0) -> RandomBench:
    """A bench with a cylinder of 10 to 200 mm bore; ``sheet_error`` as in ``random_servo``, here of the mass alone."""
    rng = np.random.default_rng((seed, 2))
    bore = _log_uniform(rng, 0.010, 0.200)
    force = SIX_BAR * math.pi / 4.0 * bore**2
    mass = float(np.clip(force / _log_uniform(rng, 300.0, 3000.0), 0.1, 100.0))
    friction = _friction(rng, force, mass)
    truth = TruthBench(
        bore=bore, rod_2=bore * rng.uniform(0.3, 0.5), stroke=0.5, mass=mass, friction=friction,
        regulator_droop=_log_uniform(rng, 1e3, 1e4),
    )  # fmt: skip
    F_noise = friction.Fc * _log_uniform(rng, 3e-3, 2e-2)
    sensors = Sensors(
        _log_uniform(rng, 0.2e-6, 2e-6), 0.1e-6, _log_uniform(rng, 200.0, 1000.0), 20.0, F_noise, 0.05 * F_noise
    )
    return RandomBench(truth, sensors, _sheet(rng, sheet_error))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _friction(rng: np.random.Generator, force: float, mass: float) -> Friction:
    """Seal friction of a cylinder whose piston force at 6 bar is ``force`` [N]; smaller cylinders have the larger share."""
    fc = force * _log_uniform(rng, 0.02, 0.15)
    sigma0 = fc / rng.uniform(12e-6, 60e-6)
    return Friction(
        Fc=fc, Fs=fc * rng.uniform(1.15, 1.9), vs=_log_uniform(rng, 3e-3, 30e-3), sigma0=sigma0,
        sigma1=2.0 * rng.uniform(0.1, 0.4) * math.sqrt(sigma0 * mass), sigma2=fc * rng.uniform(0.5, 3.0),
    )  # fmt: skip


def _sheet(rng: np.random.Generator, held: float) -> Sheet:
    mass, dead_1, dead_2 = (float(value) for value in 1.0 + held * rng.standard_normal(3))
    return Sheet(rng.uniform(0.75, 1.25), mass, dead_1, dead_2, float(0.5 * held * rng.standard_normal()))


def _cylinder(truth: TruthServo | TruthBench) -> tuple[str, ...]:
    return f'bore = "{truth.bore!r} m"', f'rod = "{truth.rod_2!r} m"', f'stroke = "{truth.stroke!r} m"'


def _ambient(patm: float, temperature: float) -> tuple[str, ...]:
    return "[ambient]", f'pressure = "{patm!r} Pa"', f'temperature = "{temperature!r} K"'


def _sensors(sensors: Sensors, others: tuple[str, ...]) -> tuple[str, ...]:
    noise = {"p1": f"{sensors.p_noise!r} Pa", "p2": f"{sensors.p_noise!r} Pa", "F": f"{sensors.F_noise!r} N"}
    return "[sensors]", f'x = "{sensors.x_noise!r} m"', *(f'{name} = "{noise[name]}"' for name in others)
