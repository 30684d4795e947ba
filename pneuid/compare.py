"""``python -m pneuid.compare``: hold a model against recordings."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from pneuid import api, identify
from pneuid.errors import UserError
from pneuid.report.reports import compare_report
from pneuid.report.summary import metrics_json, summary_lines
from pneuid.story import demo_runs, read_runs
from pneuid.terminal import (
    DEMO_ROOT,
    CommandParser,
    Progress,
    add_effect_file_option,
    add_output_options,
    command_line,
    next_folder,
    result_folder,
    run_command,
    warn,
    write_json,
)

_EXAMPLE = """example:
  python -m pneuid.compare monday/model.json --data tue_1.csv tue_2.csv --out tuesday
without MODEL the embedded demonstration is compared (and identified first where needed)"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser(
        "python -m pneuid.compare", "Compare a model with recordings and show where it fails.", _EXAMPLE
    )
    found.add_argument("model", nargs="?", metavar="MODEL", help="model.json of a fit")
    found.add_argument("--data", nargs="+", metavar="RUN", default=[], help="recordings to compare with")
    add_effect_file_option(found)
    add_output_options(found)
    return found


def demo_model(overlooked: Path = Path(DEMO_ROOT)) -> Path:
    """model.json of the embedded story; identified first where it is missing."""
    path = overlooked / "identify" / "model.json"
    if not path.exists():
        identify.main([])
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input."""
    given = parser().parse_args(arguments)
    if bool(given.model) != bool(given.data):
        raise UserError("MODEL and --data belong together; see --help for an example")
    embedded = not given.model
    model = api.load(demo_model() if embedded else given.model, given.effect_file)
    if embedded:
        story = demo_runs()
        runs, held = story.train, story.hold_out
    else:
        runs, held = read_runs(given.data, model.content.rig), []
    folder = result_folder(given.out, "compare", embedded, given.overwrite)
    warn(model.content.rig, [*runs, *held])
    with Progress() as progress:
        count = len(runs) + len(held)
        progress.doing(f"simulating {count} run{'s' if count > 1 else ''}")
        comparison = model.compare(runs, held)
    write_json(folder / "metrics.json", metrics_json(comparison))
    compare_report(folder / "report.html", comparison)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for line in summary_lines(comparison):
        console.print(line)
    console.print(f"report: {folder / 'report.html'}")
    if embedded:
        console.print("next: python -m pneuid.diagnose")
    else:
        out = next_folder(folder, f"{folder.name}_diagnosed")
        data, hold_out = _roles(model, given.data)
        line = command_line(
            "pneuid.diagnose", given.model, data=data, hold_out=hold_out, effect_file=given.effect_file, out=[out]
        )
        console.print(f"next: {line}")


def _roles(model: api.IdentifiedModel, compared: Sequence[str]) -> tuple[list[str], list[str]]:
    """Runs to train on and to hold out in a diagnosis: those that the model was fitted to, where they lie beside those
    compared, and the others compared; all compared to train on where they do not."""
    fitted = {item.file for item in model.content.data if item.role == "train"}
    found = {Path(path).name: path for path in compared}
    for name in sorted(fitted - found.keys()):
        near = next((place for path in compared if (place := Path(path).with_name(name)).is_file()), None)
        if near is not None:
            found[name] = str(near)
    others = [path for path in compared if Path(path).name not in fitted]
    if not others or not fitted <= found.keys():
        return list(compared), []
    return [found[name] for name in sorted(fitted)], others


if __name__ == "__main__":
    run_command(main)
