"""Where it fails: measured against simulated, the residuals, and the regions that hold the error, all linked."""

from __future__ import annotations

from typing import Any

import numpy as np
from nicegui import ui

from pneuid.report.quantities import number, percent
from pneuid.workbench.charts import cloud
from pneuid.workbench.look import FREE_RUN, NEUTRAL
from pneuid.workbench.payload import ComparisonView, RunView
from pneuid.workbench.regions import stretches
from pneuid.workbench.traces import Line, Row, stack
from pneuid.workbench.views.parts import chart, model_choice, note, zoomable

_JOIN_SHARE = 0.004
"""Highlighted stretches closer than this share of the run are one."""


def build(page: Any) -> None:
    """Draw the view."""
    bench = page.bench
    found = bench.comparisons.get(bench.model)
    if found is None:
        _nothing_yet(page)
        return
    with ui.row().classes("w-full no-wrap gap-3 items-start"):
        with ui.column().classes("gap-2").style("width:300px;flex:none"):
            with ui.column().classes("panel w-full gap-2"):
                model_choice(page)
                _run_choice(page, found)
            _regions(page, found)
        with ui.column().classes("grow gap-2").style("min-width:0"):
            _plots(page, found)


def _nothing_yet(page: Any) -> None:
    bench = page.bench
    with ui.column().classes("panel w-full gap-2"):
        if not bench.model:
            ui.label("There is no model yet").classes("head")
            ui.button("Go to Fit", on_click=lambda: page.show("fit")).props("no-caps")
            return
        model_choice(page)
        ui.label(f"{bench.model} has not been simulated against the runs since the page was started.")
        running = bench.job is not None and not bench.job.over
        button = ui.button("Compare with the runs", icon="play_arrow", on_click=lambda: page.attempt(bench.compare))
        button.props('no-caps data-testid="compare"').set_enabled(not running)
        if running:
            ui.spinner()


def _run(page: Any, found: ComparisonView) -> int:
    k = page.memory.get("where-run", found.telling)
    return int(k) if isinstance(k, int) and k < len(found.runs) else 0


def _run_choice(page: Any, found: ComparisonView) -> None:
    words = {"train": "train", "hold_out": "held out"}
    options = {k: f"{run.name} ({words[run.role]})" for k, run in enumerate(found.runs)}

    def chosen(event: Any) -> None:
        page.memory["where-run"] = event.value
        page.memory.pop("where-span", None)
        page.show("where")

    ui.select(options, value=_run(page, found), label="run", on_change=chosen).props(
        "dense outlined options-dense"
    ).classes("w-full")


def _regions(page: Any, found: ComparisonView) -> None:
    with ui.column().classes("w-full gap-2").props('data-testid="regions"'):
        ui.label("Regions that hold the error").classes("head")
        if not found.regions:
            note("The error does not concentrate in any region that signals can name.", "good")
        for k, region in enumerate(found.regions):
            with ui.column().classes("region w-full gap-0") as box:
                box.classes("chosen" if page.memory.get("region") == k else "")
                pressed = "true" if page.memory.get("region") == k else "false"
                box.props(f'tabindex="0" role="button" aria-pressed={pressed} data-testid="region-{k}"')
                ui.label(
                    f"{percent(region.share)} of the {region.signal} error in {percent(region.samples)} of the samples"
                )
                ui.label(region.text).classes("soft")
                box.on("click", lambda _, k=k: _choose(page, k))
                box.on("keydown.enter", lambda _, k=k: _choose(page, k))
        if found.defects:
            ui.label("What the balances leave").classes("head")
        for defect in found.defects:
            words = f"{defect.equation}: {number(defect.rms)} {defect.unit} rms (noise: {number(defect.expected)})"
            ui.label(words).classes("soft")


def _choose(page: Any, k: int) -> None:
    page.memory["region"] = None if page.memory.get("region") == k else k
    page.show("where")


def _plots(page: Any, found: ComparisonView) -> None:
    run = found.runs[_run(page, found)]
    chosen = page.memory.get("region")
    region = chosen if isinstance(chosen, int) and chosen < len(found.regions) else None
    signal = found.regions[region].signal if region is not None else next(iter(run.outputs))
    inside = run.regions[region] if region is not None else None
    whole = float(run.t[0]), float(run.t[-1])
    marked = stretches(run.t, inside, _JOIN_SHARE * (whole[1] - whole[0])) if inside is not None else []
    ink, key = page.ink, f"where {found.model} {run.name}"
    clouds = _Clouds(page, run, signal, inside)

    def figure(span: tuple[float, float] | None) -> dict[str, Any]:
        page.memory["where-span"] = span
        return stack(run.t, _rows(run, ink), ink, key, span, marked)

    with ui.column().classes("panel w-full").style("padding:4px 6px"):
        zoomable(figure, "max(470px, calc(100vh - 340px))", "overlay", page.memory.get("where-span"), clouds.refresh)
    clouds.draw(page.memory.get("where-span"))


def _rows(run: RunView, ink: Any) -> tuple[Row, ...]:
    rows = []
    for view in run.outputs.values():
        predicted = "predicted, whole run" if view.free is None else "predicted 200 ms ahead"
        lines = [
            Line("measured", view.measured, ink.measured, 1.7), Line(predicted, view.ahead, ink.simulated, 1.2),
        ]  # fmt: skip
        if view.free is not None:
            lines.append(Line("free run", view.free, FREE_RUN, 1.1, "dash"))
        rows.append(Row(view.label, tuple(lines), 2.0, framing=2))
        rows.append(
            Row(
                view.error_label, (Line("error: measured − predicted", view.error, ink.residual, 1.0),), 1.15, view.band
            )
        )
    context = run.features[run.context]
    rows.append(Row(context.label, (Line("", context.values, NEUTRAL, 1.2),), 0.9))
    return tuple(rows)


class _Clouds:
    """The residual against a signal and the phase plane, of the stretch that the traces show."""

    def __init__(self, page: Any, run: RunView, signal: str, inside: np.ndarray | None) -> None:
        self.page, self.run, self.signal, self.inside = page, run, signal, inside

    def draw(self, span: tuple[float, float] | None) -> None:
        """Both, side by side."""
        run, memory = self.run, self.page.memory
        memory.setdefault("against", "v")
        with ui.row().classes("w-full no-wrap gap-2"):
            with ui.column().classes("panel gap-0").style("flex:1 1 0;min-width:0;overflow:hidden;padding:4px 8px"):
                with ui.row().classes("items-center gap-2"):
                    ui.label(f"Error of {self.signal} against").classes("soft")
                    ui.select(list(run.features), value=memory["against"], on_change=self._against).props(
                        'dense options-dense borderless aria-label="signal to plot against"'
                    )
                self.residual = chart(self._residual(span), "190px", "residual")
            with ui.column().classes("panel gap-0").style("flex:1 1 0;min-width:0;overflow:hidden;padding:4px 8px"):
                ui.label("Phase plane: speed over position").classes("soft").style("line-height:40px")
                self.phase = chart(self._phase(span), "190px", "phase")

    def _against(self, event: Any) -> None:
        self.page.memory["against"] = event.value
        self.residual.update_figure(self._residual(self.page.memory.get("where-span")))

    def refresh(self, span: tuple[float, float] | None) -> None:
        """The same for another stretch of time."""
        self.residual.update_figure(self._residual(span))
        self.phase.update_figure(self._phase(span))

    def _within(self, values: np.ndarray, span: tuple[float, float] | None) -> np.ndarray:
        if span is None:
            return values
        return np.where((self.run.t >= span[0]) & (self.run.t <= span[1]), values, np.nan)

    def _residual(self, span: tuple[float, float] | None) -> dict[str, Any]:
        view, against = self.run.outputs[self.signal], self.page.memory["against"]
        return cloud(self.run.features[against], self._within(view.error, span), view.error_label, self.inside, self.page.ink,
                     f"residual {against}", view.band)  # fmt: skip

    def _phase(self, span: tuple[float, float] | None) -> dict[str, Any]:
        speed = self.run.features["v"]
        return cloud(self.run.features["x"], self._within(speed.values, span), speed.label, self.inside, self.page.ink, "phase",
                     color=NEUTRAL)  # fmt: skip
