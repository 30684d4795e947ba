"""The ladder: every model step, accepted or rejected, as a rung."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pneuid.criticism.comparison.comparison import Comparison
from pneuid.errors import UserError


@dataclass(frozen=True)
class Rung:
    """One step: the effects in the model, what was added (None for the base), and errors per signal in SI."""

    effects: tuple[str, ...]
    added: str | None
    accepted: bool
    train: dict[str, float]
    hold_out: dict[str, float]
    noise_floor: dict[str, float]
    parameters: int


def to_json(rungs: Sequence[Rung]) -> list[dict[str, Any]]:
    """The content of ladder.json."""
    return [{**vars(rung), "effects": list(rung.effects)} for rung in rungs]


def from_json(raw: Any, where: str) -> list[Rung]:
    """Rungs from the content of ladder.json. Raises ``UserError`` naming ``where``."""
    try:
        return [Rung(**{**item, "effects": tuple(item["effects"])}) for item in raw]
    except (TypeError, KeyError) as error:
        raise UserError(f"{where}: not a ladder.json ({error})") from error


def rung_of(comparison: Comparison, added: str | None) -> Rung:
    """The ladder's rung for a compared model."""
    floors = comparison.hold_out or comparison.train
    return Rung(
        effects=comparison.model.effects, added=added, accepted=True,
        train={name: item.rmse for name, item in comparison.train.items()},
        hold_out={name: item.rmse for name, item in comparison.hold_out.items()},
        noise_floor={name: item.noise_floor for name, item in floors.items()}, parameters=len(comparison.model.parameters),
    )  # fmt: skip
