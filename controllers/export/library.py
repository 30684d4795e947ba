"""The exported C called from Python: for tests, benchmarks, and anyone who wants the C loop in a study."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from controllers.base import Array
from controllers.export.sources import ALL, NMPC, SERVO
from pneuid.compiled import compiler
from pneuid.errors import ComputationError, UserError

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
"""What the exported C must pass without a warning."""


def build_library(folder: Path, target: Path, names: Sequence[str] = ALL, flags: Sequence[str] = ("-O2",)) -> Path:
    """Compile the C files ``names`` of ``folder`` into the shared library ``target``.

    Raises ``UserError`` without a C compiler, ``ComputationError`` when the code does not compile.
    """
    tool = compiler()
    if tool is None:
        raise UserError("no C compiler found; install gcc or clang, or name one in the environment variable CC")
    command = [
        tool[0],
        *STRICT,
        *flags,
        "-fPIC",
        "-shared",
        *(str(folder / name) for name in names),
        "-o",
        str(target),
        "-lm",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200])
        raise ComputationError(f"the exported C did not compile: {first}")
    return target


class _Exported:
    """A controller in a compiled export; one C structure per instance."""

    stem: str

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        self._size = structure_bytes(library, self.stem)
        self.structure = ctypes.create_string_buffer(self._size)
        self._function("init", None)(self.structure)
        self._begin, self._step = self._function("start", ctypes.c_int), self._function("step", ctypes.c_double)

    def _function(self, verb: str, result: type | None) -> ctypes._NamedFuncPointer:
        found = getattr(self._library, f"pneuid_{self.stem}_{verb}")
        found.restype = result
        found.argtypes = [ctypes.c_void_p] * {"init": 1, "memory": 1, "start": 2, "step": 3}[verb]
        return found

    def play(self, seen: Array, target: Array) -> Array:
        """Commands in V for measurements ``(n, 4)`` and a reference with one row per sample and the preview after it.

        Raises ``ValueError`` when the first measurement is not finite.
        """
        seen, target = np.ascontiguousarray(seen, dtype=float), np.ascontiguousarray(target, dtype=float)
        self.begin(seen[0])
        return np.array([self.step(row, target[k:]) for k, row in enumerate(seen)])

    def begin(self, seen: Array) -> None:
        """Start at rest at ``seen`` ``(4,)``. Raises ``ValueError`` when it is not finite."""
        if self._begin(self.structure, seen.ctypes.data) != 0:
            raise ValueError("a controller starts from finite measurements")

    def step(self, seen: Array, target: Array) -> float:
        """Command in V for a measurement ``(4,)`` and a reference ``(preview, 4)``, both of C order and float64."""
        return float(self._step(self.structure, seen.ctypes.data, target.ctypes.data))

    def memory(self, size: int) -> Array:
        """A copy of the controller's memory ``(size,)``, as its Python counterpart shows it."""
        place = self._function("memory", ctypes.c_void_p)(self.structure)
        return np.array((ctypes.c_double * size).from_address(place))


class ExportedServo(_Exported):
    """The servo of a compiled export."""

    stem = "servo"


class ExportedNmpc(_Exported):
    """The predictive controller of a compiled export."""

    stem = "nmpc"


def structure_bytes(library: Path, stem: str) -> int:
    """Size in bytes of a controller's structure, as its compiler lays it out."""
    return int(ctypes.c_size_t.in_dll(ctypes.CDLL(str(library)), f"pneuid_{stem}_bytes").value)


__all__ = ["NMPC", "SERVO", "ExportedNmpc", "ExportedServo", "build_library", "structure_bytes"]
