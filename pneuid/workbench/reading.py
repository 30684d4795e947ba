"""What the reading process does: recordings, their heads, rig files; everything comes back ready to be shown."""

from __future__ import annotations

import contextlib
import itertools
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pneuid.errors import UserError
from pneuid.formats import READERS, FileLayout, RawTable, read_table
from pneuid.formats.text import read_text
from pneuid.recording import REQUIRED, Recording
from pneuid.report.signal_units import axis_label, shown
from pneuid.rig import Rig
from pneuid.workbench.payload import Channel, RawPreview, RunData
from pneuid.workbench.project import default_role
from pneuid.workbench.rig_text import FILE_DEFAULTS
from pneuid.zero_reading import ZeroReading

LARGE_TEXT = 8 * 2**20
"""Size in bytes above which a text file is shown thinned while the whole of it is being checked."""

PREVIEW_SAMPLES = 8000
HEAD_ROWS = 6
HEAD_LINES = 200
"""Lines of a text file that tell its layout."""

_LAYOUTS: tuple[dict[str, Any], ...] = tuple(
    {"delimiter": delimiter, "decimal": decimal, "encoding": encoding, "units": units}
    for units in (False, True)
    for encoding in ("utf-8", "cp1252")
    for delimiter, decimal in ((",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", "."), ("whitespace", "."))
)


def check_rig(text: str) -> None:
    """Raises ``UserError`` for a rig.toml that cannot be used."""
    rig_of(text)


def rig_of(text: str) -> Rig:
    """The rig that ``text`` describes. Raises ``UserError``."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"rig.toml: not valid TOML: {' '.join(str(error).split())}") from error
    return Rig.from_dict(raw, where="rig.toml")


def read_run(path: Path, rig_text: str) -> RunData:
    """The recording, checked as every command checks it. Raises ``UserError``."""
    rig = rig_of(rig_text)
    run = Recording.read(path, rig)
    return run_data(run, rig)


def read_zero(path: Path, rig_text: str) -> str:
    """What the sensors show in a zero reading, in words, checked as every command checks it. Raises ``UserError``."""
    return str(ZeroReading.read(path, rig_of(rig_text)))


def run_data(run: Recording, rig: Rig, preview: bool = False) -> RunData:
    """A recording as it is shown: recorded signals in display units, pressures gauge."""
    channels = {
        name: Channel(axis_label(name), np.asarray(shown(name, run.signals[name], rig.patm), dtype=np.float32))
        for name in rig.known_signals
        if name in run.recorded
    }
    return RunData(run.name, run.t, channels, run.n, run.rate, run.notes, preview)


def preview_run(path: Path, rig_text: str) -> RunData | None:
    """Lines from places spread over a large text file, for the first look; None where there is no shortcut."""
    if path.suffix.lower() not in (".csv", ".txt", ".dat") or path.stat().st_size < LARGE_TEXT:
        return None
    rig = rig_of(rig_text)
    lines = _spread(path, rig.files.skip_rows + int(rig.files.header))
    with tempfile.TemporaryDirectory() as folder:
        thin = Path(folder) / path.name
        thin.write_bytes(b"".join(lines))
        try:
            run = Recording.read(thin, rig)
        except UserError:
            # the whole file will be refused with the right row number in a moment
            return None
    return run_data(run, rig, preview=True)


def _spread(path: Path, head: int) -> list[bytes]:
    """The first ``head`` lines of a file, then about PREVIEW_SAMPLES whole lines from places evenly spread over it."""
    with path.open("rb") as stream:
        lines = [stream.readline() for _ in range(head)]
        first, size = stream.tell(), path.stat().st_size
        for place in np.linspace(first, size, PREVIEW_SAMPLES, endpoint=False, dtype=np.int64).tolist():
            if place > first:
                stream.seek(max(place, stream.tell()) - 1)
                stream.readline()
            line = stream.readline()
            if line.endswith(b"\n"):
                lines.append(line)
    return lines


def check_upload(path: Path, rig_text: str | None) -> str:
    """Whether an upload is a recording: empty when it can be used, else what is to be mapped or mended first.

    Raises ``UserError`` for a file that is no table of numbers at all, or one whose rows are broken.
    """
    layout = rig_of(rig_text).files if rig_text is not None else FileLayout()
    try:
        table = read_table(path, layout)
    except UserError as error:
        if _fitting_layout(path, layout) in (None, layout):
            raise
        return str(error)
    numeric = _numeric(table)
    mixed = [name for name in table.frame.columns if name not in numeric and _some_number(table.frame[name])]
    zero = default_role(path.name) == "zero"
    if len(numeric) + len(mixed) < (1 if zero else 2):
        raise UserError(f"{path.name}: not a recording: it holds no two columns of numbers; give one column per signal")
    if rig_text is None:
        return "there is no rig.toml yet; describe the rig first"
    reading = ZeroReading if zero else Recording
    try:
        reading.read(path, rig_of(rig_text))
    except UserError as error:
        if mixed:
            raise
        return str(error)
    return ""


def _numeric(table: RawTable) -> list[str | int]:
    return [name for name in table.frame.columns if table.frame[name].dtype != object]


def _some_number(column: object) -> bool:
    def number(cell: object) -> bool:
        try:
            float(str(cell))
        except ValueError:
            return False
        return True

    return any(number(cell) for cell in list(column)[:1000])  # type: ignore[call-overload]


def raw_head(path: Path, rig_text: str | None, layout: Mapping[str, Any] | None = None) -> RawPreview:
    """The head of a file as it stands, and the mapping that the rig states.

    A text file is read with the keys of ``layout``; without them as the rig states, or with another layout that makes
    more numbers of it. Raises ``UserError`` for a file that cannot be read at all.
    """
    rig = rig_of(rig_text) if rig_text is not None else None
    used, fault = rig.files if rig else FileLayout(), ""
    with _head_only(path, HEAD_LINES + used.skip_rows) as head:
        if head is None:
            table = read_table(path, used)
        else:
            used = replace(used, **layout) if layout is not None else _fitting_layout(path, used) or used
            try:
                table = read_table(head, used)
            except UserError as error:
                fault = str(error).replace(str(head), path.name)
                lines = head.read_text(encoding="utf-8", errors="replace").splitlines()[:HEAD_ROWS]
                table = RawTable(pd.DataFrame({"": lines}))
    columns = tuple(str(name) for name in table.frame.columns)
    rows = tuple(tuple(f"{cell:.7g}" if isinstance(cell, float) else str(cell) for cell in row)
                 for row in table.frame.head(HEAD_ROWS).itertuples(index=False))  # fmt: skip
    units = {str(name): unit for name, unit in table.units.items()}
    known = rig.known_signals if rig else ("t", "u", "x", "v", "p1", "p2", "psup", "F")
    mapped = {name: (str(source.column), source.unit or "") for name, source in (rig.columns if rig else {}).items()}
    for name in known:
        if name not in mapped and name in columns:
            mapped[name] = (name, "")
    keys = {} if head is None else {key: getattr(used, key) for key in FILE_DEFAULTS}
    return RawPreview(path.name, columns, units, rows, keys, fault, known, REQUIRED[rig.kind] if rig else (), mapped)


@contextlib.contextmanager
def _head_only(path: Path, lines: int) -> Iterator[Path | None]:
    """A copy of the first lines of a text file, under its name in a folder of its own; None where it is not text."""
    if READERS.get(path.suffix.lower()) is not read_text:
        yield None
        return
    with tempfile.TemporaryDirectory() as folder, path.open("rb") as stream:
        head = Path(folder) / path.name
        head.write_bytes(b"".join(itertools.islice(stream, lines)))
        yield head


def _fitting_layout(path: Path, stated: FileLayout) -> FileLayout | None:
    """The layout, first of all ``stated``, that makes the most columns of numbers of a text file; None without two."""
    best, most = None, 1
    with _head_only(path, HEAD_LINES + stated.skip_rows) as head:
        if head is None:
            return None
        for change in ({}, *_LAYOUTS):
            layout = replace(stated, **change)
            with contextlib.suppress(UserError):
                count = len(_numeric(read_table(head, layout)))
                if count > most:
                    best, most = layout, count
    return best


def doubts(paths: Sequence[Path], rig_text: str) -> tuple[str, ...]:
    """What an experienced eye would doubt in these recordings taken together, a sentence each; unusable ones left out."""
    from pneuid.plausibility import check_recordings  # noqa: PLC0415 - brings scipy, which the first look can do without

    rig = rig_of(rig_text)
    runs = []
    for path in paths:
        with contextlib.suppress(UserError):
            runs.append(Recording.read(path, rig))
    return tuple(finding.line for finding in check_recordings(rig, runs))
