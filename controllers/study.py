"""Closed-loop study over controllers and pressure conditions.

Example: ``python -m controllers.study --out study``. Without a scenario the shipped pressure grid is played.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from controllers.figures import save_figures
from controllers.grid import Models, Result, run_study
from controllers.nominal import nominal_model
from controllers.registry import CONTROLLERS
from controllers.scenario import Scenario, read_scenario
from pneuid.errors import ComputationError, UserError
from pneuid.resources import scenario_path
from pneuid.virtual_rig.truth import TruthServo

SCHEMA = 1
DEMO = Path("pneuid-demo/study")

__all__ = ["main", "run_study", "save_study", "table"]


def built_in_models(truth: TruthServo, design_supply: float) -> Models:
    """The rig's own model, and beside it, where its friction follows the pressures, the one with constant friction."""
    exact = nominal_model(truth)
    if not exact[0].effects:
        return {"exact": exact}
    return {"pressure laws": exact, "constant friction": nominal_model(truth, frozen_at=design_supply)}


def table(results: Sequence[Result], patm: float) -> Table:
    """RMS and largest tracking error in mm, worst steady error and standstill motion in um, step time in us."""
    shown = Table("controller", "model", "supply", "reference", "RMS mm", "max mm", "steady um", "p-p um", "step us")
    for result in results:
        m = result.metrics
        numbers = ["diverged"] + [""] * 4
        if m is not None:
            lengths = ((m.rms, 1e3, 3), (m.peak, 1e3, 2), (m.worst_steady, 1e6, 0), (m.wander, 1e6, 0))
            numbers = ["" if math.isnan(value) else f"{value * factor:.{digits}f}" for value, factor, digits in lengths]
            numbers.append(f"{m.step_median * 1e6:.0f}")
        pressure = f"{(result.supply - patm) / 1e5:.1f} bar"
        shown.add_row(CONTROLLERS[result.controller].label, result.model, pressure, result.reference, *numbers)
    return shown


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
    written.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")
    return [written, *save_figures(results, scenario.title, scenario.design.supply, truth.patm, folder)]


def _plain(value: Any) -> dict[str, float | None]:
    """A dataclass of numbers as JSON takes it: NaN becomes null."""
    content = asdict(value) if is_dataclass(value) and not isinstance(value, type) else {}
    return {key: None if number is None or math.isnan(number) else float(number) for key, number in content.items()}


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m controllers.study",
        description="Closed-loop study over controllers and pressure conditions, on the virtual rig.",
        epilog="example: python -m controllers.study scenarios/pressure_grid.toml --out study",
    )
    parser.add_argument("scenario", nargs="?", type=Path, help="scenario file; the shipped pressure grid when left out")
    parser.add_argument("--out", type=Path, help=f"folder for the results ({DEMO} when the shipped grid is played)")
    parser.add_argument("--overwrite", action="store_true", help="replace results that --out holds already")
    parser.add_argument("--workers", type=int, help="processes on this machine (one per core when left out)")
    return parser


def _prepare(out: Path | None, demo: bool, overwrite: bool) -> Path:
    """An empty folder for the results. Raises ``UserError`` when it holds some and may not be replaced."""
    if out is None and not demo:
        raise UserError("--out is missing; name a folder for the results, such as --out study")
    folder = out or DEMO
    if (folder / "study.json").exists():
        if not (overwrite or out is None):
            raise UserError(f"{folder} holds a study already; give another --out or add --overwrite")
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _run(arguments: argparse.Namespace, console: Console) -> None:
    folder = _prepare(arguments.out, arguments.scenario is None, arguments.overwrite)
    scenario, truth, hidden = read_scenario(arguments.scenario or scenario_path("pressure_grid.toml"))
    models = built_in_models(truth, scenario.design.supply)
    began = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("closed loops", total=None)

        def told(done: int, every: int) -> None:
            progress.update(task, completed=done, total=every)

        results = run_study(scenario, models, truth, hidden, workers=arguments.workers, on_result=told)
    paths = save_study(results, scenario, truth, folder)
    console.print(table(results, truth.patm))
    console.print(f"{scenario.title}: {len(results)} closed loops in {time.monotonic() - began:.0f} s")
    console.print("wrote " + ", ".join(str(path) for path in paths))
    if all(result.metrics is None for result in results):
        raise ComputationError("every closed loop diverged; check the scenario's truth and design")


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    arguments = _arguments().parse_args(argv)
    console = Console(stderr=False)
    try:
        _run(arguments, console)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ComputationError as error:
        print(f"failed: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
