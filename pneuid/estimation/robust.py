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
    parabolas through two such pairs, exact at constant acceleration, whichever is nearer to the sample; after
    Hampel's identifier, J. Am. Statist. Assoc. 69 (1974) 383.
    """
    reach, n = 4, y.size
    padded = np.pad(y, reach, mode="reflect", reflect_type="odd")
    pair = {j: 0.5 * (padded[reach - j : reach - j + n] + padded[reach + j : reach + j + n]) for j in range(1, reach + 1)}
    straight = np.median([pair[1], pair[2], pair[3]], axis=0)
    # most of these leave out any one neighbour, which may be an outlier itself
    spans = ((1, 2), (1, 3), (2, 3), (2, 4), (3, 4))
    curved = np.median([(b**2 * pair[a] - a**2 * pair[b]) / (b**2 - a**2) for a, b in spans], axis=0)
    middle = np.where(np.abs(y - straight) < np.abs(y - curved), straight, curved)
    off = np.abs(y - middle)
    beside = np.maximum(np.append(off[1:], 0.0), np.insert(off[:-1], 0, 0.0))
    found = (off > FAR * noise) & (beside < np.maximum(BEND * off, HUBER * noise))
    found[:reach] = found[-reach:] = False
    return found, middle


def pseudo_values(y: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """``y`` (N,) with outliers drawn in to ``HUBER`` noise levels from the local median, and which they were.

    Least squares on them has the gradient of Huber's loss; Huber, Robust Statistics (1981), section 7.8 (pseudo-values).
    """
    found, middle = outliers(y, noise)
    return np.where(found, middle + np.clip(y - middle, -HUBER * noise, HUBER * noise), y), found
