"""Signals as a person reads them: display units, pressures gauge; nothing here draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pneuid.report.quantities import number
from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import to_display


def shown(signal: str, values: Any, patm: float) -> Any:
    """SI values of a signal in its display unit, pressures gauge."""
    meant = SIGNALS[signal]
    reference = patm if signal in PRESSURES else 0.0
    factor = to_display(1.0, meant.unit, meant.display_unit) - to_display(0.0, meant.unit, meant.display_unit)
    return (np.asarray(values) - reference) * factor


def axis_label(signal: str) -> str:
    """Symbol and unit of a signal as ``shown`` gives it."""
    meant = SIGNALS[signal]
    return f"{meant.symbol} ({meant.display_unit}{' gauge' if signal in PRESSURES else ''})"


@dataclass(frozen=True)
class ErrorUnit:
    """Unit for differences of a signal: ``shown = SI * factor``."""

    unit: str
    factor: float


def error_unit(signal: str, size: float) -> ErrorUnit:
    """The unit in which differences of about ``size`` (SI) read as plain numbers."""
    meant = SIGNALS[signal]
    if meant.unit == "m":
        return ErrorUnit("µm", 1e6) if size < 0.5e-3 else ErrorUnit("mm", 1e3)
    if meant.unit == "Pa":
        return ErrorUnit("Pa", 1.0) if size < 100.0 else ErrorUnit("kPa", 1e-3)
    factor = to_display(1.0, meant.unit, meant.display_unit)
    return ErrorUnit(meant.display_unit, factor)


def signal_error(name: str, value: float | None) -> str:
    """A signal's error (SI) in words, ``None`` or not finite where the simulation diverged."""
    if value is None or not np.isfinite(value):
        return f"{name} diverged"
    unit = error_unit(name, value)
    return f"{name} {number(value * unit.factor)} {unit.unit}"
