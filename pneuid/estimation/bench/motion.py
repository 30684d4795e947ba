"""Speed and acceleration of a bench run: a smoothing spline that is softer where the motion is steady.

Pre-sliding lives in micrometres and milliseconds after a reversal, a few samples of a record that is mostly steady. One
spline for the whole record, softened until its residual is the noise, hides its error there. At rest the speed is zero
and not noise about zero: the bristle relaxes with ``|v|``, so noise of 0.02 mm/s forgets a fifth of it in 0.1 s.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_smoothing_spline

from pneuid.estimation.differentiate import Motion

WINDOW = 24
"""Samples over which the residual is judged."""

STRICT = 4.0
"""Standard deviations of a window's mean square above which the spline is too soft there."""

STIFFER = 4.0
"""Factor on the weight of such a window at each pass; the local bandwidth grows by its fourth root."""

PASSES = 16

REST, REST_SECONDS = 40, 0.05
"""Least samples and seconds of a rest, in which the position shows noise alone; a smooth reversal is shorter."""

EDGE = 6
"""Samples whose mean tells where a rest ends."""

ONSET = 0.005
"""Seconds at the end of a rest in which a movement may have begun below the noise."""


def refined_motion(t: np.ndarray, x: np.ndarray, noise: float, even: Motion) -> Motion:
    """Smooth ``x`` (m) over ``t`` (s, any spacing) so that the residual is noise (m, 1-sigma) in every short window.

    Starts from ``even``, the spline of one bandwidth for the whole record, and raises the weight of the data wherever
    the mean square of the residual over ``WINDOW`` samples shows more than noise. The bandwidth returned is that of
    the liveliest window. Reinsch, Numer. Math. 10 (1967) 177, with weights.
    """
    step = float(np.median(np.diff(t)))
    s = (t - t[0]) / step
    lam = (1.0 / (2.0 * np.pi * step * even.bandwidth)) ** 4
    weight, window = np.ones(t.size), np.ones(min(WINDOW, t.size))
    count = np.convolve(np.ones(t.size), window, mode="same")
    limit = 1.0 + STRICT * np.sqrt(2.0 / count)
    spline, fitted = None, even.x
    for _ in range(PASSES):
        rough = np.convolve(((x - fitted) / noise) ** 2, window, mode="same") / count > limit
        if not rough.any():
            break
        weight[np.convolve(rough, window, mode="same") > 0.5] *= STIFFER
        spline = make_smoothing_spline(s, x, w=weight, lam=lam)
        fitted = np.asarray(spline(s))
    v, a, widest = even.v, even.a, even.bandwidth
    if spline is not None:
        v, a = spline.derivative(1)(s) / step, spline.derivative(2)(s) / step**2
        widest = even.bandwidth * float(weight.max()) ** 0.25
    fitted, v, a = fitted.copy(), v.copy(), a.copy()
    for rest in _rests(x, noise, step):
        fitted[rest], v[rest], a[rest] = np.mean(x[rest]), 0.0, 0.0
    return Motion(fitted, v, a, widest)


def _rests(x: np.ndarray, noise: float, step: float) -> list[slice]:
    """Stretches in which the position (m, sampled every ``step`` s) does not move; their uncertain ends left out."""
    least, onset = max(REST, round(REST_SECONDS / step)), max(3, round(ONSET / step))
    if x.size < least:
        return []
    sums = np.cumsum(np.insert(np.vstack([x - x[0], (x - x[0]) ** 2]), 0, 0.0, axis=1), axis=1)
    mean, square = (sums[:, least:] - sums[:, :-least]) / least
    still = square - mean**2 < noise**2 * (1.0 + STRICT * np.sqrt(2.0 / least))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    found, allowed = [], 3.0 * noise / np.sqrt(EDGE)
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        # a window that is still starts at every sample from begin to end - 1; its tails may hold the first movement
        first, last = int(begin), int(end) - 1 + least
        level = float(np.mean(x[first + least // 4 : last - least // 4]))
        while first < last and abs(float(np.mean(x[first : first + EDGE])) - level) > allowed:
            first += 1
        while last > first and abs(float(np.mean(x[last - EDGE : last])) - level) > allowed:
            last -= 1
        # a movement begins below the noise: what is lost of it would count as bristle stiffness
        first, last = first + onset * (first > 0), last - onset * (last < x.size)
        if last - first >= EDGE:
            found.append(slice(first, last))
    return found
