"""A plant with a user's own effects, tried out before it is fitted: a slip in the user's file is one clear line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import casadi as ca
import numpy as np

from pneuid.effect import Effect
from pneuid.effects._own_file import tried
from pneuid.errors import UserError
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant
from pneuid.rig import Rig

_SERVO = {"x": 0.4, "v": 0.05, "p1": 4e5, "p2": 3e5, "z": 1e-5}
_INPUTS = {"u": 0.4, "psup": 7e5, "x": 0.2, "v": 0.05, "a": 0.3, "p1": 4e5, "p2": 3e5}
"""A point in motion at which every port has something to act on; ``x`` of a servo in strokes, ``u`` in full scales."""


def checked_plant(rig: Rig, law: str, effects: Sequence[Effect]) -> Plant:
    """The plant of ``effects``. Raises ``UserError`` naming file and line where one of the user's own cannot be evaluated
    or does not vanish at its off-values.
    """
    for effect in effects:
        if effect.origin:
            path = str(sys.modules[type(effect).__module__].__file__)
            without, with_it = tried(effect.name, path, lambda effect=effect: _values(rig, law, effect))  # type: ignore[misc]
            if not np.allclose(without, with_it, rtol=1e-12, atol=0.0):
                raise UserError(
                    f"{path}: effect '{effect.name}' does not vanish at its off-values, so no screening and no ladder can "
                    "judge it; give an amplitude an off-value at which the port returns what it was given"
                )
    return Plant(rig, law, effects)


def _values(rig: Rig, law: str, effect: Effect) -> tuple[np.ndarray, np.ndarray]:
    """Rates and outputs of the base plant and of the one with the effect at its off-values, at one point."""
    base, plant = Plant(rig, law), Plant(rig, law, [effect])
    off = {item.name: item.off for item in plant.parameters if item.off is not None}
    return _evaluated(base, {}), _evaluated(plant, off)


def _evaluated(plant: Plant, values: dict[str, float]) -> np.ndarray:
    rig = plant.rig
    known = _SERVO | {"x": 0.4 * rig.stroke if plant.servo else 0.2}
    known |= {state.name: state.initial for state in plant.effect_states}
    given = _INPUTS | {"u": rig.null + 0.4 * rig.full_scale if plant.servo else 0.0}
    ranges = {"p1_low": 1e5, "p1_high": 7e5, "p2_low": 1e5, "p2_high": 7e5, "x_low": 0.0, "x_high": 2.0 * known["x"]}
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    at = plant.evaluate(s, w, plant.theta(plant.starts() | values, ranges, smoothing=FINE))
    core = [*at.explicit, *at.relaxing[0], *at.outputs.values()]
    function = ca.Function("own", [s, w], [ca.vertcat(*core)])
    found = function([known[name] for name in plant.states], [given[name] for name in plant.inputs])
    return np.asarray(found).ravel()
