"""A first-order lag that may vanish: regular, with a useful derivative, where its time constant is zero."""

from __future__ import annotations

import casadi as ca

from pneuid.physics.smoothing import Expression


def vanishing_lag(delay: Expression, shortest: float) -> tuple[Expression, Expression]:
    """Weight (0..1) and time constant (s) of a lag whose mean delay is ``delay`` (s), for any ``delay >= 0``.

    With ``y`` following ``value`` by the time constant, ``value - weight (value - y)`` has the transfer function
    ``(1 + (T - delay) s) / (1 + T s)``: exactly ``value`` at ``delay = 0``, late by ``delay`` at low frequency, and the plain
    lag ``1/(1 + delay s)`` once ``delay`` is long against ``shortest`` (s). The plain lag is singular at zero.
    """
    time_constant = ca.sqrt(delay * delay + shortest * shortest)
    return delay / time_constant, time_constant
