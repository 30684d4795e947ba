"""Intervals side by side, one in every lane of the processor's vectors.

Intervals of a recording share every instruction and differ in their numbers alone, so that four or eight of them take about
the time of one to three. Samples and substeps are loops around the functions that `vectors` writes. Where the compiler knows no
vectors, intervals run one after the other.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np

from pneuid.compiled import compiled_library, lanes
from pneuid.vectors import HEAD, NoLanesError, Written


@dataclass(frozen=True)
class Body:
    """C of one chain: it calls ``parts``, reads ``given`` and fills ``found``, arrays of vectors of these sizes by name.

    A part ``NAME`` is called with its inputs, ``NAME_constant`` and its outputs; an array that is filled ends in ``_``.
    """

    text: str
    parts: tuple[str, ...]
    given: Mapping[str, int]
    found: Mapping[str, int]


def side_by_side(parts: Mapping[str, ca.Function], bodies: Mapping[str, Body], prefix: str) -> dict[str, SideBySide]:
    """Entries that run the chains, by name; none where there is no compiler with vectors, or an operation has no C here."""
    count = lanes()
    try:
        text = source(parts, bodies, count)
    except NoLanesError:
        return {}
    library = compiled_library(text, f"{prefix}_lanes")
    return {} if library is None else {name: SideBySide(library, name, body, count) for name, body in bodies.items()}


def source(parts: Mapping[str, ca.Function], bodies: Mapping[str, Body], lanes: int) -> str:
    """The whole C file: the sample's functions, whose input ``theta`` stays, and an entry for every chain.

    Raises ``NoLanesError``.
    """
    used = sorted({name for body in bodies.values() for name in body.parts})
    made = {name: Written(parts[name], name, parts[name].name_in().index("theta")) for name in used}
    text = [f"#define LANES {lanes}", HEAD, *(one.text for one in made.values())]
    return "\n".join([*text, *(_entry(name, body, [made[part] for part in body.parts]) for name, body in bodies.items())])


def _entry(name: str, body: Body, parts: Sequence[Written]) -> str:
    """Gathers lanes, runs the chain, scatters what it found; intervals ``first`` to ``last - 1``."""
    arguments = [f"const double *{one}_given" for one in body.given] + [f"double *{one}_found" for one in body.found]
    arrays = [f"v {one}[{size}];" for one, size in body.given.items()]
    arrays += [f"v {one}_[{size}];" for one, size in body.found.items()]
    arrays += [f"v {part.name}_constant[{part.constants + 1}];" for part in parts]
    gather = [f"into_lanes({one}, {one}_given + i * {size}, {size}, here);" for one, size in body.given.items()]
    scatter = [f"out_of_lanes({one}_found + i * {size}, {one}_, {size}, here);" for one, size in body.found.items()]
    lines = [
        f"void {name}_side_by_side({', '.join(arguments)}, long first, long last) {{", *arrays,
        "for (long i = first; i < last; i += LANES) {", "const long here = last - i < LANES ? last - i : LANES;",
        *gather, *(f"{part.name}_before(theta, {part.name}_constant);" for part in parts), body.text, *scatter, "}", "}",
    ]  # fmt: skip
    return "\n".join(lines)


class SideBySide:
    """An entry of a built library: intervals in lanes, lanes on threads."""

    def __init__(self, library: Path, name: str, body: Body, lanes: int) -> None:
        self._run = getattr(ctypes.CDLL(str(library)), f"{name}_side_by_side")
        self._run.restype = None
        self._run.argtypes = [ctypes.c_void_p] * (len(body.given) + len(body.found)) + [ctypes.c_long] * 2
        self._lanes = lanes

    def __call__(self, given: Sequence[np.ndarray], found: Sequence[np.ndarray], count: int, threads: int) -> None:
        """Fills ``found`` from ``given``, C arrays of ``count`` intervals one after the other."""
        tiles = -(-count // self._lanes)
        edges = [min(tiles * k // threads * self._lanes, count) for k in range(threads + 1)] if threads > 1 else [0, count]
        jobs = [
            _pool(threads, os.getpid()).submit(self._some, given, found, first, last) for first, last in pairwise(edges[1:])
        ]
        self._some(given, found, edges[0], edges[1])
        if jobs:
            wait(jobs)

    def _some(self, given: Sequence[np.ndarray], found: Sequence[np.ndarray], first: int, last: int) -> None:
        """Intervals ``first`` to ``last - 1``; holds the arrays until they are done, also where the caller is interrupted."""
        self._run(*(item.ctypes.data for item in (*given, *found)), first, last)


@lru_cache(maxsize=4)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:  # noqa: ARG001 - a forked process has no threads of its parent's
    return ThreadPoolExecutor(threads - 1, thread_name_prefix="lanes")
