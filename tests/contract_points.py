"""Effects evaluated alone and in company, at operating points and parameter values drawn at random.

For the checks of ``contract_checks.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from helpers import RANGES, TRUTH, off_values, rig

from pneuid.effect import Effect
from pneuid.effects import CATALOGUE
from pneuid.physics.friction import FrictionLaw
from pneuid.plant import Plant
from pneuid.rig import Rig

POINTS = 12

# a rig on which nothing is zero by accident
RIGS = {
    "servo": rig(
        "servo",
        {"load": {"incline": "8 deg"}, "valve": {"null": "0.4 V", "critical_ratio": 0.35}},
        ambient={"temperature": "300 K", "pressure": "98 kPa"},
    ),
    "bench": rig("bench", {"load": {"incline": "8 deg"}}),
}


@dataclass(frozen=True)
class Case:
    """One effect on one rig with one friction law; ``company`` stands beside it in the plant."""

    effect: Effect
    rig: Rig
    law: FrictionLaw

    def plant(self, company: Sequence[Effect] = (), without: bool = False) -> Plant:
        every = [*company] if without else [*company, self.effect]
        order = {name: i for i, name in enumerate(CATALOGUE)}
        every.sort(key=lambda effect: order.get(effect.name, len(order)))
        return Plant(self.rig, self.law.name, every)


# --- evaluating a plant by name ---


def stages_of(plant: Plant, s: Any, w: Any, theta: Any) -> dict[str, list]:
    """What stands at each port, by the name of the stage."""
    at = plant.evaluate(s, w, theta)
    k = at.coefficients
    found = {
        "friction": [at.friction, k.Fc, k.Fs, k.vs, k.sigma0, k.sigma1, k.sigma2],
        "bristle": list(at.relaxing[0]),
        **{f"shown_{name}": [value] for name, value in at.outputs.items()},
    }
    if plant.servo:
        found |= {
            "valve": [at.opening, at.edges.supply_1, at.edges.supply_2, at.edges.exhaust_1, at.edges.exhaust_2],
            "flow": [at.mdot1, at.mdot2],
            "pressure": at.explicit[2:],
            "force": at.explicit[1:2],
        }
    return found


def names_of(plant: Plant) -> list[str]:
    return [*plant.states, *(f"input {name}" for name in plant.inputs), *plant.theta_names]


class Probe:
    """Stages and their derivatives as functions of named values."""

    def __init__(self, plant: Plant) -> None:
        self.plant, self.names = plant, names_of(plant)
        y = ca.SX.sym("y", len(self.names))
        parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(self.names)])
        stages = stages_of(plant, *parts)
        self.labels = [f"{stage}[{i}]" for stage, items in stages.items() for i in range(len(items))]
        column = ca.densify(ca.vertcat(*(item for items in stages.values() for item in items)))
        self.value = ca.Function("value", [y], [column])
        self.jacobian = ca.Function("jacobian", [y], [ca.densify(ca.jacobian(column, y))])

    def column(self, point: dict[str, float]) -> np.ndarray:
        return np.array([point[name] for name in self.names])

    def values(self, points: Sequence[dict[str, float]]) -> np.ndarray:
        """``(rows, points)``."""
        return np.column_stack([np.asarray(self.value(self.column(point))).ravel() for point in points])

    def slopes(self, points: Sequence[dict[str, float]], names: Sequence[str]) -> np.ndarray:
        """``(rows, names, points)``."""
        chosen = [self.names.index(name) for name in names]
        return np.stack([np.asarray(self.jacobian(self.column(point)))[:, chosen] for point in points], axis=2)

    def by_stage(self, points: Sequence[dict[str, float]]) -> dict[str, np.ndarray]:
        """``(items, points)`` by stage."""
        found: dict[str, list[np.ndarray]] = {}
        for label, row in zip(self.labels, self.values(points), strict=True):
            found.setdefault(label.split("[")[0], []).append(row)
        return {stage: np.array(rows) for stage, rows in found.items()}


@cache
def _probe(plant_key: tuple) -> Probe:
    return Probe(_PLANTS[plant_key])


_PLANTS: dict[tuple, Plant] = {}


def probe(plant: Plant) -> Probe:
    """The probe of a plant, built once; effects are told apart by identity, which the plant keeps alive."""
    key = (plant.rig.kind, plant.law.name, tuple(id(effect) for effect in plant.effects))
    _PLANTS.setdefault(key, plant)
    return _probe(key)


# --- random operating points and parameter values ---


def operating_point(plant: Plant, rng: np.random.Generator) -> dict[str, float]:
    """States, inputs and base parameters somewhere a cylinder can be, at least 2 mm/s from rest."""
    v = float(rng.choice((-1, 1)) * 10 ** rng.uniform(np.log10(2e-3), np.log10(0.6)))
    # the ends of the travel are visited more often than the middle
    motion = {"x": 0.25 - 0.24 * np.cos(np.pi * rng.uniform()), "v": v}
    motion |= {"p1": rng.uniform(1.2e5, 7e5), "p2": rng.uniform(1.2e5, 7e5)}
    motion |= {"a": rng.uniform(-5, 5), "u": rng.uniform(-9, 9), "psup": rng.uniform(3e5, 8e5)}
    point = {name: float(motion[name]) for name in plant.states if name in motion}
    point |= {f"input {name}": float(motion[name]) for name in plant.inputs}
    point["z"] = float(rng.uniform(-6e-5, 6e-5))
    point |= {own.name: own.initial + own.scale * rng.uniform(-1, 1) for own in plant.effect_states}
    values = {name: TRUTH[name] * 10 ** rng.uniform(-0.2, 0.2) for name in plant.parameter_names if name in TRUTH}
    if "Fs" in values:
        values["Fs"] = values["Fc"] * rng.uniform(1.1, 2.0)
    if "n" in values:
        values["n"] = rng.uniform(1.02, 1.38)
    # a run with a payload of its own
    theta = plant.theta(plant.starts() | values, RANGES, mass_run=plant.rig.mass * rng.uniform(0.8, 1.6))
    return dict(zip(plant.theta_names, theta.tolist(), strict=True)) | point


def drawn(effect: Effect, plant: Plant, rng: np.random.Generator, wide: bool = False) -> dict[str, float]:
    """Values of an effect's parameters inside its bounds: about their typical size, or ``wide`` up to the bounds."""
    found = {}
    for item in effect.parameters(plant.rig, plant.law):
        centre = item.start if item.off is None else item.off
        reach = 10 ** rng.uniform(-2, 3 if wide else 0.0)
        if item.positive:
            value = centre * np.exp(rng.uniform(-1, 1))
        else:
            value = centre + rng.choice((-1, 1)) * item.scale * reach
            # an amplitude that may only grow is drawn to the side where it may
            if not item.lower < value < item.upper:
                value = centre - (value - centre)
        found[item.name] = float(np.clip(value, item.lower, item.upper))
    return found


def constraint_values(plant: Plant, point: dict[str, float]) -> np.ndarray:
    theta = np.array([point[name] for name in plant.theta_names])
    return np.array([float(item.value) for item in plant.constraints(theta)])


def allowed_point(case: Case, plant: Plant, rng: np.random.Generator, wide: bool = False) -> dict[str, float]:
    """An operating point with the effect on, its amplitudes halved towards off until the constraints hold."""
    point = operating_point(plant, rng) | drawn(case.effect, plant, rng, wide)
    off = off_values(plant, case.effect)
    for _ in range(60):
        if np.all(constraint_values(plant, point) >= 0.0):
            return point
        point |= {name: value + 0.5 * (point[name] - value) for name, value in off.items()}
    raise AssertionError(f"{case.effect.name}: its constraints do not hold even next to off")


def points_of(
    case: Case, plant: Plant, seed: int = 11, wide: bool = False, count: int = POINTS
) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return [allowed_point(case, plant, rng, wide) for _ in range(count)]


def company_of(case: Case) -> list[Effect]:
    return [
        item
        for item in CATALOGUE.values()
        if case.rig.kind in item.rigs and case.law.name in item.laws and item.name != case.effect.name
    ]


def switched_off(case: Case, plant: Plant, point: dict[str, float]) -> dict[str, float]:
    return point | off_values(plant, case.effect)
