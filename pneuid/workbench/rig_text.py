"""rig.toml as text: what a new project starts from, and the tables that the workbench writes into it."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

RIG_TEMPLATE = """kind = "servo"         # or "bench"
friction = "lugre"

[conventions]
pressure = "gauge"     # as recorded: "gauge" or "abs"

[cylinder]
bore = "32 mm"
rod = "12 mm"
stroke = "500 mm"
# with tubing; chamber 1 is the cap side
dead_volume_1 = "12 cm^3"
dead_volume_2 = "14 cm^3"

[load]
mass = "2.4 kg"        # all that moves

[valve]
# data sheet; the fit starts from it
conductance = "1.0e-8 m^3/(s*Pa)"
critical_ratio = 0.30
full_scale = "10 V"
null = "0 V"

[supply]
pressure = "600 kPa"

# what differs in one run:
# [runs."run_1.csv"]
# supply = "400 kPa"
"""

FILE_DEFAULTS: dict[str, Any] = {
    "delimiter": ",", "decimal": ".", "header": True, "skip_rows": 0, "encoding": "utf-8", "units": False,
}  # fmt: skip
"""What ``[files]`` says of a text file's layout where it says nothing."""


def with_columns(rig_text: str, mapping: Mapping[str, tuple[str, str]]) -> str:
    """``rig_text`` with ``[columns]`` replaced by ``signal -> (column, unit)``; gain and offset of a signal stay.

    A signal whose column bears its own name and needs nothing else is not written. Comments in other tables stay.
    """
    stated = _table(rig_text, "columns")
    numbered = _table(rig_text, "files").get("header") is False
    rows = {}
    for signal, (column, unit) in mapping.items():
        old = stated.get(signal)
        kept = {key: old[key] for key in ("gain", "offset") if key in old} if isinstance(old, dict) else {}
        entry = {"column": int(column) if numbered and column.isdecimal() else column} | ({"unit": unit} if unit else {}) | kept
        if entry != {"column": signal}:
            rows[signal] = entry
    lines = [f"{signal} = {{{', '.join(f'{key} = {_toml(value)}' for key, value in entry.items())}}}"
             for signal, entry in rows.items()]  # fmt: skip
    return _replaced(rig_text, "columns", lines)


def with_files(rig_text: str, layout: Mapping[str, Any]) -> str:
    """``rig_text`` with the keys of ``layout`` in ``[files]``, those at their default left out; other keys there stay."""
    entries = {key: value for key, value in (_table(rig_text, "files") | dict(layout)).items()
               if key not in FILE_DEFAULTS or value != FILE_DEFAULTS[key]}  # fmt: skip
    if entries == _table(rig_text, "files"):
        return rig_text
    return _replaced(rig_text, "files", [f"{key} = {_toml(value)}" for key, value in entries.items()])


def _table(rig_text: str, name: str) -> dict[str, Any]:
    try:
        found = tomllib.loads(rig_text).get(name, {})
    except tomllib.TOMLDecodeError:
        return {}
    return found if isinstance(found, dict) else {}


def _replaced(rig_text: str, name: str, rows: list[str]) -> str:
    """``rig_text`` without the table ``name``, which is written anew at the end where it has rows."""
    kept, inside = [], False
    for line in rig_text.splitlines():
        header = re.match(r"\s*\[+\s*([^\]]+?)\s*\]+", line)
        if header:
            inside = header[1] == name or header[1].startswith(f"{name}.")
        if not inside:
            kept.append(line)
    text = "\n".join(kept).rstrip()
    return "\n".join([text, "", f"[{name}]", *rows, ""]) if rows else f"{text}\n"


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
