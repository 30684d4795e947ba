"""What a diagnosis says: verdict, ranking of the catalogue, the unknown rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pneuid.criticism.frames import notebook_html
from pneuid.estimation.curves import Curve

NOTHING_MISSING = "nothing is missing above the noise"
"""Sentence of a verdict ``adequate`` whose model leaves noise alone."""

NOT_SHOWN = "these runs do not show that an effect is missing"
"""What such a verdict says otherwise: the error is above noise, and the sentences say why that is no evidence."""


@dataclass(frozen=True)
class Candidate:
    """One effect's evidence.

    screen_gain : predicted relative drop of the relaxed cost; hold_out_error_ratio : held-out error after over before
    (weighted over signals), None where it was not refitted; excess_explained : share of the base model's held-out excess
    removed; p_value of the refit's drop; indistinguishable_from : members of its group.
    """

    effect: str
    equation: str
    screen_gain: float
    hold_out_error_ratio: float | None = None
    excess_explained: float | None = None
    p_value: float | None = None
    indistinguishable_from: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unknown:
    """The rest that the catalogue does not explain: in which equation, on which signals it depends, how large.

    Where a smooth function explains it: ``effect`` is what to add for it, ``curve`` its shape with a band and
    ``excess_explained`` the share of the held-out excess that it removes; ``formula`` is the shape in words of mathematics,
    ``formula_effect`` what to add for that, ``formula_error`` its rms distance over the rms of the shape.
    """

    equation: str
    depends_on: tuple[str, ...]
    rms: float
    unit: str
    formula: str | None = None
    effect: str | None = None
    formula_effect: str | None = None
    formula_error: float | None = None
    excess_explained: float | None = None
    curve: Curve | None = None

    def to_dict(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        curve = None if self.curve is None else self.curve.to_dict()
        return {**vars(self), "depends_on": list(self.depends_on), "curve": curve}


@dataclass(frozen=True)
class Command:
    """What to play: times (s), position (m), other signals (SI), all ``(N,)``.

    On a servo rig ``inputs`` are the valve command ``u`` and the supply ``psup``, and ``x`` is what the models expect; on a
    bench they are the chambers' pressures ``p1`` and ``p2``, and ``x`` is what the motor imposes. Pressures absolute.
    """

    t: np.ndarray
    x: np.ndarray
    inputs: Mapping[str, np.ndarray]

    def csv(self, patm: float, gauge: bool) -> str:
        """The command file; pressures in the rig's convention, ``patm`` (Pa) is atmospheric pressure."""
        columns = [("t [s]", self.t, "{:.6g}")]
        for name, values in self.inputs.items():
            if name == "u":
                columns.append(("u [V]", values, "{:.5f}"))
            else:
                columns.append((f"{name} [kPa]", 1e-3 * (values - (patm if gauge else 0.0)), "{:.2f}"))
        place, form = ("x_expected [mm]", "{:.3f}") if "u" in self.inputs else ("x [mm]", "{:.5f}")
        columns.append((place, 1e3 * self.x, form))
        rows = (",".join(way.format(values[k]) for _, values, way in columns) for k in range(self.t.size))
        return "\n".join([",".join(head for head, _, _ in columns), *rows, ""])


@dataclass(frozen=True)
class Diagnosis:
    """Verdict ``adequate``, ``effect``, ``ambiguous`` or ``unknown`` with its evidence."""

    verdict: str
    effects: tuple[str, ...]
    ranking: tuple[Candidate, ...]
    unknown: Unknown | None = None
    next_experiment: dict[str, Any] | None = None
    sentences: tuple[str, ...] = field(default=())
    command: Command | None = field(default=None, compare=False)
    """What the next experiment plays; the command writes it to the file that ``next_experiment`` names."""
    beside: tuple[str, ...] = ()
    """Of the ``effects`` of an ambiguous verdict those that are missing whichever of the others is."""
    one_of: tuple[tuple[str, ...], ...] = ()
    """Groups of the others: of each one is missing, the weightiest group first. One group where it is left out."""
    by_all_runs: bool = field(default=False, compare=False)
    """Whether the effect was named on all runs together, to which its model then is to be fitted."""

    @property
    def choices(self) -> tuple[tuple[str, ...], ...]:
        """Groups of effects that these data do not tell apart, of each of which one is missing."""
        if self.verdict != "ambiguous":
            return ()
        return self.one_of or (tuple(name for name in self.effects if name not in self.beside),)

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        ranking = [{**vars(item), "indistinguishable_from": list(item.indistinguishable_from)} for item in self.ranking]
        unknown = None if self.unknown is None else self.unknown.to_dict()
        return {
            "schema": 1, "verdict": self.verdict, "effects": list(self.effects), "ranking": ranking, "unknown": unknown,
            "next_experiment": self.next_experiment, "sentences": list(self.sentences), "beside": list(self.beside),
            "one_of": [list(group) for group in self.choices],
        }  # fmt: skip

    def to_pandas(self) -> pd.DataFrame:
        """The ranking, a row per effect, best first; all numbers are shares, ratios or probabilities (``unit`` 1)."""
        rows = [
            {
                "effect": item.effect, "equation": item.equation, "named": item.effect in self.effects,
                "screen_gain": item.screen_gain, "hold_out_error_ratio": item.hold_out_error_ratio,
                "excess_explained": item.excess_explained, "p_value": item.p_value, "unit": "1",
                "indistinguishable_from": ", ".join(item.indistinguishable_from),
            }
            for item in self.ranking
        ]  # fmt: skip
        numbers = ["screen_gain", "hold_out_error_ratio", "excess_explained", "p_value"]
        columns = ["effect", "equation", "named", *numbers, "unit", "indistinguishable_from"]
        frame = pd.DataFrame(rows, columns=columns).set_index("effect")
        return frame.astype(dict.fromkeys(numbers, float))

    def _repr_html_(self) -> str:
        """Verdict and ranking, as a notebook shows them."""
        names = f": {', '.join(self.effects)}" if self.effects else ""
        return notebook_html(f"verdict {self.verdict}{names}", self.to_pandas().drop(columns="unit"))
