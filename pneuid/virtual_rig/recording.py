"""Recordings of a servo rig as an engineer would take them: closed loop, sampled, noisy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.excitation import EXCITATIONS, Excitation, dither
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.kernel import run_closed_loop, run_commands
from pneuid.virtual_rig.packing import pack
from pneuid.virtual_rig.sensors import SERVO_SENSORS, Sensors, averaged, delayed, on_grid
from pneuid.virtual_rig.servo import STEP, channels, check_states, holds_linear, rest_state, substeps_for
from pneuid.virtual_rig.truth import TruthServo

Array = NDArray[np.float64]

SETTLING = 0.4
"""Seconds of closed-loop hold, dither included, before the record starts."""

DRIFT_TIME = 4.0
"""Time constant [s] of a sensor's drift."""

CURRENT_LIMIT = 0.4
"""Share of the full scale about which the current of the valve's solenoid stops growing."""


def record_servo(
    truth: TruthServo,
    hidden: Hidden = NOTHING,
    excitation: str | Excitation = "multisine",
    duration: float = 6.0,
    seed: int = 0,
    *,
    supply: float | None = None,
    rate: float = 1000.0,
    sensors: Sensors = SERVO_SENSORS,
    input_hold: str = "linear",
    step: float = STEP,
    with_truth: bool = False,
) -> dict[str, Array]:
    """One recorded run: t [s], u [V], x [m], p1, p2 (absolute Pa), ``round(duration * rate)`` samples each.

    A proportional position controller with speed feed-forward and dither (with an integral for slow
    motion) follows the excitation at
    the recording ``rate`` [Hz]; the command computed from sample k is the one of sample k + 1, and
    runs linearly to it (or jumps, with ``input_hold="zero-order"``). ``supply`` (absolute Pa)
    replaces the rig's. The same ``seed`` gives the same reference, dither and noise whatever the
    rig. ``with_truth`` adds the noise-free ``true_x``, ``true_v``, ... of ``servo.channels``.

    Raises ``KeyError`` for an unknown excitation, ``ValueError`` for an impossible setting and
    ``ComputationError`` when the state stops being finite.
    """
    chosen = _excitation(excitation)
    ramp = holds_linear(input_hold)
    pressure = truth.supply if supply is None else supply
    samples, settling = round(duration * rate), round(SETTLING * rate)
    if samples < 2:
        raise ValueError(f"a recording needs two samples, got {duration} s at {rate} Hz")
    reference_rng, dither_rng, noise_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))

    t = np.arange(samples) / rate
    r, speed = chosen.reference(t, truth.stroke, truth.top_speed, reference_rng)
    reference = np.concatenate((np.full(settling, r[0]), r))
    speed = np.concatenate((np.zeros(settling), speed))
    shaking = dither(np.arange(settling + samples) / rate, chosen.dither * truth.full_scale, dither_rng)
    noise = noise_rng.standard_normal((3, settling + samples))

    par = pack(truth, hidden)
    gain, feed_forward = _controller(truth, hidden, pressure)
    u, states = run_closed_loop(
        rest_state(par, float(r[0]), pressure), reference, speed, shaking, sensors.x_noise * noise[0], gain,
        chosen.integral, feed_forward, sensors.u_grid, sensors.x_grid, pressure, ramp, 1.0 / rate,
        substeps_for(1.0 / rate, step), par,
    )  # fmt: skip
    check_states(states, settling + samples, 1.0 / rate)
    seen = _measured(states, u, noise, truth, hidden, sensors, rate)
    record = {"t": t, "u": u[settling:]} | {name: values[settling:] for name, values in seen.items()}
    if with_truth:
        record |= {f"true_{name}": values for name, values in channels(states[settling:]).items()}
        record["reference"] = r
    return record


def record_command(
    truth: TruthServo,
    hidden: Hidden,
    u: Array,
    supply: Array,
    x0: float,
    seed: int = 0,
    *,
    rate: float = 1000.0,
    sensors: Sensors = SERVO_SENSORS,
    step: float = STEP,
) -> dict[str, Array]:
    """One recorded run under a command that is played open loop: t [s], u [V], x [m], p1, p2, psup (absolute Pa).

    u [V] and supply [absolute Pa] : one value per sample at ``rate`` [Hz], the command linear in between; x0 : m, where the
    piston rests at first. Raises as ``record_servo`` does.
    """
    par = pack(truth, hidden)
    commands = np.ascontiguousarray(on_grid(u, sensors.u_grid), dtype=np.float64)
    pressure = np.ascontiguousarray(supply, dtype=np.float64)
    start = rest_state(par, x0, float(pressure[0]))
    states = run_commands(start, commands, pressure, True, 1.0 / rate, substeps_for(1.0 / rate, step), par)
    check_states(states, commands.size, 1.0 / rate)
    noise = np.random.default_rng(seed).standard_normal((3, commands.size))
    seen = _measured(states, commands, noise, truth, hidden, sensors, rate)
    return {"t": np.arange(commands.size) / rate, "u": commands} | seen | {"psup": pressure}


def _excitation(wanted: str | Excitation) -> Excitation:
    if isinstance(wanted, Excitation):
        return wanted
    if wanted not in EXCITATIONS:
        raise KeyError(f"no excitation {wanted!r}; there are {sorted(EXCITATIONS)}")
    return EXCITATIONS[wanted]


def _controller(truth: TruthServo, hidden: Hidden, supply: float) -> tuple[float, float]:
    """Position gain [V/m] and speed feed-forward [V s/m] that stay calm on rigs of any size.

    The loop's bandwidth is a quarter of the load's natural frequency on the two air springs at
    mid-stroke, at most 12 rad/s.
    """
    pressure = truth.patm + 0.6 * (supply - truth.patm)
    springs = sum(
        pressure * area**2 / (dead + 0.5 * area * truth.stroke)
        for area, dead in ((truth.area_1, truth.dead_volume_1), (truth.area_2, truth.dead_volume_2))
    )
    natural = math.sqrt(truth.polytropic * springs / (truth.mass + hidden.load_mass))
    volts_per_speed = truth.full_scale / truth.top_speed
    return min(0.25 * natural, 12.0) * volts_per_speed, volts_per_speed


def _measured(
    states: Array, u: Array, noise: Array, truth: TruthServo, hidden: Hidden, sensors: Sensors, rate: float
) -> dict[str, Array]:
    """What the sensors and the logger make of x, p1 and p2 under a command, over the settling and the record."""
    x, p1, p2 = states[:, at.X], states[:, at.P1], states[:, at.P2]
    if hidden.encoder_bow != 0.0:
        x = x + hidden.encoder_bow * np.sin(6.0 * np.pi * x / truth.stroke)
    if hidden.sensor_gain_drift != 0.0:
        warm = 1.0 - np.exp(-np.arange(x.size) / rate / DRIFT_TIME)
        p1 = p1 + hidden.sensor_gain_drift * warm * (p1 - truth.patm)
    if hidden.solenoid_crosstalk != 0.0:
        p2 = p2 + hidden.solenoid_crosstalk * np.tanh((u - truth.null) / (CURRENT_LIMIT * truth.full_scale))
    form = hidden.form
    p1, p2 = (
        averaged(values, age * rate, round(form.averages))
        for values, age in ((p1, hidden.sensor_lag_p1), (p2, hidden.sensor_lag_p2))
    )
    x, p1, p2 = (
        delayed(values, age * hidden.channel_skew * rate)
        for values, age in ((x, form.scan_x), (p1, form.scan_p1), (p2, form.scan_p2))
    )
    return {
        "x": on_grid(x + sensors.x_noise * noise[0], sensors.x_grid),
        "p1": on_grid(p1 + sensors.p_noise * noise[1] + hidden.sensor_offset_p1, sensors.p_grid),
        "p2": on_grid(p2 + sensors.p_noise * noise[2] + hidden.sensor_offset_p2, sensors.p_grid),
    }
