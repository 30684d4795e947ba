"""Where the states of effects start: at their initial values, or where they have settled on what they follow."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES

_CLOSE = 1.0e-10
"""How near a settled state is brought to what it follows, in the scale of that state."""


@once_per_structure(STRUCTURES)
def _settling(plant: Plant) -> ca.Function:
    """``(guess (m,), (s, w, theta)) -> (settled (m,))``: the m settled states where none is behind what it follows."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    relaxing, own = plant.evaluate(s, w, theta).relaxing[1:], plant.effect_states
    at = [len(plant.states) - len(own) + i for i in _settled(plant)]
    behind = (relaxing[i][0] / relaxing[i][1] - s[j] for i, j in zip(_settled(plant), at, strict=True))
    scaled = ca.vertcat(*(each / own[i].scale for i, each in zip(_settled(plant), behind, strict=True)))
    guess = ca.SX.sym("guess", len(at))
    residual = ca.substitute(scaled, s[at], guess)
    options = {"abstol": _CLOSE, "max_iter": 50, "error_on_fail": False}
    return ca.rootfinder("settling", "newton", {"x": guess, "p": ca.vertcat(s, w, theta), "g": residual}, options)


def _settled(plant: Plant) -> list[int]:
    return [i for i, state in enumerate(plant.effect_states) if state.settled]


def starting_states(plant: Plant, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Effect states ``(ne, N)`` at the first samples of N runs, in the units that the effects declare.

    states : ``(ns, N)``, of which those of effects are not read; inputs : ``(nw, N)``; theta : ``(ntheta, N)``.
    """
    own = np.tile(np.array([state.initial for state in plant.effect_states])[:, None], states.shape[1:])
    settled = _settled(plant)
    if settled:
        given = np.vstack([states[: len(states) - len(own)], own, inputs, theta])
        own[settled] = np.asarray(_settling(plant)(own[settled], given))
    return own
