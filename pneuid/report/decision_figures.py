"""Pictures of decisions: the ranking of the catalogue and the ladder of models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis
from pneuid.report import style
from pneuid.report.quantities import number, percent, probability, times
from pneuid.report.style import new_figure, plain, plain_log, quiet_grid, styled
from pneuid.signals import SIGNALS

MOST_CANDIDATES = 16
"""Rows of a ranking picture; the table holds the rest."""

MOST_RUNGS = 24


# --- ranking ---


def verdict_of(candidate: Candidate, diagnosis: Diagnosis) -> str:
    """What became of one candidate, in words."""
    if candidate.effect in diagnosis.effects:
        return "cannot be told apart" if diagnosis.verdict == "ambiguous" else "accepted"
    if candidate.hold_out_error_ratio is None:
        return "not refitted"
    return "rejected"


_VERDICT_COLOR = {
    "accepted": style.ACCEPTED, "cannot be told apart": style.FREE_RUN, "rejected": style.REJECTED,
    "not refitted": style.NEUTRAL,
}  # fmt: skip


@styled
def ranking(diagnosis: Diagnosis) -> Figure:
    """Candidates, best first: predicted drop of the cost, then what the held-out runs said of those refitted."""
    rows = diagnosis.ranking[:MOST_CANDIDATES]
    figure = new_figure(1.3 + 0.32 * max(len(rows), 2))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1.0, 1.25])
    for y, item in enumerate(rows):
        verdict = verdict_of(item, diagnosis)
        left.barh(y, 100 * max(item.screen_gain, 0.0), height=0.66, color=_VERDICT_COLOR[verdict], zorder=2)
        _evidence(right, y, item, verdict)
    groups = [f" ({letter})" if letter else "" for letter in group_letters(diagnosis.ranking)]
    left.set_yticks(range(len(rows)), [f"{plain(item.effect, 32)}{groups[k]}" for k, item in enumerate(rows)])
    left.set_ylim(max(len(rows), 1) - 0.4, -0.6)
    left.set_xlabel("predicted drop of the cost (%)")
    left.set_xlim(left=0.0)
    right.axvline(1.0, color=style.FLOOR, lw=1.5, zorder=1)
    right.set_xlabel("held-out error with it / without it")
    drawn = [item.hold_out_error_ratio for item in rows if item.hold_out_error_ratio is not None]
    right.set_xlim(0.0, 1.1 * max([1.0, *(min(ratio, 2.0) for ratio in drawn)]))
    for axes in (left, right):
        quiet_grid(axes, "x")
    present = [words for words in _VERDICT_COLOR if any(verdict_of(item, diagnosis) == words for item in rows)]
    handles: list[Patch | Line2D] = [Patch(color=_VERDICT_COLOR[words], label=words) for words in present]
    handles.append(Line2D([], [], color=style.FLOOR, lw=1.5, label="no change"))
    figure.legend(handles=handles, loc="outside upper left", ncols=5)
    return figure


def _evidence(axes: Axes, y: float, item: Candidate, verdict: str) -> None:
    ratio, color = item.hold_out_error_ratio, _VERDICT_COLOR[verdict]
    if ratio is None:
        return
    axes.plot([1.0, min(ratio, 2.0)], [y, y], color=color, lw=3, solid_capstyle="butt", zorder=2)
    axes.plot(min(ratio, 2.0), y, "o" if ratio <= 2.0 else ">", color=color, ms=7, zorder=3)
    words = [f"{ratio:.2f}"]
    if item.excess_explained is not None:
        share = item.excess_explained
        words.append(f"explains {percent(share)}" if share > 0.0 else "explains nothing")
    if item.p_value is not None and verdict == "accepted":
        words.append(f"p {probability(item.p_value)}")
    axes.text(1.02, y, ", ".join(words), transform=axes.get_yaxis_transform(), va="center", fontsize=8.0)


def group_letters(rows: Sequence[Candidate]) -> list[str]:
    """A letter for every candidate of a group that screening cannot tell apart, empty for one that stands alone."""
    groups: list[set[str]] = []
    names = {item.effect for item in rows}
    for item in rows:
        own = {item.effect, *item.indistinguishable_from} & names
        touching = [group for group in groups if group & own]
        groups = [group for group in groups if not group & own] + [own.union(*touching)]
    ordered = sorted(groups, key=lambda group: min(k for k, item in enumerate(rows) if item.effect in group))
    letters = iter("ABCDEFGHIJKLMNOP")
    marks: dict[str, str] = {}
    for group in ordered:
        if len(group) > 1:
            marks |= dict.fromkeys(group, next(letters, "…"))
    return [marks.get(item.effect, "") for item in rows]


# --- ladder ---


def rung_errors(rungs: Sequence[Rung]) -> list[dict[str, float]]:
    """Held-out error (training, where none is held out) of every rung per signal, in noise floors of the best rung.

    One yardstick for all: a poor model's own floor is too high. inf where a rung diverged.
    """
    accepted = [rung for rung in rungs if rung.accepted]
    floors = (accepted or list(rungs))[-1].noise_floor
    found = []
    for rung in rungs:
        errors = rung.hold_out or rung.train
        found.append({
            name: value / floors[name] if floors.get(name, 0.0) > 0 else float("inf")
            for name, value in errors.items()
        })  # fmt: skip
    return found


def overall(errors: dict[str, float]) -> float:
    """Root mean square over the signals."""
    return float(np.sqrt(np.mean(np.square(list(errors.values()))))) if errors else float("inf")


@styled
def ladder(rungs: Sequence[Rung]) -> Figure:
    """Every model step, oldest first: held-out error over noise floor (log), accepted or rejected, parameters."""
    shown = list(rungs)[-MOST_RUNGS:]
    errors = rung_errors(rungs)[-MOST_RUNGS:]
    totals = [overall(item) for item in errors]
    signals = [name for name in SIGNALS if any(name in item for item in errors)]
    every = [value for item in errors for value in item.values() if np.isfinite(value) and value > 0] or [1.0]
    edge = 1.3 * max([*every, 2.0])
    figure = new_figure(1.5 + 0.42 * max(len(shown), 2))
    axes = figure.subplots()
    axes.axvspan(min(0.6, 0.9 * min(every)), 1.0, color=style.FLOOR, alpha=0.3, lw=0, zorder=0)
    before: tuple[float, float] | None = None
    for y, (rung, item, total) in enumerate(zip(shown, errors, totals, strict=True)):
        at = min(total, edge)
        if before is not None:
            _step(axes, before, (at, y), rung.accepted)
        before = (at, y) if rung.accepted else before
        _rung_marks(axes, y, rung, item, at, total)
    names = [_rung_name(rung, k == 0 and shown[0] is rungs[0]) for k, rung in enumerate(shown)]
    axes.set_yticks(range(len(shown)), names)
    axes.tick_params(axis="y", labelsize=9.0, length=0)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xscale("log")
    axes.set_xlim(min(0.6, 0.9 * min(every)), 1.15 * edge)
    plain_log(axes.xaxis)
    held = any(rung.hold_out for rung in shown)
    one = "" if len(signals) < 2 else " (large: rms over the signals)"
    axes.set_xlabel(f"error on {'held-out' if held else 'training'} runs / noise floor{one}")
    quiet_grid(axes, "x")
    figure.legend(handles=_ladder_legend(signals, shown), loc="outside upper left", ncols=7)
    return figure


def _rung_marks(axes: Axes, y: float, rung: Rung, errors: dict[str, float], at: float, total: float) -> None:
    """Small marks for the signals, a large one for all together, and the words at the right."""
    for name, value in errors.items():
        if np.isfinite(value) and len(errors) > 1:
            axes.plot(value, y, style.MARKS.get(name, "o"), mfc="none", mec="#777777", ms=4.5, mew=0.8, zorder=3)
    color = style.ACCEPTED if rung.accepted else style.REJECTED
    mark = "o" if np.isfinite(total) else ">"
    axes.plot(at, y, mark, mfc=color if rung.accepted else "white", mec=color, mew=2.0, ms=11, zorder=5)
    words = _rung_words(rung, total)
    axes.text(1.015, y, words, transform=axes.get_yaxis_transform(), va="center", color="#222222")


def _step(axes: Axes, before: tuple[float, float], now: tuple[float, float], accepted: bool) -> None:
    """From the last accepted rung down and across to this one."""
    color = style.ACCEPTED if accepted else style.REJECTED
    width, dashes = (2.2, "-") if accepted else (0.9, ":")
    axes.plot([before[0], before[0], now[0]], [before[1], now[1], now[1]], dashes, color=color, lw=width, zorder=2)


def _rung_name(rung: Rung, first: bool) -> str:
    if rung.added is None:
        base = f"{len(rung.effects)} effects" if len(rung.effects) > 2 else ", ".join(rung.effects)
        return plain("base model" if not rung.effects else f"{'base' if first else 'model'} with {base}", 40)
    return plain(f"+ {rung.added}", 40)


def _rung_words(rung: Rung, total: float) -> str:
    size = "diverged" if not np.isfinite(total) else times(total)
    return f"{size}, {rung.parameters} parameters{'' if rung.accepted else ', rejected'}"


def _ladder_legend(signals: Sequence[str], rungs: Sequence[Rung]) -> list[Line2D | Patch]:
    def dot(color: str, fill: str, label: str) -> Line2D:
        return Line2D([], [], color=color, marker="o", mfc=fill, mew=2.0, ms=9, ls="", label=label)

    handles: list[Line2D | Patch] = [dot(style.ACCEPTED, style.ACCEPTED, "accepted")]
    if any(not rung.accepted for rung in rungs):
        handles.append(dot(style.REJECTED, "white", "rejected"))
    handles.append(Patch(color=style.FLOOR, alpha=0.3, label="noise alone"))
    for name in signals if len(signals) > 1 else ():
        mark = style.MARKS.get(name, "o")
        handles.append(Line2D([], [], ls="", marker=mark, mfc="none", mec="#777777", ms=5, label=SIGNALS[name].symbol))
    return handles


def ladder_words(rungs: Sequence[Rung]) -> str:
    """The ladder in a sentence."""
    totals = [overall(item) for item in rung_errors(rungs)]
    accepted = [(rung, total) for rung, total in zip(rungs, totals, strict=True) if rung.accepted]
    rejected = sum(1 for rung in rungs if not rung.accepted)
    if not accepted:
        return "No rung was accepted."
    (first, start), (last, end) = accepted[0], accepted[-1]
    tried = f" {rejected} further step{'s were' if rejected > 1 else ' was'} tried and rejected." if rejected else ""
    kind = "Held-out" if last.hold_out else "Training"
    if len(accepted) == 1:
        return f"{kind} error: {_amount(end)} with {last.parameters} parameters.{tried}"
    gained = last.parameters - first.parameters
    return (
        f"{kind} error: from {_amount(start)} to {_amount(end)} with "
        f"{gained} more parameter{'' if gained == 1 else 's'} ({first.parameters} to {last.parameters}).{tried}"
    )


def _amount(total: float) -> str:
    return f"{number(total, 3)} times the noise floor" if np.isfinite(total) else "divergence"
