"""Where the states of effects start: at their initial values, or where they have settled on what they follow."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES


@once_per_structure(STRUCTURES)
def _behind(plant: Plant) -> ca.Function:
    """``(s, w, theta) -> (behind (m,), slopes (m, m))`` of the m settled states: how far each is from what it follows."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    relaxing = plant.evaluate(s, w, theta).relaxing[1:]
    at = [len(plant.states) - len(relaxing) + i for i in _settled(plant)]
    behind = ca.vertcat(*(relaxing[i][0] / relaxing[i][1] for i in _settled(plant))) - s[at]
    return ca.Function("behind", [s, w, theta], [behind, ca.densify(ca.jacobian(behind, s)[:, at])])


def _settled(plant: Plant) -> list[int]:
    return [i for i, state in enumerate(plant.effect_states) if state.settled]


def starting_states(plant: Plant, states: np.ndarray, inputs: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Effect states ``(ne, N)`` at the first samples of N runs, in the units that the effects declare.

    states : ``(ns, N)``, of which those of effects are not read; inputs : ``(nw, N)``; theta : ``(ntheta, N)``.
    """
    own = np.tile(np.array([state.initial for state in plant.effect_states])[:, None], states.shape[1:])
    settled = _settled(plant)
    # one may follow another, and be driven on by what it drives: each step of Newton's settles the next of what is not linear
    for _ in settled:
        at = np.vstack([states[: len(states) - len(own)], own])
        for k in range(at.shape[1]):
            behind, slopes = (np.asarray(item) for item in _behind(plant)(at[:, k], inputs[:, k], theta[:, k]))
            own[settled, k] -= np.linalg.solve(slopes, behind)[:, 0]
    return own
