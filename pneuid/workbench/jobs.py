"""Jobs: tasks for a computing process, one after the other, each with its progress, result and cancel."""

from __future__ import annotations

import itertools
import math
import multiprocessing
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pneuid.workbench.worker import News, Task, run_worker

CANCEL_SECONDS = 1.5
"""How long a task may take to stop by itself before its process is ended and a new one started."""


TOO_LITTLE_MEMORY = "the computing process ended; there may be too little memory"


@dataclass
class Job:
    """One task with what is known of it. ``state``: waiting, running, done, refused, failed or cancelled.

    ``crashed`` is said where its process dies of it, ``slow`` where it has not ended ``limit`` seconds after the process,
    which may have to import much first, took it up at ``taken``.
    """

    title: str
    task: Task
    then: Callable[[Any], None] | None = None
    otherwise: Callable[[str], None] | None = None
    state: str = "waiting"
    began: float = 0.0
    ended: float = 0.0
    costs: list[tuple[str, int, float]] = field(default_factory=list)
    sentences: list[tuple[float, str]] = field(default_factory=list)
    message: str = ""
    crashed: str = TOO_LITTLE_MEMORY
    slow: str = ""
    limit: float = math.inf
    taken: float = math.inf

    @property
    def over(self) -> bool:
        """Whether it has ended, one way or the other."""
        return self.state not in ("waiting", "running")

    @property
    def seconds(self) -> float:
        """Time it has been running."""
        if not self.began:
            return 0.0
        return (self.ended or time.monotonic()) - self.began


class Worker:
    """A process that works off jobs in order. ``poll`` is called by the one thread that owns all state."""

    def __init__(self, name: str, modules: tuple[str, ...]) -> None:
        self.name, self.modules = name, modules
        self._context = multiprocessing.get_context("spawn")
        self._numbers = itertools.count()
        self._waiting: deque[Job] = deque()
        self._news: queue.Queue[tuple[int, News | None]] = queue.Queue()
        self._generation = 0
        self._process: Any = None
        self._pipe: Any = None
        self._cancel: Any = None
        self._cancelled_at = 0.0
        self.current: Job | None = None

    def start(self) -> None:
        """Start the process where none runs; it imports what it needs while the page is being looked at."""
        if self._process is not None and self._process.is_alive():
            return
        self._generation += 1
        self._pipe, theirs = self._context.Pipe()
        self._cancel = self._context.Event()
        self._process = self._context.Process(
            target=run_worker, args=(theirs, self._cancel, self.modules), name=f"pneuid {self.name}", daemon=True
        )
        self._process.start()
        theirs.close()
        threading.Thread(target=self._listen, args=(self._pipe, self._generation), daemon=True).start()

    def _listen(self, pipe: Any, generation: int) -> None:
        while True:
            try:
                news = pipe.recv()
            except (EOFError, OSError):
                self._news.put((generation, None))
                return
            self._news.put((generation, news))

    def submit(
        self,
        title: str,
        module: str,
        name: str,
        arguments: dict[str, Any],
        live: tuple[str, ...] = (),
        then: Callable[[Any], None] | None = None,
        otherwise: Callable[[str], None] | None = None,
        first: bool = False,
        crashed: str = TOO_LITTLE_MEMORY,
        slow: str = "",
        limit: float = math.inf,
    ) -> Job:
        """Queue a task; ``then`` gets its result and ``otherwise`` the message, both from ``poll``."""
        job = Job(title, Task(next(self._numbers), module, name, arguments, live), then, otherwise,
                  crashed=crashed, slow=slow, limit=limit)  # fmt: skip
        if first:
            self._waiting.appendleft(job)
        else:
            self._waiting.append(job)
        self._begin_next()
        return job

    @property
    def busy(self) -> bool:
        """Whether a job runs or waits."""
        return self.current is not None or bool(self._waiting)

    def _begin_next(self) -> None:
        if self.current is not None or not self._waiting:
            return
        self.start()
        job = self._waiting.popleft()
        job.state, job.began = "running", time.monotonic()
        self.current, self._cancelled_at = job, 0.0
        self._pipe.send(job.task)

    def poll(self) -> bool:
        """Take in the news; True where anything changed."""
        changed = False
        while True:
            try:
                generation, news = self._news.get_nowait()
            except queue.Empty:
                break
            if generation == self._generation:
                changed |= news is None or news.kind != "taken"
                self._heard(news)
        if self._cancelled_at and time.monotonic() - self._cancelled_at > CANCEL_SECONDS:
            changed = True
            self._end_process()
            self._over("cancelled")
        if self.current is not None and time.monotonic() - self.current.taken > self.current.limit:
            changed = True
            self._end_process()
            self._over("failed", self.current.slow)
        return changed

    def _heard(self, news: News | None) -> None:
        job = self.current
        if news is None:
            self._end_process()
            if job is not None:
                self._over("failed", job.crashed)
            return
        if job is None or news.number != job.task.number:
            return
        if news.kind == "taken":
            job.taken = time.monotonic()
        elif news.kind == "iteration":
            job.costs.append(news.content)
        elif news.kind == "sentence":
            job.sentences.append((job.seconds, news.content))
        elif news.kind == "done":
            self._over("done", result=news.content)
        else:
            self._over(news.kind, news.content or "")

    def _over(self, state: str, message: str = "", result: Any = None) -> None:
        job, self.current, self._cancelled_at = self.current, None, 0.0
        if job is not None:
            job.state, job.ended, job.message = state, time.monotonic(), message
            if state == "done" and job.then is not None:
                job.then(result)
            elif state != "done" and job.otherwise is not None:
                job.otherwise(message or "cancelled")
        self._begin_next()

    def cancel(self, job: Job) -> None:
        """Ask ``job`` to stop where it runs, its process is ended where it does not; take it from the queue where it waits."""
        if job is self.current:
            if not self._cancelled_at:
                self._cancel.set()
                self._cancelled_at = time.monotonic()
        elif any(one is job for one in self._waiting):
            self._waiting = deque(one for one in self._waiting if one is not job)
            job.state, job.ended = "cancelled", time.monotonic()
            if job.otherwise is not None:
                job.otherwise("cancelled")

    def _end_process(self) -> None:
        process, self._process = self._process, None
        self._generation += 1
        if process is not None:
            process.kill()
            process.join(2.0)

    def stop(self) -> None:
        """End the process and forget what waits."""
        self._waiting.clear()
        self.current = None
        self._end_process()
