"""The report of the 2011 procedure: both routes side by side, the verdicts, every figure; and study.json."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pneuid.estimation.bench.laws import TARGETS
from pneuid.estimation.bench.steady import Condition, Value
from pneuid.model import Model
from pneuid.report.html import Items, Paragraph, Part, Picture, Section, Table, write_report
from pneuid.report.quantities import fixed, handy, number, probability, with_error
from pneuid.report.sections import stage_note
from pneuid.report.study_figures import StudyFigure, StudyResult, steady
from pneuid.report.style import PNG_DPI, png

UNITS = {
    "Fc": "N", "Fs": "N", "vs": "m/s", "sigma0": "N/m", "sigma1": "N*s/m", "sigma2": "N*s/m",
    "k1": "N/Pa", "k2": "N/Pa", "k3": "N/Pa", "k4": "N/Pa", "k5": "m/(s*Pa)", "k6": "m/(s*Pa)",
    "k7": "N*s/(m*Pa)", "k8": "N*s/(m*Pa)",
}  # fmt: skip

SPEEDS = np.geomspace(0.5e-3, 0.15, 200)
"""Speeds over which curves are compared, m/s: the study's range."""


def verification_errors(result: StudyResult) -> list[dict[str, Any]]:
    """Per held-out pressure pair and route: largest distance in N from the measured points and from the true curve."""
    study, found = result.study, []
    for item in study.held_out:
        ps, dp = item.p1 - study.rig.patm, item.p1 - item.p2
        offset = 0.0 if item.offset is None else item.offset.value
        v, force = (np.array(column) for column in zip(*((p.v, p.force - offset) for p in item.points), strict=True))
        classic = {name: value.value for name, value in study.coefficients().items()}
        for route, plain in {"classic": classic, "joint": result.joint_values}.items():
            if "Fc" not in plain:
                continue
            entry: dict[str, Any] = {"p1": ps, "p2": ps - dp, "route": route}
            entry["points"] = float(np.max(np.abs(steady(plain, v, ps, dp) - force)))
            if result.truth is not None:
                away = steady(plain, SPEEDS, ps, dp) - steady(result.truth, SPEEDS, ps, dp)
                entry["truth"] = float(np.max(np.abs(away)))
            found.append(entry)
    return found


def study_json(result: StudyResult) -> dict[str, Any]:
    """The content of study.json, all SI, pressures gauge in Pa."""
    study = result.study
    return {
        "schema": 1,
        "xi": study.xi,
        "conditions": [
            _condition_json(item, study.rig.patm) | {"sigma0": _value(slid.sigma0), "presliding": slid.verdict}
            for item, slid in zip(study.conditions, study.presliding, strict=True)
        ],
        "held_out": [_condition_json(item, study.rig.patm) for item in study.held_out],
        "classic": {name: _value(value) | {"unit": UNITS[name]} for name, value in study.coefficients().items()},
        "laws": {
            name: {"conditions": item.conditions, "p_slopes": item.p_slopes, "needed": item.needed, "rms": item.rms}
            for name, item in study.laws.items()
        },
        "joint": {name: {"value": a, "std": b, "unit": UNITS.get(name, "")} for name, (a, b) in result.joint.items()},
        "truth": None if result.truth is None else dict(result.truth),
        "verification": verification_errors(result),
    }  # fmt: skip


def _value(value: Value | None) -> dict[str, Any]:
    return {"value": None, "std": None} if value is None else {"value": value.value, "std": value.std}


def _condition_json(item: Condition, patm: float) -> dict[str, Any]:
    names = ("Fc", "Fs", "vs", "sigma2", "offset")
    points = [
        {"v": p.v, "force": p.force, "scatter": p.scatter, "samples": p.samples, "run": p.run} for p in item.points
    ]
    found: dict[str, Any] = {
        "p1": item.p1 - patm,
        "p2": item.p2 - patm,
        "runs": list(item.runs),
        "verdict": item.verdict,
    }
    return found | {name: _value(getattr(item, name)) for name in names} | {"rms": item.rms, "points": points}


# --- words ---


def route_rows(result: StudyResult) -> list[tuple[str, ...]]:
    """A row per coefficient: name, unit, classic and joint with standard errors, then truth and both errors in percent."""
    classic, rows = result.study.coefficients(), []
    for name, unit in UNITS.items():
        if name not in classic and name not in result.joint:
            continue
        shown, factor = handy(unit)
        cells = [name, shown]
        for pair in ((classic[name].value, classic[name].std) if name in classic else None, result.joint.get(name)):
            if pair is None:
                cells += ["not seen", "—"]
                continue
            size, std = pair
            cells += with_error(factor * size, None if std is None else factor * std)
        if result.truth is not None:
            true = result.truth[name]
            cells.append(number(factor * true, 4))
            for value in (classic[name].value if name in classic else None, result.joint_values.get(name)):
                cells.append("—" if value is None else _signed(100.0 * (value / true - 1.0)))
        rows.append(tuple(cells))
    return rows


def _signed(percent: float) -> str:
    """A relative error with its sign, zero without one."""
    return "0.0 %" if abs(percent) < 0.05 else f"{percent:+.1f} %".replace("-", "−")


def law_words(result: StudyResult) -> list[str]:
    """Whether each law needs its slopes, in sentences; vs first, on which two papers differ."""
    lines = []
    for name in ("vs", "Fc", "Fs", "sigma2"):
        item = result.study.laws.get(name)
        names = " and ".join(TARGETS[name])
        if item is None:
            lines.append(f"{name}: no pressure pair shows it, so {names} cannot be tested.")
        elif item.p_slopes is None:
            lines.append(f"{name}: {item.conditions} pressure pairs are too few to test {names}.")
        else:
            word = "needed" if item.needed else "not needed"
            chance = f"F-test of the slopes over {item.conditions} pressure pairs, p {probability(item.p_slopes)}"
            lines.append(f"{name}: {names} {word} ({chance}).")
    return lines


def joint_words(result: StudyResult) -> list[str]:
    """What of the joint fit's slopes these data do not tell apart, in sentences."""
    laws, joint = result.study.laws, result.joint_values
    held = [
        (target, joint[first] + joint[second], f"{first} and {second}")
        for target, (first, second) in TARGETS.items()
        if target in laws
        and laws[target].ps is not None
        and laws[target].dp is None
        and {first, second} <= joint.keys()
    ]
    lines = []
    for target, total, names in held:
        unit, factor = handy(UNITS[TARGETS[target][0]])
        lines.append(
            f"{target}: dp went along with ps in these data, so the joint fit's {names} are seen as their sum alone, "
            f"{number(factor * total)} {unit}."
        )
    return lines


def verification_words(result: StudyResult) -> list[str]:
    """The verification in sentences."""
    lines = []
    for item in verification_errors(result):
        words = (
            f"unseen pressures p1 = {item['p1'] / 1e3:.0f}, p2 = {item['p2'] / 1e3:.0f} kPa, {item['route']}: "
            f"within {item['points']:.2f} N of the measured points"
        )
        lines.append(words + (f", {item['truth']:.3f} N of the true curve" if "truth" in item else ""))
    return lines


def _routes(result: StudyResult, model: Model | None) -> Section:
    heads: tuple[str, ...] = ("coefficient", "unit", "classic", "± std", "joint fit", "± std")
    if result.truth is not None:
        heads += ("truth", "classic error", "joint error")
    rows = tuple(route_rows(result))
    caption = "Values at zero gauge; k1 to k8, in pairs: what p1 and p1 - p2 add to Fc, Fs, vs and sigma2, as in the study."
    parts: list[Part] = [Table(heads, rows, "ln" + "r" * (len(heads) - 2), caption)]
    parts.append(
        Paragraph(
            f"sigma1 of the classic route is an assumption (damping ratio xi = {result.study.xi:g}), not a measurement; "
            "its ± is that of ratios 0.2 to 0.7.", "note",
        )
    )  # fmt: skip
    if model is not None:
        parts += stage_note(model)
        parts.append(
            Paragraph(f"Joint fit: {model.fit.status}; mean squared weighted residual {model.fit.cost_per_sample:.3f}.")
        )
    parts += [Paragraph("Are the pressure slopes needed?"), Items((*law_words(result), *joint_words(result)))]
    if result.study.held_out:
        parts += [Paragraph("Verification:"), Items(tuple(f"{line}." for line in verification_words(result)))]
    return Section("Both routes", tuple(parts))


def _pairs(result: StudyResult) -> Section:
    study = result.study
    rows = []
    for item, slid in zip(study.conditions, study.presliding, strict=True):
        cells = [fixed((item.p1 - study.rig.patm) / 1e3, 0), fixed((item.p2 - study.rig.patm) / 1e3, 0)]
        cells += [_cell(getattr(item, name), UNITS[name]) for name in TARGETS]
        cells += [_cell(slid.sigma0, "N/m"), str(len(item.points)), f"{item.verdict}; {slid.verdict}"]
        rows.append(tuple(cells))
    heads = ("p₁", "p₂", "Fc (N)", "Fs (N)", "vs (mm/s)", "σ₂ (N·s/m)", "σ₀ (N/mm)", "strokes", "verdict")
    table = Table(heads, tuple(rows), "rrrrrrrrl", "Pressures in kPa gauge, the measured means.")
    return Section("Pressure pairs", (table,))


def _cell(value: Value | None, unit: str) -> str:
    if value is None:
        return "not seen"
    factor = handy(unit)[1]
    return " ± ".join(with_error(factor * value.value, factor * value.std))


def write_study(path: str | Path, result: StudyResult, figures: Sequence[StudyFigure], model: Model | None) -> None:
    """Write the report, one self-contained HTML file."""
    made = {item.number for item in figures}
    missing = [str(k) for k in range(2, 17) if k not in made]
    pictures: list[Part] = [
        Picture(
            item.figure, f"Study, figure {item.number}: {item.words}", f"Study, figure {item.number}: {item.words}."
        )
        for item in figures
    ]
    if missing:
        note = f"Figures {', '.join(missing)} need pressure pairs, speeds or reversals that were not recorded."
        pictures.insert(0, Paragraph(note, "note"))
    sections = [_routes(result, model), _pairs(result), Section("Figures", tuple(pictures))]
    write_report(path, "The 2011 friction study on these runs", sections)


def write_figures(folder: Path, figures: Sequence[StudyFigure], dpi: int = PNG_DPI) -> None:
    """One PNG per figure, named by the study's number."""
    folder.mkdir(exist_ok=True)
    for item in figures:
        (folder / f"fig_{item.number:02d}_{item.name}.png").write_bytes(png(item.figure, dpi))
