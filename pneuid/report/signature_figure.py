"""Picture of an effect's signature: the base model beside the model with the effect, and the difference per signal."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pneuid.criticism.screening.signature import Signature
from pneuid.report import style
from pneuid.report.signal_units import axis_label, error_unit, shown
from pneuid.report.style import new_figure, plain, styled, ticks
from pneuid.signals import SIGNALS


@styled
def signature_figure(found: Signature, patm: float) -> Figure:
    """Command on top, then one row per signal: responses without and with the effect, and their difference.

    patm : atmospheric pressure, Pa, by which pressures are shown gauge. The grey band is the sensor's noise, two sigmas.
    """
    names = list(found.without)
    figure = new_figure(1.4 + 1.7 * (len(names) + 1))
    grid = figure.subplots(len(names) + 1, 2, sharex=True, height_ratios=[0.7] + [1.0] * len(names))
    signal, course = found.command
    grid[0, 0].plot(found.t, shown(signal, course, patm), color=style.MEASURED)
    grid[0, 0].set_ylabel(axis_label(signal))
    grid[0, 0].set_title("response without and with it")
    _legend(grid[0, 1])
    for row, name in zip(grid[1:], names, strict=True):
        _responses(row[0], found, name, patm)
        _difference(row[1], found, name)
    for axes in grid[-1]:
        axes.set_xlabel("t (s)")
    figure.suptitle(plain(f"{found.effect.name}: {found.experiment}", 110), x=0.01, ha="left", fontweight="bold")
    return figure


def _legend(axes: Axes) -> None:
    """What the colours mean, in the place beside the command."""
    axes.axis("off")
    for color, width, words in (
        (style.NEUTRAL, 2.4, "base model"), (style.SIMULATED, 1.1, "with the effect at its typical size"),
        (style.RESIDUAL, 1.1, "difference"),
    ):  # fmt: skip
        axes.plot([], [], color=color, lw=width, label=words)
    axes.fill_between([], [], [], color=style.FLOOR, alpha=0.25, label="sensor noise, 2 sigma")
    axes.legend(loc="center left")


def _responses(axes: Axes, found: Signature, name: str, patm: float) -> None:
    axes.plot(found.t, shown(name, found.without[name], patm), color=style.NEUTRAL, lw=2.4)
    axes.plot(found.t, shown(name, found.with_it[name], patm), color=style.SIMULATED)
    axes.set_ylabel(axis_label(name))
    axes.yaxis.set_major_locator(ticks(4))


def _difference(axes: Axes, found: Signature, name: str) -> None:
    change = found.with_it[name] - found.without[name]
    unit = error_unit(name, float(abs(change).max()))
    band = style.FLOOR_BAND * found.noise[name] * unit.factor
    axes.axhspan(-band, band, color=style.FLOOR, alpha=0.25, lw=0)
    axes.plot(found.t, change * unit.factor, color=style.RESIDUAL)
    axes.set_ylabel(f"Δ{SIGNALS[name].symbol} ({unit.unit})")
    axes.yaxis.set_major_locator(ticks(4))
