"""A compiled function over many columns at once, NumPy in and NumPy out."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

WORTH_A_THREAD = 16
"""Columns below which starting a thread takes longer than the thread saves."""

KEPT = 32
"""Functions over many columns that are kept: making one takes as long as calling it, and the next fit needs it again."""


@lru_cache(maxsize=KEPT)
def _side_by_side(function: ca.Function, count: int, threads: int) -> ca.Function:
    if count == 1:
        return function
    return function.map(count, "thread", threads) if threads > 1 else function.map(count, "serial")


class Mapped:
    """``function`` applied to ``count`` columns side by side on ``threads`` threads.

    A call of a CasADi function with arrays converts them to its own matrices, which takes several times as long as a compiled
    interval; here the numbers go in and out by their address. Every input and output of ``function`` is dense.
    """

    def __init__(self, function: ca.Function, count: int, threads: int = 1) -> None:
        self._function = _side_by_side(function, count, min(threads, count // WORTH_A_THREAD))
        self._buffer, self._run = self._function.buffer()
        self._sizes = [self._function.numel_in(i) for i in range(self._function.n_in())]
        self._shapes = [self._function.size_out(i) for i in range(self._function.n_out())]

    def __call__(self, *given: np.ndarray) -> tuple[np.ndarray, ...]:
        """The outputs ``(rows, count * columns)``, in Fortran order, of inputs stacked the same way.

        Raises ``ValueError`` for an input of another size, ``RuntimeError`` where the function itself fails.
        """
        held = [np.ascontiguousarray(np.asarray(item, dtype=float).T).reshape(-1) for item in given]
        for i, (item, size) in enumerate(zip(held, self._sizes, strict=True)):
            if item.size != size:
                raise ValueError(f"input {i} of {self._function.name()} has {item.size} numbers; {size} are needed")
            self._buffer.set_arg(i, item.data)  # type: ignore[call-arg]  # the buffer brings its own size
        found = [np.empty((columns, rows)) for rows, columns in self._shapes]
        for i, result in enumerate(found):
            self._buffer.set_res(i, result.reshape(-1).data)  # type: ignore[call-arg]
        self._run()
        if self._buffer.ret():
            raise RuntimeError(f"{self._function.name()} failed with code {self._buffer.ret()}")
        return tuple(result.T for result in found)
