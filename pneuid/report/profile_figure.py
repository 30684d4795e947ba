"""Profile likelihood as a picture: one panel per parameter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from pneuid.estimation.profile import LEVEL, Profile
from pneuid.report import style
from pneuid.report.quantities import handy
from pneuid.report.style import new_figure, styled, ticks


@styled
def profiles_figure(profiles: Sequence[Profile]) -> Figure:
    """Rise of the squared residuals over each pinned parameter, beside the parabola of its standard error."""
    columns = min(len(profiles), 3)
    rows = -(-len(profiles) // columns)
    figure = new_figure(2.5 * rows + 0.4)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, item in zip(panels, profiles, strict=False):
        unit, factor = handy(item.unit)
        fine = np.linspace(item.values[0], item.values[-1], 101)
        parabola = ((fine - item.estimate) / max(item.std, 1e-300)) ** 2
        axes.plot(fine * factor, parabola, "--", color=style.NEUTRAL, label="parabola of the standard error")
        axes.plot(item.values * factor, item.rise, "o-", ms=3.5, color=style.SIMULATED, label="profile")
        axes.axhline(LEVEL, color=style.REJECTED, lw=0.9, label="95 % level")
        for end in (item.low, item.high):
            if end is not None:
                axes.axvline(end * factor, color=style.REJECTED, lw=0.9, ls=":")
        axes.set_ylim(0.0, 1.6 * LEVEL)
        axes.set_xlabel(f"{item.name} ({unit})")
        axes.xaxis.set_major_locator(ticks(4))
    for axes in panels[len(profiles) :]:
        axes.set_visible(False)
    for axes in panels[::columns]:
        axes.set_ylabel("rise of χ² (1)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure
