"""Speed and acceleration of a bench run: smoothed as much as its own jerk allows at every moment.

Pre-sliding lives in micrometres and milliseconds after a reversal, a few samples of a record that is mostly steady. One
bandwidth for the whole record hides its error there. So the third derivative of the motion is taken for random with
a variance of its own at every moment, and the variances are those that make the measured positions most likely.
At rest the speed is zero and not noise about zero: the bristle relaxes with ``|v|``, so noise of 0.02 mm/s forgets a
fifth of it in 0.1 s. For the same reason a recorded speed is not taken as it is, but measures the motion as the position does,
each by its own noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import cho_solve_banded

from pneuid.estimation.differentiate import Motion, spline_motion
from pneuid.estimation.whittaker import Array, differences, factor, times, transposed

ORDER = 3
"""Derivative that is random: the jerk."""

STENCIL = 5
"""Neighbours whose positions give the speed at the middle one."""

MISSED = 1.0 / 36.0
"""Error of that speed for a jerk that is white from sample to sample with spread one, in samples."""

WINDOW = 12
"""Samples that share one variance of the jerk; of the order of the shortest ramp worth following."""

PASSES, DRAWS = 150, 4
"""Expectation-maximisation steps, and posterior draws at each for the spread of the jerk."""

START, LEAST = 1e-2, 1e-7
"""Variance of the jerk, in noise levels per sample cubed, at the start and at least: beyond it rounding would show."""

REST, REST_SECONDS = 40, 0.05
"""Least samples and seconds of a rest, in which the position shows noise alone; a smooth reversal is shorter."""

ALONE = 8
"""Without a recorded speed a rest must be longer than the least one by one in so many of its samples."""

STRICT, CREEPS = 4.0, 3.5
"""Standard deviations of a window's mean square, and of the drift in it, above which it shows more than noise."""

ROUNDED = 0.01
"""Share of the noise to which positions are rounded before the steps of their encoder are looked for."""

EDGE = 6
"""Samples whose mean tells where a rest ends."""

DISAGREE, STRETCH = 2.0, 200
"""Mean square residual of the position, in noise levels, over that many samples from which position and speed do not agree."""

WIDER, TRIES = 4.0, 6
"""Times its spread by which a speed counts less where it does not agree with the position, and how often at most."""

ONSET = 0.005
"""Seconds at the end of a rest in which a movement may have begun below the noise."""


@dataclass(frozen=True)
class Speed:
    """A recorded speed: v (N,) in m/s and its spread (1-sigma, m/s)."""

    v: Array
    noise: float


def refined_motion(t: Array, x: Array, noise: float, speed: Speed | None = None) -> Motion:
    """Smooth ``x`` (m) over ``t`` (s, any spacing), ``noise`` in m (1-sigma): softly where the motion is steady.

    Whittaker's smoother of third differences (Proc. Edinburgh Math. Soc. 41 (1922) 63) with a variance per moment, found by
    expectation-maximisation of the marginal likelihood (Dempster, Laird, Rubin, J. R. Stat. Soc. B 39 (1977) 1). A recorded
    ``speed`` counts by its noise, and where the motion is lively by what differences of positions miss; one that leads away
    from the position (a gain or an offset of its own, a lag) counts less, by the spread that is returned. The
    bandwidth returned is that of the liveliest moment. A record too short for that gets a spline of one bandwidth. The
    same data give the same result.
    """
    if t.size < 4 * ORDER + WINDOW:
        return spline_motion(t, x, noise)
    step = float(np.median(np.diff(t)))
    s, level = (t - t[0]) / step, float(np.mean(x))
    unit = noise / step
    rate = None if speed is None else _Rate(_rates(s), speed.v / unit, speed.noise / unit)
    smooth, variance, rate = _together(s, (x - level) / noise, rate)
    spline = make_interp_spline(s, smooth, k=5)
    fitted = level + noise * smooth
    v, a = (noise * np.asarray(spline.derivative(k)(s)) / step**k for k in (1, 2))
    if speed is not None and rate is not None:
        v = unit * rate.likely(smooth, variance)
        speed = Speed(speed.v, unit * rate.noise)
    for rest in _rests(x, noise, step, speed):
        fitted[rest], v[rest], a[rest] = np.mean(x[rest]), 0.0, 0.0
    bandwidth = float(variance.max()) ** (0.5 / ORDER) / (2.0 * np.pi * step)
    return Motion(fitted, v, a, bandwidth, None if speed is None else speed.noise)


def _together(s: Array, y: Array, rate: _Rate | None) -> tuple[Array, Array, _Rate | None]:
    """Smoothed position and variances as of ``_smoothed``, and the rate with the spread at which it agrees with it."""
    smooth, variance = _smoothed(s, y, rate)
    for _ in range(TRIES):
        if rate is None or _agree(y - smooth):
            break
        rate = replace(rate, noise=WIDER * rate.noise)
        smooth, variance = _smoothed(s, y, rate)
    return smooth, variance, rate


def _agree(residual: Array) -> bool:
    """Whether no stretch of a position's residual, in noise levels, shows more than noise."""
    length = min(STRETCH, residual.size)
    return bool(np.max(np.convolve(residual**2, np.ones(length), mode="valid")) < DISAGREE * length)


@dataclass(frozen=True)
class _Rate:
    """A measured rate (N,) of ``y`` and its noise, in noise levels of ``y`` per sample; D : rows of ``_rates``."""

    D: Array
    given: Array
    noise: float

    @property
    def values(self) -> Array:
        """The rate where neighbours on both sides give another, (N - 4,)."""
        return self.given[STENCIL // 2 : -(STENCIL // 2)]

    def weights(self, variance: Array) -> Array:
        """One over the squared spread of every value about the rate by differences, for variances (N - 3,) of the jerk."""
        return 1.0 / (self.noise**2 + self._missed_square(variance))

    def likely(self, smooth: Array, variance: Array) -> Array:
        """The rate (N,) by differences of ``smooth`` (N,), and what these most likely miss of the measured one.

        At the very ends, which lack neighbours on one side, the measured one.
        """
        part, by_differences = self._missed_square(variance), times(self.D, smooth)
        inside = by_differences + (self.values - by_differences) * part / (self.noise**2 + part)
        return np.concatenate([self.given[: STENCIL // 2], inside, self.given[-(STENCIL // 2) :]])

    def _missed_square(self, variance: Array) -> Array:
        return MISSED**2 * 0.5 * (variance[:-1] + variance[1:])


def _smoothed(s: Array, y: Array, rate: _Rate | None = None) -> tuple[Array, Array]:
    """The smoothed ``y`` (N,), whose noise is 1, over ``s`` (N,) in samples, and the variances (N - 3,) of its jerk."""
    D = differences(s, ORDER)
    rng = np.random.default_rng(0)
    variance, window = np.full(len(D), START), np.ones(WINDOW)
    count = np.convolve(np.ones(len(D)), window, mode="same")
    for _ in range(PASSES):
        solver = _factor(D, variance, rate)
        jerk = times(D, cho_solve_banded(solver, _pull(y, variance, rate)))
        square = jerk**2
        for _ in range(DRAWS):
            square += times(D, cho_solve_banded(solver, _drawn(D, variance, rate, rng))) ** 2 / DRAWS
        variance = np.maximum(np.convolve(square, window, mode="same") / count, LEAST)
    return np.asarray(cho_solve_banded(_factor(D, variance, rate), _pull(y, variance, rate))), variance


def _drawn(D: Array, variance: Array, rate: _Rate | None, rng: np.random.Generator) -> Array:
    """A draw (N,) of what noise on the measurements and on the jerk pulls at, of the covariance that ``_factor`` factorises.

    Smoothed as the measurements are it is a draw of the posterior about its mean.
    """
    found = rng.standard_normal(len(D) + ORDER) + transposed(D, rng.standard_normal(len(D)) / np.sqrt(variance))
    if rate is not None:
        found += transposed(rate.D, rng.standard_normal(len(rate.D)) * np.sqrt(rate.weights(variance)))
    return found


def _pull(y: Array, variance: Array, rate: _Rate | None) -> Array:
    """What the measurements pull at (N,): the right-hand side of the smoother's equations."""
    return y if rate is None else y + transposed(rate.D, rate.weights(variance) * rate.values)


def _rates(s: Array) -> Array:
    """Rows (N - 4, 5): the weights with which five neighbours of uneven spacing give the first derivative at the middle one."""
    rows, middle = s.size - STENCIL + 1, STENCIL // 2
    at = [s[j : rows + j] for j in range(STENCIL)]
    weights = np.zeros((rows, STENCIL))
    for j in set(range(STENCIL)) - {middle}:
        weights[:, j] = 1.0 / (at[j] - at[middle])
        for k in set(range(STENCIL)) - {middle, j}:
            weights[:, j] *= (at[middle] - at[k]) / (at[j] - at[k])
    weights[:, middle] = -weights.sum(axis=1)
    return weights


def _factor(D: Array, variance: Array, rate: _Rate | None) -> tuple[Array, bool]:
    """Cholesky factor of ``1 + D' D / variance``, and of what a measured rate adds, as ``cho_solve_banded`` takes it."""
    parts = [(D, 1.0 / variance)] if rate is None else [(D, 1.0 / variance), (rate.D, rate.weights(variance))]
    return factor(np.ones(len(D) + ORDER), parts)


def _rests(x: Array, noise: float, step: float, speed: Speed | None = None) -> list[slice]:
    """Stretches in which the position (m, sampled every ``step`` s) does not move; their uncertain ends left out.

    The recorded speed must be noise about zero there, too: a creep may stay below the position's noise.
    """
    least, onset = max(REST, round(REST_SECONDS / step)), max(3, round(ONSET / step))
    if x.size < least:
        return []
    mean, square = _in_windows(x - x[0], least)
    toggling = 0.5 * _code(x, noise)
    creeps = np.abs(_drift(x - x[0], least)) > CREEPS * noise * np.sqrt(4.0 / least)
    quiet = _quiet(square - mean**2, noise, least) & ~creeps
    still = (square - mean**2 < 1.01 * toggling**2) | quiet
    if speed is not None:
        still = still & _quiet(_in_windows(speed.v, least)[1], speed.noise, least)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    found, allowed = [], 3.0 * max(noise, toggling) / np.sqrt(EDGE)
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if speed is None and end - begin < min(least // ALONE, still.size):
            continue  # of a creep a window in twenty seems still by chance
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


def _code(x: Array, noise: float) -> float:
    """Least difference (m) of two positions, rounding apart: the step of an encoder, and next to nothing without one.

    A position at rest near the edge of a code toggles by half a step, nearly twice the noise of codes on average.
    """
    apart = np.diff(np.unique(np.round((x - x[0]) / (ROUNDED * noise))))
    return float(apart.min()) * ROUNDED * noise if apart.size else 0.0


def _in_windows(y: Array, length: int) -> tuple[Array, Array]:
    """Mean and mean square of every window (N - length + 1,) of ``y`` (N,)."""
    sums = np.cumsum(np.insert(np.vstack([y, y**2]), 0, 0.0, axis=1), axis=1)
    mean, square = (sums[:, length:] - sums[:, :-length]) / length
    return mean, square


def _drift(y: Array, length: int) -> Array:
    """Mean of the second half of every window (N - length + 1,) of ``y`` (N,) less that of the first: of noise its spread is
    that of the noise times sqrt(4/length).

    A bristle that unloads by 40 um in 0.15 s creeps by half a noise level in ten samples: in a window's mean square that is
    lost, and 36 N of force with it.
    """
    half, windows = length // 2, y.size - length + 1
    means = _in_windows(y, half)[0]
    return means[length - half :][:windows] - means[:windows]


def _quiet(square: Array, noise: float, length: int) -> NDArray[np.bool_]:
    """Where a window's mean square is that of noise."""
    return np.asarray(square < noise**2 * (1.0 + STRICT * np.sqrt(2.0 / length)))

