"""One reader per file format behind one registry.

A reader is a function ``(path, layout) -> RawTable``. To add a format: one file with such a function,
one line in ``READERS``. A reader whose library is an extra imports it inside the function and says in
one line what to install.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pneuid.errors import UserError
from pneuid.formats.hdf5 import read_hdf5
from pneuid.formats.matlab import read_matlab
from pneuid.formats.mdf import read_mdf
from pneuid.formats.parquet import read_parquet
from pneuid.formats.table import FileLayout, RawTable
from pneuid.formats.tdms import read_tdms
from pneuid.formats.text import read_text

__all__ = ["READERS", "FileLayout", "RawTable", "Reader", "read_table"]

Reader = Callable[[Path, FileLayout], RawTable]

READERS: dict[str, Reader] = {
    ".csv": read_text,
    ".txt": read_text,
    ".dat": read_text,
    ".mat": read_matlab,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".parquet": read_parquet,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    ".tdms": read_tdms,
}
"""Reader by file extension, lower case."""

SHEETS = (".xlsx", ".xls", ".ods")
"""Spreadsheets, which have no reader."""


def read_table(path: str | Path, layout: FileLayout) -> RawTable:
    """Read the raw columns of the measurement in ``path``.

    Raises ``UserError`` naming the file when it is absent, unreadable, of an unknown extension or not
    what its extension says.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        if path.is_dir():
            raise UserError(f"{path}: is a folder; name the files in it")
        do = "; save the sheet as CSV" if path.suffix.lower() in SHEETS else ""
        raise UserError(f"{path}: no reader for files ending in '{path.suffix}'; known: {known}{do}")
    try:
        if not path.exists():
            raise UserError(f"{path}: there is no such file")
        if not path.is_file():
            raise UserError(f"{path}: this is not a file; give one file per run")
        return reader(path, layout)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from error
