"""ASAM MDF files, versions 2 to 4: every channel of numbers is a column, the master of its group is the time.

A conversion that is a formula is not evaluated: the library would run text that stands in the file.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.series import ONE_RATE, FloatArray, Series, assemble, library, main_base, pace, reading, same_times
from pneuid.formats.table import FileLayout, RawTable

_FORMULA_3, _FORMULA_4 = 10, 3
"""Types of a conversion by formula in versions 2 and 3, and in version 4."""
_TIME = 1
"""The kind of master (version 4) that is a time; others are angle, distance and index."""


def read_mdf(path: Path, layout: FileLayout) -> RawTable:
    """Read the channels of an MDF file as columns; ``layout.gaps`` takes slower channels too, the rest does not apply.

    Samples that the file marks as invalid are NaN. Channels of another rate than most signals, over angle or
    distance, of text, arrays or by a formula are listed in ``ignored``. Raises ``UserError`` for a file that is
    not MDF, or without a channel over time.
    """
    mdf_class = library("asammdf", path).MDF
    with reading(path, "an MDF file"), mdf_class(path) as mdf:
        times = _Times(mdf)
        ignored: dict[str, str] = {}
        series: list[Series[int]] = []
        for number, group in enumerate(mdf.groups):
            place = _place(group, number)
            base, reason = times.base(number)
            for index, channel in enumerate(group.channels):
                if index == mdf.masters_db.get(number):
                    continue
                why = reason or _no_column(mdf, group, index)
                if why:
                    ignored[f"{place}/{channel.name}"] = why
                    continue
                values = partial(_values, mdf, number, index)
                series.append(Series(channel.name, values, base, times.all[base].size, place, _unit(channel)))
        if not series:
            raise UserError(f"{path}: holds no channel of numbers over time")
        main = main_base(series, layout.gaps)
        here = times.pace(main)
        return assemble(
            path,
            series,
            main,
            lambda one: f"it is recorded at {times.pace(one.base)}, the others at {here}; {ONE_RATE}",
            ignored,
            time=lambda: times.all[main],
            times=times.all.__getitem__ if layout.gaps else None,
        )


class _Times:
    """The distinct time bases of a file; groups whose masters agree share one."""

    def __init__(self, mdf: Any) -> None:
        self._mdf = mdf
        self.all: list[FloatArray] = []

    def base(self, number: int) -> tuple[int, str]:
        """The number of a group's time base, or why it has none."""
        mdf = self._mdf
        if int(mdf.groups[number].channel_group.cycles_nr) == 0:
            return -1, "empty"
        # in version 4 a group may take the master of another one
        owner = getattr(mdf, "virtual_groups_map", {}).get(number, number)
        index = mdf.masters_db.get(owner)
        if index is None:
            return -1, "its group has no master"
        master = mdf.groups[owner].channels[index]
        if getattr(master, "sync_type", _TIME) != _TIME:
            return -1, "it is not recorded over time"
        if _by_formula(mdf, master.conversion):
            return -1, "its time is a formula in the file, which is not evaluated"
        times = np.asarray(mdf.get_master(number), dtype=np.float64)
        for known, other in enumerate(self.all):
            if same_times(times, other):
                return known, ""
        self.all.append(times)
        return len(self.all) - 1, ""

    def pace(self, base: int) -> str:
        times = self.all[base]
        return pace(times.size, float(np.median(np.diff(times))) if times.size > 1 else 0.0, float(times[0]))


def _place(group: Any, number: int) -> str:
    return str(getattr(group.channel_group, "acq_name", None) or f"group {number}")


def _no_column(mdf: Any, group: Any, index: int) -> str:
    """Why a channel over time is no column, or nothing."""
    if group.channel_dependencies[index]:
        return "an array or a structure"
    if _by_formula(mdf, group.channels[index].conversion):
        return "its values are a formula in the file, which is not evaluated; save them converted"
    return ""


def _by_formula(mdf: Any, conversion: Any) -> bool:
    """Whether a conversion, or one that it refers to, is text to be evaluated."""
    kind = getattr(conversion, "conversion_type", None)
    if kind is None:
        return False
    if getattr(conversion, "formula", "") or kind == (_FORMULA_4 if mdf.version >= "4" else _FORMULA_3):
        return True
    return any(_by_formula(mdf, inner) for inner in (getattr(conversion, "referenced_blocks", None) or {}).values())


def _unit(channel: Any) -> str:
    """The channel's own unit (version 4) before its conversion's."""
    unit = getattr(channel, "unit", "") or getattr(channel.conversion, "unit", "") or ""
    return (unit.decode("latin-1") if isinstance(unit, bytes) else str(unit)).strip(" \0")


def _values(mdf: Any, number: int, index: int) -> NDArray[Any]:
    # Samples only: a whole signal would fetch attachments too. "Ignore" keeps invalid samples in place and marks them.
    samples, invalid = mdf.get(group=number, index=index, samples_only=True, ignore_invalidation_bits=True)
    if invalid is not None and np.any(invalid) and samples.dtype.kind in "fiub":
        return np.where(invalid, np.nan, samples)
    return np.asarray(samples)
