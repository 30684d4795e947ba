"""Independent computations begun ahead of being asked for, each in a forked copy of this process on cores of its own.

A copy has all that was built here, compiled functions above all, so that it begins in milliseconds; what it finds is pickled. A
pool's workers would have to be sent the jobs, which hold what cannot be.
Nothing is begun where there is one core or too little memory, inside such a copy, or where no copy may be: Windows has none,
macOS' libraries do not outlive one, a daemon may have no children. Then everything is made here when it is asked for, with the
same result.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
import signal
import sys
import warnings
import weakref
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from pneuid.cores import threads

T = TypeVar("T")

SHARE_OF_MEMORY = 0.5
"""Share of the machine's memory that copies may take: a fit to a million samples takes some 3 GB."""

_COPY = "PNEUID_COPY"
"""Variable of the environment of a copy."""


def is_copy() -> bool:
    """Whether this process is a copy: it reports to nobody but the one that began it."""
    return _COPY in os.environ


def may_begin() -> bool:
    """Whether copies may be begun here."""
    if threads() == 1 or is_copy() or multiprocessing.current_process().daemon:
        return False
    return sys.platform != "darwin" and "fork" in multiprocessing.get_all_start_methods()


def _room() -> int:
    """Copies at once for which there is memory, each of them as large as this process has ever been."""
    import resource  # noqa: PLC0415 - Windows, which has no copies, lacks it

    largest = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(SHARE_OF_MEMORY * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / largest)


class _Copy(Generic[T]):
    """One job in a copy of this process."""

    def __init__(self, job: Callable[[], T], shared: Sequence[object], cores: int) -> None:
        self._shared, self._owner = shared, os.getpid()
        self.connection, theirs = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("fork").Process
        self._process = process(target=_work, args=(job, shared, cores, theirs), daemon=True)
        with warnings.catch_warnings():
            # from Python 3.12 on: a thread might hold a lock that the copy needs; ours wait, or run a compiler
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        theirs.close()
        self.answer: bytes | None = None

    def receive(self) -> None:
        """Take the answer, empty where the copy died over it."""
        try:
            self.answer = self.connection.recv_bytes()
        except EOFError:
            self.answer = b""
        self.end()

    def result(self, job: Callable[[], T]) -> T:
        """What was answered, made here where the copy died; raises what the job raised."""
        if not self.answer:
            return job()
        found, error = _Unpickler(self.answer, self._shared).load()
        if error is not None:
            raise error
        return found

    def end(self) -> None:
        """Stop the copy, whatever it does; a copy that holds another one leaves it alone."""
        if os.getpid() != self._owner:
            return
        self._process.kill()
        self._process.join()
        self.connection.close()


class Ahead(Generic[T]):
    """Results of ``jobs`` that are asked for in their order, while as many as there are cores are made.

    One job alone is made here, on all cores; copies begin where a second one in a row is asked for, or with ``begin``.

    shared : objects that results refer to and need not bring along, such as the recordings of a fit; coming : told here of the
    place of a job that is next. An error of a job is raised where its result is asked for.
    """

    def __init__(
        self, jobs: Sequence[Callable[[], T]], shared: Sequence[object] = (), coming: Callable[[int], object] = lambda _: None
    ) -> None:
        self._jobs, self._shared, self._coming = tuple(jobs), tuple(shared), coming
        most = min(threads(), len(jobs), _room()) if may_begin() else 0
        self._most = most if most > 1 else 0
        self._begun: dict[int, _Copy[T]] = {}
        self._last = -2
        weakref.finalize(self, _end, self._begun)

    def result(self, place: int) -> T:
        """That of the job at ``place``; jobs before it are given up."""
        for earlier in [one for one in self._begun if one < place]:
            self._begun.pop(earlier).end()
        in_a_row, self._last = place == self._last + 1, place
        last = place == len(self._jobs) - 1
        if place not in self._begun and (not self._most or last or not in_a_row):
            if not last:
                self._coming(place + 1)
            return self._jobs[place]()
        self._fill(place)
        while self._begun[place].answer is None:
            self._receive()
            self._fill(place)
        return self._begun.pop(place).result(self._jobs[place])

    def begin(self) -> None:
        """Begin at once, for all will be asked for."""
        self._last = -1
        if self._most:
            self._fill(0)

    def close(self) -> None:
        """Give up what was begun."""
        _end(self._begun)

    def _fill(self, place: int) -> None:
        """Begin what there are cores for, from ``place`` on."""
        for one in range(place, len(self._jobs)):
            working = sum(copy.answer is None for copy in self._begun.values())
            if one not in self._begun and working < self._most:
                self._coming(one)
                self._begun[one] = _Copy(self._jobs[one], self._shared, threads() // self._most)

    def _receive(self) -> None:
        """Wait for an answer."""
        working = {copy.connection: copy for copy in self._begun.values() if copy.answer is None}
        for one in wait(list(working)):
            working[one].receive()  # type: ignore[index]  # what it waits for is what comes


def in_turn(jobs: Sequence[Callable[[], T]], shared: Sequence[object] = ()) -> Generator[T]:
    """Results of the ``jobs`` one after the other, as by ``Ahead`` and begun at once; those not asked for are given up."""
    with closing(Ahead(jobs, shared)) as ahead:
        ahead.begin()
        for place in range(len(jobs)):
            yield ahead.result(place)


def _end(begun: dict[int, Any]) -> None:
    while begun:
        begun.popitem()[1].end()


def _work(job: Callable[[], T], shared: Sequence[object], cores: int, answer: Connection) -> None:
    """What a copy does: the job, on its share of the cores, deaf to ctrl-C, which the process that began it takes care of."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.update({_COPY: "1", "PNEUID_THREADS": str(cores)})
    content = io.BytesIO()
    try:
        _Pickler(content, shared).dump((job(), None))
    except Exception as error:  # noqa: BLE001 - it belongs to whoever asks for the result
        content = io.BytesIO()
        pickle.dump((None, error), content)
    answer.send_bytes(content.getvalue())


class _Pickler(pickle.Pickler):
    def __init__(self, content: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(content, pickle.HIGHEST_PROTOCOL)
        self._places = {id(one): place for place, one in enumerate(shared)}

    def persistent_id(self, one: object) -> int | None:
        """Place of what is shared."""
        return self._places.get(id(one))


class _Unpickler(pickle.Unpickler):
    def __init__(self, content: bytes, shared: Sequence[object]) -> None:
        super().__init__(io.BytesIO(content))
        self._shared = shared

    def persistent_load(self, place: int) -> object:
        """What is shared, by its place."""
        return self._shared[place]
