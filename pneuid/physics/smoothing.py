"""Smooth stand-ins for |a| and max(a, 0), each with an explicit width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

Expression = Any
"""A float or a CasADi symbol."""


@dataclass(frozen=True)
class Smoothing:
    """Widths of the smoothed kinks: numerical choices, never fitted.

    speed : m/s, rounds ``|v|``; opening : 1, rounds the valve's zero; laminar : 1, the width below pressure ratio 1
    in which the flow is linear (ISO 6358 has an infinite slope there). Wider than ``FINE`` biases ``sigma0`` by
    several standard errors; wider still (``COARSE``) makes a rough start solvable.
    """

    speed: Expression
    opening: Expression
    laminar: Expression


FINE = Smoothing(speed=1e-6, opening=1e-6, laminar=1e-3)
COARSE = Smoothing(speed=3e-5, opening=1e-4, laminar=2e-3)


def absolute(a: Expression, width: Expression) -> Expression:
    """``sqrt(a^2 + width^2)``, off by at most ``width``."""
    return ca.sqrt(a * a + width * width)


def slip_speed(v: Expression, width: Expression) -> Expression:
    """``v^2 / sqrt(v^2 + width^2)``: ``|v|`` that is exactly zero at rest, however wide the rounding."""
    return v * v / absolute(v, width)


def positive_part(a: Expression, width: Expression) -> Expression:
    """Smooth ``max(a, 0)``, off by at most ``width/2``."""
    return 0.5 * (a + absolute(a, width))


def sign(a: Expression, width: Expression) -> Expression:
    """Smooth sign, ``a / sqrt(a^2 + width^2)``."""
    return a / absolute(a, width)
