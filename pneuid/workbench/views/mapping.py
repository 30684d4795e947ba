"""Which column of a file is which signal, in which unit: asked with the head of the file in view."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from pneuid.workbench.payload import RawPreview
from pneuid.workbench.project import with_columns
from pneuid.workbench.views.parts import note, table

_MEANINGS = {
    "t": "time", "u": "valve command", "x": "position", "v": "velocity", "p1": "pressure, cap side",
    "p2": "pressure, rod side", "psup": "supply pressure", "F": "driving force",
}  # fmt: skip


def ask(page: Any, name: str) -> None:
    """Open the dialog on a file of the project."""
    bench = page.bench
    bench.head = None
    bench.look_at_head(name)

    def ready() -> None:
        if bench.head is not None and bench.head.name == name:
            waiting.deactivate()
            inside.clear()
            with inside:
                _form(page, bench.head, dialog)

    page.above.clear()
    with page.above, ui.dialog().props("full-width") as dialog, ui.card().classes("w-full gap-2"):
        ui.label(f"Columns of {name}").classes("head")
        inside = ui.column().classes("w-full gap-2")
        with inside:
            ui.spinner()
        waiting = ui.timer(0.1, ready)
    dialog.open()


def _form(page: Any, head: RawPreview, dialog: ui.dialog) -> None:
    heads = [
        f"{column} [{head.units[column]}]" if column in head.units else f"{column} (no unit)" for column in head.columns
    ]
    with ui.element("div").classes("w-full").style("overflow-x:auto"):
        table(heads, head.rows)
    note(
        "Signals with * are needed. Kept in rig.toml under [columns], for every run of the project; a unit is asked for only "
        "where the header of the column states none."
    )
    chosen: dict[str, tuple[Any, Any]] = {}
    with ui.grid(columns="auto 320px 180px").classes("items-center gap-x-4 gap-y-1"):
        for signal in head.known_signals:
            needed = " *" if signal in head.required else ""
            ui.label(f"{signal}{needed}, {_MEANINGS[signal]}")
            column, unit = head.mapped.get(signal, ("", ""))
            options = ["", *head.columns]
            pick = ui.select(options, value=column if column in options else "").props("dense outlined options-dense")
            pick.props(f'aria-label="column of {signal}"')
            field = ui.input(value=unit, placeholder="as in the header").props(
                f'dense outlined aria-label="unit of {signal}"'
            )
            chosen[signal] = pick, field

    def save() -> None:
        mapping = {signal: (pick.value, unit.value.strip()) for signal, (pick, unit) in chosen.items() if pick.value}
        plain = {signal: pair for signal, pair in mapping.items() if pair != (signal, "")}
        page.bench.save_rig(with_columns(page.bench.project.rig_text(), plain))
        dialog.close()

    with ui.row():
        ui.button("Save", on_click=save).props('no-caps data-testid="save-columns"')
        ui.button("Close", on_click=dialog.close).props("flat no-caps")
