"""What the readers of binary formats share: series with a name, a unit and a time base become one table.

A run has one time base. Where a file holds several, the one that carries most of the signals is taken and
the rest is set aside with the reason in words. Where gaps are allowed, it is the fastest that carries a signal, and samples of
slower ones are put beside those nearest in time: the others are missing, nothing is resampled.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import io
import logging
import re
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.table import RawTable
from pneuid.signals import SIGNALS
from pneuid.units import base_unit, factor_and_offset, shown

FloatArray = NDArray[np.float64]

MOST_VALUES = 2**28
"""Most numbers a table may hold (2 GB); a damaged file may claim any size."""
ONE_RATE = "save all at one rate, or set [files] gaps = true in rig.toml, and slower ones are taken with gaps between"
"""What to do about a series on another time base."""
LEAST_PLACED = 4
"""Fewest samples of a slower series inside the time of the others."""
SAME_TIME = 1e-3
"""Two time bases are one when no sample differs by more than this share of the time step (as a uniform run's jitter)."""

_NAME_AND_UNIT = re.compile(r"(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]\s*")


B = TypeVar("B", bound=Hashable)


@dataclass(frozen=True)
class Series(Generic[B]):
    """One series of numbers in a file, not yet read.

    ``title``: its name as in the file; ``group``: where it is kept, ``""`` at the top; ``unit``: from the
    format's own metadata, ``""`` where there is none; ``base``: which time base it is on; ``length``: its
    samples; ``values``: reads them.
    """

    title: str
    values: Callable[[], NDArray[Any]]
    base: B
    length: int
    group: str = ""
    unit: str = ""

    @property
    def name(self) -> str:
        """The title without its unit."""
        return _printable(_split(self.title)[0])

    @property
    def path(self) -> str:
        """``group/name``."""
        return _printable(f"{self.group}/{self.name}" if self.group else self.name)


def library(name: str, path: Path) -> Any:
    """The module ``name`` of the extra ``formats``; a ``UserError`` says what to install where it is absent."""
    try:
        with quiet():
            return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        what = f'reading {path.suffix} files needs {package}; install it with: pip install "pneuid[formats]"'
        raise UserError(f"{path}: {what}") from error


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what a library prints, logs and warns about a file from the terminal; it is said in one line instead."""
    level, hook = logging.root.manager.disable, sys.unraisablehook
    logging.disable(logging.CRITICAL)
    sys.unraisablehook = lambda _problem: None
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(level)
        sys.unraisablehook = hook


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises for a file that is not ``what`` into one ``UserError``."""
    with quiet():
        try:
            yield
        except UserError:
            raise
        except MemoryError as error:
            raise UserError(f"{path}: larger than the memory of this machine, or damaged") from error
        except Exception as error:  # each library raises many kinds for bytes that are not its format
            _forget(error)
            reason = " ".join(_printable(str(error)).split())[:160]
            raise UserError(f"{path}: not {what}, or a damaged one{': ' if reason else ''}{reason}") from error


def _forget(error: BaseException | None) -> None:
    """Let go of the half-made objects of a library now, while what they say as they go is kept quiet."""
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__
    gc.collect()


def main_base(series: Iterable[Series[B]], gaps: bool = False) -> B:
    """The time base with most of the program's signals; on a tie with most series, then with most samples.

    With ``gaps`` the one with most samples among those that carry a signal.
    """
    groups: dict[B, list[Series[B]]] = {}
    for one in series:
        groups.setdefault(one.base, []).append(one)

    def rank(base: B) -> tuple[int, int, int]:
        there = groups[base]
        signals, samples = sum(one.name in SIGNALS for one in there), there[0].length
        return (min(signals, 1), samples, len(there)) if gaps else (signals, len(there), samples)

    return max(groups, key=rank)


def assemble(
    path: Path,
    series: list[Series[B]],
    main: B,
    apart: Callable[[Series[B]], str],
    ignored: dict[str, str],
    time: Callable[[], FloatArray] | None = None,
    row_word: str = "sample",
    times: Callable[[B], FloatArray] | None = None,
) -> RawTable:
    """The table of the series on the base ``main``; ``apart`` says why another one is not in it.

    A column is named as its series where that is unambiguous in the file, else ``group/name``. ``time``
    becomes the column ``t`` [s] where no series of that name is in the table. ``times`` gives the times of a base where
    samples of slower ones may be put among those of ``main``.
    """
    beside = [one for one in series if one.base == main]
    length = max(one.length for one in beside)
    if length * len(beside) > MOST_VALUES:
        raise UserError(
            f"{path}: {len(beside)} columns of {length} samples are more than {MOST_VALUES} numbers; save fewer columns"
        )
    columns: dict[str | int, Any] = {}
    units: dict[str | int, str] = {}
    placed: dict[str | int, str] = {}
    index = pd.RangeIndex(1, length + 1)
    named, left, doubtful = _addressed(series)
    for name, one in named.items():
        unit, conflict = _unit(one)
        where = None if times is None or one.base == main else _places(times(one.base), times(main))
        reason = apart(one) if one.base != main and where is None else conflict
        if reason:
            left[name] = reason
            continue
        values = np.asarray(one.values())
        if where is not None and values.shape == (one.length,) and values.dtype.kind in "fiub":
            values, slow = np.full(length, np.nan), values
            values[where[where >= 0]] = slow[where >= 0]
            placed[name] = apart(one).partition(", the others")[0].removeprefix("it is ")
        if values.shape != (length,) or values.dtype.kind not in "fiubO":
            real = values.dtype.kind in "fiubO"
            left[name] = f"{values.shape} values where {length} are expected" if real else "not real numbers"
            continue
        # as a series of objects: pandas would make text of its own type of it
        columns[name] = pd.Series(values, index=index, dtype=object if values.dtype.kind == "O" else np.float64)
        if unit:
            units[name] = unit
    if not columns:
        raise UserError(f"{path}: holds no series of numbers that can be used; save one per signal")
    if time is not None and "t" not in columns:
        columns = {"t": time(), **columns}
        units["t"] = "s"
    short = {_split(name.rpartition("/")[2])[0]: reason for name, reason in ignored.items()}
    doubtful = {name: reason for name, reason in (short | doubtful | left).items() if name not in columns}
    frame = pd.DataFrame(columns, index=index)
    return RawTable(
        frame=frame, units=units, row_word=row_word, ignored=_lines(ignored | left), apart=_lines(doubtful), placed=placed
    )  # fmt: skip


def _places(own: FloatArray, main: FloatArray) -> NDArray[np.int64] | None:
    """Sample of ``main`` nearest in time to each of ``own``, -1 before its start and after its end; None where two of them
    would fall together, or next to none lies inside."""
    after = np.clip(np.searchsorted(main, own), 1, main.size - 1)
    nearest = np.where(own - main[after - 1] < main[after] - own, after - 1, after)
    step = float(np.median(np.diff(main)))
    nearest[(own < main[0] - 0.5 * step) | (own > main[-1] + 0.5 * step)] = -1
    inside = nearest[nearest >= 0]
    together = np.unique(inside).size < inside.size
    return None if together or inside.size < LEAST_PLACED else nearest


def same_times(first: FloatArray, second: FloatArray) -> bool:
    """Whether two time bases (N,) are one."""
    if first.size != second.size:
        return False
    step = float(np.median(np.abs(np.diff(first)))) if first.size > 1 else 0.0
    return bool(np.all(np.abs(first - second) <= SAME_TIME * step))


def pace(length: int, step: float, start: float | None = None) -> str:
    """``1000 Hz (500 samples)`` for a message."""
    since = "" if start is None else f" from {start:.6g} s"
    return f"{1 / step:.6g} Hz ({length} samples{since})" if step > 0 else f"no steady rate ({length} samples{since})"


def _addressed(series: list[Series[B]]) -> tuple[dict[str, Series[B]], dict[str, str], dict[str, str]]:
    """Each series by the name it goes by; names that several series bear, so that none can be used; and
    short names that stand for several which have a longer one, with what to do."""
    leaves = Counter(one.name for one in series)
    names = [one.path if leaves[one.name] > 1 else one.name for one in series]
    count = Counter(names)
    named = {name: one for name, one in zip(names, series, strict=True) if count[name] == 1}
    repeated = {name: f"{n} series bear this name; give each its own" for name, n in count.items() if n > 1}
    doubtful = {}
    for leaf, n in leaves.items():
        if n > 1 and leaf not in count:
            paths = [one.path for one in series if one.name == leaf]
            few = ", ".join(paths[:4]) + (" and more" if n > 4 else "")
            doubtful[leaf] = f"{n} series bear this name ({few}); say which one in [columns] in rig.toml"
    return named, repeated, doubtful


def _split(title: str) -> tuple[str, str]:
    """Name and unit of ``name [unit]``; ``values[3]`` is an index, not a unit."""
    match = _NAME_AND_UNIT.fullmatch(title)
    if match is None or not match["name"] or match["unit"].strip().isdigit():
        return title.strip() or "column without a name", ""
    return match["name"].strip(), match["unit"].strip()


def _unit(one: Series[Any]) -> tuple[str, str]:
    """The unit of a series, and what is wrong where its name and the format's metadata disagree."""
    named, stated = _printable(_split(one.title)[1]), _printable(one.unit).strip()
    if named and stated and named != stated and not _same_unit(named, stated):
        return "", f"its name says {shown(named)}, the unit in the file {shown(stated)}; make them agree"
    return stated or named, ""


def _same_unit(first: str, second: str) -> bool:
    try:
        base = base_unit(first, "")
        return factor_and_offset(first, base, "") == factor_and_offset(second, base, "")
    except UserError:
        return False


def _lines(reasons: dict[str, str]) -> dict[str, str]:
    return {_printable(name): _printable(reason) for name, reason in reasons.items()}


def _printable(text: str) -> str:
    """``text`` on one line: a name in a binary file may hold any character."""
    return "".join(character if character.isprintable() else " " for character in text)
