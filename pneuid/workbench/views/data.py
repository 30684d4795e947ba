"""Data: the runs of the project, their roles, what they look like, and what is doubtful about them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import UploadEventArguments

from pneuid.errors import UserError
from pneuid.report.quantities import fixed
from pneuid.workbench.look import Ink
from pneuid.workbench.payload import RunData
from pneuid.workbench.traces import Line, Row, stack
from pneuid.workbench.views import mapping
from pneuid.workbench.views.parts import note, zoomable

_ROLES = {"train": "train", "hold_out": "held out", "zero": "zero", "unused": "not used"}

_PRESSED = "event => { const row = event.target.closest('.run-row'); if (row) emit(row.dataset.run); }"
_ENTERED = "event => { if (event.target.matches('.run-row')) emit(event.target.dataset.run); }"


def build(page: Any) -> None:
    """Draw the view: what the user may be busy with, a file dialog or rig.toml, stays while the rest follows the state."""
    with ui.row().classes("w-full no-wrap gap-3 items-start"):
        with ui.column().classes("gap-3").style("width:410px;flex:none"):
            runs = ui.column().classes("w-full")
            # heard here and not on the rows: a row that is drawn anew between press and arrival would lose it
            runs.on("click", lambda event: _choose(page, event.args), js_handler=_PRESSED)
            runs.on("keydown.enter", lambda event: _choose(page, event.args), js_handler=_ENTERED)
            _upload(page)
            follow = _rig(page)
        shown = ui.column().classes("grow gap-3").style("min-width:0")

    drawn: dict[Callable[[Any], None], Any] = {}

    def again() -> None:
        """Draw what has changed."""
        # what shows the same stays: a menu that is open or a plot that is being dragged would be lost
        for box, draw, state in ((runs, _runs, _runs_state(page)), (shown, _right, _right_state(page))):
            if drawn.get(draw) != state:
                drawn[draw] = state
                box.clear()
                with box:
                    draw(page)
        for run in page.bench.files:
            page.memory["roles"][run.name].set_value(run.role)
        page.memory["refine"]()
        follow()

    again()
    page.again = again


def _runs_state(page: Any) -> Any:
    """What the list of runs shows, the roles apart: they are changed in place."""
    bench = page.bench
    rows = [(run.name, _state(bench, run.name, run.size), bench.faults.get(run.name)) for run in bench.files]
    return rows, _chosen(page)


def _right_state(page: Any) -> Any:
    """What the right side shows, the curves apart: the plot takes new ones in as it stands."""
    bench, name = page.bench, _chosen(page)
    run = bench.data.get(name)
    return (tuple(bench.refused.items()), bench.doubts, name, None if run is None else (run.notes, tuple(run.channels)),
            bench.faults.get(name), bench.zeros.get(name), bench.project.has_rig, page.ink)  # fmt: skip


def _right(page: Any) -> None:
    bench = page.bench
    if bench.refused:
        with ui.row().classes("panel warning w-full items-start no-wrap"):
            with ui.column().classes("grow gap-1"):
                ui.label("Refused, and not in the project").classes("head")
                lines = ui.column().classes("w-full gap-1").style("max-height:40vh;overflow-y:auto")
                with lines.props('data-testid="refused"'):
                    for name, message in bench.refused.items():
                        ui.label(message if name in message else f"{name}: {message}")
            ui.button(icon="close", on_click=lambda: _dismiss(page)).props('flat dense round aria-label="dismiss"')
    if bench.doubts:
        words = f"Look at this first: {len(bench.doubts)} doubt{'s' * (len(bench.doubts) > 1)} about the recordings"
        with ui.expansion(words, value=True) as box:
            box.classes("panel warning w-full").style("padding:0").props('data-testid="doubts"')
            for doubt in bench.doubts:
                ui.label(doubt)
    _shown_run(page)


def _dismiss(page: Any) -> None:
    page.bench.refused.clear()
    page.bench.revision += 1


def _chosen(page: Any) -> str:
    names = [run.name for run in page.bench.files]
    chosen = page.memory.get("run", "")
    return chosen if chosen in names else (names[0] if names else "")


def _runs(page: Any) -> None:
    bench = page.bench
    roles = page.memory["roles"] = {}
    with ui.column().classes("panel w-full gap-1").props('data-testid="runs"'):
        ui.label("Runs").classes("head")
        if not bench.files:
            ui.label("No recording yet: drop files below, or copy them into the project folder.").classes("soft")
        for run in bench.files:
            with ui.row().classes("run-row w-full items-center no-wrap gap-2") as row:
                row.classes("chosen" if run.name == _chosen(page) else "")
                row.props('tabindex="0"').props["data-run"] = run.name
                with ui.column().classes("gap-0 grow").style("min-width:0"):
                    ui.label(run.name).classes("ellipsis").props('data-testid="run"')
                    fault = bench.faults.get(run.name)
                    label = ui.label(_state(bench, run.name, run.size)).classes("ellipsis soft")
                    if fault:
                        label.style("color:#d55e00").tooltip(fault)
                # the row's own click stays out of it: drawing the list anew would close the menu
                with ui.element("div").on("click", js_handler="event => event.stopPropagation()"):
                    role = ui.select(_ROLES, value=run.role, on_change=lambda e, name=run.name: _role(page, name, e.value))
                    role.props(f'dense borderless options-dense aria-label="role of {run.name}"').style("width:92px")
                    roles[run.name] = role


def _state(bench: Any, name: str, size: int) -> str:
    if name in bench.faults:
        return "cannot be used: see the message"
    if name in bench.zeros:
        return bench.zeros[name]
    run = bench.data.get(name)
    if run is None:
        return f"reading, {size / 2**20:.1f} MB" if bench.project.has_rig else "waiting for rig.toml"
    if run.preview:
        return f"first look, {size / 2**20:.1f} MB is being checked"
    return f"{fixed(run.samples, 0)} samples, {run.t[-1]:.4g} s at {run.rate:.4g} Hz"


def _choose(page: Any, name: str) -> None:
    """Show a run; a name that is no run of the project shows the first one."""
    page.memory["run"] = name
    page.memory.pop("data-span", None)
    page.show("data")


def _role(page: Any, name: str, role: str) -> None:
    known = {run.name: run.role for run in page.bench.files}
    if role != known.get(name) and page.attempt(page.bench.project.set_role, name, role):
        page.bench.look()


def _upload(page: Any) -> None:
    bench = page.bench

    async def arrived(event: UploadEventArguments) -> None:
        """Take one uploaded file into the project, or say why not."""
        name = event.file.name
        try:
            waiting = bench.project.incoming(name)
            await event.file.save(waiting)
        except UserError as error:
            bench.refuse(name, str(error))
            return
        bench.uploaded(name, waiting)

    def too_large() -> None:
        bench.say(
            f"refused: an upload may have {bench.limit / 2**20:.0f} MB; copy larger files into the project folder instead"
        )

    box = ui.upload(multiple=True, auto_upload=True, max_file_size=bench.limit, on_upload=arrived, on_rejected=too_large,
                    label="Drop recordings here, or add with +")  # fmt: skip
    box.props('flat bordered data-testid="upload"').classes("w-full").style("max-height:130px")


def _rig(page: Any) -> Callable[[], None]:
    """The editor of rig.toml; what comes back makes it follow the file where the user has not changed it."""
    bench = page.bench
    with ui.expansion("rig.toml", icon="architecture", value=not bench.project.has_rig).classes("panel w-full") as box:
        box.style("padding:0")
        fault = note("", "warning", "rig-fault")
        text = ui.textarea(value=page.memory.get("rig", bench.project.rig_text())).props(
            'outlined aria-label="rig.toml" input-style="'
            'font-family:monospace;font-size:13px;height:300px;white-space:pre;overflow-x:auto"'
        )
        text.classes("w-full").on_value_change(lambda e: page.memory.__setitem__("rig", e.value))

        def save() -> None:
            page.memory.pop("rig", None)
            bench.save_rig(text.value)

        ui.button("Check and save", on_click=save).props("no-caps")

    def follow() -> None:
        box.set_text("rig.toml" if bench.project.has_rig else "rig.toml: describe the rig")
        fault.set_text(bench.rig_fault)
        fault.set_visibility(bool(bench.rig_fault))
        if "rig" not in page.memory and text.value != bench.project.rig_text():
            text.set_value(bench.project.rig_text())
            del page.memory["rig"]

    return follow


def _shown_run(page: Any) -> None:
    bench = page.bench
    name = _chosen(page)
    page.memory["refine"] = lambda: None
    with ui.column().classes("panel w-full gap-2"):
        if not name:
            ui.label("Nothing to show yet").classes("head")
            return
        with ui.row().classes("w-full items-center gap-2"):
            ui.label(name).classes("head grow")
            asks = ui.button("Map columns", icon="view_column", on_click=lambda: mapping.ask(page, name))
            asks.props('flat no-caps dense data-testid="map"').set_enabled(bench.project.has_rig)
            ui.button("Put aside", icon="archive", on_click=lambda: _put_aside(page, name)).props("flat no-caps dense")
        if name in bench.faults:
            note(bench.faults[name], "warning", "fault")
            words = "Where only layout, names or units differ: Map columns shows the file's head and writes them to rig.toml."
            ui.label(words).classes("soft")
            return
        if name in bench.zeros:
            ui.label(f"The sensors with both chambers vented and nothing pulling show {bench.zeros[name]}.")
            ui.label("A diagnosis takes it into account: it tells a shifted sensor from a constant force.").classes("soft")
            return
        run = bench.data.get(name)
        if run is None:
            with ui.row().classes("items-center"):
                ui.spinner()
                ui.label("reading the recording" if bench.project.has_rig else "describe the rig first").classes("soft")
            return
        if run.notes:
            ui.label("; ".join(run.notes)).classes("soft")
        ink, shown = page.ink, [run]

        def figure(span: tuple[float, float] | None) -> dict[str, Any]:
            page.memory["data-span"] = span
            return _figure(shown[0], ink, name, span)

        plot = zoomable(figure, "calc(100vh - 190px)", "run-plot", page.memory.get("data-span"))

        def refine() -> None:
            """The whole recording in place of the first look, or a file that was written anew: zoom and tool stay."""
            now = bench.data.get(name)
            if now is not None and now is not shown[0]:
                shown[0] = now
                plot.update_figure(figure(page.memory["data-span"]))

        page.memory["refine"] = refine


def _figure(run: RunData, ink: Ink, key: str, span: tuple[float, float] | None) -> dict[str, Any]:
    rows = tuple(
        Row(channel.label, (Line("measured", channel.values, ink.measured, 1.2),)) for channel in run.channels.values()
    )
    figure = stack(run.t, rows, ink, key, span)
    figure["layout"]["showlegend"] = False
    figure["layout"]["margin"] |= {"t": 12}
    return figure


def _put_aside(page: Any, name: str) -> None:
    if page.attempt(page.bench.project.remove, name):
        page.bench.say(f"{name} moved to the folder 'removed' of the project", "info")
        page.bench.look()
