"""Results in words and in the numbers that scripts read back."""

from __future__ import annotations

import math
from typing import Any

from pneuid.criticism.comparison.comparison import Comparison, SignalError
from pneuid.criticism.decision.diagnosis import NOT_SHOWN, NOTHING_MISSING, Candidate, Diagnosis
from pneuid.signals import SIGNALS
from pneuid.units import to_display


def metrics_json(comparison: Comparison) -> dict[str, Any]:
    """The content of metrics.json; a diverged simulation is null."""
    return {
        "schema": 1,
        "signals": {name: _numbers(item) for name, item in comparison.train.items()},
        "hold_out": {name: _numbers(item) for name, item in comparison.hold_out.items()},
        "where": [vars(region) for region in comparison.where],
        "defects": [vars(defect) for defect in comparison.defects],
    }


def _numbers(item: SignalError) -> dict[str, Any]:
    numbers = {key: value for key, value in vars(item).items() if key != "unit"}
    return {"unit": item.unit} | {key: value if math.isfinite(value) else None for key, value in numbers.items()}


def summary_lines(comparison: Comparison) -> list[str]:
    """A short account for the terminal: parameters, errors against the noise floor, where the model fails."""
    model = comparison.model
    lines = [f"model: {model.friction} + {', '.join(model.effects) or 'no effects'}; {model.fit.status}"]
    for item in model.parameters:
        error = "" if item.std is None else f" ± {item.std:.2g}"
        owner = f" ({item.effect})" if item.effect else ""
        unit = "" if item.unit == "1" else f" {item.unit}"
        words = "" if item.std is None and item.verdict == "weakly determined" else f"  {item.verdict}"
        lines.append(f"  {item.name:12s} {item.value:<11.5g}{error}{unit}{words}{owner}")
    fitted = {item.sha256 for item in model.data if item.role == "train"}
    seen = {item.run.recording.sha256 for item in comparison.predictions}
    first = "training" if fitted & seen else "compared"
    for role, errors in ((first, comparison.train), ("held-out", comparison.hold_out)):
        for name, found in errors.items():
            unit = SIGNALS[name].display_unit
            size, floor = (to_display(value, found.unit, unit) for value in (found.rmse, found.noise_floor))
            times = found.rmse / found.noise_floor if found.noise_floor > 0 else float("nan")
            lines.append(
                f"{role} error of {name}: {size:.4g} {unit} ({times:.1f} times the noise floor of {floor:.3g} {unit})"
            )
    lines += [
        f"where: {100 * region.share:.0f} % of the {region.signal} error in {100 * region.samples:.0f} % of the samples: "
        f"{region.region}"
        for region in comparison.where
    ]
    return lines


def _tested(item: Candidate) -> str:
    """What the refit of a candidate showed on held-out runs."""
    if item.excess_explained is None:
        return "screened only"
    if item.excess_explained > 0.0 or item.hold_out_error_ratio is None:
        return f"explains {100 * item.excess_explained:.1f} % held out"
    return f"refitted, held-out error times {item.hold_out_error_ratio:.2f}"


def _found_beside(diagnosis: Diagnosis) -> str:
    return f"; found beside it: {', '.join(diagnosis.effects)}" if diagnosis.effects else ""


def verdict_lines(diagnosis: Diagnosis) -> list[str]:
    """The verdict and its evidence, a line each."""
    rivals = "; and ".join(f"one of {', '.join(group)}" for group in diagnosis.choices)
    beside = f"; and {', '.join(diagnosis.beside)}" if diagnosis.beside else ""
    words = {
        "adequate": NOTHING_MISSING if NOTHING_MISSING in diagnosis.sentences else NOT_SHOWN,
        "effect": f"missing: {', '.join(diagnosis.effects)}",
        "ambiguous": f"missing: {rivals} (these data cannot tell which){beside}",
        "unknown": f"something is missing that the catalogue does not hold{_found_beside(diagnosis)}",
    }
    said = [text for text in diagnosis.sentences if text != words[diagnosis.verdict]]
    lines = [f"verdict: {diagnosis.verdict} - {words[diagnosis.verdict]}", *said]
    width = max((len(item.effect) for item in diagnosis.ranking[:4]), default=0)
    lines += [
        f"  {item.effect:{width}s}  predicted drop of the cost {100 * item.screen_gain:5.1f} %, {_tested(item)}"
        for item in diagnosis.ranking[:4]
    ]
    if diagnosis.unknown is not None:
        rest = diagnosis.unknown
        where = ", ".join(rest.depends_on) or "no signal in particular"
        lines.append(f"unexplained: {rest.rms:.3g} {rest.unit} rms in equation {rest.equation}, follows {where}")
    if diagnosis.next_experiment:
        lines.append(f"next experiment: {diagnosis.next_experiment['why']}")
    return lines
