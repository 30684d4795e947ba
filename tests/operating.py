"""One evaluation of a plant at named states, inputs and parameters, for tests of single effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
from helpers import RANGES, rig, values_of

from pneuid.effects import effects_by_name
from pneuid.plant import Plant, Stages
from pneuid.rig import Rig

SERVO_POINT = {"x": 0.25, "v": 0.0, "p1": 4e5, "p2": 3e5, "z": 0.0, "u": 0.0, "psup": 7.01325e5}
BENCH_POINT = {"z": 0.0, "x": 0.2, "v": 0.0, "a": 0.0, "p1": 4e5, "p2": 3e5}


def plant_with(*effects: str, on: Rig | None = None) -> Plant:
    """A plant of the servo rig, or of ``on``, with the named effects."""
    return Plant(on or rig(), "lugre", effects_by_name(list(effects)))


def at(plant: Plant, point: Mapping[str, float] | None = None, values: Mapping[str, float] | None = None) -> Stages:
    """Stages at the standard point with some signals and states of ``point`` and parameters of ``values`` replaced."""
    known = {own.name: own.initial for own in plant.effect_states}
    known |= (SERVO_POINT if plant.servo else BENCH_POINT) | dict(point or {})
    theta = plant.theta(values_of(plant, values), RANGES)
    return plant.evaluate([known[name] for name in plant.states], [known[name] for name in plant.inputs], theta)


def followed(
    plant: Plant, command: Callable[[float], float], values: Mapping[str, float], seconds: float, h: float,
    point: Mapping[str, float] | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:  # fmt: skip
    """Times (N,), and ``opening``, ``mdot1``, ``mdot2`` and the effects' states (N,) over a command in V.

    States by Euler's exponential rule; piston and pressures stay at the standard point, or at what ``point`` says of it.
    """
    s, w, theta = (
        ca.SX.sym(n, len(of)) for n, of in (("s", plant.states), ("w", plant.inputs), ("th", plant.theta_names))
    )
    stages = plant.evaluate(s, w, theta)
    decay = ca.vertcat(*(item for _, item in stages.relaxing[1:]))
    rest = ca.vertcat(*(item for item, _ in stages.relaxing[1:])) / decay
    own = s[plant.explicit_count + 1 :]
    moved = ca.vertcat(s[: plant.explicit_count + 1], rest + (own - rest) * ca.exp(-decay * h))
    shown = ca.vertcat(stages.opening, stages.mdot1, stages.mdot2, own)
    step = ca.Function("step", [s, w, theta], [moved, shown])
    t = np.arange(0.0, seconds, h)
    known = SERVO_POINT | {state.name: state.initial for state in plant.effect_states} | dict(point or {})
    inputs = np.array([[command(float(now)) for now in t], np.full(t.size, known["psup"])])
    start = np.array([known[name] for name in plant.states])
    _, found = step.mapaccum(t.size)(start, inputs, plant.theta(values_of(plant, values), RANGES))
    names = ("opening", "mdot1", "mdot2", *(state.name for state in plant.effect_states))
    return t, dict(zip(names, np.asarray(found), strict=True))
