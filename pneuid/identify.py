"""``python -m pneuid.identify``: fit the model to recordings."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from pneuid import api
from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.comparison.ladder import Rung, from_json, rung_of, to_json
from pneuid.criticism.decision.diagnosis import Diagnosis
from pneuid.errors import UserError
from pneuid.estimation.fit import Interrupted
from pneuid.estimation.profile import Profile
from pneuid.model import file_sha256, model_of
from pneuid.physics.friction import LAWS
from pneuid.report.reports import identify_report
from pneuid.report.summary import metrics_json, summary_lines
from pneuid.rig import Rig
from pneuid.story import Runs, demo_files, demo_runs, read_ladder, read_runs
from pneuid.terminal import (
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
  python -m pneuid.identify --rig rig.toml --data mon_1.csv mon_2.csv --hold-out tue_1.csv --out monday
without --rig and --data the embedded demonstration is identified into pneuid-demo/identify"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser("python -m pneuid.identify", "Identify the model of a rig from recordings.", _EXAMPLE)
    found.add_argument("--rig", metavar="rig.toml", help="description of the rig")
    found.add_argument(
        "--from", dest="parent", metavar="MODEL", help="start from an identified model.json instead of --rig"
    )
    found.add_argument("--data", nargs="+", metavar="RUN", default=[], help="recordings to fit")
    found.add_argument(
        "--hold-out", nargs="+", metavar="RUN", default=[], help="recordings kept from the fit, to judge by"
    )
    found.add_argument("--friction", choices=tuple(LAWS), help="friction law instead of the rig's")
    found.add_argument(
        "--add", nargs="+", metavar="EFFECT", default=[],
        help="effects to add: of the catalogue, 'spline:EQUATION(SIGNAL)', 'formula:EQUATION(SHAPE(SIGNAL,NUMBERS))', or "
        "your own",
    )  # fmt: skip
    found.add_argument("--drop", nargs="+", metavar="EFFECT", default=[], help="effects to leave out")
    found.add_argument("--diagnosis", metavar="FILE", help="diagnosis.json whose rejected rungs join the ladder")
    found.add_argument(
        "--profile", nargs="+", metavar="NAME", default=[], help="parameters whose profile likelihood is wanted (slow)"
    )
    add_effect_file_option(found)
    add_output_options(found)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input."""
    given = parser().parse_args(arguments)
    if given.rig and given.parent:
        raise UserError("--rig and --from: give one of them; --from takes the rig from the model")
    embedded = not (given.rig or given.parent or given.data)
    if not embedded and not (given.data and (given.rig or given.parent)):
        raise UserError("--data and one of --rig or --from belong together; see --help for an example")
    parent = api.load(given.parent, given.effect_file) if given.parent else None
    runs = demo_runs() if embedded else _runs(given, parent)
    # names are checked before the folder is made, so that a slip leaves nothing behind
    add = [*(parent.content.effects if parent else ()), *given.add]
    drop = [*given.drop, *_dropped_before(parent, given.add)]
    friction = given.friction or (parent.content.friction if parent else None)
    api.plant_of(runs.rig, add, drop, friction, given.effect_file)
    before = _ladder(given, parent)
    folder = result_folder(given.out, "identify", embedded, given.overwrite)
    warn(runs.rig, [*runs.train, *runs.hold_out])
    with Progress() as progress:
        count = len(runs.train)
        progress.doing(f"fitting {count} run{'s' if count > 1 else ''}, {sum(run.n for run in runs.train)} samples")
        try:
            model = api.fit(
                runs.rig, runs.train, add=add, drop=drop, friction=friction, name=folder.name, effect_files=given.effect_file,
                start=parent.values if parent else None, hold_out=runs.hold_out,
                parent=file_sha256(given.parent) if given.parent else None, monitor=progress.monitor,
            )  # fmt: skip
        except Interrupted as stopped:
            model_of(stopped.best, folder.name, runs.hold_out).save(folder / "model.json")
            progress.say(f"stopped; the best so far, labelled so, is in {folder / 'model.json'}")
            raise
        progress.doing("comparing with the recordings")
        comparison = model.compare(runs.train, runs.hold_out)
        profiles = _profiles(model, given.profile, progress)
    rungs = [*before, rung_of(comparison, ", ".join(given.add) or None)]
    write_results(folder, model, comparison, rungs, profiles=profiles)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for line in summary_lines(comparison):
        console.print(line)
    console.print(f"report: {folder / 'report.html'}")
    if embedded and given.out is None:
        console.print("next: python -m pneuid.diagnose")
    else:
        data, hold_out = (demo_files("train"), demo_files("hold_out")) if embedded else (given.data, given.hold_out)
        out = next_folder(folder, f"{folder.name}_diagnosed")
        model_file = folder / "model.json"
        line = command_line(
            "pneuid.diagnose", model_file, data=data, hold_out=hold_out, effect_file=given.effect_file, out=[out]
        )
        console.print(f"next: {line}")


def _profiles(model: api.IdentifiedModel, names: Sequence[str], progress: Progress) -> list[Profile]:
    """The profiles that can be had; why one cannot is said, and the fit is kept."""
    found = []
    for name in names:
        progress.doing(f"profile likelihood of {name}")
        try:
            found.append(model.profile(name, progress.monitor))
        except UserError as error:
            progress.say(f"no profile: {error}")
    return found


def _runs(given: argparse.Namespace, parent: api.IdentifiedModel | None) -> Runs:
    rig = parent.content.rig if parent else Rig.from_toml(given.rig)
    every = read_runs([*given.data, *given.hold_out], rig)
    return Runs(rig, every[: len(given.data)], every[len(given.data) :])


def _dropped_before(parent: api.IdentifiedModel | None, added: Sequence[str]) -> list[str]:
    """Base effects of the rig that the parent model was identified without."""
    if parent is None:
        return []
    return [name for name in parent.content.rig.base_effects if name not in (*parent.content.effects, *added)]


def _ladder(given: argparse.Namespace, parent: api.IdentifiedModel | None) -> list[Rung]:
    """Rungs so far: those beside the parent model, then what the diagnosis tried and rejected."""
    rungs = read_ladder(Path(given.parent).parent / "ladder.json") if parent else []
    if given.diagnosis:
        try:
            raw = json.loads(Path(given.diagnosis).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise UserError(f"{given.diagnosis}: cannot read the diagnosis: {error}") from error
        if not isinstance(raw, dict) or "verdict" not in raw:
            raise UserError(f"{given.diagnosis}: verdict: is missing; give the diagnosis.json of a diagnosis")
        tried = from_json(raw.get("rungs", []), given.diagnosis)
        rungs += [rung for rung in tried if not rung.accepted]
    return rungs


def write_results(
    folder: Path,
    model: api.IdentifiedModel,
    comparison: Comparison,
    rungs: list[Rung],
    diagnosis: Diagnosis | None = None,
    profiles: Sequence[Profile] = (),
) -> None:
    """model.json, ladder.json, metrics.json and report.html; the model last, so that its presence means complete."""
    write_json(folder / "ladder.json", to_json(rungs))
    write_json(folder / "metrics.json", metrics_json(comparison))
    if profiles:
        write_json(folder / "profiles.json", {item.name: item.to_dict() for item in profiles})
    identify_report(folder / "report.html", comparison, rungs, diagnosis, profiles)
    model.save(folder / "model.json")


if __name__ == "__main__":
    run_command(main)
