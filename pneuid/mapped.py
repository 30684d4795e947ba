"""Compiled functions over many columns at once, side by side or in a row, NumPy in and NumPy out."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
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
        self._threads, self._edges = min(threads, count // WORTH_A_THREAD), np.arange(count + 1, dtype=ctypes.c_long)
        self._sizes = [function.numel_in(i) * count for i in range(function.n_in())]
        self._shapes = [(function.size1_out(i), function.size2_out(i) * count) for i in range(function.n_out())]
        self._twin = _TWINS.get(function)
        if self._twin is None:
            self._function = _side_by_side(function, count, self._threads)
            self._buffer, self._run = self._function.buffer()

    def __call__(self, *given: np.ndarray) -> tuple[np.ndarray, ...]:
        """The outputs ``(rows, count * columns)``, in Fortran order, of inputs stacked the same way.

        Raises ``ValueError`` for an input of another size, ``RuntimeError`` where the function itself fails.
        """
        held = _held(given, self._sizes, self._name)
        found = [np.empty((columns, rows)) for rows, columns in self._shapes]
        if self._twin is None:
            self._one_by_one(held, found)
        else:
            self._twin(held, found, self._edges, self._threads)
        return tuple(result.T for result in found)

    def _one_by_one(self, held: list[np.ndarray], found: list[np.ndarray]) -> None:
        for i, item in enumerate(held):
            self._buffer.set_arg(i, item.data)  # type: ignore[call-arg]  # the buffer brings its own size
        for i, result in enumerate(found):
            self._buffer.set_res(i, result.reshape(-1).data)  # type: ignore[call-arg]
        self._run()
        if self._buffer.ret():
            raise RuntimeError(f"{self._name} failed with code {self._buffer.ret()}")


def _held(given: Sequence[np.ndarray], sizes: Sequence[int], name: str) -> list[np.ndarray]:
    """Inputs column after column. Raises ``ValueError`` for one of another size."""
    held = [np.ascontiguousarray(np.asarray(item, dtype=float).T).reshape(-1) for item in given]
    for i, (item, size) in enumerate(zip(held, sizes, strict=True)):
        if item.size != size:
            raise ValueError(f"input {i} of {name} has {item.size} numbers; {size} are needed")
    return held


class InARow:
    """A chain of ``(state, data, theta)`` along windows of intervals: each interval starts where the one before it ended, and
    windows run side by side on ``threads`` threads.

    lengths : intervals of every window, ``(W,)``, at least one each; a window's intervals lie one after the other.
    """

    def __init__(self, chain: ca.Function, lengths: np.ndarray, threads: int = 1) -> None:
        self._chain, self._name, self._lengths = chain, chain.name(), np.asarray(lengths)
        self._edges = np.concatenate([[0], np.cumsum(self._lengths)]).astype(ctypes.c_long)
        windows, count = self._lengths.size, int(self._edges[-1])
        self._threads = min(threads, windows // WORTH_A_THREAD)
        self._sizes = [chain.numel_in(i) * (count if i else windows) for i in range(chain.n_in())]
        self._shapes = [(count, chain.size2_out(i), chain.size1_out(i)) for i in range(chain.n_out())]

    def __call__(self, start: np.ndarray, data: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, ...]:
        """The chain's outputs ``(intervals, columns, rows)`` from the windows' first states ``(ns, W)``.

        data : ``(rows, intervals * K)``; theta : ``(ntheta, intervals)``. Raises ``ValueError`` for an input of another size.
        """
        held = _held((start, data, theta), self._sizes, self._name)
        twin = _TWINS.get(self._chain)
        found = tuple(np.empty(shape) for shape in self._shapes)
        if twin is None:
            self._step_by_step(held, found)
        else:
            twin(held, found, self._edges, self._threads)
        return found

    def _step_by_step(self, held: Sequence[np.ndarray], found: tuple[np.ndarray, ...]) -> None:
        """The first intervals of all windows, then the second ones of those that have one, and so on."""
        state = held[0].reshape(self._lengths.size, -1).copy()
        data, theta = (item.reshape(self._edges[-1], -1) for item in held[1:])
        for k in range(int(self._lengths.max())):
            going = np.flatnonzero(self._lengths > k)
            at = self._edges[going] + k
            run = Mapped(self._chain, going.size, self._threads)
            columns = data[at].reshape(-1, self._chain.size1_in(1))
            for item, result in zip(found, run(state[going].T, columns.T, theta[at].T), strict=True):
                item[at] = result.T.reshape(going.size, *item.shape[1:])
            state[going] = self._gone_on(found, going, at, k)

    def _gone_on(self, found: tuple[np.ndarray, ...], going: np.ndarray, at: np.ndarray, k: int) -> np.ndarray:
        """States ``(going, ns)`` in which the next intervals start; ``found`` of the intervals ``at`` is that of each alone."""
        raise NotImplementedError


class Ends(InARow):
    """End states ``(intervals, 1, ns)`` and costs ``(intervals, 1, 1)`` of intervals along windows, of a function of values."""

    def _gone_on(self, found: tuple[np.ndarray, ...], going: np.ndarray, at: np.ndarray, k: int) -> np.ndarray:  # noqa: ARG002
        return np.asarray(found[0][at, 0])


class Trajectories(InARow):
    """Outputs ``(intervals, K, ny)`` and states ``(intervals, K + 1, ns)`` along windows, of a trajectory function."""

    def _gone_on(self, found: tuple[np.ndarray, ...], going: np.ndarray, at: np.ndarray, k: int) -> np.ndarray:  # noqa: ARG002
        return np.asarray(found[1][at, -1])


class Slopes(InARow):
    """End states ``(intervals, 1, ns)`` along windows, of a function of derivatives; their slopes ``(intervals, width, ns)`` by
    parameters and the window's first state; packed Gram blocks ``(intervals, 1, size)`` summed up since its beginning.
    """

    def _gone_on(self, found: tuple[np.ndarray, ...], going: np.ndarray, at: np.ndarray, k: int) -> np.ndarray:
        ends, slopes, grams = found
        if k:
            _, width, ns = slopes.shape
            cols, rows = np.tril_indices(width + 1)
            # derivative of [parameters, interval's first state, 1] with respect to [parameters, window's first state, 1]
            inward = np.tile(np.eye(width + 1), (going.size, 1, 1))
            inward[:, width - ns : width, :width] = slopes[at - 1].transpose(0, 2, 1)
            own = np.empty_like(inward)
            own[:, rows, cols] = own[:, cols, rows] = grams[at, 0]
            grams[at, 0] = grams[at - 1, 0] + (inward.transpose(0, 2, 1) @ own @ inward)[:, rows, cols]
            slopes[at] = inward[:, :width, :width].transpose(0, 2, 1) @ slopes[at]
        return np.asarray(ends[at, 0])
