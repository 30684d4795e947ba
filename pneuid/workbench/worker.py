"""The loop of a computing process: one task at a time, progress and results through a pipe, a flag to cancel by."""

from __future__ import annotations

import importlib
import os
import signal
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from typing import Any

from pneuid.errors import ComputationError, UserError


@dataclass(frozen=True)
class Task:
    """A function of the workbench by module and name, and its arguments; ``live`` ones take ``monitor`` and/or ``say``."""

    number: int
    module: str
    name: str
    arguments: dict[str, Any]
    live: tuple[str, ...] = ()


@dataclass(frozen=True)
class News:
    """What a process says of task ``number``.

    ``kind``: ``taken``, ``iteration``, ``sentence``, ``done``, ``refused``, ``failed`` or ``cancelled``.
    """

    number: int
    kind: str
    content: Any = None


def run_worker(pipe: Connection, cancel: Event, modules: tuple[str, ...]) -> None:
    """Work off tasks from ``pipe`` until it closes. ``modules`` are imported first, so that the first task is quick."""
    # ctrl-C reaches the whole group; the process that serves the page decides
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("PNEUID_WORKBENCH", "1")
    for module in modules:
        importlib.import_module(module)
    while True:
        try:
            task: Task = pipe.recv()
        except (EOFError, OSError):
            return
        cancel.clear()
        pipe.send(News(task.number, "taken"))
        pipe.send(_performed(task, pipe.send, cancel))


def _performed(task: Task, send: Callable[[News], None], cancel: Event) -> News:
    def monitor(stage: str, iteration: int, cost: float) -> None:
        send(News(task.number, "iteration", (stage, iteration, cost)))
        if cancel.is_set():
            # the one exception that the solver lets through
            raise KeyboardInterrupt

    def say(sentence: str) -> None:
        send(News(task.number, "sentence", sentence))
        if cancel.is_set():
            raise KeyboardInterrupt

    hooks = {"monitor": monitor, "say": say}
    try:
        function = getattr(importlib.import_module(task.module), task.name)
        found = function(**task.arguments, **{name: hooks[name] for name in task.live})
    except KeyboardInterrupt:
        return News(task.number, "cancelled")
    except (UserError, ComputationError) as error:
        return News(task.number, "refused", str(error))
    except Exception as error:  # noqa: BLE001 - a fault of a task must reach the page, not end the process
        return News(task.number, "failed", f"{type(error).__name__}: {error}\n{traceback.format_exc()}")
    return News(task.number, "done", found)
