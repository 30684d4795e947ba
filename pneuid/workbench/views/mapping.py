"""Which column of a file is which signal, in which unit: asked with the head of the file in view."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from pneuid.workbench.payload import RawPreview
from pneuid.workbench.rig_text import with_columns, with_files
from pneuid.workbench.views.parts import note, table

_MEANINGS = {
    "t": "time", "u": "valve command", "x": "position", "v": "velocity", "p1": "pressure, cap side",
    "p2": "pressure, rod side", "psup": "supply pressure", "F": "driving force",
}  # fmt: skip

_DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", "whitespace": "blanks", "|": "bar"}
_DECIMALS = {".": "point", ",": "comma"}
_ENCODINGS = {"utf-8": "UTF-8", "cp1252": "cp1252 (Windows)"}


def ask(page: Any, name: str) -> None:
    """Open the dialog on a file of the project."""
    bench = page.bench
    bench.look_at_head(name)

    def ready() -> None:
        if bench.head is not None and bench.head.name == name:
            waiting.deactivate()
            inside.clear()
            with inside:
                _form(page, bench.head, dialog, again)

    def again(layout: dict[str, Any]) -> None:
        bench.look_at_head(name, layout)
        waiting.activate()

    page.above.clear()
    with page.above, ui.dialog().props("full-width") as dialog, ui.card().classes("w-full gap-2"):
        ui.label(f"Columns of {name}").classes("head")
        inside = ui.column().classes("w-full gap-2")
        with inside:
            ui.spinner()
        waiting = ui.timer(0.1, ready)
    dialog.open()


def _layout(head: RawPreview, again: Callable[[dict[str, Any]], None]) -> None:
    """How the text is laid out; a change reads the head again."""

    def changed(key: str, value: Any) -> None:
        if value is not None:
            again(head.layout | {key: value} | ({"units": False} if key == "header" else {}))

    with ui.row().classes("w-full items-center gap-3"):
        for key, label, known in (("delimiter", "cells split at", _DELIMITERS), ("decimal", "decimal mark", _DECIMALS),
                                  ("encoding", "text", _ENCODINGS)):  # fmt: skip
            value = head.layout[key]
            options = known if value in known else {value: value} | known
            pick = ui.select(options, value=value, label=label, on_change=lambda e, key=key: changed(key, e.value))
            pick.props("dense outlined options-dense").classes("min-w-[150px]")
        rows = ui.number("lines before the header", value=head.layout["skip_rows"], min=0, precision=0)
        rows.props("dense outlined debounce=600").classes("w-[180px]")
        rows.on_value_change(lambda e: changed("skip_rows", int(e.value) if e.value is not None and e.value >= 0 else None))
        for key, words in (("header", "a line names the columns"), ("units", "units in the line below")):
            box = ui.checkbox(words, value=head.layout[key], on_change=lambda e, key=key: changed(key, bool(e.value)))
            box.set_enabled(key == "header" or head.layout["header"])


def _form(page: Any, head: RawPreview, dialog: ui.dialog, again: Callable[[dict[str, Any]], None]) -> None:
    if head.layout:
        _layout(head, again)
    if head.fault:
        note(head.fault, "warning", "head-fault")
    heads = [f"{column} [{head.units[column]}]" if column in head.units else f"{column} (no unit)" * bool(column)
             for column in head.columns]  # fmt: skip
    with ui.element("div").classes("w-full").style("overflow-x:auto"):
        table(heads, head.rows)
    if head.fault:
        ui.button("Close", on_click=dialog.close).props("flat no-caps")
        return
    note(
        "Signals with * are needed. Kept in rig.toml under [files] and [columns], for every run of the project; a unit is "
        "asked for only where the header of the column states none."
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
            field = ui.input(value=unit, placeholder="as in the header" if head.units else "unit").props(
                f'dense outlined aria-label="unit of {signal}"'
            )
            chosen[signal] = pick, field

    def save() -> None:
        mapping = {signal: (pick.value, unit.value.strip()) for signal, (pick, unit) in chosen.items() if pick.value}
        text = with_files(page.bench.project.rig_text(), head.layout)
        page.bench.save_rig(with_columns(text, mapping))
        dialog.close()

    with ui.row():
        ui.button("Save", on_click=save).props('no-caps data-testid="save-columns"')
        ui.button("Close", on_click=dialog.close).props("flat no-caps")
