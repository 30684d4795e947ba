"""Parquet files: one column per signal, its unit in the field's metadata ``unit`` or in the name.

A column of time stamps or durations is read as seconds: its type states the unit.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.series import MOST_VALUES, Series, assemble, library, reading
from pneuid.formats.table import FileLayout, RawTable

_ROWS = "rows"
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read_parquet(path: Path, layout: FileLayout) -> RawTable:
    """Read the columns of a Parquet file; ``layout`` does not apply.

    A null is an empty cell. Text columns keep their text; lists, structures, dates and bytes are listed in
    ``ignored``. Time stamps count from the first one. Raises ``UserError`` for a file that is not Parquet or
    without rows.
    """
    arrow, parquet = library("pyarrow", path), library("pyarrow.parquet", path)
    ignored: dict[str, str] = {}
    series: list[Series[str]] = []
    with reading(path, "a Parquet file"), parquet.ParquetFile(path) as file:
        rows, width = int(file.metadata.num_rows), int(file.metadata.num_columns)
        if rows == 0:
            raise UserError(f"{path}: the file has no rows")
        if rows * width > MOST_VALUES:
            raise UserError(f"{path}: {width} columns of {rows} rows are more than {MOST_VALUES} numbers; save fewer")
        table = file.read()
        for field, column in zip(table.schema, table.columns, strict=True):
            kind = field.type.value_type if arrow.types.is_dictionary(field.type) else field.type
            convert = _converter(arrow, kind)
            if convert is None:
                ignored[field.name] = f"{kind}, neither numbers nor text"
                continue
            unit = "s" if convert is _seconds else _unit(field)
            series.append(Series(field.name, partial(convert, arrow, kind, column), _ROWS, rows, unit=unit))
        if not series:
            raise UserError(f"{path}: holds no column of numbers; save one column per signal")
        return assemble(path, series, _ROWS, lambda _one: "", ignored, row_word="row")


def _unit(field: Any) -> str:
    value = (field.metadata or {}).get(b"unit", b"")
    return str(value.decode("utf-8", errors="replace")).strip()


def _converter(arrow: Any, kind: Any) -> Any:
    types = arrow.types
    if types.is_timestamp(kind) or types.is_duration(kind) or types.is_time(kind):
        return _seconds
    if any(
        fits(kind) for fits in (types.is_integer, types.is_floating, types.is_boolean, types.is_decimal, types.is_null)
    ):
        return _numbers
    return _text if types.is_string(kind) or types.is_large_string(kind) else None


def _numbers(arrow: Any, kind: Any, column: Any) -> NDArray[np.float64]:
    if arrow.types.is_boolean(kind):
        column = column.cast(arrow.uint8())
    return np.asarray(column.cast(arrow.float64(), safe=False).to_numpy(), dtype=np.float64)


def _seconds(arrow: Any, kind: Any, column: Any) -> NDArray[np.float64]:
    counts = column.cast(kind).cast(arrow.int32() if kind.bit_width == 32 else arrow.int64()).cast(arrow.int64())
    missing = np.asarray(counts.is_null().to_numpy(), dtype=bool)
    whole = np.asarray(counts.fill_null(0).to_numpy(), dtype=np.int64)
    if arrow.types.is_timestamp(kind) and not missing.all():
        # in whole ticks: nanoseconds since 1970 have more digits than a float
        whole = whole - whole[~missing][0]
    return np.where(missing, np.nan, whole * _SECONDS[kind.unit])


def _text(arrow: Any, kind: Any, column: Any) -> NDArray[np.object_]:
    return np.array(["" if cell is None else cell for cell in column.cast(kind).to_pylist()], dtype=object)
