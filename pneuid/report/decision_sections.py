"""The sections of a report on decisions: the ladder, the verdict and the ranking of the candidates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import NOT_SHOWN, NOTHING_MISSING, Candidate, Diagnosis
from pneuid.effects import CATALOGUE
from pneuid.report.decision_figures import (
    group_letters,
    ladder,
    ladder_words,
    overall,
    ranking,
    rung_errors,
    verdict_of,
)
from pneuid.report.html import Items, Paragraph, Part, Picture, Section, Table
from pneuid.report.quantities import number, percent, probability, times
from pneuid.report.sections import shape
from pneuid.report.signal_units import signal_error

ATMOSPHERE = 101325.0
"""Standard atmosphere, Pa, by which pressures are gauge where no rig is at hand."""


def ladder_section(rungs: Sequence[Rung]) -> Section:
    """The ladder chart and its numbers."""
    if not rungs:
        return Section("Ladder", (Paragraph("No rungs yet."),))
    totals = [overall(item) for item in rung_errors(rungs)]
    rows = []
    for rung, total in zip(rungs, totals, strict=True):
        held = rung.hold_out or rung.train
        cells = ", ".join(signal_error(name, value) for name, value in held.items())
        words = "accepted" if rung.accepted else "rejected"
        step = f"+ {rung.added}" if rung.added else ", ".join(rung.effects) or "base model"
        rows.append((step, words, times(total), cells, str(rung.parameters)))
    heads = ("step", "", "ratio", "error rms", "parameters")
    faint = frozenset(k for k, rung in enumerate(rungs) if not rung.accepted)
    caption = "Every step is measured by one noise floor, that of the last accepted model."
    picture = Picture(ladder(rungs), "Error over noise floor of every model step", caption)
    return Section("Ladder", (Paragraph(ladder_words(rungs)), picture, Table(heads, tuple(rows), "lnrnr", "", faint)))


_VERDICTS: dict[str, tuple[str, Literal["good", "warning"]]] = {
    "adequate": (f"{NOTHING_MISSING.capitalize()}.", "good"),
    "effect": ("Missing from the model: NAMES.", "warning"),
    "ambiguous": ("Something is missing; these data cannot tell apart: NAMES.", "warning"),
    "unknown": ("Something is missing that the catalogue does not hold.", "warning"),
}


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
