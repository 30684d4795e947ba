"""``python -m pneuid.diagnose``: which physical effect is missing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from pneuid import api
from pneuid.compare import demo_model
from pneuid.criticism.comparison.ladder import to_json
from pneuid.criticism.decision.diagnosis import NOTHING_MISSING, Diagnosis
from pneuid.errors import UserError
from pneuid.pool import Pool, open_pool
from pneuid.report.reports import diagnose_report
from pneuid.report.summary import verdict_lines
from pneuid.rig import Rig
from pneuid.store import Store
from pneuid.story import demo_files, demo_runs, read_runs
from pneuid.terminal import (
    KNOWN,
    CommandParser,
    Progress,
    add_effect_file_option,
    add_output_options,
    add_running_options,
    check_running,
    command_line,
    kept_folder,
    next_folder,
    run_command,
    warn,
    write_json,
)
from pneuid.zero_reading import ZeroReading

_EXAMPLE = """example:
  python -m pneuid.diagnose monday/model.json --data mon_1.csv mon_2.csv --hold-out tue_1.csv --out why
without MODEL the embedded demonstration is diagnosed (and identified first where needed)"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser("python -m pneuid.diagnose", "Name the physical effect that the model lacks.", _EXAMPLE)
    found.add_argument("model", nargs="?", metavar="MODEL", help="model.json of a fit")
    found.add_argument("--data", nargs="+", metavar="RUN", default=[], help="recordings the model is refitted on")
    found.add_argument("--hold-out", nargs="+", metavar="RUN", default=[], help="recordings to judge by")
    found.add_argument(
        "--zero", metavar="FILE", help="sensors read with both chambers vented and nothing pulling (docs/next_experiment.md)"
    )
    add_effect_file_option(found)
    found.add_argument(
        "--minutes", type=float, default=api.MINUTES, metavar="N",
        help="finish what was begun after N minutes and look for nothing more (%(default)g)",
    )  # fmt: skip
    add_running_options(found, "diagnosis", "this one, on all cores,")
    add_output_options(found)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input."""
    given = parser().parse_args(arguments)
    if bool(given.model) != bool(given.data):
        raise UserError("MODEL and --data belong together; see --help for an example")
    if not given.minutes > 0:
        raise UserError(f"--minutes {given.minutes:g}: give a time above zero")
    check_running(given)
    with open_pool(given.workers or 1, given.scheduler) as pool:
        _diagnose(given, pool)


def _diagnose(given: argparse.Namespace, pool: Pool) -> None:
    embedded = not given.model
    path = demo_model() if embedded else given.model
    model = api.load(path, given.effect_file)
    if embedded:
        story = demo_runs()
        runs, held = story.train, story.hold_out
    else:
        every = read_runs([*given.data, *given.hold_out], model.content.rig)
        runs, held = every[: len(given.data)], every[len(given.data) :]
    zero = None if given.zero is None else ZeroReading.read(given.zero, model.content.rig)
    folder = kept_folder(given, "diagnose", embedded)
    warn(model.content.rig, [*runs, *held])
    store = Store(folder / KNOWN)
    with Progress() as progress:
        progress.doing("fitting the model again on its relaxed problem")
        how = progress.monitor, progress.doing, given.effect_file, pool, store, given.minutes, zero
        found = api.diagnose(model, runs, held, *how)
        progress.doing("comparing the model as it was with the recordings")
        comparison = model.compare(runs, held)
    diagnosis = _with_command_file(found.diagnosis, model.content.rig, folder)
    diagnose_report(folder / "report.html", comparison, diagnosis, found.rungs)
    write_json(folder / "diagnosis.json", {**diagnosis.to_dict(), "rungs": to_json(found.rungs)})
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for line in verdict_lines(diagnosis):
        console.print(line)
    console.print(f"report: {folder / 'report.html'}")
    files = (demo_files("train"), demo_files("hold_out")) if embedded else (given.data, given.hold_out)
    console.print(f"next: {_next(diagnosis, Path(path), files, folder, given.effect_file)}")
    if embedded:
        console.print("or, from measurement to control: python -m controllers.study --chain")


def _with_command_file(diagnosis: Diagnosis, rig: Rig, folder: Path) -> Diagnosis:
    """The diagnosis with the command of the next experiment written beside it."""
    if diagnosis.command is None or diagnosis.next_experiment is None:
        return diagnosis
    text = diagnosis.command.csv(rig.patm, rig.pressure_convention == "gauge")
    (folder / "next.csv").write_text(text, encoding="utf-8")
    return replace(diagnosis, next_experiment={**diagnosis.next_experiment, "file": "next.csv"})


def _next(
    diagnosis: Diagnosis, path: Path, files: tuple[Sequence[str], Sequence[str]], folder: Path, own: Sequence[str]
) -> str:
    if diagnosis.verdict == "adequate":
        if NOTHING_MISSING in diagnosis.sentences:
            return f"nothing is left to add; {path} is ready for use"
        return f"record what the sentences above ask for before {path} is used beyond its training runs"
    unknown = diagnosis.unknown.effect if diagnosis.verdict == "unknown" and diagnosis.unknown else None
    if diagnosis.verdict == "ambiguous":
        return _to_decide(diagnosis, path, files, folder, own)
    if not diagnosis.effects and unknown is None:
        return "look in the report at the first of the ranking and at where it fails; record more runs of that kind"
    out = next_folder(path.parent, f"{path.parent.name}_better")
    data, hold_out = ([*files[0], *files[1]], []) if diagnosis.by_all_runs else files
    return command_line(
        "pneuid.identify", from_=[path], add=[*diagnosis.effects, *(unknown or "").split()], data=data, hold_out=hold_out,
        diagnosis=[folder / "diagnosis.json"], effect_file=own, out=[out],
    )  # fmt: skip


def _to_decide(
    diagnosis: Diagnosis, path: Path, files: tuple[Sequence[str], Sequence[str]], folder: Path, own: Sequence[str]
) -> str:
    """What comes next where the data in hand do not tell the candidates apart: the cheaper step first."""
    steps = []
    if diagnosis.next_experiment and diagnosis.next_experiment.get("zero_reading"):
        out = next_folder(folder, f"{folder.name}_zero")
        again = command_line(
            "pneuid.diagnose", path, data=files[0], hold_out=files[1], zero=["zero.csv"], effect_file=own, out=[out]
        )
        steps.append(f"record a zero reading, zero.csv, and: {again}")
    if diagnosis.command is not None:
        again = "diagnose again with one recording among --data and the other among --hold-out"
        steps.append(f"play {folder / 'next.csv'} on the rig twice, and {again}")
    return "; where that does not decide, ".join(steps) or "look at the report, then measure what it asks for"


if __name__ == "__main__":
    run_command(main)
