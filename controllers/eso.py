"""Extended state observer: the force that the model does not explain, from the position alone.

The model predicts position and velocity; the innovation of the measured position corrects both and a constant
unexplained force. All three poles sit at ``exp(-bandwidth * sample_time)``, which is the fading-memory filter.
Sources: Han, IEEE Trans. Ind. Electronics 56 (2009) 900 (extended state observer); Morrison, Introduction to
Sequential Smoothing and Prediction (1969), fading-memory polynomial filter of degree 2 (the gains).
"""

from __future__ import annotations

from typing import Any

import casadi as ca


def correction_gains(bandwidth: Any, sample_time: Any) -> tuple[Any, Any, Any]:
    """Gains on the innovation: position [1], velocity [1/s], acceleration [1/s^2]; ``bandwidth`` in rad/s."""
    q = ca.exp(-bandwidth * sample_time)
    return (
        1.0 - q**3,
        1.5 * (1.0 - q) ** 2 * (1.0 + q) / sample_time,
        (1.0 - q) ** 3 / sample_time**2,
    )


def corrected(x: Any, v: Any, residual: Any, innovation: Any, mass: Any, gains: tuple[Any, Any, Any]) -> tuple:
    """Position [m], velocity [m/s] and unexplained force [N, against +x] after an ``innovation`` [m]."""
    return x + gains[0] * innovation, v + gains[1] * innovation, residual - mass * gains[2] * innovation
