"""``python -m pneuid.bench``: the procedure of the 2011 study, and the joint fit of the same runs beside it."""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from pneuid import api
from pneuid.errors import UserError
from pneuid.estimation.bench.joint import joint_fit
from pneuid.estimation.bench.laws import TARGETS
from pneuid.estimation.bench.presliding import check_ratio
from pneuid.estimation.bench.study import XI, Study, classic_route
from pneuid.model import Model, model_of
from pneuid.recording import Recording
from pneuid.report.study_figures import StudyResult, study_figures
from pneuid.report.study_report import (
    joint_words,
    law_words,
    route_rows,
    study_json,
    verification_words,
    write_figures,
    write_study,
)
from pneuid.resources import scenario_path
from pneuid.rig import Rig
from pneuid.story import Runs, read_runs
from pneuid.terminal import (
    CommandParser,
    Progress,
    add_output_options,
    command_line,
    next_folder,
    result_folder,
    run_command,
    warn,
    write_json,
)
from pneuid.virtual_rig import Friction, Motion, TruthBench
from pneuid.virtual_rig.bench import STUDY_PRESSURES, STUDY_UNSEEN, record_study, study_motions

_EXAMPLE = """example:
  python -m pneuid.bench --rig rig.toml --data equal_*.csv difference_*.csv --hold-out 300_400.csv --out study
without --rig and --data the study is played on the virtual bench; runs are told apart by their measured pressures"""


@dataclass(frozen=True)
class Outcome:
    """Everything the command found: both routes, and the joint model."""

    result: StudyResult
    model: Model

    @property
    def study(self) -> Study:
        """The classic route."""
        return self.result.study


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser(
        "python -m pneuid.bench",
        "Friction of a cylinder on a bench, as the 2011 study did it and by a joint fit.",
        _EXAMPLE,
    )
    found.add_argument("--rig", metavar="rig.toml", help='description of the bench (kind = "bench")')
    found.add_argument("--data", nargs="+", metavar="RUN", default=[], help="recordings of strokes at steady speeds")
    found.add_argument("--hold-out", nargs="+", metavar="RUN", default=[], help="recordings to verify with")
    found.add_argument(
        "--xi",
        type=float,
        default=XI,
        help=f"damping ratio of the bristle that the classic route assumes (default {XI})",
    )
    found.add_argument("--seed", type=int, default=1, help="noise of the virtual bench (default 1)")
    add_output_options(found)
    return found


def virtual_runs(
    truth: TruthBench,
    seed: int,
    pressures: Sequence[tuple[float, float]],
    unseen: Sequence[tuple[float, float]],
    motions: Mapping[str, Motion],
) -> Runs:
    """The study's recordings on the virtual bench; pressures in Pa gauge."""
    rig = Rig.from_toml(scenario_path("study_2011/rig.toml"))

    def record(pairs: Sequence[tuple[float, float]]) -> list[Recording]:
        recorded = record_study(truth, pairs, motions, seed)
        return [Recording.from_arrays(name, rig, **signals) for name, signals in recorded.items()]

    return Runs(rig, record(pressures), record(unseen))


def true_coefficients(friction: Friction) -> dict[str, float]:
    """The virtual bench's truth under the names of the study, SI."""
    names = ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")
    slopes = {
        k: getattr(friction, f"{target}_{end}")
        for target, pair in TARGETS.items()
        for k, end in zip(pair, ("ps", "dp"), strict=True)
    }
    return {name: getattr(friction, name) for name in names} | slopes


def both_routes(
    runs: Runs, name: str, xi: float = XI, truth: Mapping[str, float] | None = None, progress: Progress | None = None
) -> Outcome:
    """The classic route, then the joint fit started from it. Raises ``UserError`` for runs that cannot be used."""
    if runs.rig.kind != "bench":
        raise UserError(f'{runs.rig.where}: kind: is "{runs.rig.kind}"; this command needs a bench, kind = "bench"')
    check_ratio(xi)
    if progress is not None:
        progress.doing(f"classic route on {len(runs.train)} runs, {sum(run.n for run in runs.train)} samples")
    study = classic_route(runs.rig, runs.train, runs.hold_out, xi)
    if progress is not None:
        progress.doing(f"joint fit of the same runs, {len(study.conditions)} pressure pairs")
    varied = len(study.conditions) > 1 and "p1" in runs.train[0].recorded
    plant = api.plant_of(runs.rig, add=["friction_pressure"] if varied else [])
    start = {key: value.value for key, value in study.coefficients().items()}
    fitted = joint_fit(plant, runs.train, start, None if progress is None else progress.monitor)
    model = model_of(fitted, name, runs.hold_out)
    joint = {item.name: (item.value, item.std) for item in model.parameters}
    return Outcome(StudyResult(study, joint, truth), model)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input."""
    given = parser().parse_args(arguments)
    check_ratio(given.xi)
    embedded = not (given.rig or given.data or given.hold_out)
    if not embedded and not (given.rig and given.data):
        raise UserError("--rig and --data belong together; see --help for an example")
    runs = None if embedded else _read(given)
    with _results(given, embedded) as folder:
        if runs is not None:
            warn(runs.rig, [*runs.train, *runs.hold_out])
        with Progress() as progress:
            truth = None
            if runs is None:
                progress.doing("recording the study on the virtual bench")
                bench = TruthBench()
                runs = virtual_runs(bench, given.seed, STUDY_PRESSURES, STUDY_UNSEEN, study_motions())
                truth = true_coefficients(bench.friction)
            outcome = both_routes(runs, folder.name, given.xi, truth, progress)
            progress.doing("drawing")
            write_outcome(folder, outcome)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for line in summary_lines(outcome):
        console.print(line)
    console.print(f"report: {folder / 'report.html'}")
    if embedded:
        console.print("next: your own bench: python -m pneuid.bench --rig rig.toml --data RUN... --out DIR")
    else:
        out = next_folder(folder, f"{folder.name}_diagnosed")
        line = command_line(
            "pneuid.diagnose", folder / "model.json", data=given.data, hold_out=given.hold_out, out=[out]
        )
        console.print(f"next: {line}")


def _read(given: argparse.Namespace) -> Runs:
    rig = Rig.from_toml(given.rig)
    every = read_runs([*given.data, *given.hold_out], rig)
    return Runs(rig, every[: len(given.data)], every[len(given.data) :])


@contextmanager
def _results(given: argparse.Namespace, embedded: bool) -> Iterator[Path]:
    """The folder for the results; one that is still empty when the work fails is taken away again."""
    wanted = Path(given.out) if given.out else None
    made = wanted is not None and not wanted.exists()
    folder = result_folder(given.out, "bench", embedded, given.overwrite)
    try:
        yield folder
    except BaseException:
        if (made or wanted is None) and not any(folder.iterdir()):
            folder.rmdir()
        raise


def write_outcome(folder: Path, outcome: Outcome) -> None:
    """figures/, study.json, report.html and model.json: all made beside ``folder``, then moved in, the model last."""
    figures = study_figures(outcome.result)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as name:
        staged = Path(name)
        write_figures(staged / "figures", figures)
        write_json(staged / "study.json", study_json(outcome.result))
        write_study(staged / "report.html", outcome.result, figures, outcome.model)
        outcome.model.save(staged / "model.json")
        # an old model beside new figures would look complete
        (folder / "model.json").unlink(missing_ok=True)
        shutil.rmtree(folder / "figures", ignore_errors=True)
        for part in ("figures", "study.json", "report.html", "model.json"):
            (staged / part).replace(folder / part)


def summary_lines(outcome: Outcome) -> list[str]:
    """Both routes side by side, verdicts that limit them, and the verification."""
    study = outcome.study
    lines = [f"{len(study.conditions)} pressure pairs; joint fit {outcome.model.fit.status}"]
    heads = ["", "unit", "classic", "±", "joint", "±", *(["truth", "classic", "joint"] if outcome.result.truth else [])]
    rows = [heads, *(list(row) for row in route_rows(outcome.result))]
    widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
    lines += ["  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    if "sigma1" in study.coefficients():
        lines.append(f"sigma1, classic: assumed from the damping ratio {study.xi:g}, not measured")
    for item in study.conditions:
        if item.Fs is None:
            p1, p2 = ((p - study.rig.patm) / 1e3 for p in (item.p1, item.p2))
            lines.append(f"p1 {p1:.0f}, p2 {p2:.0f} kPa: {item.verdict}")
    return [*lines, law_words(outcome.result)[0], *joint_words(outcome.result), *verification_words(outcome.result)]


if __name__ == "__main__":
    run_command(main)
