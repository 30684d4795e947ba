"""What every command shares: progress on the terminal, exit codes, result folders."""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn, Self

from rich.console import Console
from rich.markup import escape

from pneuid.errors import ComputationError, UserError

if TYPE_CHECKING:
    from pneuid.recording import Recording
    from pneuid.rig import Rig

DEMO_ROOT = "pneuid-demo"

KNOWN = "done.jsonl"
"""File in the result folder that ``--resume`` reads."""

SOLVER = "pneuid.estimation.solver"
"""Module whose frames lie below a solver that exceptions cannot cross."""

_INTERRUPTED = threading.Event()


def _on_interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``; inside a solver, which would swallow it, the next iteration raises it instead."""
    again = _INTERRUPTED.is_set()
    _INTERRUPTED.set()
    while frame is not None and not again:
        if frame.f_globals.get("__name__") == SOLVER:
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _go_on() -> None:
    """Raise the ``KeyboardInterrupt`` that is due."""
    if _INTERRUPTED.is_set():
        raise KeyboardInterrupt


class CommandParser(argparse.ArgumentParser):
    """A command's arguments: the epilog is shown as it is written, and a slip is one ``UserError`` instead of the usage."""

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog, description=description, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
        )

    def error(self, message: str) -> NoReturn:
        """Raise ``UserError`` where argparse would print its usage and exit."""
        raise UserError(f"{message}; see {self.prog} --help")


class Progress:
    """Live line on a terminal: what is being done, iteration, cost; silent elsewhere except for sentences."""

    def __init__(self) -> None:
        self.console = Console(stderr=True, highlight=False)
        self._status = self.console.status("starting")
        self._began = time.monotonic()
        self._doing = "fit"

    def __enter__(self) -> Self:
        if self.console.is_terminal:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.console.is_terminal:
            self._status.stop()

    def doing(self, words: str) -> None:
        """Say what comes next. Raises ``KeyboardInterrupt`` after a ctrl-C."""
        _go_on()
        self._doing = words
        self.say(words)

    def say(self, words: str) -> None:
        """Print a sentence, after a ctrl-C too."""
        self.console.print(f"[dim]{time.monotonic() - self._began:6.1f} s[/dim]  {escape(words)}", soft_wrap=True)

    def monitor(self, stage: str, iteration: int, cost: float) -> None:
        """Show one iteration of a fit. Raises ``KeyboardInterrupt`` after a ctrl-C."""
        _go_on()
        if self.console.is_terminal:
            status = f"{self._doing}: {stage} stage, iteration {iteration}, cost per sample {cost:.4g}"
            self._status.update(escape(status))


def warn(rig: Rig, recordings: Sequence[Recording]) -> None:
    """Say on stderr what the sanity checks suspect of the recordings, a line each; nothing is changed."""
    from pneuid.plausibility import check_recordings  # noqa: PLC0415 - brings scipy.signal, which not every command needs

    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    for finding in check_recordings(rig, recordings):
        console.print(f"warning: {finding.line}")


def run_command(main: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None) -> None:
    """Run a command: exit 0 on success, 2 on bad input, 1 when the computation failed, 130 on ctrl-C."""
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    _INTERRUPTED.clear()
    here = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, _on_interrupt) if here else None
    try:
        main(arguments)
    except UserError as error:
        # a file name may hold line ends; the message stays one line
        console.print(f"error: {' '.join(str(error).splitlines())}")
        sys.exit(2)
    except ComputationError as error:
        console.print(f"failed: {error}")
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("interrupted")
        sys.exit(130)
    except Exception:
        # a ctrl-C while CasADi converts its arguments comes out as its complaint about their types
        if not _INTERRUPTED.is_set():
            raise
        console.print("interrupted")
        sys.exit(130)
    finally:
        if here:
            signal.signal(signal.SIGINT, before)


def result_folder(out: str | None, demo: str, embedded: bool, overwrite: bool) -> Path:
    """The folder to write to. A demo folder is replaced; another that holds results needs ``--overwrite``.

    Raises ``UserError`` when it may not be used.
    """
    folder = Path(out) if out else Path(DEMO_ROOT) / demo
    if out is None and not embedded:
        raise UserError("--out is missing; name a folder for the results, such as --out results")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: is a file; --out needs a folder")
    if folder.exists() and any(folder.iterdir()):
        if not (overwrite or (embedded and out is None)):
            raise UserError(f"{folder}: holds results already; choose another --out or add --overwrite")
        if out is None:
            shutil.rmtree(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be created: {error.strerror}") from error
    return folder


def command_line(module: str, *words: str | Path, **options: Sequence[str | Path]) -> str:
    """A command that can be pasted into a shell; options without words are left out, ``hold_out`` is ``--hold-out``."""
    line = ["python", "-m", module, *map(str, words)]
    for name, given in options.items():
        line += [f"--{name.rstrip('_').replace('_', '-')}", *map(str, given)] if given else []
    return shlex.join(line)


def next_folder(folder: Path, name: str) -> Path:
    """A folder for the results of the command that comes next, beside ``folder``, that holds nothing yet."""
    found, count = folder.parent / name, 2
    while found.exists():
        found, count = folder.parent / f"{name}_{count}", count + 1
    return found


def write_json(path: Path, content: Any) -> None:
    """Write JSON whole or not at all. Raises ``KeyboardInterrupt`` after a ctrl-C."""
    _go_on()
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")
    part.replace(path)


def add_effect_file_option(parser: argparse.ArgumentParser) -> None:
    """``--effect-file``, the same everywhere."""
    parser.add_argument(
        "--effect-file", nargs="+", metavar="FILE.py", default=[], help="your own effects; the file is run (docs/own_effect.md)"
    )


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """``--out`` and ``--overwrite``, the same everywhere."""
    parser.add_argument("--out", metavar="DIR", help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="replace results that are in DIR already")


def add_running_options(parser: argparse.ArgumentParser, what: str, usual: str) -> None:
    """``--workers``, ``--scheduler`` and ``--resume``, the same for every long command.

    ``what`` it computes, and the ``usual`` number of processes, in words.
    """
    parser.add_argument("--workers", type=int, metavar="N", help=f"processes on this machine ({usual} when left out)")
    parser.add_argument("--scheduler", metavar="tcp://...", help="address of a Dask scheduler to run on instead")
    parser.add_argument("--resume", action="store_true", help=f"go on with the results in DIR, of a {what} that was killed")


def check_running(given: argparse.Namespace) -> None:
    """Raises ``UserError`` for options of ``add_running_options`` that contradict each other."""
    if given.workers is not None and given.workers < 1:
        raise UserError(f"--workers {given.workers}: must be at least 1")
    if given.scheduler is not None and given.workers is not None:
        raise UserError("--workers is for this machine and --scheduler for a cluster; leave one out")
    if given.resume and given.overwrite:
        raise UserError("--resume keeps what is there and --overwrite replaces it; leave one out")


def kept_folder(given: argparse.Namespace, demo: str, embedded: bool) -> Path:
    """As ``result_folder``; with ``--resume`` one that holds results is taken, and what is known in it is kept."""
    if given.resume and given.out is None and embedded:
        given.out = str(Path(DEMO_ROOT) / demo)
    folder = result_folder(given.out, demo, embedded, given.overwrite or given.resume)
    if not given.resume:
        (folder / KNOWN).unlink(missing_ok=True)
    return folder
