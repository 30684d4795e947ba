"""The contract of a controller: what it measures, what it returns, at which sample time.

Timing. At sample ``k`` the controller is given what the sensors show at ``t_k`` and returns the command that acts from
``t_k+1`` on: one sample for the computation, as on a real controller. While it computes, the command returned before
acts, so every controller knows what is being applied. Row 0 of the reference is ``t_k``, row 1 ``t_k+1`` and so on.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POSITION, VELOCITY, ACCELERATION, JERK = range(4)
"""Columns of a reference: m, m/s, m/s^2, m/s^3."""


class Measurement(NamedTuple):
    """What a servo's sensors show: position [m], chamber and supply pressures [Pa, absolute]."""

    x: float
    p1: float
    p2: float
    psup: float


class Controller(ABC):
    """A controller of one servo rig.

    name : as in the registry; sample_time : s; preview : rows of the reference that ``step`` looks at; lowest,
    highest : limits of the command, V; neutral : command that closes the valve, V; gains : a frozen dataclass.
    """

    name: str
    gains: Any
    preview: int = 2

    def __init__(self, sample_time: float, lowest: float, highest: float, neutral: float) -> None:
        self.sample_time, self.lowest, self.highest, self.neutral = sample_time, lowest, highest, neutral
        self.applied = neutral
        """The command that acts during the present sample, V."""
        self._trusted = Measurement(0.0, 0.0, 0.0, 0.0)

    def reset(self, measurement: Measurement, reference: Array) -> None:
        """Start at rest at ``measurement``; ``reference`` is ``(preview, 4)`` as for ``step``.

        Raises ``ValueError`` for a measurement or reference that is not finite, or a reference of another shape.
        """
        if not all(map(math.isfinite, measurement)):
            raise ValueError(f"a controller starts from finite measurements, got {measurement}")
        if reference.shape != (self.preview, 4) or not np.all(np.isfinite(reference)):
            raise ValueError(
                f"{self.name} needs a finite reference of shape ({self.preview}, 4), got {reference.shape}"
            )
        self.applied, self._trusted = self.neutral, measurement
        self._start(measurement)

    def step(self, measurement: Measurement, reference: Array) -> float:
        """Command [V] that acts from the next sample on; ``reference`` is ``(preview, 4)`` from this sample on.

        A value that is not finite is replaced by the last finite one of that sensor, and a command that is not
        finite closes the valve and restarts the controller: nonsense in never becomes nonsense out.
        """
        if not all(map(math.isfinite, measurement)):
            pairs = zip(measurement, self._trusted, strict=True)
            measurement = Measurement(*(new if math.isfinite(new) else old for new, old in pairs))
        self._trusted = measurement
        u = self._command(measurement, reference)
        if not math.isfinite(u):
            self._start(measurement)
            u = self.neutral
        self.applied = min(max(u, self.lowest), self.highest)
        return self.applied

    @abstractmethod
    def retune(self, gains: Any) -> None:
        """Other gains for the same controller, without compiling again."""

    @abstractmethod
    def _start(self, measurement: Measurement) -> None:
        """Set the memory for a start at rest."""

    @abstractmethod
    def _command(self, measurement: Measurement, reference: Array) -> float:
        """Command [V] for the next sample; ``self.applied`` is the one acting now."""
