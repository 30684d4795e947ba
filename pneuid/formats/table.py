"""What every reader gives back: the raw columns of one file, before any signal is known."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.units import shown

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MISSING = ("", "nan")
_DECIMAL_COMMA = re.compile(_NUMBER.pattern.replace(r"\.", ","))


@dataclass(frozen=True)
class FileLayout:
    """How text files are laid out.

    ``delimiter``: one character, or ``"whitespace"``; ``header``: whether a line names the columns;
    ``skip_rows``: lines before it; ``gaps``: whether empty and NaN cells are missing samples; ``decimal``: ``"."`` or
    ``","``; ``encoding``: of the text, by the name that Python gives it; ``units``: whether the line below the header states
    the units.
    """

    delimiter: str = ","
    header: bool = True
    skip_rows: int = 0
    gaps: bool = False
    decimal: str = "."
    encoding: str = "utf-8"
    units: bool = False


@dataclass(frozen=True)
class RawTable:
    """The columns of one file as recorded.

    ``frame``: one column per file column, named as in the file (or 1..n without a header); its index is
    what a person counts, the line of a text file or the sample of an array, from 1. Columns hold floats,
    or the cells' text where a cell is not a number. ``units``: the unit of a column where the file states
    one. ``row_word``: what the index counts. ``ignored``: name -> why a variable is not a column. ``apart``:
    name without group -> why it is in the file but not a column (another rate, several of that name, two units):
    a signal among them is refused, not taken as absent. ``placed``: column -> at which rate it was recorded, for columns whose
    samples were put where they belong among those of a faster one, NaN between them. ``decimal``: ``"."`` or ``","``, what
    cells kept as text write decimals with.
    """

    frame: pd.DataFrame
    units: dict[str | int, str] = field(default_factory=dict)
    row_word: str = "row"
    ignored: dict[str, str] = field(default_factory=dict)
    apart: dict[str, str] = field(default_factory=dict)
    placed: dict[str | int, str] = field(default_factory=dict)
    decimal: str = "."

    def numbers(self, column: str | int, gaps: bool, where: str) -> NDArray[np.float64]:
        """The column as floats, shape (N,), NaN where a sample is missing.

        Raises ``UserError`` naming ``where``, row, column and value for text, an infinite number, and,
        unless ``gaps``, an empty or NaN cell.
        """
        series = self.frame[column]
        if series.dtype == object:
            self._refuse_text(series, gaps, where)
            values = np.array([to_number(cell, self.decimal) for cell in series])
        else:
            values = series.to_numpy(float)
        refused = np.isinf(values) if gaps else ~np.isfinite(values)
        if refused.any():
            first = int(np.flatnonzero(refused)[0])
            row, found = self.frame.index[first], series.iloc[first]
            if np.isinf(values[first]):
                raise UserError(f"{where}: {self.row_word} {row}, column {shown(column)}: {found} is not finite")
            what = "is empty" if str(found).strip() == "" else "is NaN"
            advice = "remove the row, or set [files] gaps = true in rig.toml to treat it as a missing sample"
            raise UserError(f"{where}: {self.row_word} {row}, column {shown(column)}: the cell {what}; {advice}")
        return values

    def _refuse_text(self, series: pd.Series, gaps: bool, where: str) -> None:
        for row, cell in series.items():
            text = str(cell).strip()
            if is_number(text, self.decimal) or text.lower() in _MISSING:
                continue
            advice = ""
            if self.decimal == "." and is_number(text, ","):
                advice = '; for decimal commas write decimal = "," below [files] in rig.toml'
            elif is_number(text):
                advice = '; [files] decimal in rig.toml says that decimals are written with ","'
            elif row == self.frame.index[0] and re.fullmatch(r"[\[(]?[^\W\d][\w/^*]{0,5}[\])]?", text):
                advice = "; for a line of units below the header write units = true below [files] in rig.toml"
            elif gaps:
                advice = "; leave a missing sample empty or write NaN"
            place = f"{where}: {self.row_word} {row}, column {shown(series.name)}"
            raise UserError(f"{place}: {shown(text)} is not a number{advice}")


def is_number(text: str, decimal: str = ".") -> bool:
    """Whether ``text`` is a number with decimals after ``decimal`` (no NaN, no underscores, no mark for thousands)."""
    return (_DECIMAL_COMMA if decimal == "," else _NUMBER).fullmatch(text) is not None


def to_number(cell: object, decimal: str = ".") -> float:
    """The number that a cell holds, NaN for an empty one."""
    text = str(cell).strip().replace(decimal, ".")
    return float(text) if text else float("nan")
