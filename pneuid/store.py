"""What a study has already computed, one JSON object a line, so that a killed study goes on where it was."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any


def key_of(*parts: object) -> str:
    """Hash of everything that decides a result: the exact text of numbers, strings and frozen dataclasses."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def plain(value: Any) -> dict[str, float | None]:
    """A dataclass of numbers as JSON takes it: NaN becomes null."""
    content = asdict(value) if is_dataclass(value) and not isinstance(value, type) else {}
    return {key: None if number is None or math.isnan(number) else float(number) for key, number in content.items()}


def numbers(content: Mapping[str, float | None]) -> dict[str, float]:
    """The reverse of ``plain``: null becomes NaN."""
    return {key: math.nan if value is None else float(value) for key, value in content.items()}


class Store:
    """Results by key in the file ``path``; in memory only without one.

    A line that a kill cut short is left out. JSON keeps every digit of a float, so what is read back is what was
    computed.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._known: dict[str, Any] = {}
        if path is None or not path.exists():
            return
        text = path.read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                self._known[entry["key"]] = entry["content"]
            except (json.JSONDecodeError, KeyError, TypeError):
                continue
        if text and not text.endswith("\n"):
            with path.open("a", encoding="utf-8") as file:
                file.write("\n")

    def __contains__(self, key: str) -> bool:
        return key in self._known

    def __getitem__(self, key: str) -> Any:
        return self._known[key]

    def put(self, key: str, content: Any) -> None:
        """Keep ``content``, which JSON must be able to hold, and write it to the file at once."""
        self._known[key] = content
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, "content": content}, allow_nan=False) + "\n")
