"""MATLAB files up to version 7 (``save -v7``): every real vector of the common length is a column."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.table import FileLayout, RawTable


def read_matlab(path: Path, layout: FileLayout) -> RawTable:
    """Read the vectors, (N,), (N,1) or (1,N), of a .mat file as columns; ``layout`` does not apply.

    N is the length that most vectors share (the longer one on a tie). Scalars, text, structures,
    matrices and vectors of another length are no columns and are listed in ``ignored``. A .mat file
    states no units. Raises ``UserError`` for version 7.3, for a file that is not MATLAB, or without vectors.
    """
    vectors, ignored = _vectors(_load(path))
    if not vectors:
        raise UserError(f"{path}: holds no vector of numbers; save one vector per signal, all of one length")
    counts = Counter(vector.size for vector in vectors.values())
    length = max(counts, key=lambda size: (counts[size], size))
    for name, vector in list(vectors.items()):
        if vector.size != length:
            ignored[name] = f"{vector.size} values where the other vectors have {length}"
            del vectors[name]
    frame = pd.DataFrame(vectors, index=pd.RangeIndex(1, length + 1))
    return RawTable(frame=frame, row_word="sample", ignored=ignored)


def _load(path: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = scipy.io.loadmat(path)
    except NotImplementedError as error:
        raise UserError(f"{path}: MATLAB 7.3 file; save it in MATLAB with save(..., '-v7')") from error
    except OSError:
        raise
    except Exception as error:  # loadmat raises many kinds for bytes that are not MATLAB
        raise UserError(f"{path}: not a MATLAB file, or a damaged one; save it again with save(..., '-v7')") from error
    return content


def _vectors(content: dict[str, Any]) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    vectors: dict[str, NDArray[np.float64]] = {}
    ignored: dict[str, str] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
            ignored[name] = "not real numbers"
        elif value.size <= 1:
            ignored[name] = "a scalar" if value.size else "empty"
        elif max(value.shape) != value.size:
            ignored[name] = "a matrix of " + " x ".join(str(n) for n in value.shape)
        else:
            vectors[name] = value.astype(np.float64).ravel()
    return vectors, ignored
