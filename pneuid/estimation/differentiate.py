"""Velocity and acceleration from a measured position: one smoothing spline for all users."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

SEARCHED = 1500
"""Samples on which the amount of smoothing is sought."""

NEAR = 0.005
"""Relative difference of residual and noise at which the search ends."""


@dataclass(frozen=True)
class Motion:
    """Smoothed position, velocity and acceleration (N,), SI, and the spline's bandwidth in Hz.

    speed_noise : spread (1-sigma, m/s) with which a recorded speed counted, None where none did.
    """

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    bandwidth: float
    speed_noise: float | None = None


def _smoothed(s: np.ndarray, x: np.ndarray, lam: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and second derivatives (N,) at its knots ``s`` of the natural cubic spline that minimises the sum of squares to
    ``x`` plus ``lam`` times the integral of the squared second derivative; Reinsch (1967), eq. (9) to (14).

    ``scipy.interpolate.make_smoothing_spline`` is the same curve, but builds its system row by row in Python, which was most of
    the preparation of a long record.
    """
    step = np.diff(s)
    left, right = 1.0 / step[:-1], 1.0 / step[1:]
    middle = -left - right
    band = np.zeros((3, s.size - 2))
    band[2] = (step[:-1] + step[1:]) / 3.0 + lam * (left**2 + middle**2 + right**2)
    band[1, 1:] = step[1:-1] / 6.0 + lam * (right[:-1] * middle[1:] + middle[:-1] * left[1:])
    band[0, 2:] = lam * right[:-2] * left[2:]
    second = np.zeros(s.size)
    second[1:-1] = solveh_banded(band, np.diff(np.diff(x) / step), check_finite=False)
    return x - lam * np.diff(np.diff(second, prepend=0.0, append=0.0) / np.pad(step, 1, mode="edge")), second


def _slopes(s: np.ndarray, value: np.ndarray, second: np.ndarray) -> np.ndarray:
    """First derivatives (N,) at the knots of the cubic spline with these values and second derivatives."""
    step = np.diff(s)
    chord = np.diff(value) / step
    last = chord[-1] + step[-1] * (second[-2] + 2.0 * second[-1]) / 6.0
    return np.append(chord - step * (2.0 * second[:-1] + second[1:]) / 6.0, last)


def _residual(s: np.ndarray, x: np.ndarray, lam: float) -> float:
    return float(np.sqrt(np.mean((_smoothed(s, x, lam)[0] - x) ** 2)))


def _liveliest(s: np.ndarray, x: np.ndarray) -> slice:
    """The stretch of ``SEARCHED`` samples with the most motion: at rest any spline stays within the noise."""
    if s.size <= SEARCHED:
        return slice(None)
    speed = np.diff(x[::10]) ** 2
    width = SEARCHED // 10
    energy = np.convolve(speed, np.ones(width), mode="valid")
    first = 10 * int(np.argmax(energy))
    return slice(first, first + SEARCHED)


def spline_motion(t: np.ndarray, x: np.ndarray, noise: float) -> Motion:
    """Smooth ``x`` (m) over ``t`` (s, any spacing) so that the residual equals ``noise`` (m, 1-sigma).

    The spline of least curvature at that distance: Reinsch, Numer. Math. 10 (1967) 177. For a sampling interval
    ``dt`` the spline acts as a low-pass of cut-off ``1/(2 pi (lam/dt)^(1/4))``, which is reported.
    """
    step = float(np.median(np.diff(t)))
    # work in units of samples: the spline's system is badly scaled in seconds at kHz rates
    s = (t - t[0]) / step
    piece = _liveliest(s, x)
    low, high = -2.0, 14.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        residual = _residual(s[piece], x[piece], 10**middle)
        if abs(residual / noise - 1.0) < NEAR:
            low = high = middle
            break
        low, high = (middle, high) if residual < noise else (low, middle)
    lam = 10 ** (0.5 * (low + high))
    value, second = _smoothed(s, x, lam)
    bandwidth = float(1 / (2 * np.pi * step * lam**0.25))
    return Motion(value, _slopes(s, value, second) / step, second / step**2, bandwidth)
