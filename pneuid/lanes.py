"""Intervals side by side, one in every lane of the processor's vectors.

Intervals of a recording share every instruction and differ in their numbers alone, so that four or eight of them take about
the time of one to three. Samples and substeps are loops around the functions that `vectors` writes; a further one goes from
interval to interval of a window that is simulated from its first state. Where the compiler knows no vectors, intervals run one
after the other.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np

from pneuid.compiled import begin, compiled_library, lanes
from pneuid.vectors import HEAD, NoLanesError, Written


@dataclass(frozen=True)
class Body:
    """C of one interval: it calls ``parts``, reads ``given`` and fills ``found``, arrays of vectors of these sizes by name.

    A part ``NAME`` is called with its inputs, ``NAME_constant`` and its outputs; an array that is filled ends in ``_``. What is
    given as ``start`` belongs to a window's first interval, before which ``first`` runs; ``then`` makes of it the start of the
    next. ``substeps`` is a number that the caller chooses, so that one library serves all of them.
    """

    text: str
    parts: tuple[str, ...]
    given: Mapping[str, int]
    found: Mapping[str, int]
    first: str = ""
    then: str = ""


def side_by_side(
    parts: Mapping[str, ca.Function], bodies: Mapping[str, Body], substeps: int, prefix: str
) -> dict[str, SideBySide]:
    """Entries that run the chains, by name; none where there is no compiler with vectors, or an operation has no C here."""
    count = lanes()
    try:
        text = source(parts, bodies, count)
    except NoLanesError:
        return {}
    library = compiled_library(text, f"{prefix}_lanes")
    if library is None:
        return {}
    return {name: SideBySide(library, name, body, count, substeps) for name, body in bodies.items()}


def begin_side_by_side(parts: Mapping[str, ca.Function], bodies: Mapping[str, Body], prefix: str) -> None:
    """Start compiling what ``side_by_side`` will need."""
    with suppress(NoLanesError):
        begin(source(parts, bodies, lanes()), f"{prefix}_lanes")


def source(parts: Mapping[str, ca.Function], bodies: Mapping[str, Body], lanes: int) -> str:
    """The whole C file: the sample's functions, whose input ``theta`` stays, and an entry for every chain.

    Raises ``NoLanesError``.
    """
    used = sorted({name for body in bodies.values() for name in body.parts})
    made = {name: _written(parts[name], name) for name in used}
    text = [f"#define LANES {lanes}", HEAD, *(one.text for one in made.values())]
    return "\n".join([*text, *(_entry(name, body, [made[part] for part in body.parts]) for name, body in bodies.items())])


@lru_cache(maxsize=32)
def _written(part: ca.Function, name: str) -> Written:
    return Written(part, name, part.name_in().index("theta"))


def _entry(name: str, body: Body, parts: Sequence[Written]) -> str:
    """Windows ``first`` to ``last - 1``: gathers lanes, runs the body and scatters what it found, interval by interval.

    Window ``i`` holds the intervals ``edges[i]`` to ``edges[i + 1] - 1``; a lane whose window is over repeats its last interval
    for nothing.
    """
    arguments = [f"const double *{one}_given" for one in body.given] + [f"double *{one}_found" for one in body.found]
    arrays = [f"v {one}[{size}];" for one, size in body.given.items()]
    arrays += [f"v {one}_[{size}];" for one, size in body.found.items()]
    arrays += [f"v {part.name}_constant[{part.constants + 1}];" for part in parts]
    gather = {one: f"into_lanes({one}, {one}_given, {size}, {{}});" for one, size in body.given.items()}
    scatter = [f"out_of_lanes({one}_found, {one}_, {size}, at, k, length);" for one, size in body.found.items()]
    lines = [
        f"void {name}_side_by_side({', '.join(arguments)}, const long *edges, long first, long last, long substeps) {{",
        *arrays,
        "for (long i = first; i < last; i += LANES) { long window[LANES], at[LANES], length[LANES], longest = 0;",
        "for (long l = 0; l < LANES; l++) { window[l] = smaller(i + l, last - 1);",
        "length[l] = i + l < last ? edges[i + l + 1] - edges[i + l] : 0; longest = -smaller(-longest, -length[l]); }",
        gather.pop("start").format("window"), body.first, "for (long k = 0; k < longest; k++) {",
        "for (long l = 0; l < LANES; l++) at[l] = smaller(edges[window[l]] + k, edges[window[l] + 1] - 1);",
        *(line.format("at") for line in gather.values()),
        *(f"{part.name}_before(theta, {part.name}_constant);" for part in parts), body.text, *scatter, body.then, "}", "}", "}",
    ]  # fmt: skip
    return "\n".join(lines)


class SideBySide:
    """An entry of a built library: intervals in lanes, lanes on threads."""

    def __init__(self, library: Path, name: str, body: Body, lanes: int, substeps: int) -> None:
        self._run = getattr(ctypes.CDLL(str(library)), f"{name}_side_by_side")
        self._run.restype = None
        self._run.argtypes = [ctypes.c_void_p] * (len(body.given) + len(body.found) + 1) + [ctypes.c_long] * 3
        self._lanes, self._substeps = lanes, substeps

    def __call__(self, given: Sequence[np.ndarray], found: Sequence[np.ndarray], edges: np.ndarray, threads: int) -> None:
        """Fills ``found`` from ``given``, C arrays of intervals one after the other; ``start`` of windows.

        edges : ``(windows + 1,)`` C longs, the intervals that windows begin with and their number.
        """
        count = edges.size - 1
        tiles = -(-count // self._lanes)
        shares = [min(tiles * k // threads * self._lanes, count) for k in range(threads + 1)] if threads > 1 else [0, count]
        arrays = (*given, *found, edges)
        jobs = [_pool(threads, os.getpid()).submit(self._some, arrays, first, last) for first, last in pairwise(shares[1:])]
        self._some(arrays, shares[0], shares[1])
        if jobs:
            wait(jobs)

    def _some(self, arrays: Sequence[np.ndarray], first: int, last: int) -> None:
        """Windows ``first`` to ``last - 1``; holds the arrays until they are done, also where the caller is interrupted."""
        self._run(*(item.ctypes.data for item in arrays), first, last, self._substeps)


@lru_cache(maxsize=4)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:  # noqa: ARG001 - a forked process has no threads of its parent's
    return ThreadPoolExecutor(threads - 1, thread_name_prefix="lanes")
