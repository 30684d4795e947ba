"""One run as recorded: signals in SI on one time base, with what was missing or left aside said.

A ``Recording`` comes from a file (``read``) or from arrays (``from_arrays``) through the same checks.
Nothing is repaired in silence: what was filled or not used is in ``notes`` and ``extra``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pneuid.columns import conversion, listed, used_columns
from pneuid.errors import UserError
from pneuid.formats import RawTable, read_table
from pneuid.rig import Rig
from pneuid.signals import PRESSURES
from pneuid.units import shown

FloatArray = NDArray[np.float64]

REQUIRED = {"servo": ("t", "u", "x", "p1", "p2"), "bench": ("t", "x", "F")}
"""Signals a run must have, by kind of rig."""

MINIMUM_SAMPLES = 20
"""Fewer samples than the base model with its initial states has parameters cannot be fitted."""
STROKE_SLACK = 1e-3
"""How far ``x`` may lie outside the stroke [m] (sensor zero, end-stop compliance)."""
LEAST_TRAVEL = {"servo": 50e-6, "bench": 5e-6}
"""A run with a smaller range of ``x`` [m] is one without motion. Pre-sliding runs of a bench are micrometres."""
LARGEST_JITTER = 1e-3
"""Largest deviation of a time step from the median, over the median, of a uniform run."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One run: N samples in SI, pressures absolute [Pa].

    ``t`` (N,) [s] starts at 0 and increases; ``signals``: name -> (N,); ``weights``: name -> (N,), 1.0, or
    0.0 where a sample was missing and filled; ``recorded``: the signals that the source holds, the others
    of ``signals`` are constants from the rig; ``extra``: columns not used; ``notes``: what was filled,
    assumed or left aside, in words. ``sha256`` is of the file, or of the arrays.
    """

    name: str
    file: str | None
    sha256: str
    t: FloatArray
    signals: dict[str, FloatArray]
    weights: dict[str, FloatArray]
    recorded: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.t.size)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate(self) -> float:
        """Median sample rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.t)))

    @property
    def uniform(self) -> bool:
        """Whether every time step is within 1e-3 of the median step."""
        steps = np.diff(self.t)
        median = np.median(steps)
        return bool(np.max(np.abs(steps - median)) < LARGEST_JITTER * median)

    @classmethod
    def read(cls, path: str | Path, rig: Rig) -> Recording:
        """Read the run in ``path`` as ``rig`` describes it.

        Raises ``UserError`` naming file, row, column and value for everything that CONTRACT refuses.
        """
        where = str(path)
        table = read_table(path, rig.files)
        rows = tuple(int(row) for row in table.frame.index)
        digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        source = _Source(Path(path).name, where, where, digest, table.row_word, rows)
        used = used_columns(table, rig, rig.known_signals, where)
        _require(set(used), table, rig, where)
        signals: dict[str, FloatArray] = {}
        for signal, column in used.items():
            factor, offset = conversion(signal, column, table, rig, where)
            values = table.numbers(column, rig.files.gaps and signal != "t", where)
            signals[signal] = factor * values + offset
            source.columns[signal] = (column, values)
        notes = [f"{name} is not used: {why}" for name, why in table.ignored.items()]
        notes += [
            f"{signal}: {table.placed[column]}, its samples stand at the nearest of the others' times"
            for signal, column in used.items()
            if column in table.placed
        ]
        extra = tuple(str(column) for column in table.frame.columns if column not in used.values())
        return _checked(signals, rig, source, extra, notes)

    @classmethod
    def from_arrays(cls, name: str, rig: Rig, *, t: FloatArray, **signals: FloatArray) -> Recording:
        """A run from arrays (N,) in SI, pressures absolute [Pa]; the same checks as a file.

        Raises ``UserError`` naming ``name``, sample and value.
        """
        given = {
            signal: _vector(signal, values, np.shape(t), rig, name) for signal, values in {"t": t, **signals}.items()
        }
        _require(set(given), None, rig, name)
        digest = hashlib.sha256()
        for signal in sorted(given):
            digest.update(signal.encode() + given[signal].tobytes())
        source = _Source(name, None, name, digest.hexdigest(), "sample", ())
        source.columns.update({signal: (signal, values) for signal, values in given.items()})
        return _checked(given, rig, source, (), [])


@dataclass
class _Source:
    """Where values came from, to say so in a message: rows as a person counts them, raw values by signal."""

    name: str
    file: str | None
    where: str
    sha256: str
    row_word: str
    rows: tuple[int, ...]
    columns: dict[str, tuple[str | int, FloatArray]] = field(default_factory=dict)

    def place(self, signal: str, sample: int) -> str:
        row = self.rows[sample] if self.rows else sample + 1
        return f"{self.where}: {self.row_word} {row}, column {shown(self.columns[signal][0])}"

    def raw(self, signal: str, sample: int) -> str:
        return f"{self.columns[signal][1][sample]:.12g}"


def _vector(signal: str, values: FloatArray, shape: tuple[int, ...], rig: Rig, name: str) -> FloatArray:
    """A copy of ``values`` (N,) as floats; refuses what is no signal, no vector like t, or not finite."""
    if signal not in rig.known_signals:
        known = ", ".join(rig.known_signals)
        raise UserError(f"{name}: {shown(signal)} is no signal of a {rig.kind} rig; its signals: {known}")
    array = np.array(values, dtype=np.float64)
    if array.ndim != 1 or array.shape != shape:
        raise UserError(f"{name}: column {signal} has shape {array.shape} and t {shape}; give vectors of one length")
    bad = np.isinf(array) if rig.files.gaps and signal != "t" else ~np.isfinite(array)
    if bad.any():
        first = int(np.argmax(bad))
        raise UserError(f"{name}: sample {first + 1}, column {signal}: {array[first]} is not a finite number")
    return array


def _require(found: set[str], table: RawTable | None, rig: Rig, where: str) -> None:
    """Refuse a run without the signals that the rig's kind needs, or with pressures it has no area for."""
    for signal in REQUIRED[rig.kind]:
        if signal in found:
            continue
        there = ""
        if table is not None:
            there = f"; columns there: {listed(list(table.frame.columns))}; map it in [columns] in rig.toml"
        raise UserError(
            f"{where}: column {signal} is missing; a {rig.kind} rig needs {', '.join(REQUIRED[rig.kind])}{there}"
        )
    for signal, area, key in (("p1", rig.A1, "bore"), ("p2", rig.A2, "rod")):
        if signal in found and area == 0.0:
            raise UserError(f"{where}: column {signal} is there, but {rig.where} has no cylinder.{key}; add it")


def _checked(
    signals: dict[str, FloatArray], rig: Rig, source: _Source, extra: tuple[str, ...], notes: list[str]
) -> Recording:
    """The recording after every check; ``signals`` in SI, NaN where a sample is missing."""
    t = signals.pop("t")
    if t.size < MINIMUM_SAMPLES:
        raise UserError(f"{source.where}: {t.size} samples; at least {MINIMUM_SAMPLES} are needed")
    _check_time(t, source)
    weights: dict[str, FloatArray] = {}
    recorded = tuple(signals)
    for signal, values in signals.items():
        missing = np.isnan(values)
        weights[signal] = np.where(missing, 0.0, 1.0)
        if missing.all():
            raise UserError(f"{source.where}: column {shown(source.columns[signal][0])}: every cell is missing")
        if missing.any():
            signals[signal] = np.interp(t, t[~missing], values[~missing])
            notes.append(f"{signal}: {int(missing.sum())} missing samples filled linearly, weight 0")
    _check_pressures(signals, source)
    _check_position(signals["x"], source, rig)
    notes.extend(_constants(source.name, signals, rig, t.size))
    steps = np.diff(t)
    if steps.max() > 5.0 * np.median(steps):
        notes.append(f"longest time step {steps.max():.4g} s, median {np.median(steps):.4g} s")
    t = t - t[0]
    weights = {signal: weights.get(signal, np.ones(t.size)) for signal in signals}
    for array in (t, *signals.values(), *weights.values()):
        array.setflags(write=False)
    return Recording(source.name, source.file, source.sha256, t, signals, weights, recorded, extra, tuple(notes))


def _check_time(t: FloatArray, source: _Source) -> None:
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if late.size:
        sample = int(late[0]) + 1
        word = "repeats" if t[sample] == t[sample - 1] else "runs back"
        values = f"{source.raw('t', sample)} after {source.raw('t', sample - 1)}"
        raise UserError(f"{source.place('t', sample)}: time {word}: {values}; it must increase from row to row")


def _check_pressures(signals: dict[str, FloatArray], source: _Source) -> None:
    for signal in PRESSURES:
        if signal in signals and signals[signal].min() < 0.0:
            sample = int(np.argmax(signals[signal] < 0.0))
            raise UserError(
                f"{source.place(signal, sample)}: {source.raw(signal, sample)} is below vacuum "
                f"({signals[signal][sample] / 1e3:.6g} kPa absolute); check the unit and conventions.pressure"
            )


def _check_position(x: FloatArray, source: _Source, rig: Rig) -> None:
    if rig.kind == "servo":
        outside = (x < -STROKE_SLACK) | (x > rig.stroke + STROKE_SLACK)
        if outside.any():
            sample = int(np.argmax(outside))
            raise UserError(
                f"{source.place('x', sample)}: {source.raw('x', sample)} ({x[sample] * 1e3:.6g} mm) is outside the "
                f"stroke, 0 to {rig.stroke * 1e3:g} mm; check the unit of x; x counts from the cap end (columns.x gain, offset)"
            )
    travel, least = float(np.ptp(x)), LEAST_TRAVEL[rig.kind]
    if travel < least:
        column = shown(source.columns["x"][0])
        raise UserError(
            f"{source.where}: column {column}: no motion, x stays within {travel * 1e6:.3g} um; "
            f"a run needs more than {least * 1e6:g} um"
        )


def _constants(name: str, signals: dict[str, FloatArray], rig: Rig, n: int) -> list[str]:
    """Add the inputs that were not recorded as constants; says so."""
    notes = []
    if rig.kind == "bench":
        for signal in ("p1", "p2"):
            if signal not in signals:
                signals[signal] = np.full(n, rig.patm)
                notes.append(f"{signal} is not recorded: taken as ambient pressure")
    elif "psup" not in signals:
        own = rig.run(name).supply
        supply = rig.supply if own is None else own
        signals["psup"] = np.full(n, supply)
        gauge = rig.pressure_convention == "gauge"
        stated = f"{(supply - gauge * rig.patm) / 1e3:.6g} kPa {'gauge' if gauge else 'absolute'}"
        notes.append(f"psup is not recorded: taken as {stated} from the rig")
    return notes
