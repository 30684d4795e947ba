"""Closed-loop study over controllers, pressure conditions and disturbances.

Example: ``python -m controllers.study --out study``. Without a scenario the shipped pressure grid is played.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from controllers.candidates import candidates_of
from controllers.chain import play_scenario
from controllers.figures import save_figures
from controllers.grid import Result, run_study
from controllers.scenario import Scenario, read_scenario
from controllers.tables import Grid, tables
from pneuid.errors import ComputationError, UserError
from pneuid.pool import open_pool
from pneuid.resources import scenario_path
from pneuid.store import Store, plain
from pneuid.terminal import (
    KNOWN,
    CommandParser,
    add_output_options,
    add_running_options,
    check_running,
    kept_folder,
    result_folder,
    run_command,
    write_json,
)
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.truth import TruthServo

SCHEMA = 2


def rich_table(grid: Grid) -> Table:
    """A table for the terminal; a first cell that repeats is left out."""
    found, last = Table(*grid.heads, title=grid.title), ""
    for first, *rest in grid.rows:
        found.add_row("" if first == last else first, *rest)
        last = first
    return found


def save_study(results: Sequence[Result], scenario: Scenario, truth: TruthServo, folder: Path) -> list[Path]:
    """Write ``study.json`` (SI, supplies absolute), ``tables.md`` and the figures into ``folder``; returns the paths."""
    rows = [
        {
            "model": own.model, "controller": own.controller, "condition": own.condition, "supply": own.supply,
            "reference": own.reference, "seed": own.seed, "gains": own.gains, "signature": own.signature,
            "metrics": None if own.metrics is None else plain(own.metrics),
        }
        for own in results
    ]  # fmt: skip
    written = folder / "study.json"
    content = {"schema": SCHEMA, "title": scenario.title, "design": plain(scenario.design), "results": rows}
    write_json(written, content)
    text = folder / "tables.md"
    parts = [grid.markdown() for grid in tables(results, scenario.design.supply, truth.patm)]
    text.write_text(f"# {scenario.title}\n\n" + "\n\n".join(parts) + "\n", encoding="utf-8")
    return [written, text, *save_figures(results, scenario.title, truth.patm, folder)]


def _arguments() -> argparse.ArgumentParser:
    parser = CommandParser(
        "python -m controllers.study", "Closed-loop study over controllers and pressure conditions, on the virtual rig.",
        "examples:\n  python -m controllers.study --chain\n"
        "  python -m controllers.study scenarios/pressure_grid.toml --out study\n"
        "  python -m controllers.study scenarios/disturbances.toml --out robust --workers 8 --resume\n"
        "  python -m controllers.study scenarios/price_list.toml --out prices --scheduler tcp://10.0.0.5:8786",
    )  # fmt: skip
    parser.add_argument("scenario", nargs="?", type=Path, help="scenario file; the shipped pressure grid when left out")
    add_output_options(parser)
    parser.add_argument(
        "--chain", action="store_true",
        help="measure, fit, diagnose, add what is missing, and study the controllers before and after",
    )  # fmt: skip
    add_running_options(parser, "study", "one per core")
    return parser


def _run(
    scenario: Scenario, truth: TruthServo, hidden: Hidden, folder: Path, arguments: argparse.Namespace
) -> list[Result]:
    """The study, with a live bar on a terminal and a line now and then elsewhere."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    store = Store(folder / KNOWN)
    with (
        open_pool(arguments.workers, arguments.scheduler) as pool,
        Progress(*columns, console=console, transient=True) as progress,
    ):
        task = progress.add_task("models", total=None)
        quarter = -1

        def told(done: int, every: int, words: str) -> None:
            nonlocal quarter
            progress.update(task, completed=done, total=every, description=words)
            if not console.is_terminal and (reached := 4 * done // max(every, 1)) != quarter:
                quarter = reached
                console.print(f"{done} of {every} loops: {words}", soft_wrap=True, highlight=False)

        def named(words: str) -> None:
            progress.update(task, description=words)
            if not console.is_terminal:
                console.print(words, soft_wrap=True, highlight=False)

        candidates = candidates_of(scenario, truth, hidden, pool, store, folder, named)
        return run_study(scenario, candidates, truth, hidden, pool=pool, store=store, on_result=told)


def _checked(arguments: argparse.Namespace) -> None:
    check_running(arguments)
    if arguments.chain and arguments.resume:
        raise UserError("--resume goes on with a study; --chain measures and fits anew, leave one out")


def main(argv: Sequence[str] | None = None) -> None:
    """The command. Raises ``UserError`` and ``ComputationError`` for ``run_command`` to report."""
    arguments = _arguments().parse_args(argv)
    _checked(arguments)
    if arguments.chain:
        if arguments.scenario is not None:
            read_scenario(arguments.scenario)  # so that a slip in it leaves no folder behind
        folder = result_folder(arguments.out, "chain", arguments.scenario is None, arguments.overwrite)
        with open_pool(arguments.workers, arguments.scheduler) as pool:
            play_scenario(folder, pool, arguments.scenario)
        return
    scenario, truth, hidden = read_scenario(arguments.scenario or scenario_path("pressure_grid.toml"))
    folder = kept_folder(arguments, "study", arguments.scenario is None)
    began = time.monotonic()
    results = _run(scenario, truth, hidden, folder, arguments)
    paths = save_study(results, scenario, truth, folder)
    console = Console(width=None if sys.stdout.isatty() else 160)
    for grid in tables(results, scenario.design.supply, truth.patm):
        console.print(rich_table(grid))
    console.print(f"{scenario.title}: {len(results)} closed loops in {time.monotonic() - began:.0f} s")
    console.print("wrote " + ", ".join(str(path) for path in paths), soft_wrap=True)
    console.print("next, measure, fit, diagnose, add, study again: python -m controllers.study --chain")
    if all(result.metrics is None for result in results):
        raise ComputationError("every closed loop diverged; check the scenario's truth and design")


if __name__ == "__main__":
    run_command(main)
