"""The sensors read at zero: both chambers vented, nothing pulling on the force sensor.

A constant force on the piston, a wrong zero of the force sensor and one of a pressure sensor are the same in every stroke; the
reading tells them apart in a few seconds. It needs no motion, no time column and only the signals in question.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pneuid.columns import conversion, listed, used_columns
from pneuid.errors import UserError
from pneuid.estimation.noise import noise_from_roughness
from pneuid.formats import read_table
from pneuid.rig import Rig
from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import to_display

READ = ("p1", "p2", "F")
"""Signals of which it is known what the sensor must show."""

FEWEST = 100
"""Samples of a reading at least, of which the mean is known to a tenth of the noise of one; it is not believed to less."""

BLOCKS = 10
"""Parts whose means tell whether a reading stands still."""

RESTLESS = 5.0
"""Times the noise of one sample over which the parts' means may range: a chamber that still vents falls by far more."""

VENTED = 50e3
"""Pa from ambient pressure beyond which no sensor's zero is off, but the chamber is not vented."""


@dataclass(frozen=True)
class Zero:
    """What one sensor shows beyond what it must, SI: the mean, and its 1-sigma, drift while it is read included."""

    value: float
    std: float


@dataclass(frozen=True)
class ZeroReading:
    """What the sensors show at zero: ``zeros`` by signal (``p1``, ``p2``, ``F``)."""

    name: str
    zeros: Mapping[str, Zero]

    @classmethod
    def read(cls, path: str | Path, rig: Rig) -> ZeroReading:
        """Read the file as the rig describes its recordings; columns other than p1, p2 and F are not looked at.

        Raises ``UserError`` for a file without any of these, one that is too short or does not stand still, and for absolute
        pressures where the rig does not state the ambient pressure.
        """
        where = str(path)
        table = read_table(path, rig.files)
        used = used_columns(table, rig, _readable(rig), where)
        signals = {}
        for signal, column in used.items():
            factor, offset = conversion(signal, column, table, rig, where)
            values = factor * table.numbers(column, rig.files.gaps, where) + offset
            signals[signal] = values[~np.isnan(values)]
        return cls._checked(where, rig, signals, f"; columns there: {listed(list(table.frame.columns))}")

    @classmethod
    def from_arrays(cls, name: str, rig: Rig, **signals: ArrayLike) -> ZeroReading:
        """A reading from arrays (N,) in SI, pressures absolute [Pa]. Raises ``UserError`` as ``read`` does."""
        wanted = _readable(rig)
        for signal in signals:
            if signal not in wanted:
                raise UserError(f"{name}: {signal} has no zero on this rig; give {' or '.join(wanted)}")
        return cls._checked(name, rig, {signal: np.asarray(values, dtype=float) for signal, values in signals.items()})

    @classmethod
    def _checked(cls, where: str, rig: Rig, signals: Mapping[str, np.ndarray], there: str = "") -> ZeroReading:
        if not signals:
            raise UserError(f"{where}: a zero reading needs a column {' or '.join(_readable(rig))}{there}")
        absolute = [signal for signal in signals if signal in PRESSURES and rig.pressure_convention != "gauge"]
        if absolute and "pressure" not in rig.raw.get("ambient", {}):
            raise UserError(
                f"{where}: {absolute[0]} is absolute, and the weather moves the ambient pressure by some kPa; write what a "
                'barometer shows into rig.toml: [ambient] pressure = "..." (always absolute)'
            )
        return cls(Path(where).name, {signal: _zero(where, rig, signal, values) for signal, values in signals.items()})

    def __str__(self) -> str:
        """As a sentence says it: ``F 2.65 ± 0.29 N, p1 0.05 ± 0.14 kPa``."""
        return ", ".join(f"{signal} {shown_with(signal, zero.value, zero.std)}" for signal, zero in self.zeros.items())


def shown_with(signal: str, value: float, std: float = 0.0) -> str:
    """A zero (SI), and its 1-sigma where there is one, in the unit of the signal's figures."""
    unit = SIGNALS[signal]
    first, second = (to_display(number, unit.unit, unit.display_unit) for number in (value, std))
    if second == 0.0:
        return f"{first:.3g} {unit.display_unit}"
    places = max(0, 1 - int(np.floor(np.log10(second))))
    return f"{first:.{places}f} ± {second:.{places}f} {unit.display_unit}"


def _readable(rig: Rig) -> tuple[str, ...]:
    """Signals of this rig that have a known zero."""
    return tuple(signal for signal in READ if signal in (*rig.chambers, *(("F",) if rig.kind == "bench" else ())))


def _zero(where: str, rig: Rig, signal: str, values: np.ndarray) -> Zero:
    """The mean beyond what the sensor must show, for a reading that stands still."""
    if values.size < FEWEST:
        raise UserError(f"{where}: column {signal}: {values.size} samples; a zero reading needs at least {FEWEST}")
    if not np.all(np.isfinite(values)):
        raise UserError(f"{where}: column {signal}: not every sample is a finite number")
    noise = noise_from_roughness(values)
    means = np.array([part.mean() for part in np.array_split(values, BLOCKS)])
    drift = float(np.ptp(means))
    if drift > RESTLESS * max(noise, 1e-9 * float(np.abs(values).max())):
        unit = SIGNALS[signal]
        moved = to_display(drift, unit.unit, unit.display_unit)
        raise UserError(
            f"{where}: column {signal} moves by {moved:.3g} {unit.display_unit} while it is read; record once both chambers "
            "are vented, nothing pulls on the rod and all has come to rest"
        )
    shown = float(values.mean()) - (rig.patm if signal in PRESSURES else 0.0)
    if signal in PRESSURES and abs(shown) > VENTED:
        raise UserError(
            f"{where}: column {signal} is {shown / 1e3:.4g} kPa from ambient pressure; a zero reading is taken with both "
            "chambers vented: check that, its unit and conventions.pressure"
        )
    return Zero(shown, max(mean_error(noise), float(means.std())))


def mean_error(noise: float) -> float:
    """1-sigma of the mean of a reading by a sensor whose samples have this noise, in its unit."""
    return float(noise / np.sqrt(FEWEST))
