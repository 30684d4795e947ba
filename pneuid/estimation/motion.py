"""Speed and acceleration of a bench run: smoothed as much as its own jerk allows at every moment.

Pre-sliding lives in micrometres and milliseconds after a reversal, a few samples of a record that is mostly steady. One
bandwidth for the whole record hides its error there. So the third derivative of the motion is taken for random with
a variance of its own at every moment, and the variances are those that make the measured positions most likely.
At rest the speed is zero and not noise about zero: the bristle relaxes with ``|v|``, so noise of 0.02 mm/s forgets a
fifth of it in 0.1 s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import cho_solve_banded, cholesky_banded

from pneuid.estimation.differentiate import Motion, spline_motion

Array = NDArray[np.float64]

ORDER = 3
"""Derivative that is random: the jerk."""

WINDOW = 12
"""Samples that share one variance of the jerk; of the order of the shortest ramp worth following."""

PASSES, DRAWS = 150, 4
"""Expectation-maximisation steps, and posterior draws at each for the spread of the jerk."""

START, LEAST = 1e-2, 1e-7
"""Variance of the jerk, in noise levels per sample cubed, at the start and at least: beyond it rounding would show."""

REST, REST_SECONDS = 40, 0.05
"""Least samples and seconds of a rest, in which the position shows noise alone; a smooth reversal is shorter."""

STRICT = 4.0
"""Standard deviations of a window's mean square above which it shows more than noise."""

EDGE = 6
"""Samples whose mean tells where a rest ends."""

ONSET = 0.005
"""Seconds at the end of a rest in which a movement may have begun below the noise."""


def refined_motion(t: Array, x: Array, noise: float) -> Motion:
    """Smooth ``x`` (m) over ``t`` (s, any spacing), ``noise`` in m (1-sigma): softly where the motion is steady.

    Whittaker's smoother of third differences (Proc. Edinburgh Math. Soc. 41 (1922) 63) with a variance per moment, found by
    expectation-maximisation of the marginal likelihood (Dempster, Laird, Rubin, J. R. Stat. Soc. B 39 (1977) 1). The
    bandwidth returned is that of the liveliest moment. A record too short for that gets a spline of one bandwidth. The
    same data give the same result.
    """
    if t.size < 4 * ORDER + WINDOW:
        return spline_motion(t, x, noise)
    step = float(np.median(np.diff(t)))
    s, level = (t - t[0]) / step, float(np.mean(x))
    smooth, variance = _smoothed(s, (x - level) / noise)
    spline = make_interp_spline(s, smooth, k=5)
    fitted = level + noise * smooth
    v, a = (noise * np.asarray(spline.derivative(k)(s)) / step**k for k in (1, 2))
    for rest in _rests(x, noise, step):
        fitted[rest], v[rest], a[rest] = np.mean(x[rest]), 0.0, 0.0
    bandwidth = float(variance.max()) ** (0.5 / ORDER) / (2.0 * np.pi * step)
    return Motion(fitted, v, a, bandwidth)


def _smoothed(s: Array, y: Array) -> tuple[Array, Array]:
    """The smoothed ``y`` (N,), whose noise is 1, over ``s`` (N,) in samples, and the variances (N - 3,) of its jerk."""
    D = _third_differences(s)
    rng = np.random.default_rng(0)
    variance, window = np.full(len(D), START), np.ones(WINDOW)
    count = np.convolve(np.ones(len(D)), window, mode="same")
    for _ in range(PASSES):
        factor = _factor(D, variance)
        jerk = _differenced(D, cho_solve_banded(factor, y))
        square = jerk**2
        for _ in range(DRAWS):
            # a draw of the posterior about its mean: noise on the positions and on the jerk, smoothed as they are
            kicks = _transposed(D, rng.standard_normal(len(D)) / np.sqrt(variance))
            drawn = cho_solve_banded(factor, rng.standard_normal(y.size) + kicks)
            square += _differenced(D, drawn) ** 2 / DRAWS
        variance = np.maximum(np.convolve(square, window, mode="same") / count, LEAST)
    return np.asarray(cho_solve_banded(_factor(D, variance), y)), variance


def _third_differences(s: Array) -> Array:
    """Rows (N - 3, 4): the weights with which four neighbours of uneven spacing give the third derivative."""
    rows = s.size - ORDER
    weights = np.full((rows, ORDER + 1), 6.0)
    for j in range(ORDER + 1):
        for k in range(ORDER + 1):
            if k != j:
                weights[:, j] /= s[j : rows + j] - s[k : rows + k]
    return weights


def _differenced(D: Array, y: Array) -> Array:
    return np.asarray(sum(D[:, j] * y[j : j + len(D)] for j in range(ORDER + 1)))


def _transposed(D: Array, jerk: Array) -> Array:
    found = np.zeros(len(D) + ORDER)
    for j in range(ORDER + 1):
        found[j : j + len(D)] += D[:, j] * jerk
    return found


def _factor(D: Array, variance: Array) -> tuple[Array, bool]:
    """Cholesky factor of ``1 + D' D / variance`` as ``cho_solve_banded`` takes it."""
    band = np.zeros((ORDER + 1, len(D) + ORDER))
    band[ORDER] = 1.0
    for i in range(ORDER + 1):
        for j in range(i, ORDER + 1):
            band[ORDER + i - j, j : j + len(D)] += D[:, i] * D[:, j] / variance
    return cholesky_banded(band), False


def _rests(x: Array, noise: float, step: float) -> list[slice]:
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
