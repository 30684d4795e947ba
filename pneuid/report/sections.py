"""The sections of a report: results in, sentences, tables and pictures out. No numerics, no HTML."""

from __future__ import annotations

import numpy as np

from pneuid.criticism.comparison.comparison import Comparison, SignalError
from pneuid.estimation.curves import Curve
from pneuid.model import Estimate, Model
from pneuid.plausibility import check_recordings
from pneuid.report.friction_figure import friction_curve
from pneuid.report.html import Items, Paragraph, Part, Picture, Section, Table
from pneuid.report.quantities import handy, number, percent, times, with_error
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
from pneuid.report.signal_units import error_unit, signal_error

NOISE_LIKE = 1.15
"""Error over noise floor up to which a signal counts as predicted down to the noise."""

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


def shape(curve: Curve, patm: float) -> Picture:
    """An unknown function with its band; ``patm`` is atmospheric pressure, Pa."""
    caption = f"{curve.effect}: the function where the data visit it, two standard errors either side."
    if curve.provisional:
        caption += " The band is that of a relaxed fit."
    return Picture(shape_figure(curve, patm), f"Unknown function of {curve.signal} in equation {curve.equation}", caption)


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
    noise = ", ".join(signal_error(name, value) for name, value in model.noise.items())
    parts: list[Part] = [table]
    if noise:
        parts.append(Paragraph(f"Sensor noise used (1-sigma): {noise}."))
    if model.parent:
        parts.append(Paragraph(f"Fitted from the model with sha256 {model.parent[:12]}."))
    if notes:
        parts.append(Items(tuple(dict.fromkeys(notes))))
    return Section("Data and notes", tuple(parts))
