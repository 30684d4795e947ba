"""What a diagnosis says: verdict, ranking of the catalogue, the unknown rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


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
    """The rest that the catalogue does not explain: in which equation, on which signals it depends, how large."""

    equation: str
    depends_on: tuple[str, ...]
    rms: float
    unit: str
    formula: str | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Verdict ``adequate``, ``effect``, ``ambiguous`` or ``unknown`` with its evidence."""

    verdict: str
    effects: tuple[str, ...]
    ranking: tuple[Candidate, ...]
    unknown: Unknown | None = None
    next_experiment: dict[str, Any] | None = None
    sentences: tuple[str, ...] = field(default=())

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        ranking = [{**vars(item), "indistinguishable_from": list(item.indistinguishable_from)} for item in self.ranking]
        unknown = None if self.unknown is None else {**vars(self.unknown), "depends_on": list(self.unknown.depends_on)}
        return {
            "schema": 1, "verdict": self.verdict, "effects": list(self.effects), "ranking": ranking, "unknown": unknown,
            "next_experiment": self.next_experiment, "sentences": list(self.sentences),
        }  # fmt: skip
