"""Control: what the controllers reach in closed loop, over the supply pressure."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from pneuid.workbench.charts import study_chart
from pneuid.workbench.views.parts import chart, note

_METRICS = {"rms": "RMS tracking error (mm)", "peak": "largest error (mm)", "worst_steady": "steady error (mm)"}

_PLAIN = "as stated"
"""Condition of results that name none."""


def build(page: Any) -> None:
    """Draw the view."""
    bench = page.bench
    studies = bench.project.studies()
    if not studies:
        with ui.column().classes("panel w-full gap-2"):
            ui.label("No closed-loop study in this project yet").classes("head")
            ui.label("Run one into the project folder; it appears here by itself:")
            ui.label(f"python -m controllers.study --out {bench.project.folder.name}/study").style(
                "font-family:monospace"
            )
        return
    chosen = page.memory.get("study", studies[-1])
    chosen = chosen if chosen in studies else studies[-1]
    content = bench.project.result(chosen, "study.json")
    results = content.get("results", []) if isinstance(content, dict) else []
    if not results:
        note(f"{chosen}/study.json holds no results", "warning")
        return
    conditions = list(dict.fromkeys(row.get("condition", _PLAIN) for row in results))
    condition = page.memory.get("condition", conditions[0])
    condition = condition if condition in conditions else conditions[0]
    results = [row for row in results if row.get("condition", _PLAIN) == condition]
    references = list(dict.fromkeys(row["reference"] for row in results))
    known = [name for name in _METRICS if any((row["metrics"] or {}).get(name) is not None for row in results)]
    reference = page.memory.get("reference", references[0])
    reference = reference if reference in references else references[0]
    metric = page.memory.get("metric", "rms")
    metric = metric if metric in known else known[0] if known else "rms"
    with ui.column().classes("panel w-full gap-2"):
        with ui.row().classes("w-full items-center"):
            ui.label(str(content.get("title", chosen))).classes("head grow")
            for key, options, value, label in (
                ("study", studies, chosen, "study"), ("condition", conditions, condition, "condition"),
                ("reference", references, reference, "reference"),
                ("metric", {name: _METRICS[name] for name in known}, metric, "shown"),
            ):  # fmt: skip
                choice = ui.select(
                    options, value=value, label=label, on_change=lambda e, key=key: _choose(page, key, e.value)
                )
                choice.props("dense outlined options-dense").classes("min-w-[150px]")
        own = [row for row in results if row["reference"] == reference]
        lost = sum(row["metrics"] is None for row in own)
        if lost:
            note(f"{lost} of {len(own)} loops diverged and are not drawn", "warning")
        chart(study_chart(results, reference, metric, _METRICS[metric], page.ink), "calc(100vh - 210px)", "study")


def _choose(page: Any, key: str, value: Any) -> None:
    page.memory[key] = value
    page.show("control")
