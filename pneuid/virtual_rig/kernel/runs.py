"""Whole runs: open loop, closed loop with a logger's controller, and the bench's imposed motion.

The loops over samples are plain Python: a call of ``advance`` costs a microsecond, and compiling all equations once more
for each kind of run would cost seconds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel.compiled import entry
from pneuid.virtual_rig.kernel.friction import friction_force, remember
from pneuid.virtual_rig.kernel.load import load_force
from pneuid.virtual_rig.kernel.motion import advance

Array = NDArray[np.float64]


def run_commands(y: Array, u: Array, supply: Array, ramp: bool, duration: float, substeps: int, par: Array) -> Array:
    """Open loop: states ``[samples, STATES]`` under a command array, one state per sample."""
    samples = u.shape[0]
    states = np.empty((samples, at.STATES))
    states[0] = y
    for k in range(samples - 1):
        u_end = u[k + 1] if ramp else u[k]
        advance(y, u[k], u_end, supply[k], duration, substeps, par)
        states[k + 1] = y
        if not math.isfinite(y[at.X] + y[at.V] + y[at.P1] + y[at.P2] + y[at.Z]):
            return states[: k + 2]
    return states


def rounded(value: float, step: float) -> float:
    """``value`` on the grid of a converter; a step of zero is an ideal one."""
    return value if step == 0.0 else step * round(value / step)


def run_closed_loop(
    y: Array,
    reference: Array,
    speed: Array,
    dither: Array,
    noise: Array,
    gain: float,
    integral: float,
    feed_forward: float,
    u_step: float,
    x_step: float,
    supply: float,
    ramp: bool,
    duration: float,
    substeps: int,
    par: Array,
) -> tuple[Array, Array]:
    """Follow a reference as an engineer's logger does: measure, compute, apply one sample later.

    ``u[k+1] = null + feed_forward speed[k+1] + gain (e[k] + integral sum(e) duration) + dither[k+1]``
    with ``e = reference - measured x``, limited to full scale, the integral to a tenth of it.
    Returns the applied commands and the states at the samples.
    """
    samples = reference.shape[0]
    states = np.empty((samples, at.STATES))
    u = np.empty(samples)
    u[0] = par[at.NULL]
    states[0] = y
    held = 0.0
    for k in range(samples - 1):
        error = reference[k] - rounded(y[at.X] + noise[k], x_step)
        held = min(max(held + gain * integral * error * duration, -0.1 * par[at.FULL_SCALE]), 0.1 * par[at.FULL_SCALE])
        wanted = feed_forward * speed[k + 1] + gain * error + held + dither[k + 1]
        u[k + 1] = rounded(par[at.NULL] + min(max(wanted, -par[at.FULL_SCALE]), par[at.FULL_SCALE]), u_step)
        advance(y, u[k], u[k + 1] if ramp else u[k], supply, duration, substeps, par)
        states[k + 1] = y
        if not math.isfinite(y[at.X] + y[at.V] + y[at.P1] + y[at.P2] + y[at.Z]):
            return u[: k + 2], states[: k + 2]
    return u, states


@entry
def run_imposed(
    x: Array, v: Array, a: Array, p1: Array, p2: Array, duration: float, substeps: int, par: Array
) -> tuple[Array, Array]:
    """Friction and external driving force [N] at the samples of an imposed motion.

    Between samples the velocity is the cubic through the velocities and accelerations at both
    ends; position and chamber pressures run linearly. The bristle starts unstrained.
    """
    samples = x.shape[0]
    friction = np.empty(samples)
    drive = np.empty(samples)
    y = np.zeros(at.STATES)
    h = duration / substeps
    for k in range(samples):
        y[at.P1], y[at.P2] = p1[k], p2[k]
        friction[k] = friction_force(x[k], v[k], y, par)
        pressure = (p1[k] - par[at.PATM]) * par[at.AREA_1] - (p2[k] - par[at.PATM]) * par[at.AREA_2]
        drive[k] = par[at.MASS] * a[k] + friction[k] + load_force(x[k], v[k], par) - pressure
        if k == samples - 1:
            break
        for i in range(substeps):
            s = (i + 0.5) / substeps
            r = 1.0 - s
            here = (1.0 + 2.0 * s) * r * r * v[k] + s * s * (3.0 - 2.0 * s) * v[k + 1]
            here += duration * s * r * (r * a[k] - s * a[k + 1])
            y[at.P1], y[at.P2] = r * p1[k] + s * p1[k + 1], r * p2[k] + s * p2[k + 1]
            remember(r * x[k] + s * x[k + 1], here, y, h, par)
    return friction, drive
