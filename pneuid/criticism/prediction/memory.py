"""What the windows before tell of an effect's slow state: a warmth that lasts minutes is not found anew in 0.1 s."""

from __future__ import annotations

import numpy as np

ENOUGH = 3
"""Windows, the present one included, from which a state is carried on."""

LASTING = 0.8
"""Share of a deviation that must last from one window to a later one for the earlier to say anything."""

CERTAIN = 0.02
"""Least spread of a state carried on, relative to its spread at the start of a run."""


def carried(
    estimated: np.ndarray, followed: np.ndarray, forgotten: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Guesses ``(W, ne)`` of effect states at the start of each window and their 1-sigma ``(W, ne)``.

    estimated : found in each window by itself; followed : along the measured trajectory from the initial values, so that the
    two differ by what was wrong at the start of the run; forgotten : by then, the integral of the decay (dimensionless); all
    ``(W, ne)`` in the order of time; spread ``(ne,)`` at the start of a run. A window is told by itself and those before it,
    by their median, as one that breaks away may find anything.
    """
    W, ne = estimated.shape
    guess, sigma = followed.copy(), np.tile(spread, (W, 1))
    deviation = estimated - followed
    for i in range(ne):
        for k in range(W):
            lasting = np.exp(forgotten[: k + 1, i] - forgotten[k, i])
            telling = lasting > LASTING
            if telling.sum() < ENOUGH:
                continue
            told = deviation[: k + 1, i][telling] * lasting[telling]
            middle = float(np.median(told))
            scatter = 1.5 * float(np.median(np.abs(told - middle))) / np.sqrt(told.size)
            guess[k, i] = followed[k, i] + middle
            sigma[k, i] = min(max(scatter, CERTAIN * spread[i]), spread[i])
    return guess, sigma
