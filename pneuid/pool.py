"""Where the tasks of a study run: in this process, in several on this machine, or on a Dask cluster.

Every task is a pure function of one picklable argument, so where it runs cannot change a number.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from pneuid.cores import threads
from pneuid.errors import ComputationError, UserError

T = TypeVar("T")
R = TypeVar("R")

CONNECTING = 10.0
"""Seconds to wait for a scheduler to answer."""


class Pool(Protocol):
    """Runs tasks; results come as they are done, each with the place of its item."""

    def each(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """``(place, function(items[place]))`` in the order in which they are done; a task's error is raised."""


class InProcess:
    """One after the other, here."""

    def each(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """See ``Pool``."""
        for place, item in enumerate(items):
            yield place, function(item)


class Processes:
    """``count`` processes of this machine; use it as a context."""

    def __init__(self, count: int) -> None:
        self._pool = ProcessPoolExecutor(count, initializer=_take, initargs=(max(1, threads() // count),))

    def each(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """See ``Pool``."""
        pending = {self._pool.submit(function, item): place for place, item in enumerate(items)}
        try:
            for future in as_completed(pending):
                yield pending[future], future.result()
        finally:  # also where nobody waits for the rest: what has not begun is not worth a processor
            for future in pending:
                future.cancel()

    def close(self) -> None:
        """End the processes; tasks that have not begun never do, so an interrupt waits for the running ones only."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def _take(cores: int) -> None:
    """What a process of several does first: it leaves the others their cores."""
    os.environ.setdefault("PNEUID_THREADS", str(cores))


class Cluster:
    """The workers of a Dask scheduler at ``address``, which need this installation.

    Raises ``UserError`` when the extra is not installed or nobody answers.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise UserError("--scheduler needs the extra 'cluster': pip install 'pneuid[cluster]'") from error
        self._dask = distributed
        try:
            self._client = distributed.Client(address, timeout=CONNECTING, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise UserError(
                f"--scheduler {address}: no Dask scheduler answers; start one with 'dask scheduler'"
            ) from error
        if not self._client.scheduler_info()["workers"]:
            self._client.close()
            raise UserError(f"--scheduler {address}: it has no workers; start some with 'dask worker {address}'")

    def each(self, function: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """See ``Pool``. Raises ``ComputationError`` when workers die over a task."""
        futures = self._client.map(function, list(items), pure=False)
        places = {future.key: place for place, future in enumerate(futures)}
        try:
            for future, result in self._dask.as_completed(futures, loop=self._client.loop, with_results=True):
                yield places[future.key], result
        except self._dask.KilledWorker as error:
            raise ComputationError(f"workers of the cluster died over a task: {error}") from error
        finally:
            self._client.cancel(futures)

    def close(self) -> None:
        """Leave the cluster as it is."""
        self._client.close()


@contextmanager
def open_pool(workers: int | None = None, scheduler: str | None = None) -> Iterator[Pool]:
    """A pool for a ``with`` block: the cluster of ``scheduler``, else ``workers`` processes (None: one per core)."""
    count = workers or os.cpu_count() or 1
    if scheduler is None and count == 1:
        yield InProcess()
        return
    pool: Any = Processes(count) if scheduler is None else Cluster(scheduler)
    try:
        yield pool
    finally:
        pool.close()
