"""What was right in the cases of ``hidden_effects.py``, counted: marks per case, tables per category and effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from pneuid.virtual_rig import OUTSIDE_EFFECTS

SHEET_EFFECTS = {"load_mass", "dead_volume", "valve_critical_ratio"}
SHEET_ERROR = 0.03
"""Relative error (one sigma) of what the rig file states in the category ``sheet``, for which those effects may be named."""


def marks(row: dict[str, Any]) -> dict[str, bool]:
    """What was right in one case, by the columns that apply to its category.

    Outside the catalogue ``either`` is what the design asks for: verdict ``unknown``, or a function in the right equation and
    signal.
    """
    names, effects, verdict = row["names"], row["effects"], row["verdict"]
    if not names:
        allowed = SHEET_EFFECTS if row["category"] == "sheet" else set()
        quiet = verdict == "adequate" or (bool(effects) and set(effects) <= allowed)
        return {"false alarms": not quiet and verdict != "failed"}
    if row["category"] == "outside":
        item, said = OUTSIDE_EFFECTS[names[0]], row.get("unknown") or {"equation": "", "depends_on": []}
        at = said["equation"] in item.equations
        signal = at and bool(set(said["depends_on"]) & set(item.signals))
        unknown = verdict == "unknown"
        return {"unknown": unknown, "equation": at, "equation, signal": signal, "either": unknown or signal}
    explained = row.get("explained", 0.0) >= 0.9
    if row["category"].endswith("pair"):
        return {"both": set(names) <= set(effects), "one": bool(set(names) & set(effects)), "explained": explained}
    first = bool(effects) and (effects[0] == names[0] or (verdict == "ambiguous" and names[0] in effects))
    return {
        "first": first, "verdict": verdict == "effect" and effects == names, "ambiguous": verdict == "ambiguous" and first,
        "explained": explained,
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Counts per category and effect, then what was named instead."""
    lines: list[str] = []
    for category in dict.fromkeys(_kind(row) for row in rows):
        part = [row for row in rows if _kind(row) == category]
        columns = list(marks(part[0]))
        lines.append(f"\n{category:34s} {'cases':>6s}" + "".join(f"{name:>18s}" for name in [*columns, "failed"]))
        groups = dict.fromkeys(("+".join(row["names"]) or row["rig"], row["level"]) for row in part)
        for name, level in sorted(groups):
            lines.append(_counted(f"{name} {level}", [r for r in part if _group(r) == (name, level)], columns))
        lines.append(_counted(f"all of {category}", part, columns))
    lines.append("\nnamed first, by what hides")
    for hidden in dict.fromkeys(_group(row)[0] for row in rows):
        said = Counter(
            f"{row['verdict']}: {row['effects'][0]}" if row["effects"] else row["verdict"]
            for row in rows
            if _group(row)[0] == hidden
        )
        lines.append(f"  {hidden:34s} " + ", ".join(f"{what} x{count}" for what, count in said.most_common()))
    return "\n".join(lines)


def _kind(row: dict[str, Any]) -> str:
    """The category as it is counted: varied cases by kind of rig, those that hide nothing apart."""
    if row["category"] != "varied":
        return str(row["category"])
    return f"varied {'bench' if row['rig'].endswith('bench') else 'servo'}{'' if row['names'] else ', null'}"


def _group(row: dict[str, Any]) -> tuple[str, str]:
    return "+".join(row["names"]) or row["rig"], row["level"]


def _counted(name: str, rows: Sequence[dict[str, Any]], columns: Sequence[str]) -> str:
    counts = [sum(marks(row)[column] for row in rows) for column in columns]
    counts.append(sum(row["verdict"] == "failed" for row in rows))
    return f"{name:34s} {len(rows):6d}" + "".join(f"{count:18d}" for count in counts)
