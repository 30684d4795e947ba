"""HDF5 files: every real vector is a column, its unit in the attribute ``unit`` or ``units``.

Values outside the file (external links, external storage, virtual datasets) are not followed.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.series import Series, assemble, library, main_base, reading
from pneuid.formats.table import FileLayout, RawTable


def read_hdf5(path: Path, layout: FileLayout) -> RawTable:
    """Read the vectors, (N,), (N,1) or (1,N), of an HDF5 file as columns; ``layout`` does not apply.

    N is the length that most signals share, then most vectors, then the longer one. What is no vector of
    real numbers is listed in ``ignored``. Raises ``UserError`` for a file that is not HDF5 or without vectors.
    """
    h5py = library("h5py", path)
    ignored: dict[str, str] = {}
    series: list[Series[int]] = []
    with reading(path, "an HDF5 file"), h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset):
                return
            reason = _no_vector(item)
            if reason:
                ignored[name] = reason
                return
            group, _, title = name.rpartition("/")
            size = int(item.size)
            series.append(Series(title, partial(_values, item), size, size, group, _unit(item)))

        file.visititems(visit)
        if not series:
            raise UserError(f"{path}: holds no vector of numbers; save one dataset per signal, all of one length")
        main = main_base(series)
        return assemble(
            path,
            series,
            main,
            lambda one: f"{one.length} values where the others have {main}; save all at one rate",
            ignored,
        )


def _no_vector(item: Any) -> str:
    """Why a dataset is no column, or nothing."""
    if item.shape is None or item.size == 0:
        return "empty"
    if item.dtype.names:
        return "a table of fields; save one dataset per signal"
    if item.dtype.kind not in "fiub":
        return "not real numbers"
    if item.is_virtual or item.external:
        return "its values are in another file"
    if item.size == 1:
        return "a scalar"
    if max(item.shape) != item.size:
        return "a matrix of " + " x ".join(str(n) for n in item.shape)
    return ""


def _values(item: Any) -> NDArray[Any]:
    return np.asarray(item[()]).ravel()


def _unit(item: Any) -> str:
    for key in ("unit", "units"):
        try:
            value = item.attrs.get(key)
        except (OSError, TypeError, ValueError, KeyError):
            continue  # an attribute of a kind that NumPy does not have is no text
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.ravel()[0]
        if isinstance(value, bytes):
            value = value.decode("utf-8", errors="replace")
        if isinstance(value, str) and value.strip():
            return value.strip()
    return ""
