"""The ladder: every model step, accepted or rejected, as a rung."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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


def read_ladder(path: Path) -> list[Rung]:
    """Rungs of ``path``, none where the file does not exist."""
    if not path.exists():
        return []
    try:
        return from_json(json.loads(path.read_text(encoding="utf-8")), str(path))
    except json.JSONDecodeError as error:
        raise UserError(f"{path}: line {error.lineno}: not JSON ({error.msg})") from error
