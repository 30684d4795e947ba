"""The decorators of all compiled equations.

Numba's cache of a function watches only the file that the function stands in: after an edit of a callee elsewhere, or
of the indices in ``layout``, it would go on using old machine code. So only what Python calls is cached, with its callees
inside, and stamped with the newest of all the files that the equations stand in.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_SOURCES = (*sorted(Path(__file__).parent.glob("*.py")), Path(__file__).parents[1] / "layout.py")
_STAMP = (max(path.stat().st_mtime for path in _SOURCES), sum(path.stat().st_size for path in _SOURCES))


def compiled(function: Callable[..., Any]) -> Any:
    """An equation that other compiled ones call."""
    return njit(error_model="numpy")(function)


def entry(function: Callable[..., Any]) -> Any:
    """A function that Python calls: compiled on first use and cached until any of the equations' files changes."""
    dispatcher: Any = njit(cache=True, error_model="numpy")(function)
    dispatcher._cache._cache_file._source_stamp = _STAMP  # noqa: SLF001 - numba has no public way
    return dispatcher
