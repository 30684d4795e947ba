"""Start states of windows and of whole runs, estimated from their own measurements with the parameters frozen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.memory import carried
from pneuid.estimation.first_guess import first_states
from pneuid.estimation.preparation import Run
from pneuid.interval import IntervalFunction
from pneuid.simulate import estimate_start

FIRST_TRIES, LATER_TRIES = 20, 60
"""Iterations for a window's start, and for one that fits badly."""

OTHER_STARTS = (None, 0.0, 0.9, -0.9)
"""Deflections of the bristle, over that at break-away, from which a window is tried again at rest; None leaves the guess."""

OUTLYING = 1.25
"""Cost of a window over the median of its run above which other starts are tried."""


def stiffness(model: Frozen) -> float:
    """Stiffness of the model's bristle, N/m."""
    if not model.plant.law.static:
        return float(model.values["sigma0"])
    theta = dict(zip(model.plant.theta_names, model.plant.theta(model.values, model.ranges), strict=True))
    return float(theta["carrier_stiffness"])


def _break_away(model: Frozen) -> float:
    """Bristle deflection in m at which the model breaks away: the scale of the bristle states that can occur."""
    return float(model.values.get("Fs", model.values["Fc"])) / stiffness(model)


def loose_prior(model: Frozen) -> np.ndarray:
    """1-sigma ``(ns,)`` of a state of which nothing is known but what can occur; infinite where measurements tell it."""
    plant = model.plant
    prior = np.full(len(plant.states), np.inf)
    prior[plant.explicit_count] = _break_away(model)
    prior[plant.explicit_count + 1 :] = [state.spread for state in plant.effect_states]
    return prior


def start_states(
    model: Frozen, function: IntervalFunction, guess: np.ndarray, data: np.ndarray, theta: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Start states ``(W, ns)`` of windows from their own measurements ``data`` (W, rows, N), parameters frozen; ``prior`` is
    the 1-sigma of the guess, ``(ns,)`` or ``(W, ns)``.

    A window that breaks away, or comes to rest, has several local optima in the bristle: windows that fit worse than
    the others of their run are tried again from rest with the bristle relaxed and near break-away on either side.
    """
    plant = model.plant
    z, spread, prior = plant.explicit_count, _break_away(model), np.broadcast_to(prior, guess.shape)
    best, cost = estimate_start(function, guess, data, theta, prior, plant.state_scales, FIRST_TRIES)
    poor = np.flatnonzero(~(cost < OUTLYING * np.median(cost)))
    if poor.size == 0:
        return best
    again = np.tile(guess[poor], (len(OTHER_STARTS), 1, 1))
    if plant.servo:
        again[:, :, plant.states.index("v")] = 0.0
    for k, deflection in enumerate(OTHER_STARTS):
        if deflection is not None:
            again[k, :, z] = deflection * spread
    # all side by side: one after the other each would be waited for by windows that have long settled
    every = np.tile(poor, len(OTHER_STARTS))
    tried, found = estimate_start(
        function, again.reshape(every.size, -1), data[every], theta[every], prior[every], plant.state_scales, LATER_TRIES
    )
    tried, found = tried.reshape(again.shape), found.reshape(-1, poor.size)
    found = np.where(np.isfinite(found), found, np.inf)
    first, at = np.argmin(found, axis=0), np.arange(poor.size)
    better = found[first, at] < cost[poor]
    best[poor[better]] = tried[first, at][better]
    return best


@dataclass(frozen=True)
class Starts:
    """Start states of windows ``(W, ns)``, and the 1-sigma ``(W, ns)`` of what was known of them before their own data."""

    states: np.ndarray
    prior: np.ndarray


def starts_of(
    model: Frozen, function: IntervalFunction, run: Run, first: np.ndarray, data: np.ndarray, theta: np.ndarray
) -> Starts:
    """Start states of the windows that begin at the samples ``first``, slow effect states with what the windows before tell."""
    plant, loose = model.plant, loose_prior(model)
    every, decay = first_states(plant, run, run.motion, dict(model.values))
    guess, prior = every[:, first].T, np.tile(loose, (first.size, 1))
    states = start_states(model, function, guess, data, theta, prior)
    if not plant.effect_states:
        return Starts(states, prior)
    own = slice(plant.explicit_count + 1, None)
    forgotten = np.cumsum(decay * run.data[0], axis=1)[:, first].T
    guess[:, own], told = carried(states[:, own], guess[:, own], forgotten, loose[own])
    if np.array_equal(told, prior[:, own]):
        return Starts(states, prior)  # every state forgets from one window to the next
    prior[:, own] = told
    return Starts(start_states(model, function, guess, data, theta, prior), prior)


def guessed(model: Frozen, run: Run) -> np.ndarray:
    """State guesses ``(N, ns)`` at every sample, from the measurements."""
    return first_states(model.plant, run, run.motion, dict(model.values))[0].T


def stretched(start: Any, z: int, ratio: float) -> Any:
    """Start states with the bristle's deflection, state ``z``, times ``ratio``."""
    states = (start.states if isinstance(start, Starts) else start).copy()
    states[:, z] *= ratio
    return replace(start, states=states) if isinstance(start, Starts) else states
