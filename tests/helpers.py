"""Rigs, recordings and fits that several test modules share, each made once per test process.

The servo rig's valve is declared at 1.0e-8 where the truth has 1.2e-8, as a data sheet would have it. Recordings come
from the virtual rig, which shares no code with the estimator.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import Fit, fit
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.step import substep
from pneuid.virtual_rig import ATMOSPHERE, HIDDEN_EFFECTS, NOTHING, Friction, TruthServo, record_servo

SERVO: dict[str, Any] = {
    "kind": "servo",
    "friction": "lugre",
    "conventions": {"pressure": "gauge"},
    "cylinder": {
        "bore": "32 mm", "rod": "12 mm", "stroke": "500 mm", "dead_volume_1": "12 cm^3", "dead_volume_2": "14 cm^3",
    },
    "load": {"mass": "2.4 kg", "incline": "0 deg"},
    "valve": {
        "conductance": "1.0e-8 m^3/(s*Pa)", "critical_ratio": 0.30, "full_scale": "10 V", "null": "0 V",
    },
    "supply": {"pressure": "600 kPa"},
    "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
    "runs": {f"s{bar}.csv": {"supply": f"{bar}00 kPa"} for bar in (3, 5, 7)},
}  # fmt: skip

BENCH: dict[str, Any] = {
    "kind": "bench",
    "friction": "lugre",
    "conventions": {"pressure": "gauge"},
    "cylinder": {"bore": "32 mm", "rod": "12 mm", "stroke": "500 mm"},
    "load": {"mass": "0.6 kg"},
    "sensors": {"x": "1 nm", "F": "0.2 N"},
}

TRUTH: dict[str, float] = {
    "Fc": 12.0, "Fs": 20.0, "vs": 0.008, "sigma0": 4.0e5, "sigma1": 250.0, "sigma2": 45.0, "n": 1.2, "C": 1.2e-8,
}  # fmt: skip
"""What the virtual rig has behind its sensors."""

RANGES: dict[str, float] = {
    "p1_low": 1.1e5, "p1_high": 6.5e5, "p2_low": 1.05e5, "p2_high": 6.3e5, "x_low": 0.1, "x_high": 0.4,
}  # fmt: skip
"""Ranges of the data that laws are clamped to, where no data are at hand."""


def rig(kind: str = "servo", changes: Mapping[str, Mapping[str, Any]] | None = None, **keys: Any) -> Rig:
    """A rig of either kind; ``changes`` are merged into its tables, ``keys`` are top-level."""
    raw = copy.deepcopy(SERVO if kind == "servo" else BENCH)
    for table, entries in (changes or {}).items():
        raw.setdefault(table, {}).update(entries)
    return Rig.from_dict({**raw, **keys})


@cache
def servo_run(
    excitation: str, bar: int, seed: int, hidden: str = "", seconds: float = 3.0, friction: Friction | None = None
) -> Recording:
    """A run at ``bar`` gauge supply of the rig with a strong ``hidden`` effect, none where empty."""
    truth = TruthServo() if friction is None else TruthServo(friction=friction)
    effect = HIDDEN_EFFECTS[hidden]["strong"] if hidden else NOTHING
    record = record_servo(truth, effect, excitation, seconds, seed, supply=bar * 1e5 + ATMOSPHERE)
    return Recording.from_arrays(f"s{bar}.csv", rig(), **record)


def train_runs(hidden: str = "", seed: int = 1) -> tuple[Recording, ...]:
    """Two runs of 3 s at 5 and 7 bar."""
    return servo_run("multisine", 5, 10 * seed + 1, hidden), servo_run("steps", 7, 10 * seed + 2, hidden)


def held_runs(hidden: str = "", seed: int = 1) -> tuple[Recording, ...]:
    """Two further runs, at 3 and 7 bar."""
    return servo_run("multisine", 3, 10 * seed + 4, hidden), servo_run("steps", 7, 10 * seed + 5, hidden)


@cache
def base_fit(hidden: str = "", seed: int = 1) -> Fit:
    """The base model, fitted (relaxed stage) to runs of a rig with a strong ``hidden`` effect."""
    return fit(Plant(rig(), "lugre"), train_runs(hidden, seed), exact=False)


@cache
def scores(hidden: str = "", seed: int = 1) -> tuple[Score, ...]:
    """The catalogue screened on ``base_fit``."""
    return tuple(screen(base_fit(hidden, seed), list(CATALOGUE.values()), list(CATALOGUE)))


def step_function(plant: Plant) -> ca.Function:
    """``(s, w, slope, h, theta) -> s`` after ``h`` seconds, interpreted."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    slope, theta, h = ca.SX.sym("slope", len(plant.inputs)), ca.SX.sym("theta", len(plant.theta_names)), ca.SX.sym("h")
    return ca.Function("one_step", [s, w, slope, h, theta], [ca.densify(substep(plant, s, w, slope, h, theta))])


def march(
    step: ca.Function, start: np.ndarray, w: np.ndarray, slope: np.ndarray, h: float, count: int, theta: np.ndarray
) -> np.ndarray:
    """States ``(ns, count + 1)`` of ``count`` steps of ``h`` seconds under the input ``w + slope t``."""
    times = h * np.arange(count)
    inputs = w[:, None] + slope[:, None] * times
    found = step.mapaccum(count)(start, inputs, slope, h, theta)
    return np.column_stack([start, np.asarray(found)])


def values_of(plant: Plant, changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """The truth's values for the base parameters that ``plant`` has, declared starts for the others, then ``changes``."""
    known = {name: TRUTH[name] for name in plant.parameter_names if name in TRUTH}
    return plant.starts() | known | dict(changes or {})


def off_values(plant: Plant, effect: Effect) -> dict[str, float]:
    """Off-values of an effect's amplitudes."""
    own = effect.parameters(plant.rig, plant.law)
    return {item.name: item.off for item in own if item.off is not None}
