"""A control law as one compiled function: memory, measurement and reference in, command and memory out.

A law is written symbolically once. Compiled it costs a few microseconds per sample, and the same function is what a
code export needs.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import astuple, dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers.base import Array, Controller, Measurement
from controllers.control_model import ControlModel
from controllers.inplace import InPlace
from pneuid.compiled import compile_functions

COLUMNS = 4


@dataclass(frozen=True)
class Sample:
    """What a law looks at in one sample, all symbolic.

    seen : as ``Measurement``; target : reference, ``preview x 4``; applied : the command acting now, V; theta : the
    model's column.
    """

    seen: Any
    target: Any
    applied: Any
    theta: Any


class CompiledLaw(Controller):
    """A controller whose sample is one CasADi function.

    gains : a frozen dataclass of numbers; subclasses name its class in ``gains_type`` and implement ``law``, which
    is handed an instance of it that holds symbols.
    """

    gains_type: type

    def __init__(self, model: ControlModel, gains: Any, sample_time: float) -> None:
        super().__init__(sample_time, model.lowest, model.highest, model.neutral)
        self.model, self.gains = model, gains
        symbolic = self.symbolic()
        (function,), self.compiled = compile_functions([symbolic], symbolic.name())
        self._memory, self._next = np.zeros(function.numel_in(0)), np.zeros(function.numel_in(0))
        self._seen, self._target = np.zeros(len(Measurement._fields)), np.zeros(self.preview * COLUMNS)
        self._acting, self._u = np.zeros(1), np.zeros(1)
        self._numbers = np.array(astuple(gains), dtype=float)
        given = (self._memory, self._seen, self._target, self._acting, self._numbers, model.theta.copy())
        self._run = InPlace(function, given, (self._u, self._next))

    @abstractmethod
    def start(self, measurement: Measurement) -> np.ndarray:
        """The memory at rest, ``(size,)``."""

    @abstractmethod
    def law(self, memory: Any, sample: Sample, gains: Any) -> tuple[Any, Any]:
        """Command [V] for the next sample and the memory for it, symbolic."""

    def symbolic(self) -> ca.Function:
        """``(memory, seen, target, applied, gains, theta) -> (command, memory)``, interpreted; for code exports."""
        size = self.start(Measurement(0.0, 0.0, 0.0, 0.0)).size
        memory, seen, applied = ca.SX.sym("memory", size), ca.SX.sym("seen", 4), ca.SX.sym("applied")
        target, theta = ca.SX.sym("target", self.preview * COLUMNS), self.model.theta_symbol()
        numbers = ca.SX.sym("gains", len(astuple(self.gains)))
        gains = self.gains_type(*(numbers[i] for i in range(numbers.numel())))
        rows = ca.reshape(target, COLUMNS, self.preview).T
        u, after = self.law(memory, Sample(seen, rows, applied, theta), gains)
        given = [memory, seen, target, applied, numbers, theta]
        return ca.Function(f"controllers_{self.name}", given, [u, after], {"cse": True})

    def _start(self, measurement: Measurement) -> None:
        self._memory[:] = self.start(measurement)

    def _command(self, measurement: Measurement, reference: Array) -> float:
        self._seen[:] = measurement
        self._target[:] = reference[: self.preview].ravel()
        self._acting[0] = self.applied
        self._run()
        self._memory[:] = self._next
        return float(self._u[0])

    def retune(self, gains: Any) -> None:
        """Other gains for the same law, without compiling again."""
        self.gains = gains
        self._numbers[:] = astuple(gains)

    @property
    def memory(self) -> np.ndarray:
        """A copy of the memory, for inspection."""
        return self._memory.copy()
