"""A compiled function over many columns at once, NumPy in and NumPy out."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from pneuid.lanes import SideBySide

WORTH_A_THREAD = 16
"""Columns below which starting a thread takes longer than the thread saves."""

KEPT = 32
"""Functions over many columns that are kept: making one takes as long as calling it, and the next fit needs it again."""


@lru_cache(maxsize=KEPT)
def _side_by_side(function: ca.Function, count: int, threads: int) -> ca.Function:
    if count == 1:
        return function
    return function.map(count, "thread", threads) if threads > 1 else function.map(count, "serial")


_TWINS: dict[ca.Function, SideBySide] = {}


def pair(function: ca.Function, twin: SideBySide) -> None:
    """Have ``Mapped`` run ``twin`` wherever it is given ``function``."""
    _TWINS[function] = twin


class Mapped:
    """``function`` applied to ``count`` columns side by side on ``threads`` threads.

    A call of a CasADi function with arrays converts them to its own matrices, which takes several times as long as a compiled
    interval; here the numbers go in and out by their address. Every input and output of ``function`` is dense. A function
    that has a twin over lanes runs that.
    """

    def __init__(self, function: ca.Function, count: int, threads: int = 1) -> None:
        self._name, self._count = function.name(), count
        self._threads = min(threads, count // WORTH_A_THREAD)
        self._sizes = [function.numel_in(i) * count for i in range(function.n_in())]
        self._shapes = [(function.size1_out(i), function.size2_out(i) * count) for i in range(function.n_out())]
        # one interval alone leaves all lanes but one empty, where the function is compiled
        alone = count == 1 and function.is_a("External", True)
        self._twin = None if alone else _TWINS.get(function)
        if self._twin is None:
            self._function = _side_by_side(function, count, self._threads)
            self._buffer, self._run = self._function.buffer()

    def __call__(self, *given: np.ndarray) -> tuple[np.ndarray, ...]:
        """The outputs ``(rows, count * columns)``, in Fortran order, of inputs stacked the same way.

        Raises ``ValueError`` for an input of another size, ``RuntimeError`` where the function itself fails.
        """
        held = [np.ascontiguousarray(np.asarray(item, dtype=float).T).reshape(-1) for item in given]
        for i, (item, size) in enumerate(zip(held, self._sizes, strict=True)):
            if item.size != size:
                raise ValueError(f"input {i} of {self._name} has {item.size} numbers; {size} are needed")
        found = [np.empty((columns, rows)) for rows, columns in self._shapes]
        if self._twin is None:
            self._one_by_one(held, found)
        else:
            self._twin(held, found, self._count, self._threads)
        return tuple(result.T for result in found)

    def _one_by_one(self, held: list[np.ndarray], found: list[np.ndarray]) -> None:
        for i, item in enumerate(held):
            self._buffer.set_arg(i, item.data)  # type: ignore[call-arg]  # the buffer brings its own size
        for i, result in enumerate(found):
            self._buffer.set_res(i, result.reshape(-1).data)  # type: ignore[call-arg]
        self._run()
        if self._buffer.ret():
            raise RuntimeError(f"{self._name} failed with code {self._buffer.ret()}")
