"""Text files: a header ``name [unit]``, one sample a line, any delimiter.

Two ways through the same file: NumPy's strict parser when every cell is a number, and a plain walk
over the lines otherwise, which knows the line and the cell that is wrong.
"""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd

from pneuid.errors import UserError
from pneuid.formats.table import FileLayout, RawTable, is_number, to_number
from pneuid.units import shown

_HEADER_CELL = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")


def read_text(path: Path, layout: FileLayout) -> RawTable:
    """Read a delimited text file.

    The frame's index is the line number in the file, counted from 1. Raises ``UserError`` naming file,
    row and what was found for bytes that are not UTF-8 text, no samples, empty lines between samples,
    rows with more or fewer cells than the first, and repeated column names.
    """
    lines = _lines(path, layout.encoding)
    first = layout.skip_rows
    if len(lines) <= first + layout.header + layout.units:
        skipped = f" after skip_rows = {layout.skip_rows}" if layout.skip_rows else ""
        what = f"has {len(lines)} lines and no sample{skipped}" if lines else "is empty"
        raise UserError(f"{path}: the file {what}")
    names: list[str | int] | None = None
    units: dict[str | int, str] = {}
    if layout.header:
        names, units = _header(lines[first], lines[first + 1], layout, f"{path}: row {first + 1}")
        first += 1
        if layout.units:
            units |= _unit_line(lines[first], names, layout, f"{path}: row {first + 1}")
            first += 1
    body = lines[first:]
    for offset, line in enumerate(body):
        if not line.strip():
            raise UserError(f"{path}: row {first + 1 + offset} is empty; remove it")
    width = len(names) if names is not None else len(_cells(body[0], layout, f"{path}: row {first + 1}"))
    names = names or list(range(1, width + 1))
    index = pd.RangeIndex(first + 1, first + 1 + len(body))
    numbers = _all_numbers(body, layout, width)
    if numbers is not None:
        return RawTable(frame=pd.DataFrame(numbers, columns=names, index=index), units=units)
    return RawTable(frame=_walk(body, layout, names, index, path), units=units, decimal=layout.decimal)


def _lines(path: Path, encoding: str) -> list[str]:
    """The lines of the file without line ends; empty lines at its end are dropped."""
    content = path.read_bytes()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise UserError(f"{path}: the file is UTF-16 text; save it as UTF-8")
    if b"\0" in content:
        raise UserError(f"{path}: the file holds binary data, not text")
    try:
        text = content.decode("utf-8-sig" if encoding == "utf-8" else encoding)
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        advice = 'save the file as UTF-8, or write [files] encoding = "cp1252" (Windows, western Europe) in rig.toml'
        raise UserError(f"{path}: row {row}: byte 0x{byte:02x} is not {encoding.upper()} text; {advice}") from error
    # Not str.splitlines: it also splits at form feeds and the like, and line numbers would be off.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def _cells(line: str, layout: FileLayout, where: str) -> list[str]:
    if layout.delimiter == "whitespace":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=layout.delimiter, skipinitialspace=True))]
    except csv.Error as error:
        raise UserError(f"{where}: {error}") from error


def _header(line: str, below: str, layout: FileLayout, where: str) -> tuple[list[str | int], dict[str | int, str]]:
    """Column names and units of a header line; a column without a name is called ``column N``.

    ``below``, the first line of samples, says whether a wrong delimiter comes with decimal commas.
    """
    cells = _header_cells(line, layout, where)
    other = next((mark for mark in (";", "\t", ",") if mark != layout.delimiter and mark in line), None)
    if len(cells) == 1 and other is not None:
        commas = any("," in cell and is_number(cell.strip(), ",") for cell in below.split(other))
        keys = f"delimiter = {json.dumps(other)}" + ' and decimal = ","' * (other != "," and commas)
        raise UserError(
            f"{where}: only one column found with delimiter {shown(layout.delimiter)}; the line holds "
            f"{shown(other)}: write {keys} below [files] in rig.toml"
        )
    if all(is_number(cell, layout.decimal) for cell in cells):
        raise UserError(
            f"{where}: {shown(line.strip())} is no header; write name [unit] for each column, or set "
            "[files] header = false in rig.toml"
        )
    names: list[str | int] = []
    units: dict[str | int, str] = {}
    for number, cell in enumerate(cells, start=1):
        match = _HEADER_CELL.fullmatch(cell)
        if match is None:
            raise UserError(f"{where}, column {number}: {shown(cell)} is not of the form name [unit]")
        name = match["name"].strip() or f"column {number}"
        if name in names:
            raise UserError(f"{where}, column {number}: {shown(name)} names two columns; give each its own name")
        names.append(name)
        if match["unit"] and match["unit"].strip():
            units[name] = match["unit"].strip()
    return names, units


def _unit_line(line: str, names: list[str | int], layout: FileLayout, where: str) -> dict[str | int, str]:
    """Units that a line below the header states, bare or in brackets; empty cells and ``-`` state none."""
    cells = [cell.strip("[]() ") for cell in _cells(line, layout, where)]
    if len(cells) != len(names) or all(is_number(cell, layout.decimal) for cell in cells):
        raise UserError(f"{where}: {shown(line.strip())} is no line of units, one for each column; remove units from [files]")
    return {name: cell for name, cell in zip(names, cells, strict=True) if cell.strip("-")}


def _header_cells(line: str, layout: FileLayout, where: str) -> list[str]:
    """As ``_cells``, but ``x [mm]`` stays together in a header split at white space."""
    if layout.delimiter == "whitespace":
        return re.findall(r"[^\s\[\]]+(?:\s*\[[^\[\]]*\])?", line)
    return _cells(line, layout, where)


def _all_numbers(body: list[str], layout: FileLayout, width: int) -> np.ndarray | None:
    """The samples as an array (N, width), or None when some cell or row is not plain numbers."""
    delimiter = None if layout.delimiter == "whitespace" else layout.delimiter
    if layout.gaps and delimiter is not None:
        # Where empty cells are missing samples they are NaN to the strict parser.
        split = (line.split(delimiter) for line in body)
        body = [delimiter.join("nan" if not cell.strip() else cell for cell in cells) for cells in split]
    if layout.decimal == ",":
        if any("." in line for line in body):
            # A point may mean thousands: the walk keeps such a cell as text.
            return None
        body = [line.replace(",", ".") for line in body]
    try:
        numbers = np.loadtxt(body, delimiter=delimiter, comments=None, ndmin=2, dtype=np.float64)
    except ValueError:
        return None
    return numbers if numbers.shape == (len(body), width) else None


def _walk(
    body: list[str], layout: FileLayout, names: list[str | int], index: pd.RangeIndex, path: Path
) -> pd.DataFrame:
    """The samples cell by cell, columns of text where a cell is not a number."""
    rows = []
    for row, line in zip(index, body, strict=True):
        cells = _cells(line, layout, f"{path}: row {row}")
        if len(cells) != len(names):
            size = "short" if len(cells) < len(names) else "long"
            if len(names) == 1:
                raise UserError(
                    f"{path}: row {row} has {len(cells)} cells, but the header only one, {shown(names[0])}; where lines "
                    "stand above the header, write their number as skip_rows below [files] in rig.toml"
                )
            raise UserError(
                f"{path}: row {row} is {size}: {len(cells)} cells where {len(names)} columns are expected; "
                f"the last one read is {shown(cells[-1])} in column {shown(names[min(len(cells), len(names)) - 1])}"
            )
        rows.append(cells)
    columns: dict[str | int, pd.Series] = {}
    for place, name in enumerate(names):
        cells = [row[place] for row in rows]
        plain = all(is_number(cell, layout.decimal) for cell in cells)
        columns[name] = (
            pd.Series([to_number(cell, layout.decimal) for cell in cells], index=index)
            if plain
            else pd.Series(cells, index=index, dtype=object)
        )
    return pd.DataFrame(columns, index=index)
