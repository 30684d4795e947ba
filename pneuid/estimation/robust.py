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
    the parabolas through two of these pairs, exact at constant acceleration, whichever is nearer to the sample; after
    Hampel's identifier, J. Am. Statist. Assoc. 69 (1974) 383.
    """
    padded = np.pad(y, 3, mode="reflect", reflect_type="odd")
    n = y.size
    one, two, three = (0.5 * (padded[3 - j : 3 - j + n] + padded[3 + j : 3 + j + n]) for j in (1, 2, 3))
    straight = np.median([one, two, three], axis=0)
    curved = np.median([(4 * one - two) / 3, (9 * one - three) / 8, (9 * two - 4 * three) / 5], axis=0)
    middle = np.where(np.abs(y - straight) < np.abs(y - curved), straight, curved)
    off = np.abs(y - middle)
    beside = np.maximum(np.append(off[1:], 0.0), np.insert(off[:-1], 0, 0.0))
    found = (off > FAR * noise) & (beside < np.maximum(BEND * off, HUBER * noise))
    found[:3] = found[-3:] = False
    return found, middle


def pseudo_values(y: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """``y`` (N,) with outliers drawn in to ``HUBER`` noise levels from the local median, and which they were.

    Least squares on them has the gradient of Huber's loss; Huber, Robust Statistics (1981), section 7.8 (pseudo-values).
    """
    found, middle = outliers(y, noise)
    return np.where(found, middle + np.clip(y - middle, -HUBER * noise, HUBER * noise), y), found
