"""Picture of an unknown function: its shape over the signal that it follows, with its band."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pneuid.estimation.curves import Curve
from pneuid.report import style
from pneuid.report.quantities import handy
from pneuid.report.style import axis_label, new_figure, shown, styled

_RELATIVE = {"u": ("relative opening of the valve", 1.0), "dp": ("p1 - p2 (kPa)", 1e-3)}
"""Signals that a function sees in another way than they are recorded."""


@styled
def shape_figure(curve: Curve, patm: float) -> Figure:
    """The function with two standard errors either side; patm : atmospheric pressure, Pa, by which pressures are gauge."""
    figure = new_figure(3.2)
    axes = figure.subplots()
    at, value, std = (np.array(item) for item in (curve.at, curve.value, curve.std))
    if curve.signal in _RELATIVE:
        label, scale = _RELATIVE[curve.signal]
        place = at * scale
    else:
        label, place = axis_label(curve.signal), shown(curve.signal, at, patm)
    unit, factor = {"kg/s": ("g/s", 1e3), "Pa/s": ("kPa/s", 1e-3)}.get(curve.unit) or handy(curve.unit)
    low, high = factor * (value - 2 * std), factor * (value + 2 * std)
    axes.fill_between(place, low, high, color=style.SIMULATED, alpha=0.2, lw=0, label="two standard errors")
    axes.plot(place, factor * value, color=style.SIMULATED)
    axes.axhline(0.0, color=style.NEUTRAL, lw=0.8)
    axes.set_xlabel(label)
    times = f", times {curve.times}" if curve.times else ""
    axes.set_ylabel(f"{curve.equation}{times}" + (f" ({unit})" if unit else ""))
    axes.legend(loc="best")
    return figure
