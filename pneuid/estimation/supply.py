"""The recorded supply pressure: what its sensor's noise leaves of it.

It is an input, and simulated flows follow its noise: 0.47 kPa of white noise at 500 Hz drove the pressures of whole runs so
far that a rig which lacked nothing left 5 % more than its sensors' noise, and Fc came out eleven standard errors off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded
from scipy.optimize import minimize_scalar

from pneuid.estimation.whittaker import Array, differences, factor

ORDER = 2
"""Derivative that is random: the pressure's rate wanders."""

SLOWEST, FASTEST = 1e-14, 1.0
"""Variances of that derivative, in noise levels per sample squared, between which the likeliest is sought: below the first
rounding would show, above the second nothing is smoothed."""


@dataclass(frozen=True)
class Supply:
    """A supply pressure (N,) in Pa, and the bandwidth in Hz up to which the recorded one was followed."""

    pressure: Array
    bandwidth: float


def smoothed_supply(t: Array, psup: Array, noise: float, recorded: Array) -> Supply:
    """Smooth ``psup`` (N,) in Pa over ``t`` (N,) in s of any spacing, measured with ``noise`` (1-sigma, Pa).

    recorded : (N,), 0 where a sample is missing. Whittaker's smoother of second differences, whose variance is the one that
    makes the whole record most likely (Patterson and Thompson, Biometrika 58 (1971) 545): a steady supply becomes its mean and
    trend, one that moves faster than its noise can hide stays as it was recorded. A record without noise stays as well.
    """
    step = float(np.median(np.diff(t)))
    if noise <= 0.0 or t.size <= 2 * ORDER:
        return Supply(psup, 0.5 / step)
    level, D = float(np.mean(psup)), differences((t - t[0]) / step, ORDER)
    counts = np.where(recorded > 0.0, 1.0, 0.0)
    y = (psup - level) / noise

    def smooth(variance: float) -> tuple[Array, Array]:
        solver = factor(counts, [(D, np.full(len(D), 1.0 / variance))])
        return cho_solve_banded(solver, counts * y), np.log(solver[0][-1])

    def unlikely(exponent: float) -> float:
        found, logs = smooth(np.exp(exponent))
        return float((counts * y) @ (y - found) + 2.0 * logs.sum() + len(D) * exponent)

    best = minimize_scalar(unlikely, bounds=(np.log(SLOWEST), np.log(FASTEST)), method="bounded", options={"xatol": 0.05})
    variance = float(np.exp(best.x))
    bandwidth = min(variance ** (0.5 / ORDER) / (2.0 * np.pi), 0.5) / step
    return Supply(level + noise * smooth(variance)[0], bandwidth)
