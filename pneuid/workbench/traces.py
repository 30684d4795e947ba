"""Long traces made short enough for a browser: the lowest and highest sample of each stretch, refined on zoom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from tsdownsample import MinMaxDownsampler

from pneuid.workbench.look import Ink

POINTS = 1600
"""Points per trace over the visible range; a screen has fewer columns of pixels."""

MARGIN = 0.5
"""Part of the visible range that is sent on either side of it, so that a pan shows data at once."""

LABELS = 76
"""Width in pixels of the column of labels left of a stack of panels."""

_DOWNSAMPLER = MinMaxDownsampler()


@dataclass(frozen=True)
class Line:
    """One trace over time: name in the legend, values (N,), colour, width, dash."""

    name: str
    values: np.ndarray
    color: str
    width: float = 1.2
    dash: str = "solid"


@dataclass(frozen=True)
class Row:
    """One panel of a stack: axis label, lines, its share of the height, a band +-``band`` about zero, which lines set the
    frame (all if 0)."""

    label: str
    lines: tuple[Line, ...]
    weight: float = 1.0
    band: float = 0.0
    framing: int = 0


def thin(
    t: np.ndarray, y: np.ndarray, span: tuple[float, float] | None = None, points: int = POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """``t`` and ``y`` (N,) of ``span`` (s) and its margins, as at most about ``points`` per span; NaN stay where shown."""
    first, last = 0, t.size
    if span is not None:
        wide = MARGIN * (span[1] - span[0])
        first = max(int(np.searchsorted(t, span[0] - wide)) - 1, 0)
        last = min(int(np.searchsorted(t, span[1] + wide)) + 1, t.size)
        points = int(points * (1 + 2 * MARGIN))
    if last - first <= points:
        return t[first:last], y[first:last]
    part = np.ascontiguousarray(y[first:last])
    gaps = np.isnan(part)
    if gaps.any():
        # the search for extremes knows no gaps: each is bridged by the value before it, then shown as a gap again
        before = np.maximum.accumulate(np.where(gaps, 0, np.arange(part.size)))
        part = np.nan_to_num(part[before])
    kept = _DOWNSAMPLER.downsample(part, n_out=points - points % 2).astype(np.int64)
    if gaps.any():
        kept = np.unique(np.concatenate([kept, _long_gaps(gaps)]))
    return t[first + kept], y[first + kept]


def _long_gaps(gaps: np.ndarray, least: int = 20) -> np.ndarray:
    """One sample of every gap that is too long to be the seam of two windows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], gaps.astype(np.int8), [0]])))
    first, last = edges[0::2], edges[1::2]
    return np.asarray(first[last - first >= least], dtype=np.int64)


def stack(
    t: np.ndarray,
    rows: tuple[Row, ...],
    ink: Ink,
    key: str,
    span: tuple[float, float] | None = None,
    marked: list[tuple[float, float]] | None = None,
) -> dict[str, Any]:
    """A figure of panels above one another with one time axis; ``key`` keeps the user's zoom while it stays the same."""
    data: list[dict[str, Any]] = []
    layout = base_layout(ink, key)
    shapes: list[dict[str, Any]] = [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": a, "x1": b, "y0": 0, "y1": 1, "line": {"width": 0},
         "fillcolor": ink.highlight, "layer": "below"}
        for a, b in marked or ()
    ]  # fmt: skip
    total, gap, top = sum(row.weight for row in rows), 0.018, 1.0
    height = 1.0 - gap * (len(rows) - 1)
    named: set[str] = set()
    titles: list[dict[str, Any]] = []
    for k, row in enumerate(rows):
        axis = "y" if k == 0 else f"y{k + 1}"
        size = height * row.weight / total
        layout["yaxis" if k == 0 else f"yaxis{k + 1}"] = _axis(ink, row, (max(top - size, 0.0), top))
        titles.append(_title(row.label, top - 0.5 * size, ink))
        top -= size + gap
        if row.band > 0:
            shapes.append({
                "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": axis, "y0": -row.band, "y1": row.band,
                "line": {"width": 0}, "layer": "below", "fillcolor": "rgba(140,140,140,0.3)",
            })  # fmt: skip
        for line in row.lines:
            x, y = thin(t, line.values, span)
            data.append({
                "type": "scatter", "mode": "lines", "name": line.name, "x": x, "y": y, "yaxis": axis, "xaxis": "x",
                "legendgroup": line.name, "showlegend": bool(line.name) and line.name not in named, "connectgaps": False,
                "line": {"color": line.color, "width": line.width, "dash": line.dash},
                "hovertemplate": "%{y:.5g}<extra>" + (line.name or row.label) + "</extra>",
            })  # fmt: skip
            named.add(line.name)
    last = "y" if len(rows) == 1 else f"y{len(rows)}"
    layout["xaxis"] = axis_style(ink, "t (s)") | {"anchor": last, "range": list(span or (float(t[0]), float(t[-1])))}
    layout["shapes"], layout["annotations"] = shapes, titles
    layout["margin"] |= {"l": LABELS + 50}
    layout["hovermode"] = "x"
    layout["dragmode"] = "zoom"
    return {"data": data, "layout": layout, "config": CONFIG}


# not "responsive": its observer complains about every plot that a change of view takes away; the page resizes them
CONFIG = {
    "displaylogo": False, "scrollZoom": False, "responsive": False,
    "modeBarButtonsToRemove": ["select2d", "lasso2d", "autoScale2d", "toImage"],
}  # fmt: skip


def base_layout(ink: Ink, key: str) -> dict[str, Any]:
    """What all figures share."""
    return {
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)", "uirevision": key, "showlegend": True,
        "font": {"color": ink.text, "size": 13, "family": "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"},
        "margin": {"l": 78, "r": 14, "t": 34, "b": 46},
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "font": {"size": 13}},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": ink.text, "activecolor": ink.simulated},
        "hoverlabel": {"font": {"size": 13}},
    }  # fmt: skip


def axis_style(ink: Ink, title: str) -> dict[str, Any]:
    """Grid, ticks and title of an axis."""
    return {
        "title": {"text": title, "font": {"size": 13}, "standoff": 6}, "gridcolor": ink.grid, "zerolinecolor": ink.grid,
        "linecolor": "#777777", "ticks": "outside", "tickcolor": "#777777", "tickfont": {"size": 12}, "automargin": False,
    }  # fmt: skip


def _title(label: str, middle: float, ink: Ink) -> dict[str, Any]:
    """The label of a panel left of its axis, the unit below the name: turned on its side it would not fit a low panel."""
    return {
        "text": label.replace(" (", "<br>("), "xref": "paper", "yref": "paper", "x": 0, "xshift": -LABELS - 46, "y": middle,
        "xanchor": "left", "yanchor": "middle", "align": "left", "showarrow": False, "font": {"size": 13, "color": ink.text},
    }  # fmt: skip


def _axis(ink: Ink, row: Row, domain: tuple[float, float]) -> dict[str, Any]:
    style = axis_style(ink, "") | {"domain": list(domain), "nticks": 5 if row.weight >= 1.0 and not row.band else 3}
    framing = row.lines[: row.framing] if row.framing else row.lines
    ends = [(np.nanmin(line.values), np.nanmax(line.values)) for line in framing if np.isfinite(line.values).any()]
    low = min([float(a) for a, _ in ends] + ([-row.band] if row.band else []), default=0.0)
    high = max([float(b) for _, b in ends] + ([row.band] if row.band else []), default=1.0)
    margin = 0.06 * max(high - low, 1e-9)
    return style | {"range": [low - margin, high + margin], "zeroline": bool(row.band)}
