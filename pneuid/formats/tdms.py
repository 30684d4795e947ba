"""TDMS files of LabVIEW: every channel of numbers is a column, ``wf_increment`` is the time step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import UserError
from pneuid.formats.series import ONE_RATE, SAME_TIME, FloatArray, Series, assemble, library, main_base, pace, reading
from pneuid.formats.table import FileLayout, RawTable


@dataclass(frozen=True)
class _Base:
    """``samples`` at the time ``step`` [s], 0 where the file states none, from ``start`` [s] after the file's first."""

    samples: int
    step: float
    start: float

    def __str__(self) -> str:
        return pace(self.samples, self.step, self.start if self.step else None)

    def same(self, other: _Base) -> bool:
        """Whether no sample of the two differs in time by more than ``SAME_TIME`` of a step."""
        drift = abs(self.start - other.start) + self.samples * abs(self.step - other.step)
        return self.samples == other.samples and drift <= SAME_TIME * other.step

    def times(self) -> FloatArray:
        """The time of each sample [s]."""
        return self.start + self.step * np.arange(self.samples, dtype=np.float64)


def read_tdms(path: Path, layout: FileLayout) -> RawTable:
    """Read the channels of a TDMS file as columns; ``layout.gaps`` takes slower channels too, the rest does not apply.

    The unit is the property ``unit_string``. The time is a channel ``t``, else it comes from ``wf_increment``
    and ``wf_start_offset``. A channel of time stamps is read as seconds from its first one. A channel without
    a time step goes with those of its length. Channels of another rate than most signals, of text or of complex
    numbers are listed in ``ignored``. Raises ``UserError`` for a file that is not TDMS or without a channel of numbers.
    """
    nptdms = library("nptdms", path)
    ignored: dict[str, str] = {}
    with reading(path, "a TDMS file"), path.open("rb") as stream, nptdms.TdmsFile.open(stream) as file:
        if file.file_status.incomplete_final_segment:
            raise UserError(f"{path}: the file is cut off, its last segment is incomplete; copy or record it again")
        usable = []
        for channel in (channel for group in file.groups() for channel in group.channels()):
            reason = "empty" if len(channel) == 0 else "" if channel.dtype.kind in "fiubM" else "not real numbers"
            if reason:
                ignored[f"{channel.group_name}/{channel.name}"] = reason
            else:
                usable.append(channel)
        if not usable:
            raise UserError(f"{path}: holds no channel of numbers; save one channel per signal")
        series = [
            Series(channel.name, partial(_values, channel), base, base.samples, channel.group_name, _unit(channel))
            for channel, base in zip(usable, _merged(_bases(usable)), strict=True)
        ]
        main = main_base(series, layout.gaps)
        return assemble(
            path,
            series,
            main,
            lambda one: f"it is recorded at {one.base}, the others at {main}; {ONE_RATE}",
            ignored,
            time=main.times if main.step > 0.0 else None,
            times=_Base.times if layout.gaps and main.step > 0.0 else None,
        )


def _bases(channels: list[Any]) -> list[_Base]:
    starts = [channel.properties.get("wf_start_time") for channel in channels]
    ticks = [int(s.astype("datetime64[us]").astype(np.int64)) if isinstance(s, np.datetime64) else None for s in starts]
    first = min((tick for tick in ticks if tick is not None), default=0)
    bases = []
    for channel, tick in zip(channels, ticks, strict=True):
        step = max(_number(channel.properties.get("wf_increment")), 0.0)
        since = 0.0 if tick is None else (tick - first) * 1e-6
        start = _number(channel.properties.get("wf_start_offset")) + since
        bases.append(_Base(len(channel), step, start if step else 0.0))
    return bases


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float | np.number) and math.isfinite(value) else 0.0


def _merged(bases: list[_Base]) -> list[_Base]:
    """The base of each channel where those that are the same are one and those without a step join one of their length."""
    distinct: list[_Base] = []
    for base in bases:
        if base.step > 0.0 and not any(base.same(other) for other in distinct):
            distinct.append(base)
    merged = []
    for base in bases:
        alike = [other for other in distinct if base.same(other)] if base.step > 0.0 else []
        fitting = alike or [other for other in distinct if other.samples == base.samples]
        merged.append(fitting[0] if alike or len(fitting) == 1 else base)
    return merged


def _unit(channel: Any) -> str:
    if channel.dtype.kind == "M":
        return "s"
    unit = channel.properties.get("unit_string", "")
    return unit.strip() if isinstance(unit, str) else ""


def _values(channel: Any) -> NDArray[Any]:
    values = np.asarray(channel[:])
    if values.dtype.kind != "M":
        return values
    ticks = values.astype("datetime64[us]")
    return np.asarray((ticks - ticks[0]) / np.timedelta64(1, "s"), dtype=np.float64)
