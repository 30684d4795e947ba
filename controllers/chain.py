"""The whole sentence: measure, fit, see where it fails, name what is missing, add it, and control before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from controllers.figures import errors_figure
from controllers.grid import Candidate, Result, run_study
from controllers.measure import measured_runs
from controllers.registry import CONTROLLERS
from controllers.scenario import Scenario, read_scenario
from pneuid import api
from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.comparison.ladder import Rung, rung_of, to_json
from pneuid.criticism.decision.verdict import Verdict
from pneuid.errors import ComputationError
from pneuid.model import Model
from pneuid.pool import Pool
from pneuid.report import decision_sections, sections
from pneuid.report.html import Items, Paragraph, Picture, Section, Table, write_report
from pneuid.report.quantities import change
from pneuid.report.summary import metrics_json, summary_lines, verdict_lines
from pneuid.resources import scenario_path
from pneuid.story import Runs, demo_runs
from pneuid.terminal import Progress, write_json
from pneuid.virtual_rig.truth import TruthServo

BEFORE, AFTER = "before", "after"
_NEXT = (
    f"The models are in {BEFORE}/model.json and {AFTER}/model.json beside this file.",
    f"C code of a servo or a predictive controller: python -m controllers.export {AFTER}/model.json --out c_code",
    "Your own logs: python -m pneuid.workbench shows a file and writes its rig.toml; or python -m pneuid.identify --help",
    "Every controller at every pressure and under disturbances: python -m controllers.study",
)


@dataclass(frozen=True)
class Chain:
    """Everything that the story produced."""

    before: Comparison
    verdict: Verdict
    after: Comparison
    results: list[Result]
    rungs: list[Rung]


def run_chain(runs: Runs, scenario_file: Path, progress: Progress, pool: Pool) -> tuple[Chain, Scenario, TruthServo]:
    """Fit, diagnose, add and study. Raises ``ComputationError`` when no effect is named, so nothing can be added."""
    progress.doing(f"fitting the base model to {len(runs.train)} runs")
    base = api.fit(runs.rig, runs.train, name="base model", hold_out=runs.hold_out, monitor=progress.monitor)
    progress.doing("comparing it with the recordings")
    before = base.compare(runs.train, runs.hold_out)
    progress.doing("screening the catalogue for what is missing")
    verdict = api.diagnose(base, runs.train, runs.hold_out, progress.monitor, progress.doing)
    named = verdict.diagnosis.effects
    if not named:
        raise ComputationError(
            f"the diagnosis says '{verdict.diagnosis.verdict}' and names no effect, so none is added"
        )
    added = named if verdict.diagnosis.verdict != "ambiguous" else named[:1]
    progress.doing(f"fitting again with {', '.join(added)}")
    better = api.fit(
        runs.rig, runs.train, add=added, start=verdict.best.values, name=f"with {', '.join(added)}", hold_out=runs.hold_out,
        monitor=progress.monitor,
    )  # fmt: skip
    progress.doing("comparing the new model with the recordings")
    after = better.compare(runs.train, runs.hold_out)
    scenario, truth, hidden = read_scenario(scenario_file)
    candidates = [Candidate(label, own.plant, own.theta()) for label, own in _models(before, after).items()]
    progress.doing("closed loops on the virtual rig, controllers made from the model before and after")
    results = run_study(scenario, candidates, truth, hidden, pool=pool)
    rejected = [rung for rung in verdict.rungs if not rung.accepted]
    rungs = [rung_of(before, None), *rejected, rung_of(after, ", ".join(added))]
    return Chain(before, verdict, after, results, rungs), scenario, truth


def _models(before: Comparison, after: Comparison) -> dict[str, Model]:
    return {BEFORE: before.model, AFTER: after.model}


def tracking_rows(results: Sequence[Result], patm: float) -> list[tuple[str, str, float, float, float]]:
    """``(controller, reference, supply in bar gauge, RMS error in mm before, after)``; NaN where a loop diverged."""
    rms: dict[tuple[str, str, float], dict[str, float]] = {}
    for result in results:
        key = (CONTROLLERS[result.controller].label, result.reference, (result.supply - patm) / 1e5)
        rms.setdefault(key, {})[result.model] = float("nan") if result.metrics is None else 1e3 * result.metrics.rms
    return [(*key, value.get(BEFORE, float("nan")), value.get(AFTER, float("nan"))) for key, value in rms.items()]


def _plain(item: str | float) -> str | float | None:
    """NaN as JSON takes it."""
    return None if isinstance(item, float) and math.isnan(item) else item


def write_chain(chain: Chain, scenario: Scenario, truth: TruthServo, folder: Path) -> Path:
    """Models, metrics, diagnosis, ladder and one report; returns the report's path."""
    for label, comparison in ((BEFORE, chain.before), (AFTER, chain.after)):
        (folder / label).mkdir(exist_ok=True)
        write_json(folder / label / "metrics.json", metrics_json(comparison))
        comparison.model.save(folder / label / "model.json")
    diagnosis = chain.verdict.diagnosis
    write_json(folder / "diagnosis.json", {**diagnosis.to_dict(), "rungs": to_json(chain.verdict.rungs)})
    write_json(folder / "ladder.json", to_json(chain.rungs))
    rows = tracking_rows(chain.results, truth.patm)
    keys = ("controller", "reference", "supply_bar_gauge", "rms_mm_before", "rms_mm_after")
    tracked = [dict(zip(keys, [_plain(item) for item in row], strict=True)) for row in rows]
    write_json(folder / "tracking.json", tracked)
    parts = [
        sections.summary(chain.before),
        decision_sections.diagnosis_verdict(diagnosis),
        decision_sections.ladder_section(chain.rungs),
        decision_sections.ranking_section(diagnosis),
        _tracking_section(chain.results, rows, scenario, truth),
        sections.parameters(chain.after.model),
        replace(sections.errors(chain.after), heading="Errors after"),
        replace(sections.where_it_fails(chain.before), heading="Where it failed before"),
        replace(sections.overlays(chain.before), heading="Measured, and predicted by the model before"),
        sections.data_section(chain.before),
        Section("What to do next", (Items(_NEXT),)),
    ]
    path = folder / "report.html"
    write_report(path, f"From measurement to control: {', '.join(diagnosis.effects)} found and added", parts)
    return path


def _tracking_section(
    results: Sequence[Result], rows: Sequence[tuple], scenario: Scenario, truth: TruthServo
) -> Section:
    figure = errors_figure(results, truth.patm)
    cells = tuple(
        (label, reference, f"{bar:g}", f"{was:.3f}", f"{now:.3f}", change(was, now))
        for label, reference, bar, was, now in rows
    )
    heads = ("controller", "reference", "supply, bar gauge", "RMS before, mm", "RMS after, mm", "change")
    words = (
        "Every controller was made twice with the same rules, from the model before and after the missing effect was added, "
        f"tuned for {(scenario.design.supply - truth.patm) / 1e5:g} bar gauge and run unchanged at the other supplies, on the "
        "virtual rig that was recorded. Controllers that use no friction model are there as the baseline."
    )
    alt = "RMS tracking error per supply pressure, controllers made from the model before and after"
    return Section(
        "What it is worth in closed loop", (Paragraph(words), Picture(figure, alt), Table(heads, cells, align="lnrrrr"))
    )


def play(folder: Path, pool: Pool, runs: Runs, scenario_file: Path) -> None:
    """The command behind ``--chain``: progress, a summary on the terminal, the report."""
    with Progress() as progress:
        chain, scenario, truth = run_chain(runs, scenario_file, progress, pool)
        progress.doing("writing the report")
        path = write_chain(chain, scenario, truth, folder)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print("BEFORE")
    for line in summary_lines(chain.before):
        console.print(line)
    console.print("DIAGNOSIS")
    for line in verdict_lines(chain.verdict.diagnosis):
        console.print(line)
    console.print("AFTER")
    for line in summary_lines(chain.after):
        console.print(line)
    console.print(
        f"final fits, all windows: held-out error {chain.before.weighted_error() ** 0.5:.2f} times the noise floor before, "
        f"{chain.after.weighted_error() ** 0.5:.2f} after"
    )
    console.print("TRACKING, RMS in mm, controllers made from the model before -> after")
    for label, reference, bar, was, now in tracking_rows(chain.results, truth.patm):
        console.print(
            f"  {label:42s} {reference:12s} {bar:3g} bar  {was:7.3f} -> {now:7.3f}  ({change(was, now)})"
        )
    console.print(f"report: {path}")
    console.print("next, with your own data: python -m pneuid.identify --help")
    console.print("or, every controller at every pressure: python -m controllers.study")


def play_scenario(folder: Path, pool: Pool, scenario_file: Path | None) -> None:
    """The embedded story, or the same on recordings of the virtual rig of a scenario."""
    if scenario_file is None:
        play(folder, pool, demo_runs(), scenario_path("demo/study.toml"))
        return
    _, truth, hidden = read_scenario(scenario_file)
    play(folder, pool, measured_runs(truth, hidden), scenario_file)
