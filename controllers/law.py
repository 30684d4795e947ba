"""A control law as one compiled function: memory, measurement and reference in, command and memory out.

A law is written symbolically once. Compiled it costs a few microseconds per sample, and the same function is what a
code export needs.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import astuple
from typing import Any

import casadi as ca
import numpy as np

from controllers.base import Array, Controller, Measurement
from controllers.control_model import ControlModel
from pneuid.compiled import compile_functions

COLUMNS = 4


class CompiledLaw(Controller):
    """A controller whose sample is one CasADi function.

    gains : a frozen dataclass of numbers; subclasses name its class in ``gains_type`` and implement ``law``, which
    is handed an instance of it that holds symbols.
    """

    gains_type: type

    def __init__(self, model: ControlModel, gains: Any, sample_time: float) -> None:
        super().__init__(sample_time, model.lowest, model.highest, model.neutral)
        self.model, self.gains = model, gains
        function, self.compiled = self._function()
        self._buffer, self._run = function.buffer()
        size = function.size1_in(0)
        self._memory, self._next = np.zeros(size), np.zeros(size)
        self._seen, self._target, self._u = np.zeros(4), np.zeros(self.preview * COLUMNS), np.zeros(1)
        self._acting = np.zeros(1)
        self._numbers = np.array(astuple(gains), dtype=float)
        self._theta = np.ascontiguousarray(model.theta)
        given = (self._memory, self._seen, self._target, self._acting, self._numbers, self._theta)
        for place, array in enumerate(given):
            self._buffer.set_arg(place, memoryview(array))
        for place, array in enumerate((self._u, self._next)):
            self._buffer.set_res(place, memoryview(array))

    @abstractmethod
    def start(self, measurement: Measurement, reference: Array) -> np.ndarray:
        """The memory at rest, ``(size,)``."""

    @abstractmethod
    def law(self, memory: Any, seen: Any, target: Any, applied: Any, gains: Any, theta: Any) -> tuple[Any, Any]:
        """Command [V] and next memory, symbolic; ``seen`` as ``Measurement``, ``target`` is ``preview x 4``."""

    def memory_length(self) -> int:
        """Length of the memory."""
        return self.start(Measurement(0.0, 1e5, 1e5, 1e5), np.zeros((self.preview, COLUMNS))).size

    def _function(self) -> tuple[ca.Function, bool]:
        memory, seen, applied = ca.SX.sym("memory", self.memory_length()), ca.SX.sym("seen", 4), ca.SX.sym("applied")
        target, theta = ca.SX.sym("target", self.preview * COLUMNS), self.model.theta_symbol()
        numbers = ca.SX.sym("gains", len(astuple(self.gains)))
        gains = self.gains_type(*(numbers[i] for i in range(numbers.numel())))
        rows = ca.reshape(target, COLUMNS, self.preview).T
        u, after = self.law(memory, seen, rows, applied, gains, theta)
        name = f"controllers_{self.name}"
        function = ca.Function(name, [memory, seen, target, applied, numbers, theta], [u, after], {"cse": True})
        found, compiled = compile_functions([function], name)
        return found[0], compiled

    def _start(self, measurement: Measurement, reference: Array) -> None:
        self._memory[:] = self.start(measurement, reference)

    def _command(self, measurement: Measurement, reference: Array) -> float:
        self._seen[:] = measurement
        self._target[:] = reference[: self.preview].ravel()
        self._acting[0] = self.applied
        self._run()
        self._memory[:] = self._next
        return float(self._u[0])

    @property
    def memory(self) -> np.ndarray:
        """A copy of the memory, for inspection."""
        return self._memory.copy()
