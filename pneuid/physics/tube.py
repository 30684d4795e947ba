"""A metering edge and a tube in series: what the edge's flow keeps of itself with the tube between it and the chamber.

The tube lets ``C_tube sqrt(p_up^2 - p_down^2)`` pass, as turbulent friction does at a constant temperature and ISO 6358 with a
critical ratio of zero; the edge follows ISO 6358's quarter ellipse. Where both let the same flow through, the pressure at the
valve's port is the root of a quadratic. Sources: Richer, Hurmuzlu, J. Dyn. Syst. Meas. Control 122 (2000) 416, part 1
(pressure drop along the tubes); ISO 6358-1:2013, eq. (1) and (2), with ISO 6358-3:2014 for components in series.
"""

from __future__ import annotations

import casadi as ca

from pneuid.physics.smoothing import Expression
from pneuid.physics.valve import squared_share

_LEVEL = 1.0e-3
"""Squared share of the choked flow below which a flow counts as that between nearly equal pressures."""

_LEAST = 1.0e-9
"""Least value under a root, so that its derivative is finite in the branch not taken."""


def share_filling(R: Expression, p: Expression, psup: Expression, b: Expression) -> Expression:
    """Share (0..1) of its flow from the supply ``psup`` that an edge keeps with a tube between it and a chamber at ``p``.

    R : squared ratio of the edge's conductance, as far as it is open, to the tube's; b : the edge's critical pressure ratio;
    pressures in Pa, absolute. All of the flow where R is zero, or the port's pressure leaves the edge choked.
    """
    g = 1.0 / (1.0 - b)
    ratio, P = ca.fmin(p / psup, 1.0), R * g * g
    # p_port / psup from (p_port^2 - p^2) = R psup^2 (1 - (p_port / psup - b)^2 g^2); below b the edge is choked
    port = (P * b + ca.sqrt(ca.fmax((1.0 + P) * (ratio * ratio + R) - P * b * b, _LEAST))) / (1.0 + P)
    return _over(port, ratio, R * g, b)


def share_venting(R: Expression, p: Expression, patm: Expression, b: Expression) -> Expression:
    """Share (0..1) of its flow into the open that an edge keeps with a tube between it and a chamber at ``p``.

    As ``share_filling``. The port's pressure stays below the chamber's, so that a choked edge loses flow as well.
    """
    g = 1.0 / (1.0 - b)
    ratio = ca.fmin(patm / p, 1.0)
    P = R * g * g
    # p_port / p from (p^2 - p_port^2) = R p_port^2 (1 - (patm / p_port - b)^2 g^2), and without the bracket where it is choked
    A, B, Q = 1.0 + R - P * b * b, P * b * ratio, 1.0 + P * ratio * ratio
    subsonic, choked = Q / (B + ca.sqrt(ca.fmax(B * B + A * Q, _LEAST))), 1.0 / ca.sqrt(1.0 + R)
    port = ca.if_else(ratio < b * choked, choked, subsonic)
    return port * _over(ratio / port, ratio, R * g, b)


def _over(at: Expression, alone: Expression, near: Expression, b: Expression) -> Expression:
    """Flow at one pressure ratio over that at another; ``1 / sqrt(1 + near)`` in the limit of equal pressures."""
    return ca.sqrt((squared_share(at, b) + _LEVEL / (1.0 + near)) / (squared_share(alone, b) + _LEVEL))
