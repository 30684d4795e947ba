"""Frequency responses by experiment: a sine is added to the command and the answer is correlated with it.

It needs nothing of a controller but that it can be run, so delay, sampling, inverse valve and observer are all in. The
axis slides at constant speed meanwhile, because a loop at rest inside its friction answers differently.
Source: the injection method, e.g. Middlebrook, Int. J. Electronics 38 (1975) 485.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import control
import numpy as np

from controllers.base import Array, Controller, Measurement
from controllers.loop import Stepped
from controllers.references import Ramp

SETTLING = 0.25
"""Seconds of sliding before a loop's sine begins to count."""

RINGING = 0.5
"""The same for the open axis, whose air springs ring on for longer."""

SHORTEST = 0.1
"""The sine counts over whole periods that last at least so many seconds."""


def phasor(t: Array, signal: Array, frequency: float) -> complex:
    """Complex amplitude of a sine of ``frequency`` [Hz] in ``signal``, whose slow trend (a parabola) is left aside."""
    angle, span = 2.0 * np.pi * frequency * t, t - t.mean()
    columns = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(t), span, span**2])
    cosine, sine = np.linalg.lstsq(columns, signal, rcond=None)[0][:2]
    return complex(cosine, -sine)


def _window(frequency: float) -> float:
    return max(2.0, np.ceil(SHORTEST * frequency)) / frequency


@dataclass(frozen=True)
class Answer:
    """Answer of the open axis at one frequency [Hz]: ``x``, ``p1``, ``p2`` in SI per V, and what the piston passed with
    meanwhile (x [m], v [m/s], p1, p2 [Pa])."""

    frequency: float
    x: complex
    p1: complex
    p2: complex
    passed: tuple[float, float, float, float]


def swept_sine(
    plant: Stepped, x: float, supply: float, u: float, amplitude: float, frequencies: Sequence[float], interval: float
) -> list[Answer]:
    """Answers to a sine on the constant command ``u`` [V], as the piston slides past ``x`` [m].

    The plant starts at rest so far before ``x`` that it passes there half-way through the window that counts. The same
    motion without the sine is subtracted, so what is left is the sine's doing. ``interval`` : s between commands.
    """
    answers = []
    for frequency in frequencies:
        window = _window(frequency)
        count, counted = round((RINGING + window) / interval), round(window / interval)
        t = interval * np.arange(count, dtype=np.float64)
        start = 2.0 * x - _open_loop(plant, x, supply, np.full(count, u), interval)["x"][-(counted // 2)]
        plain = _open_loop(plant, start, supply, np.full(count, u), interval)
        commands = u + amplitude * np.sin(2.0 * np.pi * frequency * t)
        seen = _open_loop(plant, start, supply, commands, interval)
        # the plant's hold delays the command by half an interval
        hold = np.exp(-1j * np.pi * frequency * interval)
        given = phasor(t[-counted:], commands[-counted:], frequency) * hold
        found = {
            name: phasor(t[-counted:], (seen[name] - plain[name])[-counted:], frequency) / given
            for name in ("x", "p1", "p2")
        }
        x_mean, p1, p2 = (float(np.mean(plain[name][-counted:])) for name in ("x", "p1", "p2"))
        v = float(np.polyfit(t[-counted:], plain["x"][-counted:], 1)[0])
        answers.append(Answer(frequency, **found, passed=(x_mean, v, p1, p2)))
    return answers


def _open_loop(plant: Stepped, x0: float, supply: float, commands: Array, interval: float) -> dict[str, Array]:
    plant.reset(x0, supply)
    rows = []
    for u in commands:
        rows.append(plant.measure(None))
        plant.step(float(u), interval)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True)
class Margins:
    """Margins of a loop opened at the command.

    gain : factor on the loop gain that it survives upwards; phase : degrees; modulus : smallest distance to -1;
    crossover : Hz; frequencies [Hz] and loop gain : what they were read from. Infinite where nothing crosses.
    """

    gain: float
    phase: float
    modulus: float
    crossover: float
    frequencies: Array
    loop_gain: Array


def loop_margins(
    controller: Controller,
    plant: Stepped,
    x: float,
    supply: float,
    speed: float,
    amplitude: float,
    frequencies: Sequence[float],
) -> Margins:
    """Margins of ``controller`` as the axis follows a ramp past ``x`` [m] at ``speed`` [m/s]; ``amplitude`` of the sine
    in V. Raises ``ComputationError`` when the plant diverges."""
    gains = np.array([_loop_gain(controller, plant, x, supply, speed, amplitude, f) for f in frequencies])
    w = 2.0 * np.pi * np.asarray(frequencies)
    # read as a discrete loop would be: the response is the loop's own, whatever is inside
    response = control.FrequencyResponseData(gains, w, smooth=True)
    gain, phase, modulus, _, crossover, _ = control.stability_margins(response)
    return Margins(
        float(gain), float(phase), float(modulus), float(crossover) / (2.0 * np.pi), np.asarray(frequencies), gains
    )


def _loop_gain(
    controller: Controller, plant: Stepped, x: float, supply: float, speed: float, amplitude: float, frequency: float
) -> complex:
    """Minus what the controller commands over what the valve gets, at one frequency."""
    T, window = controller.sample_time, _window(frequency)
    count, counted = round((SETTLING + window) / T), round(window / T)
    lasts = T * (count + controller.preview + 1)
    begin = x - speed * (lasts - 0.5 * window)
    ramp = Ramp("ramp", begin, 4.0 * lasts, speed, 0.02, 0.1)
    track = ramp.samples(T * np.arange(count + controller.preview, dtype=np.float64))
    sine = amplitude * np.sin(2.0 * np.pi * frequency * T * np.arange(count, dtype=np.float64))
    plant.reset(begin, supply)
    asked, got = np.empty(count), np.empty(count)
    controller.reset(Measurement(**plant.measure(None), psup=supply), track[: controller.preview])
    for k in range(count):
        asked[k] = controller.applied
        got[k] = asked[k] + sine[k]
        controller.step(Measurement(**plant.measure(None), psup=supply), track[k : k + controller.preview])
        plant.step(got[k], T)
    t = T * np.arange(count, dtype=np.float64)
    return -phasor(t[-counted:], asked[-counted:], frequency) / phasor(t[-counted:], got[-counted:], frequency)
