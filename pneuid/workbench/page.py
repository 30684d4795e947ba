"""One window: the frame around the views, the keys, messages, and what only this window knows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import KeyEventArguments

from pneuid.errors import UserError
from pneuid.workbench.look import Ink, ink
from pneuid.workbench.state import Workbench
from pneuid.workbench.views import control, data, fit, ladder, missing, where

VIEWS: dict[str, tuple[str, str, Callable[[Any], None]]] = {
    "data": ("Data", "folder_open", data.build),
    "fit": ("Fit", "tune", fit.build),
    "where": ("Where it fails", "query_stats", where.build),
    "missing": ("What is missing", "manage_search", missing.build),
    "ladder": ("Ladder", "stairs", ladder.build),
    "control": ("Control", "speed", control.build),
}

TICK_SECONDS = 0.2
NUMBERS = "123456789"

CSS = """
:root { --ink:#1b1f24; --soft:#59636e; --line:#d8dee4; --panel:#ffffff; --ground:#f3f5f7; }
body.body--dark { --ink:#e6e9ed; --soft:#a9b3be; --line:#3a424b; --panel:#1b2026; --ground:#12161a; }
html { scroll-padding-top:76px; }  /* what is scrolled to, by focus too, stays clear of the bar */
body { background:var(--ground); color:var(--ink); font-size:15px; }
.nicegui-content { padding:0; gap:0; }
.bar { background:var(--panel); border-bottom:1px solid var(--line); color:var(--ink);
  position:sticky; top:0; z-index:20; }
.panel { background:var(--panel); border:1px solid var(--line); border-radius:6px; padding:12px 14px; }
.soft { color:var(--soft); font-size:14px; }
.head { font-weight:600; font-size:16px; }
.tabs .q-btn { --q-primary:var(--ink) !important; }
.tabs .q-btn { border-radius:6px 6px 0 0; border-bottom:3px solid transparent; padding:4px 12px; }
.tabs .q-btn.chosen { border-bottom-color:#0072b2; font-weight:600; }
body.body--dark .tabs .q-btn.chosen { border-bottom-color:#56b4e9; }
/* the framework's colours stand in a layer that no rule here can overrule: only their variables can be changed */
body.body--dark .q-btn--flat, body.body--dark .q-field { --q-primary:#7cc4f0; }
body.body--dark .q-btn--outline { --q-negative:#f0935a; }
.good { border-left:4px solid #009e73; } .warning { border-left:4px solid #d55e00; } .note { border-left:4px solid #0072b2; }
.plain { border-collapse:collapse; width:100%; font-variant-numeric:tabular-nums; font-size:14px; }
.plain th { text-align:left; color:var(--soft); font-weight:600; }
.plain th, .plain td { padding:4px 10px 4px 0; border-bottom:1px solid var(--line); }
.plain .r { text-align:right; }
.region { cursor:pointer; border:1px solid var(--line); border-radius:6px; padding:8px 10px; background:var(--panel); }
.region:hover { border-color:#e69f00; }
.q-notification__actions { --q-primary:#fff !important; }
.region.chosen { border:2px solid #e69f00; padding:7px 9px; }
.run-row { border-bottom:1px solid var(--line); padding:5px 4px; border-left:4px solid transparent; cursor:pointer; }
.run-row.chosen { border-left-color:#0072b2; background:rgba(0,114,178,.09); }
:focus-visible { outline:2px solid #0072b2; outline-offset:2px; }
.plain .q-field__control, .plain .q-field__marginal { height:24px; min-height:24px; }
.plain .q-field--dense .q-field__control { padding:0; }
.q-uploader__header { background:transparent; color:var(--ink); } .q-uploader__list { display:none; }
.q-uploader__subtitle { display:none; } .q-uploader { min-height:64px; border:2px dashed var(--line) !important; }
.q-uploader__header-content { padding:12px; }
.region .soft { overflow-wrap:anywhere; }
"""

RESIZE = """<script>
addEventListener("resize", async () => {
  const { Plotly } = await import("nicegui-plotly");
  for (const plot of document.querySelectorAll(".js-plotly-plot")) if (plot.offsetWidth) Plotly.Plots.resize(plot);
});
</script>"""


class Page:
    """One window on the shared state; ``memory`` holds its own choices, ``ticks`` what its view refreshes in place."""

    def __init__(self, bench: Workbench, view: str) -> None:
        self.bench = bench
        self.view = view if view in VIEWS else next(iter(VIEWS))
        self.memory: dict[str, Any] = {}
        self.ticks: list[Callable[[], None]] = []
        self.again: Callable[[], None] | None = None
        """Shows a changed state in the view as it stands; without it the view is drawn anew."""
        self._revision = -1
        self._said = bench.said[-1][0] if bench.said else 0
        self._buttons: dict[str, ui.button] = {}
        self.dark = ui.dark_mode(value=False)
        self._frame()
        self.show(self.view)
        ui.timer(TICK_SECONDS, self._tick)

    @property
    def ink(self) -> Ink:
        """Colours on this window's ground."""
        return ink(bool(self.dark.value))

    def _frame(self) -> None:
        ui.add_css(CSS)
        ui.add_body_html(RESIZE)
        ui.colors(primary="#0072b2", positive="#007a5a", negative="#b84a00", warning="#8a5a00", info="#33566b")
        ui.keyboard(on_key=self._key)
        with ui.row().classes("bar w-full items-end no-wrap px-4 pt-2 gap-4"):
            with ui.column().classes("gap-0 pb-1").style("max-width:210px"):
                ui.label("pneuid workbench").classes("head")
                ui.label(self.bench.project.folder.name).classes("soft ellipsis").tooltip(
                    str(self.bench.project.folder)
                )
            with ui.row().classes("tabs gap-0 no-wrap grow").props('role="tablist"'):
                for number, (name, (title, icon, _)) in enumerate(VIEWS.items(), start=1):
                    button = ui.button(title, icon=icon, on_click=lambda _, name=name: self.show(name))
                    button.props(f'flat no-caps role="tab" data-testid="tab-{name}" title="{title} (key {number})"')
                    self._buttons[name] = button
            self._status = ui.label("").classes("soft pb-2 ellipsis").props('role="status" data-testid="status"')
            self._stop = ui.button("Cancel", icon="stop", on_click=self.bench.cancel)
            self._stop.props('no-caps dense outline color=negative data-testid="cancel"').classes("mb-1 px-2")
            ui.button(icon="contrast", on_click=self._turn).props(
                'flat round aria-label="light or dark" title="light or dark"'
            )
        self.content = ui.column().classes("w-full p-3 gap-3").props('role="main"')
        # a dialog outlives the view that opened it, which follows the state meanwhile
        self.above = ui.element("div")

    def _turn(self) -> None:
        self.dark.value = not self.dark.value
        self.again = None
        self.show(self.view)

    def _key(self, event: KeyEventArguments) -> None:
        if not event.action.keydown or event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta:
            return
        names = list(VIEWS)
        if event.key.name in NUMBERS[: len(names)]:
            self.show(names[NUMBERS.index(event.key.name)])
        elif event.key.escape:
            self.bench.cancel()

    def show(self, view: str) -> None:
        """Show a view from the state as it is now."""
        self._revision = self.bench.revision
        if view == self.view and self.again is not None:
            self.again()
            return
        if view != self.view:
            # a window that is loaded anew, after a lost connection or by hand, opens where it was
            ui.run_javascript(f"history.replaceState(null, '', '?view={view}')")
        self.view = view
        self.ticks.clear()
        self.again = None
        self.content.clear()
        for name, button in self._buttons.items():
            button.classes(add="chosen" if name == view else "", remove="" if name == view else "chosen")
            button.props(f"aria-selected={'true' if name == view else 'false'}")
        with self.content:
            VIEWS[view][2](self)
        self._show_job()

    def _tick(self) -> None:
        if self.bench.revision != self._revision:
            self.show(self.view)
        for number, message, kind in list(self.bench.said):
            if number > self._said:
                self._said = number
                with self.content:
                    ui.notify(message, type=kind, position="bottom-right", multi_line=True,
                              close_button="close" if kind == "negative" else False,
                              timeout=12_000 if kind == "negative" else 4_000)  # fmt: skip
        for refresh in self.ticks:
            refresh()
        self._show_job()

    def _show_job(self) -> None:
        job = self.bench.job
        running = job is not None and not job.over
        self._stop.set_visibility(running)
        words = f"{job.title}, {job.seconds:.0f} s" if running and job is not None else ""
        reading = self.bench.reader.current
        if not words and reading is not None:
            words = reading.title
        if self._status.text != words:
            self._status.set_text(words)

    def attempt(self, action: Callable[..., None], *arguments: Any, **named: Any) -> bool:
        """Do it; a ``UserError`` becomes a message. Whether it was done."""
        try:
            action(*arguments, **named)
        except UserError as error:
            ui.notify(
                str(error),
                type="negative",
                position="bottom-right",
                multi_line=True,
                close_button="close",
                timeout=12_000,
            )
            return False
        return True
