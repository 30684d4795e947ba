"""The sections of a report: results in, sentences, tables and pictures out. No numerics, no HTML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from pneuid.criticism.comparison.comparison import Comparison, SignalError
from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import NOT_SHOWN, NOTHING_MISSING, Candidate, Diagnosis
from pneuid.effects import CATALOGUE
from pneuid.estimation.curves import Curve
from pneuid.model import Estimate, Model
from pneuid.plausibility import check_recordings
from pneuid.report.decision_figures import (
    group_letters,
    ladder,
    ladder_words,
    overall,
    ranking,
    rung_errors,
    verdict_of,
)
from pneuid.report.friction_figure import friction_curve
from pneuid.report.html import Items, Paragraph, Part, Picture, Section, Table
from pneuid.report.quantities import handy, number, percent, probability, times, with_error
from pneuid.report.shape_figure import shape_figure
from pneuid.report.signal_figures import (
    errors_bar,
    errors_of,
    overlay,
    residual_map,
    role_word,
    telling_run,
    worst_span,
)
from pneuid.report.signal_units import error_unit

NOISE_LIKE = 1.15
"""Error over noise floor up to which a signal counts as predicted down to the noise."""

ATMOSPHERE = 101325.0
"""Standard atmosphere, Pa, by which pressures are gauge where no rig is at hand."""

ROLES = {"train": "training", "hold_out": "held-out"}

PRESSURE_LAWS = (
    "Fc, Fs, vs and sigma2 are the values at zero gauge pressure. What p1 and p1 - p2 add to them: k1 and k2 to Fc, "
    "k3 and k4 to Fs, k5 and k6 to vs, k7 and k8 to sigma2."
)


# --- what it says ---


def summary(comparison: Comparison) -> Section:
    """The model, how well it predicts, where it fails, in sentences."""
    model = comparison.model
    effects = f" with {', '.join(model.effects)}" if model.effects else ", base model without added effects"
    samples = sum(item.samples for item in model.data if item.role == "train")
    fitted = f", fitted on {_count(sum(item.role == 'train' for item in model.data), 'run')} ({samples} samples)"
    first = f"{model.name}: {model.rig.kind} rig, {model.friction} friction{effects}{fitted if samples else ''}."
    parts: list[Part] = [Paragraph(first), *stage_note(model), *data_warnings(comparison)]
    role = "hold_out" if comparison.hold_out else "train"
    errors = errors_of(comparison, role)
    lines = [_error_sentence(name, item, model.plant.servo) for name, item in errors.items()]
    if lines:
        word = role_word(comparison, role)
        what = f"{word.capitalize()} runs{' (none was held out)' if word == 'training' else ''}"
        parts += [Paragraph(f"{what}:"), Items(tuple(lines))]
    parts += [_judgement(errors), *_where(comparison)]
    return Section("Summary", tuple(parts))


def stage_note(model: Model) -> list[Part]:
    """A label that cannot be missed where the fit is relaxed or has not converged."""
    fit = model.fit
    if fit.stage != "exact":
        words = fit.status.removeprefix("relaxed: ").removesuffix("; no standard errors")
        return [Paragraph(f"Relaxed fit, the values are provisional and have no standard errors: {words}.", "warning")]
    if not fit.converged:
        return [Paragraph(f"The fit did not converge: {fit.status}.", "warning")]
    return []


def data_warnings(comparison: Comparison) -> list[Part]:
    """What the sanity checks suspect of the recordings; first of all, since a slip in the data passes for a missing effect."""
    recordings = [item.run.recording for item in comparison.predictions]
    return [Paragraph(f"Check the data: {one.line}.", "warning") for one in check_recordings(comparison.model.rig, recordings)]


def _count(n: int, word: str) -> str:
    return f"{n} {word}{'' if n == 1 else 's'}"


def _error_sentence(name: str, item: SignalError, servo: bool) -> str:
    if not np.isfinite(item.rmse):
        return f"{name}: the prediction diverges."
    unit = error_unit(name, item.rmse)
    kind = "200 ms ahead" if servo else "over whole runs"
    sentence = (
        f"{name} {kind}: {number(item.rmse * unit.factor)} {unit.unit} rms, fit {item.fit_percent:.1f} %, "
        f"{times(item.rmse / item.noise_floor) if item.noise_floor > 0 else '—'} the noise floor"
    )
    if servo:
        if not np.isfinite(item.free_run_rmse):
            return f"{sentence}; the free run diverges."
        free = error_unit(name, item.free_run_rmse)
        sentence += f"; free run {number(item.free_run_rmse * free.factor)} {free.unit}"
    return f"{sentence}."


def _judgement(errors: dict[str, SignalError]) -> Paragraph:
    above = [name for name, item in errors.items() if not item.rmse <= NOISE_LIKE * item.noise_floor]
    if not errors:
        return Paragraph("No runs to compare with.", "warning")
    if not above:
        return Paragraph("The model predicts these runs down to the sensors' noise.", "good")
    return Paragraph(
        f"Above the noise: {', '.join(above)}. Something is missing from the model or from its data.", "warning"
    )


def _where(comparison: Comparison) -> list[Part]:
    if not comparison.where:
        return [Paragraph("The error does not concentrate in any region that signals can name.")]
    lines = tuple(
        f"{percent(item.share)} of the squared {item.signal} error sits in {percent(item.samples)} of the samples: "
        f"{item.region}."
        for item in comparison.where
    )
    return [Paragraph("Where the model fails:"), Items(lines)]


# --- numbers ---


def parameters(model: Model) -> Section:
    """Every parameter with standard error, unit, bounds and verdict."""
    owned = any(item.effect for item in model.parameters)
    rows = tuple(_parameter_row(item, owned) for item in model.parameters)
    weak = frozenset(k for k, item in enumerate(model.parameters) if item.verdict == "not visible")
    heads = ("parameter", "value", "± std", "unit", "bounds", "verdict", *(("from",) if owned else ()))
    caption = "Standard errors are 1-sigma." if model.fit.stage == "exact" else ""
    table = Table(heads, rows, "lrrnnn" + "l" * owned, caption, weak)
    parts: list[Part] = stage_note(model)
    if "friction_pressure" in model.effects:
        parts.append(Paragraph(PRESSURE_LAWS, "note"))
    fit = model.fit
    exact, relaxed = "1 when only noise is left", "between jumps, which take up what the model does not explain"
    left = exact if fit.stage == "exact" else relaxed
    about = (
        f"Fit: {fit.status}; {fit.solver}, {_count(fit.iterations, 'iteration')}, {number(fit.seconds, 2)} s; "
        f"mean squared weighted residual {number(fit.cost_per_sample)} ({left})."
    )
    shapes = tuple(shape(curve, model.rig.patm) for curve in model.curves)
    return Section("Parameters", (*parts, table, Paragraph(about), *shapes))


def _parameter_row(item: Estimate, owned: bool) -> tuple[str, ...]:
    unit, factor = handy(item.unit)
    value, std = with_error(item.value * factor, None if item.std is None else item.std * factor)
    bounds = f"{number(item.lower * factor)} to {number(item.upper * factor)}"
    name = item.name if item.run is None else f"{item.name} (run {item.run})"
    verdict = "—" if item.std is None and item.verdict == "weakly determined" else item.verdict  # nothing was weighed
    return name, value, std, unit, bounds, verdict, *((item.effect or "base model",) if owned else ())


def errors(comparison: Comparison) -> Section:
    """Error beside noise floor per signal and role."""
    servo = comparison.model.plant.servo
    rows: list[tuple[str, ...]] = []
    for role, found in (("train", comparison.train), ("hold_out", comparison.hold_out)):
        for name, item in found.items():
            unit = error_unit(name, item.rmse if np.isfinite(item.rmse) else item.noise_floor)
            cells = [_shown(value * unit.factor) for value in (item.rmse, item.noise_floor, item.free_run_rmse)]
            ratio = times(item.rmse / item.noise_floor) if item.noise_floor > 0 else "—"
            fit = f"{item.fit_percent:.1f} %".replace("-", "−")
            rows.append(
                (name, role_word(comparison, role), *cells[:2], ratio, unit.unit, fit, *(cells[2:] if servo else ()))
            )
    heads = (
        "signal",
        "runs",
        "error rms",
        "noise floor",
        "ratio",
        "unit",
        "fit",
        *(("free run rms",) if servo else ()),
    )
    kind = "200 ms ahead from a state estimated on the 100 ms before" if servo else "over whole runs"
    table = Table(heads, tuple(rows), "llrrrlr" + "r" * servo, f"Error: {kind}, parameters frozen.")
    caption = "Distance to the noise floor: what the sensors' noise alone would give on data of a perfect model."
    picture = Picture(errors_bar(comparison), "Error over noise floor per signal and kind of run", caption)
    return Section("Errors", (picture, table))


def _shown(value: float) -> str:
    return number(value) if np.isfinite(value) else "diverged"


# --- pictures ---


def overlays(comparison: Comparison) -> Section:
    """The most telling run, whole and where it is worst."""
    if not comparison.predictions:
        return Section("Measured and predicted", (Paragraph("No runs to compare with."),))
    k = telling_run(comparison)
    span = worst_span(comparison, k)
    run = comparison.predictions[k].run
    whole = float(run.t[-1] - run.t[0]) <= 1.2 * (span[1] - span[0])
    name = run.name
    caption = "The run with the largest error in noise floors."
    if whole:
        pictures = [Picture(overlay(comparison, k), f"Measured and predicted signals of run {name}", caption)]
    else:
        caption += " The shaded stretch is enlarged below."
        words = f"Measured and predicted signals of run {name} from {span[0]:.2f} s to {span[1]:.2f} s"
        pictures = [
            Picture(overlay(comparison, k, mark=span), f"Measured and predicted signals of run {name}", caption),
            Picture(overlay(comparison, k, span), words, "The stretch of this run where the error is largest."),
        ]
    return Section("Measured and predicted", tuple(pictures))


def where_it_fails(comparison: Comparison) -> Section:
    """Regions as a table, the error against each signal, the friction curve, the defects per balance."""
    parts: list[Part] = []
    if comparison.where:
        rows = tuple(
            (item.signal, percent(item.share), percent(item.samples), times(item.lift), item.region)
            for item in comparison.where
        )
        caption = "Regions may overlap. Lift: mean squared error in the region over that of all samples."
        parts.append(Table(("signal", "share of error", "of samples", "lift", "region"), rows, "lrrrl", caption))
    else:
        parts.append(Paragraph("The error does not concentrate in any region that signals can name."))
    if any(item.index.size for item in comparison.predictions):
        parts.append(Picture(
            residual_map(comparison), "Error of every output against speed, position, pressures and command",
            "A mean that leaves zero along an axis says on what the missing effect depends.",
        ))  # fmt: skip
        parts.append(Picture(
            friction_curve(comparison),
            "Steady friction of the model and force balance of the data over speed",
            "Lines: the model in steady motion. Marks: force balance of the data, medians and quartiles of "
            "quasi-steady samples. Marks off their line are force that the model does not explain: pressure in the "
            "friction where they split by pressure, a constant force where they split by direction.",
        ))  # fmt: skip
    if comparison.defects:
        parts.append(defects(comparison))
    return Section("Where it fails", tuple(parts))


def defects(comparison: Comparison) -> Table:
    """What each balance leaves unexplained."""
    rows = tuple(
        (
            item.equation, number(item.rms), number(item.expected_rms), item.unit,
            times(item.rms / item.expected_rms) if item.expected_rms > 0 else "—",
        )
        for item in comparison.defects
    )  # fmt: skip
    caption = "What each balance leaves unexplained between intervals of the fit, beside what noise alone would leave."
    return Table(("balance", "left over, rms", "from noise", "unit", "ratio"), rows, "lrrlr", caption)


# --- decisions ---


def ladder_section(rungs: Sequence[Rung]) -> Section:
    """The ladder chart and its numbers."""
    if not rungs:
        return Section("Ladder", (Paragraph("No rungs yet."),))
    totals = [overall(item) for item in rung_errors(rungs)]
    rows = []
    for rung, total in zip(rungs, totals, strict=True):
        held = rung.hold_out or rung.train
        cells = ", ".join(_signal_error(name, value) for name, value in held.items())
        words = "accepted" if rung.accepted else "rejected"
        step = f"+ {rung.added}" if rung.added else ", ".join(rung.effects) or "base model"
        rows.append((step, words, times(total), cells, str(rung.parameters)))
    heads = ("step", "", "ratio", "error rms", "parameters")
    faint = frozenset(k for k, rung in enumerate(rungs) if not rung.accepted)
    caption = "Every step is measured by one noise floor, that of the last accepted model."
    picture = Picture(ladder(rungs), "Error over noise floor of every model step", caption)
    return Section("Ladder", (Paragraph(ladder_words(rungs)), picture, Table(heads, tuple(rows), "lnrnr", "", faint)))


def _signal_error(name: str, value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return f"{name} diverged"
    unit = error_unit(name, value)
    return f"{name} {number(value * unit.factor)} {unit.unit}"


_VERDICTS: dict[str, tuple[str, Literal["good", "warning"]]] = {
    "adequate": (f"{NOTHING_MISSING.capitalize()}.", "good"),
    "effect": ("Missing from the model: NAMES.", "warning"),
    "ambiguous": ("Something is missing; these data cannot tell apart: NAMES.", "warning"),
    "unknown": ("Something is missing that the catalogue does not hold.", "warning"),
}


def shape(curve: Curve, patm: float) -> Picture:
    """An unknown function with its band; ``patm`` is atmospheric pressure, Pa."""
    caption = f"{curve.effect}: the function where the data visit it, two standard errors either side."
    if curve.provisional:
        caption += " The band is that of a relaxed fit."
    return Picture(shape_figure(curve, patm), f"Unknown function of {curve.signal} in equation {curve.equation}", caption)


def diagnosis_verdict(diagnosis: Diagnosis, patm: float = ATMOSPHERE) -> Section:
    """What is missing, in words, and what to record next; ``patm`` is atmospheric pressure, Pa."""
    words, kind = _VERDICTS.get(diagnosis.verdict, (diagnosis.verdict, "warning"))
    if diagnosis.verdict == "adequate" and NOTHING_MISSING not in diagnosis.sentences:
        words, kind = f"{NOT_SHOWN.capitalize()}.", "warning"
    groups = diagnosis.choices or (diagnosis.effects,)
    words = words.replace("NAMES", "; nor ".join(", ".join(group) for group in groups))
    if diagnosis.choices and diagnosis.beside:
        words += f" Missing whichever it is: {', '.join(diagnosis.beside)}."
    parts: list[Part] = [Paragraph(words, "good" if kind == "good" else "warning")]
    if diagnosis.verdict == "unknown" and diagnosis.effects:
        parts.append(Paragraph(f"Found beside it: {', '.join(diagnosis.effects)}."))
    known = [f"{name}: {CATALOGUE[name].mechanism}." for name in diagnosis.effects if name in CATALOGUE]
    if known:
        parts.append(Items(tuple(known)))
    rest = diagnosis.unknown
    if rest is not None:
        on = f", depending on {', '.join(rest.depends_on)}" if rest.depends_on else ""
        formula = f"; formula {rest.formula}" if rest.formula else ""
        parts.append(
            Paragraph(f"Unexplained: {number(rest.rms)} {rest.unit} rms in the {rest.equation} balance{on}{formula}.")
        )
    if rest is not None and rest.curve is not None:
        parts.append(shape(rest.curve, patm))
    said = [text for text in diagnosis.sentences if text != NOTHING_MISSING]
    if said:
        parts.append(Items(tuple(f"{_capital(text)}." for text in said)))
    following = diagnosis.next_experiment
    if following:
        file = f" Command file: {following['file']}." if following.get("file") else ""
        power = following.get("power")
        odds = f" Chance that it decides: {percent(power)}." if power else ""
        parts.append(Paragraph(f"Next experiment: {following.get('why', '')}.{file}{odds}".replace("..", "."), "note"))
    return Section("Verdict", tuple(parts))


def _capital(text: str) -> str:
    """With a capital at the start, unless that is the name of an effect."""
    return text if "_" in text.split(maxsplit=1)[0] else f"{text[:1].upper()}{text[1:]}"


def ranking_section(diagnosis: Diagnosis) -> Section:
    """Every candidate with its evidence."""
    if not diagnosis.ranking:
        return Section("Ranking", (Paragraph("No candidate was screened."),))
    groups = group_letters(diagnosis.ranking)
    rows = tuple(_candidate_row(item, group, diagnosis) for item, group in zip(diagnosis.ranking, groups, strict=True))
    heads = ("effect", "group", "equation", "screening", "error", "explains", "p", "verdict")
    faint = frozenset(k for k, item in enumerate(diagnosis.ranking) if item.hold_out_error_ratio is None)
    caption = (
        "Group: candidates whose traces in these data are alike. Screening: drop of the cost predicted without "
        "a refit. Error: on held-out runs, with the effect over without. "
        "Explains: share of the base model's excess over the noise that it removes. "
        "p: chance of such a drop of the training cost under white noise; the held-out error decides, not this. "
        "Not refitted: the leading candidates promise so much more that a refit of the others would say nothing new."
    )
    picture = Picture(
        ranking(diagnosis), "Candidates by predicted drop of the cost and held-out error",
        "A letter in brackets marks a group that screening alone cannot tell apart.",
    )  # fmt: skip
    return Section("Ranking", (picture, Table(heads, rows, "llnrrrnn", caption, faint)))


def _candidate_row(item: Candidate, group: str, diagnosis: Diagnosis) -> tuple[str, ...]:
    ratio = "—" if item.hold_out_error_ratio is None else f"× {item.hold_out_error_ratio:.2f}"
    explained = "—" if item.excess_explained is None else percent(max(item.excess_explained, 0.0))
    p = "—" if item.p_value is None else probability(item.p_value).removeprefix("= ")
    gain = f"{100 * item.screen_gain:.1f} %".replace("-", "−")
    return item.effect, group, item.equation, gain, ratio, explained, p, verdict_of(item, diagnosis)


# --- data ---


def data_section(comparison: Comparison) -> Section:
    """Files with their fingerprints, and everything that was masked, filled or left aside."""
    model = comparison.model
    known = {(item.file, item.sha256) for item in model.data}
    rows = [(item.file, ROLES.get(item.role, item.role), str(item.samples), item.sha256[:12]) for item in model.data]
    for item in comparison.predictions:
        recording = item.run.recording
        file = recording.file or recording.name
        if (file, recording.sha256) not in known:
            rows.append((file, "compared", str(recording.n), recording.sha256[:12]))
    table = Table(("file", "role", "samples", "sha256"), tuple(rows), "lnrn")
    notes: list[str] = []
    for item in comparison.predictions:
        recording = item.run.recording
        notes += [*item.run.notes, *(f"{recording.name}: {note}" for note in recording.notes)]
        if recording.extra:
            notes.append(f"{recording.name}: columns not used: {', '.join(recording.extra)}")
    noise = ", ".join(_signal_error(name, value) for name, value in model.noise.items())
    parts: list[Part] = [table]
    if noise:
        parts.append(Paragraph(f"Sensor noise used (1-sigma): {noise}."))
    if model.parent:
        parts.append(Paragraph(f"Fitted from the model with sha256 {model.parent[:12]}."))
    if notes:
        parts.append(Items(tuple(dict.fromkeys(notes))))
    return Section("Data and notes", tuple(parts))
