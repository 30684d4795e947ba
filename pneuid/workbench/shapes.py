"""Shapes for *What is missing*: leading effects over the measured defect, and the unknown function, in display units.

They stand in ``shapes.json`` beside the diagnosis, so that the page can draw them at any time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pneuid.criticism.screening.defect_shapes import DefectShape, defect_shapes
from pneuid.effects import CATALOGUE
from pneuid.estimation.curves import Curve
from pneuid.estimation.fit import Fit
from pneuid.report.shape_figure import function_axis, function_over, signal_axis
from pneuid.signals import SIGNALS

MOST = 4
"""Effects that are drawn: those named, those refitted, then those that screening puts first."""

SHAPES = "shapes.json"


def shapes_of(fit: Fit, diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    """The content of shapes.json for the content of diagnosis.json, of the model that ``fit`` is of."""
    patm = fit.plant.rig.patm
    chosen = [CATALOGUE[name] for name in leading(diagnosis) if name not in {effect.name for effect in fit.plant.effects}]
    unknown = (diagnosis.get("unknown") or {}).get("curve")
    return {
        "shapes": [_shape(item, patm) for item in defect_shapes(fit, chosen, tuple(CATALOGUE))] if chosen else [],
        "unknown": None if unknown is None else _curve(Curve.from_dict(unknown), patm),
    }


def leading(diagnosis: Mapping[str, Any]) -> list[str]:
    """Effects of the catalogue that are worth a picture, best first."""
    ranking: Sequence[Mapping[str, Any]] = diagnosis["ranking"]
    tested = [item["effect"] for item in ranking if item["hold_out_error_ratio"] is not None]
    screened = [item["effect"] for item in ranking if item["screen_gain"] > 0.0]
    found = dict.fromkeys([*diagnosis["effects"], *tested, *screened])
    return [name for name in found if name in CATALOGUE][:MOST]


def _shape(item: DefectShape, patm: float) -> dict[str, Any]:
    label, at = signal_axis(item.signal, item.at, patm)
    if item.unit == "N":
        factor, words = 1.0, f"unexplained force{'<br>against the motion' * item.against_motion} (N)"
    else:
        factor, words = 1e-3, f"unexplained rate of {SIGNALS[f'p{item.equation[-1]}'].symbol} (kPa/s)"
    columns = {name: (factor * getattr(item, name)).tolist() for name in ("measured", "spread", "taken")}
    return {"effect": item.effect, "share": item.share, "x_label": label, "y_label": words, "at": at.tolist(), **columns}


def _curve(curve: Curve, patm: float) -> dict[str, Any]:
    x_label, at = function_over(curve, patm)
    y_label, factor = function_axis(curve)
    return {"x_label": x_label, "y_label": y_label, "at": at.tolist(), "value": [factor * value for value in curve.value],
            "std": [factor * value for value in curve.std]}  # fmt: skip
