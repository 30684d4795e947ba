"""What a fit is asked to do: plain data, so that the page can say it without importing the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FitRequest:
    """What is to be fitted: files, effects beside the parent's, start values (SI), the friction law (None: the rig's)."""

    folder: Path
    train: tuple[str, ...]
    hold_out: tuple[str, ...]
    add: tuple[str, ...] = ()
    friction: str | None = None
    start: Mapping[str, float] | None = None
    parent: str | None = None
    added: str | None = None
    diagnosis: str | None = None
