"""Ladder: every model step, accepted or rejected, and what it brought."""

from __future__ import annotations

import math
from typing import Any

from nicegui import ui

from pneuid.report.quantities import times
from pneuid.workbench.charts import ladder_chart, overall, rung_errors, rung_name
from pneuid.workbench.views.parts import chart, model_choice, table


def build(page: Any) -> None:
    """Draw the view."""
    bench = page.bench
    rungs = bench.project.result(bench.model, "ladder.json") if bench.model else None
    with ui.column().classes("panel w-full gap-2"):
        with ui.row().classes("w-full items-center"):
            ui.label("Ladder of models").classes("head grow")
            model_choice(page)
        if not rungs:
            ui.label("No rung yet: the first fit makes one, every effect that is added makes the next.").classes("soft")
            return
        totals = [overall(item) for item in rung_errors(rungs)]
        ui.label(_sentence(rungs, totals)).props('data-testid="ladder-words"')
        chart(ladder_chart(rungs, page.ink), f"{150 + 58 * max(len(rungs), 2)}px", "ladder")
    with ui.column().classes("panel w-full"):
        rows = [
            (str(k + 1), rung_name(rung), "accepted" if rung["accepted"] else "rejected", str(rung["parameters"]),
             times(total) if math.isfinite(total) else "diverged", ", ".join(f"{n} {times(v)}" for n, v in item.items()))
            for k, (rung, total, item) in enumerate(zip(rungs, totals, rung_errors(rungs), strict=True))
        ]  # fmt: skip
        table(("rung", "step", "decision", "parameters", "error / floor", "per signal"), rows, (3, 4), "rungs")


def _sentence(rungs: list[dict[str, Any]], totals: list[float]) -> str:
    accepted = [(rung, total) for rung, total in zip(rungs, totals, strict=True) if rung["accepted"]]
    if not accepted:
        return "No rung was accepted."
    (first, start), (last, end) = accepted[0], accepted[-1]
    kind = "Held-out" if last["hold_out"] else "Training"
    if len(accepted) == 1:
        return (
            f"{kind} error: {times(end)} the noise floor with {last['parameters']} parameters. "
            "What is missing tells which effect would make the next rung."
        )
    more = last["parameters"] - first["parameters"]
    return f"{kind} error: from {times(start)} to {times(end)} the noise floor, with {more} more parameters."
