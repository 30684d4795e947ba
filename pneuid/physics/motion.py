"""Force balance on the piston and rod, end stops included."""

from __future__ import annotations

import casadi as ca

from pneuid.physics.smoothing import Expression

GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s^2."""

STOP_STIFFNESS = 1.0e6
"""Stiffness of the end stops, N/m."""

STOP_DAMPING = 2.0e3
"""Damping of the end stops when fully in contact, N s/m."""

STOP_ONSET = 1.0e-4
"""Penetration over which the end stop force rises smoothly, m."""


def end_stop_force(x: Expression, v: Expression, stroke: Expression) -> Expression:
    """Force in N of the end stops against +x; exactly zero for ``0 <= x <= stroke``."""
    below, above = ca.fmax(-x, 0.0), ca.fmax(x - stroke, 0.0)
    push = STOP_STIFFNESS * (above * above / (above + STOP_ONSET) - below * below / (below + STOP_ONSET))
    depth = above + below
    return push + STOP_DAMPING * v * depth / (depth + STOP_ONSET)


def pressure_force(p1: Expression, p2: Expression, A1: Expression, A2: Expression, patm: Expression) -> Expression:
    """Net pressure force on the piston in N, positive when it extends; pressures absolute in Pa."""
    return (p1 - patm) * A1 - (p2 - patm) * A2
