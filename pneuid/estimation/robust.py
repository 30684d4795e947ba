"""Outliers: samples that stand alone far off count by Huber's loss instead of the square, and are reported."""

from __future__ import annotations

import numpy as np

FAR = 6.0
"""Distance from the surroundings, in noise levels, from which a single sample is an outlier."""

HUBER = 3.0
"""Residual at which Huber's loss turns from the square to the absolute value."""

BEND = 0.3
"""Share of a sample's distance that its neighbours may have: a bend moves them too, a glitch of one sample does not."""


def outliers(y: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Which samples of ``y`` (N,) stand alone far off at ``noise`` (1-sigma, same unit), and what the others say (N,).

    The others: the median over the means of the pairs at a distance of 1, 2 and 3 samples, exact at constant speed, or over
    parabolas through two such pairs, exact at constant acceleration, or what the two next pairs or the two samples on one side
    say alone, whichever is nearest to the sample; after Hampel's identifier, J. Am. Statist. Assoc. 69 (1974) 383. A slow
    logger sees a pressure rise and fall within a few samples: no outlier is what the samples around it bend as much.
    """
    reach, n = 4, y.size
    padded = np.pad(y, reach, mode="reflect", reflect_type="odd")
    at = {j: padded[reach + j : reach + j + n] for j in range(-reach, reach + 1)}
    pair = {j: 0.5 * (at[-j] + at[j]) for j in range(1, reach + 1)}
    # most of these leave out any one neighbour, which may be an outlier itself
    spans = ((1, 2), (1, 3), (2, 3), (2, 4), (3, 4))
    others = np.array(
        [
            np.median([pair[1], pair[2], pair[3]], axis=0),
            np.median([_parabola(pair[a], pair[b], a, b) for a, b in spans], axis=0),
            _parabola(pair[1], pair[2], 1, 2), 2.0 * at[-1] - at[-2], 2.0 * at[1] - at[2],
        ]
    )  # fmt: skip
    middle = np.take_along_axis(others, np.argmin(np.abs(others - y), axis=0)[None], axis=0)[0]
    off = np.abs(y - middle)
    beside = np.maximum(np.append(off[1:], 0.0), np.insert(off[:-1], 0, 0.0))
    bends = np.max([np.abs(at[j - 1] - 2.0 * at[j] + at[j + 1]) for j in (-3, -2, 2, 3)], axis=0)
    found = (off > FAR * noise) & (beside < np.maximum(BEND * off, HUBER * noise)) & (off > bends)
    found[:reach] = found[-reach:] = False
    return found, middle


def _parabola(near: np.ndarray, far: np.ndarray, a: int, b: int) -> np.ndarray:
    """Middle (N,) of the parabolas through the pairs at distances ``a`` and ``b``, whose means are ``near`` and ``far``."""
    return np.asarray((b**2 * near - a**2 * far) / (b**2 - a**2))


def pseudo_values(y: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """``y`` (N,) with outliers drawn in to ``HUBER`` noise levels from the local median, and which they were.

    Least squares on them has the gradient of Huber's loss; Huber, Robust Statistics (1981), section 7.8 (pseudo-values).
    """
    found, middle = outliers(y, noise)
    return np.where(found, middle + np.clip(y - middle, -HUBER * noise, HUBER * noise), y), found
