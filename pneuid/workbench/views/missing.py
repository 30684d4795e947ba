"""What is missing: the verdict of a diagnosis, the ranking with its evidence, and the button that adds an effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from pneuid.report.quantities import number, percent
from pneuid.workbench.charts import ranking_chart, shape_chart, unknown_chart
from pneuid.workbench.look import NEUTRAL
from pneuid.workbench.payload import SignatureView
from pneuid.workbench.traces import Line, Row, stack
from pneuid.workbench.views.parts import chart, live_job, model_choice

_VERDICTS = {
    "adequate": ("Nothing is missing above the noise.", "good"),
    "effect": ("Missing: {effects}", "warning"),
    "ambiguous": ("Missing: {effects}; these data cannot tell which{beside}.", "warning"),
    "unknown": ("Something is missing that the catalogue does not hold.", "warning"),
}


def build(page: Any) -> None:
    """Draw the view."""
    bench = page.bench
    found = bench.diagnosis()
    running = bench.job is not None and not bench.job.over
    with ui.row().classes("panel w-full items-center gap-3"):
        if not bench.model:
            ui.label("There is no model yet: fit one first.").classes("grow")
        else:
            model_choice(page)
            ui.label("Tries every effect of the catalogue on this model and judges on the held-out runs.").classes(
                "soft grow"
            )
        button = ui.button("Diagnose", icon="manage_search", on_click=lambda: page.attempt(bench.diagnose))
        button.props('no-caps data-testid="diagnose"').set_enabled(bool(bench.model) and not running)
    if running:
        with ui.column().classes("panel w-full gap-1"):
            ui.label("Progress").classes("head")
            live_job(page, "210px")
    if found is not None:
        _diagnosis(page, found[0], found[1], running)


def _diagnosis(page: Any, folder: str, found: Mapping[str, Any], running: bool) -> None:
    words, kind = _VERDICTS.get(found["verdict"], (found["verdict"], "note"))
    if found["verdict"] == "adequate" and words.rstrip(".").lower() not in found.get("sentences", ()):
        # the words of pneuid.criticism.decision.diagnosis, which brings more than the first page can wait for
        words, kind = "These runs do not show that an effect is missing.", "warning"
    beside = found.get("beside", ())
    rivals = [name for name in found["effects"] if name not in beside]
    groups = found.get("one_of") or ([rivals] if found["verdict"] == "ambiguous" else [])
    effects = "; and ".join(f"one of {', '.join(group)}" for group in groups) or ", ".join(rivals)
    with ui.column().classes(f"panel {kind} w-full gap-1"):
        text = (
            ui.label(words.format(effects=effects, beside=f"; and {', '.join(beside)}" if beside else ""))
            .classes("head")
            .props('data-testid="verdict"')
        )
        text.tooltip(f"{folder}/diagnosis.json")
        for sentence in found.get("sentences", ()):
            ui.label(sentence).classes("soft")
    shapes = page.bench.project.result(folder, "shapes.json") or {}
    _unknown(page, folder, found, shapes.get("unknown"), running)
    for name in found["effects"]:
        _card(page, folder, name, running)
    if found["ranking"]:
        with ui.column().classes("panel w-full gap-1"):
            ui.label("Ranking of the catalogue").classes("head")
            rows = min(len(found["ranking"]), 12)
            chart(ranking_chart(found, page.ink), f"{100 + 32 * rows}px", "ranking")
            _groups(found)
    _over_defect(page, folder, found, shapes.get("shapes"), running)
    _next_experiment(page, found)


def _unknown(
    page: Any, folder: str, found: Mapping[str, Any], curve: Mapping[str, Any] | None, running: bool
) -> None:
    """The rest that the catalogue does not explain, and what can be added for it."""
    rest = found.get("unknown")
    if not rest:
        return
    where = ", ".join(rest["depends_on"]) or "no signal in particular"
    with ui.column().classes("panel w-full gap-2"):
        ui.label(f"Unexplained: {number(rest['rms'])} {rest['unit']} rms in equation {rest['equation']}, follows {where}")
        if curve is not None:
            chart(unknown_chart(curve, page.ink), "300px", "unknown")
        with ui.row().classes("w-full gap-2"):
            for words, names in (("a smooth function", rest.get("effect")), ("the formula", rest.get("formula_effect"))):
                if names:
                    _add_button(page, tuple(names.split()), folder, f"Add {words}: {names}", running)
        if rest.get("formula"):
            error = f" within {percent(rest['formula_error'])} of its size" if rest.get("formula_error") is not None else ""
            ui.label(f"Its shape is {rest['formula']}{error}.").classes("soft")


def _over_defect(
    page: Any, folder: str, found: Mapping[str, Any], shapes: Sequence[Mapping[str, Any]] | None, running: bool
) -> None:
    """Leading candidates laid over what the balances of the model leave."""
    bench = page.bench
    if shapes is None and (not bench.model or found.get("model", bench.model) != bench.model or not found["ranking"]):
        return
    with ui.column().classes("panel w-full gap-1").props('data-testid="over-defect"'):
        ui.label("Candidates over the measured defect").classes("head")
        if shapes is None:
            button = ui.button("Draw", icon="show_chart", on_click=lambda: page.attempt(bench.draw_shapes, folder))
            button.props('no-caps data-testid="draw-shapes"').set_enabled(not running)
            return
        ui.label(
            "Dots: what the balance leaves between intervals of the relaxed fit, which shows a missing term at a part of its "
            "size. Line: what the effect takes of it at its screened size, over the signal that it follows most."
        ).classes("soft")
        with ui.grid(columns=2).classes("w-full gap-3"):
            for item in shapes:
                with ui.column().classes("gap-0").style("min-width:0"):
                    ui.label(f"{item['effect']}: {_taken(item['share'])}")
                    chart(shape_chart(item, page.ink), "290px", f"shape-{item['effect']}")


def _taken(share: float) -> str:
    return f"takes {percent(share)} of the squared defect" if share > 0.005 else "takes nothing of the defect"


def _card(page: Any, folder: str, name: str, running: bool) -> None:
    bench = page.bench
    card = bench.cards.get(name)
    with ui.row().classes("panel w-full items-center gap-3"):
        with ui.column().classes("gap-0").style("flex:1 1 0;min-width:0"):
            ui.label(name).classes("head")
            if card is not None:
                ui.label(card.mechanism)
                ui.label(f"enters {card.equation}; revealed by: {card.experiment}; {card.reference}").classes("soft")
        _add_button(page, (name,), folder, f"Add {name}", running)
        if card is not None:
            _signature(page, name)


def _signature(page: Any, name: str) -> None:
    """How the effect shows on this rig, computed when it is asked for."""
    bench, opened = page.bench, page.memory.setdefault("signatures", set())
    with ui.expansion("How it shows on this rig", icon="show_chart", value=name in opened) as box:
        box.classes("w-full").props(f'dense data-testid="how-{name}"')
        place = ui.column().classes("w-full gap-0")
    drawn: list[bool] = []

    def draw() -> None:
        """Draw the candidate the first time it is opened."""
        if drawn or not box.value:
            return
        opened.add(name)
        place.clear()
        with place:
            if name not in bench.signatures:
                ui.spinner()
                return
            drawn.append(True)
            _responses(page, bench.signatures[name])

    def turned() -> None:
        opened.discard(name)
        if box.value and name not in bench.signatures:
            bench.ask_signature(name)
        draw()

    box.on_value_change(turned)
    draw()


def _responses(page: Any, found: SignatureView | None) -> None:
    if found is None or not found.rows:
        ui.label("There is no typical size to show it at.").classes("soft")
        return
    ui.label(f"Simulated at its typical size: {found.experiment}. The grey band is the sensors' noise.").classes("soft")
    ink = page.ink
    rows = [Row(found.command.label, (Line("", found.command.values, ink.measured, 1.2),), 0.8)]
    for item in found.rows:
        lines = (Line("without it", item.without, NEUTRAL, 2.6), Line("with it", item.with_it, ink.simulated, 1.2))
        rows.append(Row(item.label, lines, 1.6))
        rows.append(Row(item.change_label, (Line("difference", item.change, ink.residual, 1.2),), 1.2, item.band))
    figure = stack(found.t, tuple(rows), ink, f"signature {found.effect}")
    chart(figure, f"{90 + 62 * len(rows)}px", f"signature-{found.effect}")


def _add_button(page: Any, names: tuple[str, ...], folder: str, label: str, running: bool) -> None:
    """Fits again with these effects, and shows it happen."""
    bench = page.bench
    present = set(names) <= set((bench.project.result(bench.model, "model.json") or {}).get("effects", ()))

    def add() -> None:
        if page.attempt(bench.fit, names, bench.model, folder):
            page.show("fit")

    words, icon = (f"{', '.join(names)}: in the model", "check") if present else (label, "add")
    button = ui.button(words, icon=icon, on_click=add)
    button.props(f'no-caps data-testid="add-{" ".join(names)}"').classes("shrink-0")
    button.set_enabled(bool(bench.model) and not present and not running)


def _groups(found: Mapping[str, Any]) -> None:
    """Candidates that these data cannot tell from one another, each group once."""
    groups = {frozenset([item["effect"], *item["indistinguishable_from"]]) for item in found["ranking"]
              if item["indistinguishable_from"]}  # fmt: skip
    for group in sorted(groups, key=sorted):
        ui.label(f"Screening cannot tell apart: {', '.join(sorted(group))}").classes("soft")


def _next_experiment(page: Any, found: Mapping[str, Any]) -> None:
    plan = found.get("next_experiment")
    if not plan:
        return
    with ui.row().classes("panel note w-full items-center"):
        with ui.column().classes("grow gap-0"):
            ui.label("Next experiment").classes("head")
            ui.label(str(plan.get("why", "")))
            if plan.get("power"):
                ui.label(f"expected to decide with a probability of {percent(float(plan['power']))}").classes("soft")
        path = (page.bench.project.folder / str(plan.get("file", ""))).resolve()
        if path.is_file() and path.is_relative_to(page.bench.project.folder):
            ui.button("Download", icon="download", on_click=lambda: ui.download.file(path)).props("no-caps")
