"""What every command shares: progress on the terminal, exit codes, result folders."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

from rich.console import Console

from pneuid.errors import ComputationError, UserError

DEMO_ROOT = "pneuid-demo"


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
        """Say what comes next."""
        self._doing = words
        self.console.print(f"[dim]{time.monotonic() - self._began:6.1f} s[/dim]  {words}")

    def monitor(self, stage: str, iteration: int, cost: float) -> None:
        """Show one iteration of a fit."""
        if self.console.is_terminal:
            self._status.update(f"{self._doing}: {stage} stage, iteration {iteration}, cost per sample {cost:.4g}")


def run_command(main: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None) -> None:
    """Run a command: exit 0 on success, 2 on bad input, 1 when the computation failed, 130 on ctrl-C."""
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    try:
        main(arguments)
    except UserError as error:
        console.print(f"error: {error}")
        sys.exit(2)
    except ComputationError as error:
        console.print(f"failed: {error}")
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("interrupted")
        sys.exit(130)


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


def write_json(path: Path, content: Any) -> None:
    """Write JSON whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")
    part.replace(path)


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """``--out`` and ``--overwrite``, the same everywhere."""
    parser.add_argument("--out", metavar="DIR", help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="replace results that are in DIR already")
