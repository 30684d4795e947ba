"""One visual language for every picture: a colour and a mark for each role, type sizes, labels from the vocabulary.

Nothing here touches the global state of matplotlib for longer than one figure is drawn, and pyplot is not used.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

MEASURED = "#1a1a1a"
SIMULATED = "#0072b2"
"""The model's prediction 200 ms ahead (bench: of the whole run)."""
FREE_RUN = "#e69f00"
RESIDUAL = "#aa4499"
FLOOR = "#8c8c8c"
ACCEPTED = "#009e73"
REJECTED = "#d55e00"
NEUTRAL = "#9aa5b1"
"""Not judged: screened only, context."""
LEVELS = ("#56b4e9", "#0072b2", "#332288")
"""Low, middle, high of an ordered condition (pressure): light to dark, told apart without colour too."""
MARKS = {"x": "o", "p1": "s", "p2": "D", "F": "o", "v": "^"}
"""Marker of a signal where several share one axis."""

WIDTH = 9.0
"""Width of every figure, inches; a page column shows it at about this size."""

PNG_DPI = 120
FLOOR_BAND = 2.0
"""Half width of the noise band in noise floors: 95 % of what noise alone does."""

_RC: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 6),
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "pneuid",
    "path.simplify": True,
}

P = ParamSpec("P")


@contextmanager
def drawing() -> Iterator[None]:
    """The settings of this package while one figure is built or saved; matplotlib's own are restored after it."""
    with mpl.rc_context(_RC), warnings.catch_warnings():
        # a file name may hold letters that the font lacks: a box in the picture, the name itself is in the text
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator of every figure function: draws in this package's settings."""

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with drawing():
            return draw(*args, **kwargs)

    return inside


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure (inches) that lays itself out."""
    return Figure(figsize=(width, height), layout="constrained")


def svg(figure: Figure) -> bytes:
    """The figure as SVG, the same bytes for the same content."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": "pneuid"}, dpi=PNG_DPI)
    return stream.getvalue()


def png(figure: Figure, dpi: int = PNG_DPI) -> bytes:
    """The figure as PNG."""
    stream = io.BytesIO()
    with drawing():
        figure.savefig(stream, format="png", dpi=dpi)
    return stream.getvalue()


def plain(text: str, most: int = 60) -> str:
    """Text from a file as one line that matplotlib takes literally, not as mathematics."""
    line = "".join(c if c.isprintable() else " " for c in text)
    line = line if len(line) <= most else line[: most // 2 - 1] + "…" + line[-(most // 2) :]
    return line.replace("$", r"\$")


def thinned(t: np.ndarray, y: np.ndarray, points: int = 2400) -> tuple[np.ndarray, np.ndarray]:
    """A long trace (N,) as the lowest and highest sample of each of ``points / 2`` stretches; gaps (NaN) are kept."""
    if y.size <= points:
        return t, y
    size = -(-y.size // (points // 2))
    stretches = -(-y.size // size)
    missing = stretches * size - y.size
    block = np.pad(y, (0, missing), mode="edge").reshape(stretches, size)
    gap = np.isnan(block)
    low = np.argmin(np.where(gap, np.inf, block), axis=1)
    high = np.argmax(np.where(gap, -np.inf, block), axis=1)
    first_gap = np.where(gap.any(axis=1), np.argmax(gap, axis=1), low)
    kept = np.arange(stretches)[:, None] * size + np.column_stack([low, high, first_gap])
    kept = np.unique(np.minimum(kept, y.size - 1))
    return t[kept], y[kept]


def ticks(most: int) -> MaxNLocator:
    """At most so many ticks, on round numbers."""
    return MaxNLocator(most, steps=[1, 2, 2.5, 5, 10])


def plain_log(axis: Axis) -> None:
    """Ticks of a logarithmic axis as 1, 10, 100 and not as powers; 2 and 5 between where there is one decade."""
    low, high = sorted(axis.get_view_interval())
    axis.set_major_locator(LogLocator(10, subs=(1.0,) if high > 30 * low else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def quiet_grid(axes: Axes, axis: str) -> None:
    """Grid lines along one axis only (``x`` or ``y``)."""
    axes.grid(visible=False)
    axes.grid(visible=True, axis=axis)  # type: ignore[arg-type]
