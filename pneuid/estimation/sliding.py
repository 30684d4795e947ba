"""Laws of sliding friction read from the measured forces by linear least squares, before any fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from pneuid.estimation.first_guess import first_guess, motions, operating_points, resisting_force
from pneuid.estimation.preparation import Run
from pneuid.estimation.starts import from_sliding
from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES

FAST, SLOWEST = 0.05, 1.0e-5
"""Share of the highest speed, and speed in m/s, above which the seal slides."""

STEADY = ("Fc", "sigma2")
"""Parameters of the base law that sliding friction is made of."""

HOLD = 1e-3
"""Weight that holds each parameter at the guess, relative to what the data show of it."""


def sliding_starts(plant: Plant, runs: Sequence[Run]) -> list[dict[str, float]]:
    """Starts (SI) of a fit from the laws of sliding friction, see ``from_sliding``; none where break-away has no laws."""
    guess = first_guess(plant, runs, motions(runs))
    return from_sliding(plant, sliding_laws(plant, runs, guess)) if from_sliding(plant, guess) else []


def sliding_laws(plant: Plant, runs: Sequence[Run], guess: Mapping[str, float]) -> dict[str, float]:
    """``guess`` (SI) with ``Fc``, ``sigma2`` and the amplitudes of effects that move them as the sliding samples ask for.

    ``Fc sign(v) + sigma2 v`` is linear in them, so all are found together, beside a constant force. A fit that starts where
    these laws are zero first takes Coulomb friction to zero, and ends with a break-away from which no step leads back.
    """
    free = {item.name: item for item in plant.parameters if item.name in STEADY or item.off is not None}
    steady, rows, left = _steady(plant, tuple(free)), [], []
    for run in runs:
        v = run.motion.v
        slides = np.abs(v) > max(FAST * np.percentile(np.abs(v), 99), SLOWEST)
        states, inputs, theta = operating_points(plant, run, run.motion, guess)
        force, by = (np.asarray(item) for item in steady(states, inputs, theta[:, None]))
        rows.append(np.vstack([by, np.ones(run.n)])[:, slides].T)
        left.append((resisting_force(plant, run, run.motion) - force.ravel())[slides])
    design, wanted = np.vstack(rows), np.concatenate(left)
    shown = np.linalg.norm(design, axis=0)
    moving = np.flatnonzero(shown > 0.0)
    scaled = np.vstack([design[:, moving] / shown[moving], HOLD * np.eye(moving.size)])
    step, *_ = np.linalg.lstsq(scaled, np.concatenate([wanted, np.zeros(moving.size)]), rcond=None)
    found, names = dict(guess), list(free)
    for place, moved in zip(moving, step / shown[moving], strict=True):
        if place < len(names):
            item = free[names[place]]
            found[item.name] = float(np.clip(guess[item.name] + moved, item.lower, item.upper))
    return found


@once_per_structure(STRUCTURES)
def _steady(plant: Plant, names: tuple[str, ...]) -> ca.Function:
    """``(s, w, theta) -> (force [N], its derivative by the parameters names (n,))`` of steady sliding."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    k = plant.evaluate(s, w, theta).coefficients
    # on a bench the motion is imposed
    v = s[plant.states.index("v")] if plant.servo else w[plant.inputs.index("v")]
    force = k.Fc * ca.sign(v) + k.sigma2 * v
    at = [plant.theta_names.index(name) for name in names]
    return ca.Function("steady", [s, w, theta], [force, ca.densify(ca.jacobian(force, theta)[at]).T])
