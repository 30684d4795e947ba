"""Fit: what is to be fitted and from where, the cost falling iteration by iteration, the parameters that come of it."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from pneuid.report.quantities import handy, number, times, with_error
from pneuid.workbench.views.parts import live_job, model_choice, note, table

UNITS = {"x": ("mm", 1e3), "v": ("mm/s", 1e3), "p1": ("kPa", 1e-3), "p2": ("kPa", 1e-3), "F": ("N", 1.0)}


def build(page: Any) -> None:
    """Draw the view."""
    with ui.row().classes("w-full no-wrap gap-3 items-start"):
        with ui.column().classes("gap-3").style("width:430px;flex:none"):
            _settings(page)
        with ui.column().classes("grow gap-3").style("min-width:0"):
            with ui.column().classes("panel w-full gap-1"):
                ui.label("Progress").classes("head")
                live_job(page, "230px")
            _result(page)


def _settings(page: Any) -> None:
    bench = page.bench
    chosen = bench.selection
    with ui.column().classes("panel w-full gap-2"):
        ui.label("New fit").classes("head")
        train, held = bench.project.of_role("train"), bench.project.of_role("hold_out")
        ui.label(f"fits {len(train)} runs, judges on {len(held)} held out").classes("soft")
        laws = {"": "friction law of the rig", **{law: law for law in bench.laws}}

        def law_chosen(event: Any) -> None:
            chosen.friction = event.value or None
            bench.refresh_parameters()

        def effects_chosen(event: Any) -> None:
            chosen.effects = list(event.value)
            bench.refresh_parameters()

        ui.select(laws, value=chosen.friction or "", label="friction law", on_change=law_chosen).props(
            "dense outlined options-dense"
        ).classes("w-full")
        effects = list(bench.cards)
        included = [name for name in chosen.effects if name in effects]
        ui.select(effects, value=included, multiple=True, label="effects to include", on_change=effects_chosen).props(
            "dense outlined options-dense use-chips"
        ).classes("w-full")
        running = bench.job is not None and not bench.job.over
        with ui.row().classes("items-center"):
            start = ui.button("Fit", icon="play_arrow", on_click=lambda: page.attempt(bench.fit))
            start.props('no-caps data-testid="fit"').set_enabled(not running and bool(train) and bench.project.has_rig)
            if running:
                ui.button("Cancel", icon="stop", on_click=bench.cancel).props("no-caps outline color=negative")
        _starts(page)


def _starts(page: Any) -> None:
    bench = page.bench
    if not bench.parameters:
        return
    ui.label("Start values; an empty one is guessed from the data").classes("soft")
    with ui.element("table").classes("plain").props('data-testid="starts"'):
        with ui.element("thead"), ui.element("tr"):
            for head in ("parameter", "start", "bounds", "unit"):
                with ui.element("th"):
                    ui.label(head)
        with ui.element("tbody"):
            for item in bench.parameters:
                _start_row(bench, item)


def _start_row(bench: Any, item: Any) -> None:
    unit, factor = handy(item.unit)
    with ui.element("tr"):
        with ui.element("td"):
            ui.label(item.name).tooltip(f"{item.symbol}, {item.owner}")
        with ui.element("td"):
            given = bench.selection.start.get(item.name)

            def changed(event: Any) -> None:
                if event.value is None:
                    bench.selection.start.pop(item.name, None)
                else:
                    bench.selection.start[item.name] = float(event.value) / factor

            field = ui.number(value=None if given is None else float(f"{given * factor:.6g}"), min=item.lower * factor,
                              max=item.upper * factor, placeholder="guess", on_change=changed)  # fmt: skip
            field.props(f'dense borderless aria-label="start of {item.name}" input-style="font-size:14px"').style(
                "width:84px"
            )
        with ui.element("td"):
            ui.label(f"{number(item.lower * factor)} to {number(item.upper * factor)}").style("white-space:nowrap")
        with ui.element("td"):
            ui.label(unit).style("white-space:nowrap")


def _result(page: Any) -> None:
    bench = page.bench
    content = bench.project.result(bench.model, "model.json") if bench.model else None
    with ui.column().classes("panel w-full gap-2").props('data-testid="result"'):
        with ui.row().classes("w-full items-center"):
            ui.label("Result").classes("head grow")
            model_choice(page)
            if content is not None:
                ui.button("Write report", icon="description", on_click=lambda: page.attempt(bench.report)).props(
                    "flat no-caps dense"
                )
        if content is None:
            ui.label("No model yet: press Fit, or run python -m pneuid.identify into this folder.").classes("soft")
            return
        fit = content["fit"]
        effects = ", ".join(content["effects"]) or "no added effects"
        ui.label(f"{content['friction']} friction, {effects}").classes("soft")
        note(fit["status"], "good" if fit["stage"] == "exact" else "warning", "fit-status")
        _errors(bench.project.result(bench.model, "metrics.json"))
        rows = []
        for item in content["parameters"]:
            unit, factor = handy(item["unit"])
            std = None if item["std"] is None else item["std"] * factor
            value, error = with_error(item["value"] * factor, std)
            bounds = f"{number(item['lower'] * factor)} to {number(item['upper'] * factor)}"
            rows.append((item["name"], value, error, unit, bounds, item["verdict"], item["effect"] or "base model"))
        table(("parameter", "value", "± std", "unit", "bounds", "verdict", "from"), rows, (1, 2), "parameters")


def _errors(metrics: Any) -> None:
    """Error beside noise floor per signal and role."""
    if not isinstance(metrics, dict):
        return
    rows = []
    for role, key in (("held out", "hold_out"), ("training", "signals")):
        for name, item in metrics.get(key, {}).items():
            unit, factor = UNITS.get(name, (item["unit"], 1.0))
            cells = [("diverged" if item[field] is None else number(item[field] * factor)) for field in
                     ("rmse", "noise_floor", "free_run_rmse")]  # fmt: skip
            ratio = times(item["rmse"] / item["noise_floor"]) if item["rmse"] and item["noise_floor"] else "–"
            rows.append((name, role, cells[0], unit, ratio, cells[1], cells[2]))
    table(
        ("signal", "runs", "error rms", "unit", "in noise floors", "noise floor", "free run"),
        rows,
        (2, 4, 5, 6),
        "errors",
    )
