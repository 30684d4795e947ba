"""Forces on the rod and on the cylinder's body other than pressure and friction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import compiled

Array = NDArray[np.float64]

GUIDE = 0.5  # 1/s, viscous drag of the load's own guide over its mass
DETENT_WIDTH = 0.04  # of the stroke


@compiled
def stop_force(x: float, v: float, par: Array) -> float:
    """Push of the end stops [N], positive in +x; a hard spring and damper that never pulls."""
    if x < 0.0:
        return max(-par[at.STOP_STIFFNESS] * x - par[at.STOP_DAMPING] * v, 0.0)
    if x > par[at.STROKE]:
        return min(par[at.STOP_STIFFNESS] * (par[at.STROKE] - x) - par[at.STOP_DAMPING] * v, 0.0)
    return 0.0


@compiled
def load_force(x: float, v: float, par: Array) -> float:
    """Weight, cable pull, return spring and machine parts along the way [N], positive against +x."""
    force = par[at.MASS] * par[at.GRAVITY]
    if par[at.H_PULL] != 0.0:
        force += par[at.H_PULL] * (1.0 + 0.06 * (x / par[at.STROKE] - 0.5))  # a constant-force spring is not quite
    from_middle = x / par[at.STROKE] - 0.5
    if par[at.H_SPRING] != 0.0:
        pulled = x / par[at.STROKE] - par[at.F_SPRING_CENTRE]
        force += par[at.H_SPRING] * par[at.STROKE] * pulled * (1.0 + par[at.F_SPRING_HARDENING] * pulled * pulled)
    if par[at.H_COGGING] != 0.0:
        # teeth with flat flanks
        force += par[at.H_COGGING] * min(max(1.6 * math.sin(2.0 * math.pi * x / par[at.S_PITCH]), -1.0), 1.0)
    if par[at.H_DRAG_CHAIN] != 0.0:
        force += par[at.H_DRAG_CHAIN] * from_middle * v
    if par[at.H_DETENT] != 0.0:
        s = from_middle / DETENT_WIDTH
        force += par[at.H_DETENT] * 3.08 * s / (1.0 + s * s) ** 2  # 1 at its largest
    return force


@compiled
def flank_force(y: Array, par: Array) -> float:
    """Force [N] in +x that the rod gets from the load behind its play; none while the load floats in it."""
    ahead, closing = y[at.LOAD_X] - y[at.X], y[at.LOAD_V] - y[at.V]
    half = 0.5 * par[at.H_BACKLASH]
    light = par[at.MASS] * par[at.S_LOAD_MASS] / (par[at.MASS] + par[at.S_LOAD_MASS])
    stiffness = par[at.F_CONTACT_STIFFNESS]
    damping = 2.0 * par[at.F_CONTACT_DAMPING] * math.sqrt(stiffness * light)
    if ahead > half:
        return max(stiffness * (ahead - half) + damping * closing, 0.0)
    if ahead < -half:
        return min(stiffness * (ahead + half) + damping * closing, 0.0)
    return 0.0


@compiled
def load_rates(flank: float, y: Array, par: Array, dy: Array) -> None:
    """Motion of the load behind play."""
    dy[at.LOAD_X] = y[at.LOAD_V]
    dy[at.LOAD_V] = -flank / par[at.S_LOAD_MASS] - par[at.GRAVITY] - GUIDE * y[at.LOAD_V]


@compiled
def body_rates(force: float, y: Array, par: Array, dy: Array) -> None:
    """Motion of the cylinder's body on its bracket under ``force`` [N] in +x."""
    stiffness, mass = 1.0 / par[at.H_COMPLIANCE], par[at.S_BODY_MASS]
    bent = y[at.BODY_X] / par[at.F_BRACKET_HARDENS_AT]
    damping = 2.0 * par[at.F_BRACKET_DAMPING] * math.sqrt(stiffness * mass)
    dy[at.BODY_X] = y[at.BODY_V]
    dy[at.BODY_V] = (force - stiffness * y[at.BODY_X] * (1.0 + bent * bent) - damping * y[at.BODY_V]) / mass
