"""Calls of a compiled function on fixed arrays, without conversions: about a microsecond each."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray


class InPlace:
    """``function`` reading ``given`` and writing ``found`` (float64, C order) at every call.

    CasADi orders matrices by columns, so an argument of shape ``(rows, N)`` is an array ``(N, rows)``. Raises
    ``ValueError`` when an array has not the size of its argument.
    """

    def __init__(
        self, function: ca.Function, given: Sequence[NDArray[np.float64]], found: Sequence[NDArray[np.float64]]
    ) -> None:
        sizes = [function.numel_in(i) for i in range(function.n_in())]
        sizes += [function.numel_out(i) for i in range(function.n_out())]
        arrays = (*given, *found)
        if [array.size for array in arrays] != sizes:
            raise ValueError(f"{function.name()} has sizes {sizes}, the arrays {[array.size for array in arrays]}")
        self._kept = (function, arrays)
        self._buffer, self._run = function.buffer()
        for place, array in enumerate(given):
            self._buffer.set_arg(place, memoryview(array.reshape(-1)))  # type: ignore[call-arg, arg-type]
        for place, array in enumerate(found):
            self._buffer.set_res(place, memoryview(array.reshape(-1)))  # type: ignore[call-arg, arg-type]

    def __call__(self) -> None:
        """Read, compute, write."""
        self._run()
