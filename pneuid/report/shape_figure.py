"""Picture of an unknown function: its shape over the signal that it follows, with its band."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pneuid.estimation.curves import Curve
from pneuid.report import style
from pneuid.report.quantities import handy
from pneuid.report.signal_units import axis_label, shown
from pneuid.report.style import new_figure, styled

_RELATIVE = {
    "dp": ("p1 - p2 (kPa)", 1e-3), "psup-p1": ("psup - p1 (kPa)", 1e-3), "psup-p2": ("psup - p2 (kPa)", 1e-3),
    "t": ("time (s)", 1.0),
}  # fmt: skip
"""Signals that are not recorded ones: label and factor from SI."""


def signal_axis(signal: str, values: np.ndarray, patm: float) -> tuple[str, np.ndarray]:
    """Label and shown values of a signal along an axis; ``patm`` (Pa) makes pressures gauge."""
    if signal in _RELATIVE:
        label, scale = _RELATIVE[signal]
        return label, scale * np.asarray(values)
    return axis_label(signal), np.asarray(shown(signal, values, patm))


def function_over(curve: Curve, patm: float) -> tuple[str, np.ndarray]:
    """Label and shown values of the signal that a function follows; it sees the valve's command as a relative opening."""
    at = np.array(curve.at)
    return ("relative opening of the valve", at) if curve.signal == "u" else signal_axis(curve.signal, at, patm)


def function_axis(curve: Curve) -> tuple[str, float]:
    """Label of an unknown function with its unit, and the factor from SI to it."""
    unit, factor = {"kg/s": ("g/s", 1e3), "Pa/s": ("kPa/s", 1e-3)}.get(curve.unit) or handy(curve.unit)
    times = f", times {curve.times}" if curve.times else ""
    return f"{curve.equation}{times}" + (f" ({unit})" if unit else ""), factor


@styled
def shape_figure(curve: Curve, patm: float) -> Figure:
    """The function with two standard errors either side; patm : atmospheric pressure, Pa, by which pressures are gauge."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    value, std = np.array(curve.value), np.array(curve.std)
    label, place = function_over(curve, patm)
    y_label, factor = function_axis(curve)
    low, high = factor * (value - 2 * std), factor * (value + 2 * std)
    axes.fill_between(place, low, high, color=style.SIMULATED, alpha=0.2, lw=0, label="two standard errors")
    axes.plot(place, factor * value, color=style.SIMULATED)
    axes.axhline(0.0, color=style.NEUTRAL, lw=0.8)
    axes.set_xlabel(label)
    axes.set_ylabel(y_label)
    axes.legend(loc="best")
    return figure
