"""Where the states of effects start: at their initial values, or where they have settled on what they follow."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES


@once_per_structure(STRUCTURES)
def _targets(plant: Plant) -> ca.Function:
    """``(s, w, theta) -> targets (ne,)`` of the states that effects bring."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    relaxing = plant.evaluate(s, w, theta).relaxing[1:]
    return ca.Function("targets", [s, w, theta], [ca.vertcat(*(source / decay for source, decay in relaxing))])


def starting_states(plant: Plant, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Effect states ``(ne, N)`` at the first samples of N runs, in the units that the effects declare.

    states : ``(ns, N)``, of which those of effects are not read; inputs : ``(nw, N)``; theta : ``(ntheta, N)``.
    """
    own = np.tile(np.array([state.initial for state in plant.effect_states])[:, None], states.shape[1:])
    settled = [i for i, state in enumerate(plant.effect_states) if state.settled]
    # one may follow another: each pass settles the next of a chain
    for _ in settled:
        at = np.vstack([states[: len(states) - len(own)], own])
        own[settled] = np.asarray(_targets(plant)(at, inputs, theta))[settled]
    return own
