"""Velocity and acceleration from a measured position: one smoothing spline for all users."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline

SEARCHED = 1500
"""Samples on which the amount of smoothing is sought."""

NEAR = 0.005
"""Relative difference of residual and noise at which the search ends."""


@dataclass(frozen=True)
class Motion:
    """Smoothed position, velocity and acceleration (N,), SI, and the spline's bandwidth in Hz."""

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    bandwidth: float


def _residual(t: np.ndarray, x: np.ndarray, lam: float) -> float:
    return float(np.sqrt(np.mean((make_smoothing_spline(t, x, lam=lam)(t) - x) ** 2)))


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
    spline = make_smoothing_spline(s, x, lam=lam)
    first, second = spline.derivative(1), spline.derivative(2)
    return Motion(spline(s), first(s) / step, second(s) / step**2, float(1 / (2 * np.pi * step * lam**0.25)))
