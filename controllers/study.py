"""Closed-loop study over controllers and pressure conditions.

Example: ``python -m controllers.study --out study``. Without a scenario the shipped pressure grid is played.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from controllers.chain import play_scenario
from controllers.figures import save_figures
from controllers.grid import Models, Result, run_study
from controllers.nominal import nominal_model
from controllers.registry import CONTROLLERS
from controllers.scenario import Scenario, read_scenario
from pneuid.errors import ComputationError, UserError
from pneuid.resources import scenario_path
from pneuid.terminal import CommandParser, add_output_options, result_folder, run_command, write_json
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.truth import TruthServo

SCHEMA = 1

__all__ = ["built_in_models", "main", "run_study", "save_study", "table"]


def built_in_models(truth: TruthServo, design_supply: float) -> Models:
    """The rig's own model, and beside it, where its friction follows the pressures, the one with constant friction."""
    exact = nominal_model(truth)
    if not exact[0].effects:
        return {"exact": exact}
    return {"pressure laws": exact, "constant friction": nominal_model(truth, frozen_at=design_supply)}


def table(results: Sequence[Result], model: str, patm: float) -> Table:
    """One model's loops: RMS error in mm per reference (mean square over seeds), then the worst over the references of
    largest error [mm], steady error and standstill motion [um], valve movement [V/s], and the step time [us]."""
    own = [result for result in results if result.model == model]
    references = list(dict.fromkeys(result.reference for result in own))
    worst = ("max mm", "steady um", "p-p um", "valve V/s", "step us")
    shown = Table("controller", "bar", *references, *worst, title=f"RMS tracking error in mm, model: {model}")
    last = ""
    for controller, supply in dict.fromkeys((result.controller, result.supply) for result in own):
        chosen = [result for result in own if (result.controller, result.supply) == (controller, supply)]
        cells = [_rms_cell([result for result in chosen if result.reference == reference]) for reference in references]
        found = [result.metrics for result in chosen if result.metrics is not None]
        cells.append(_largest((m.peak * 1e3 for m in found), 2))
        cells.append(_largest((m.worst_steady * 1e6 for m in found), 0))
        cells.append(_largest((m.wander * 1e6 for m in found), 0))
        cells.append(_largest((m.travel for m in found), 0))
        cells.append(_largest((m.step_median * 1e6 for m in found), 0))
        label = CONTROLLERS[controller].label
        shown.add_row("" if label == last else label, f"{(supply - patm) / 1e5:g}", *cells)
        last = label
    return shown


def _rms_cell(results: Sequence[Result]) -> str:
    if any(result.metrics is None for result in results):
        return "diverged"
    return f"{1e3 * math.sqrt(sum(r.metrics.rms**2 for r in results if r.metrics) / len(results)):.3f}"


def _largest(values: Iterable[float], digits: int) -> str:
    known = [value for value in values if not math.isnan(value)]
    return f"{max(known):.{digits}f}" if known else ""


def save_study(results: Sequence[Result], scenario: Scenario, truth: TruthServo, folder: Path) -> list[Path]:
    """Write ``study.json`` (SI, supplies absolute) and the figures into ``folder``; returns the paths."""
    rows = [
        {
            "model": result.model, "controller": result.controller, "supply": result.supply,
            "reference": result.reference, "seed": result.seed,
            "metrics": None if result.metrics is None else _plain(result.metrics), "gains": _plain(result.gains),
        }
        for result in results
    ]  # fmt: skip
    written = folder / "study.json"
    content = {"schema": SCHEMA, "title": scenario.title, "design": _plain(scenario.design), "results": rows}
    write_json(written, content)
    return [written, *save_figures(results, scenario.title, scenario.design.supply, truth.patm, folder)]


def _plain(value: Any) -> dict[str, float | None]:
    """A dataclass of numbers as JSON takes it: NaN becomes null."""
    content = asdict(value) if is_dataclass(value) and not isinstance(value, type) else {}
    return {key: None if number is None or math.isnan(number) else float(number) for key, number in content.items()}


def _arguments() -> argparse.ArgumentParser:
    parser = CommandParser(
        "python -m controllers.study", "Closed-loop study over controllers and pressure conditions, on the virtual rig.",
        "examples:\n  python -m controllers.study --chain\n"
        "  python -m controllers.study scenarios/pressure_grid.toml --out study",
    )  # fmt: skip
    parser.add_argument("scenario", nargs="?", type=Path, help="scenario file; the shipped pressure grid when left out")
    add_output_options(parser)
    parser.add_argument(
        "--chain", action="store_true",
        help="measure, fit, diagnose, add what is missing, and study the controllers before and after",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, help="processes on this machine (one per core when left out)")
    return parser


def _run(scenario: Scenario, models: Models, truth: TruthServo, hidden: Hidden, workers: int | None) -> list[Result]:
    """The study with a live bar on the terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("closed loops", total=None)

        def told(done: int, every: int) -> None:
            progress.update(task, completed=done, total=every)

        return run_study(scenario, models, truth, hidden, workers=workers, on_result=told)


def main(argv: Sequence[str] | None = None) -> None:
    """The command. Raises ``UserError`` and ``ComputationError`` for ``run_command`` to report."""
    arguments = _arguments().parse_args(argv)
    if arguments.workers is not None and arguments.workers < 1:
        raise UserError(f"--workers {arguments.workers}: must be at least 1")
    if arguments.chain:
        if arguments.scenario is not None:
            read_scenario(arguments.scenario)  # so that a slip in it leaves no folder behind
        folder = result_folder(arguments.out, "chain", arguments.scenario is None, arguments.overwrite)
        play_scenario(folder, arguments.workers, arguments.scenario)
        return
    scenario, truth, hidden = read_scenario(arguments.scenario or scenario_path("pressure_grid.toml"))
    folder = result_folder(arguments.out, "study", arguments.scenario is None, arguments.overwrite)
    models = built_in_models(truth, scenario.design.supply)
    began = time.monotonic()
    results = _run(scenario, models, truth, hidden, arguments.workers)
    paths = save_study(results, scenario, truth, folder)
    console = Console(width=None if sys.stdout.isatty() else 140)
    for model in models:
        console.print(table(results, model, truth.patm))
    console.print(f"{scenario.title}: {len(results)} closed loops in {time.monotonic() - began:.0f} s")
    console.print("wrote " + ", ".join(str(path) for path in paths), soft_wrap=True)
    console.print("next, measure, fit, diagnose, add, study again: python -m controllers.study --chain")
    if all(result.metrics is None for result in results):
        raise ComputationError("every closed loop diverged; check the scenario's truth and design")


if __name__ == "__main__":
    run_command(main)
