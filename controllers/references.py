"""References with consistent derivatives: position, velocity, acceleration, jerk.

Every reference is a smooth function of time, written as ``samples(t)``: an array ``(len(t), 4)`` in m, m/s, m/s^2,
m/s^3. Before its start and after its end it stands still.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _blend(s: Array) -> Array:
    """Minimum-jerk blend 0..1 and its three derivatives with respect to ``s``, ``(len(s), 4)``; Flash, Hogan 1985."""
    s = np.clip(s, 0.0, 1.0)
    inside = (s > 0.0) & (s < 1.0)
    columns = (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - 3.0 * s + 2.0 * s**2),
        60.0 * (1.0 - 6.0 * s + 6.0 * s**2) * inside,
    )
    return np.stack(columns, axis=1)


def _move(t: Array, start: float, lasts: float, distance: float) -> Array:
    """A minimum-jerk move by ``distance`` that begins at ``start``."""
    return distance * _blend((t - start) / lasts) / lasts ** np.arange(4.0)


@dataclass(frozen=True)
class Reference(ABC):
    """A motion around ``centre`` [m] that lasts ``duration`` [s], shown in reports as ``name``."""

    name: str
    centre: float
    duration: float

    @abstractmethod
    def samples(self, t: Array) -> Array:
        """Position, velocity, acceleration, jerk at times ``t`` [s], ``(len(t), 4)``."""

    def over(self, interval: float) -> Array:
        """The whole motion sampled every ``interval`` [s], ``(count, 4)``."""
        return self.samples(np.arange(0.0, self.duration + 0.5 * interval, interval))

    def _from(self, deviation: Array) -> Array:
        deviation[:, 0] += self.centre
        return deviation


@dataclass(frozen=True)
class Steps(Reference):
    """Minimum-jerk moves to ``centre + targets`` [m], one every ``period`` [s], each with at most ``top_speed`` [m/s].

    A move lasts at least ``shortest`` [s]; what is left of the period is a dwell.
    """

    targets: tuple[float, ...]
    period: float
    top_speed: float
    shortest: float = 0.1

    def samples(self, t: Array) -> Array:
        """See ``Reference``."""
        t = np.asarray(t, dtype=float)
        found, here = np.zeros((t.size, 4)), 0.0
        for i, target in enumerate(self.targets):
            lasts = max(1.875 * abs(target - here) / self.top_speed, self.shortest)
            found += _move(t, i * self.period, lasts, target - here)
            here = target
        return self._from(found)


@dataclass(frozen=True)
class Sine(Reference):
    """A sine of ``amplitude`` [m] and ``frequency`` [Hz] that fades in over its first ``fade`` [s]."""

    amplitude: float
    frequency: float
    fade: float

    def samples(self, t: Array) -> Array:
        """See ``Reference``."""
        return self._from(_product(_move(np.asarray(t, float), 0.0, self.fade, 1.0), self._wave(np.asarray(t, float))))

    def _wave(self, t: Array) -> Array:
        w = 2.0 * np.pi * self.frequency
        sine, cosine = np.sin(w * t), np.cos(w * t)
        return self.amplitude * np.stack((sine, w * cosine, -(w**2) * sine, -(w**3) * cosine), axis=1)


@dataclass(frozen=True)
class Ramp(Reference):
    """There and back at constant ``speed`` [m/s], with a dwell of ``dwell`` [s] first and smooth changes of speed
    that take ``fade`` [s]."""

    speed: float
    dwell: float
    fade: float

    def samples(self, t: Array) -> Array:
        """See ``Reference``."""
        t = np.asarray(t, dtype=float)
        turn = self.dwell + 0.5 * (self.duration - self.dwell)
        return self._from(_ramp(t, self.dwell, self.fade, self.speed) + _ramp(t, turn, self.fade, -2.0 * self.speed))


@dataclass(frozen=True)
class Smooth(Reference):
    """A random track: ``count`` sines up to ``highest`` [Hz] with random phases, peak ``amplitude`` [m], faded in over
    ``fade`` [s]; the same ``seed`` gives the same track."""

    amplitude: float
    highest: float
    fade: float
    seed: int
    count: int = 8

    def samples(self, t: Array) -> Array:
        """See ``Reference``."""
        t = np.asarray(t, dtype=float)
        rng = np.random.default_rng(self.seed)
        w = 2.0 * np.pi * self.highest * (np.arange(self.count) + rng.uniform(0.3, 1.0, self.count)) / self.count
        phase, weight = rng.uniform(0.0, 2.0 * np.pi, self.count), 1.0 / (1.0 + (w / w[0]) ** 2) ** 0.5
        long = np.linspace(0.0, self.duration, 2001)
        peak = np.max(np.abs(weight @ np.sin(np.outer(w, long) + phase[:, None])))
        angle = np.outer(w, t) + phase[:, None]
        turns = (np.sin(angle), np.cos(angle), -np.sin(angle), -np.cos(angle))
        wave = np.stack([(weight * w**i) @ turn for i, turn in enumerate(turns)], axis=1)
        return self._from(_product(_move(t, 0.0, self.fade, 1.0), self.amplitude / peak * wave))


def _product(a: Array, b: Array) -> Array:
    """Leibniz rule for the product of two signals given with three derivatives."""
    return np.stack(
        (
            a[:, 0] * b[:, 0],
            a[:, 1] * b[:, 0] + a[:, 0] * b[:, 1],
            a[:, 2] * b[:, 0] + 2 * a[:, 1] * b[:, 1] + a[:, 0] * b[:, 2],
            a[:, 3] * b[:, 0] + 3 * a[:, 2] * b[:, 1] + 3 * a[:, 1] * b[:, 2] + a[:, 0] * b[:, 3],
        ),
        axis=1,
    )


def _ramp(t: Array, start: float, fade: float, speed: float) -> Array:
    """From rest to constant ``speed``: the velocity is a minimum-jerk blend that takes ``fade`` seconds."""
    s = (t - start) / fade
    inside = np.clip(s, 0.0, 1.0)
    # the integral of the blend, 1/2 at its end, continued with slope 1
    area = inside**4 * (2.5 - 3.0 * inside + inside**2) + np.maximum(s - 1.0, 0.0)
    blend = _blend(s)
    return speed * np.stack((fade * area, blend[:, 0], blend[:, 1] / fade, blend[:, 2] / fade**2), axis=1)
