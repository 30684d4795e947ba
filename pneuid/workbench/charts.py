"""The charts that are not traces over time: cost, ranking, ladder, study, residual and phase plane."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pneuid.report.quantities import percent, probability, times
from pneuid.workbench.look import ACCEPTED, DARK, FREE_RUN, MARKS, NEUTRAL, PLOTLY_MARKS, REJECTED, Ink
from pneuid.workbench.payload import Channel
from pneuid.workbench.traces import CONFIG, axis_style, base_layout

SCATTER_POINTS = 5000
"""Points of a cloud; more only darken it."""

Figure = dict[str, Any]


def _figure(data: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    return {"data": data, "layout": layout, "config": CONFIG | {"displayModeBar": False}}


def cost_chart(costs: Sequence[tuple[str, int, float]], ink: Ink) -> Figure:
    """Cost per sample over iterations, one line per stage as the stages follow each other."""
    data: list[dict[str, Any]] = []
    for count, (stage, iteration, cost) in enumerate(costs, start=1):
        if not data or iteration == 1 or data[-1]["name"] != stage:
            color = ink.simulated if stage == "relaxed" else ACCEPTED
            data.append({"type": "scatter", "mode": "lines+markers", "name": stage, "x": [], "y": [],
                         "line": {"color": color, "width": 2}, "marker": {"size": 5},
                         "legendgroup": stage, "showlegend": all(trace["name"] != stage for trace in data)})  # fmt: skip
        data[-1]["x"].append(count)
        data[-1]["y"].append(cost if math.isfinite(cost) and cost > 0 else None)
    layout = base_layout(ink, "cost")
    layout["xaxis"] = axis_style(ink, "iteration") | {"rangemode": "tozero"}
    layout["yaxis"] = axis_style(ink, "cost per sample (–)") | _cost_axis(costs)
    if not costs:
        layout["annotations"] = [_note("the cost of each iteration appears here while a fit runs", ink)]
        layout["xaxis"] |= {"range": [0, 30]}
    return _figure(data, layout)


def _cost_axis(costs: Sequence[tuple[str, int, float]]) -> dict[str, Any]:
    good = [cost for _, _, cost in costs if math.isfinite(cost) and cost > 0] or [0.1, 1000.0]
    return log_axis(0.7 * min(good), 1.4 * max(good))


def log_axis(low: float, high: float) -> dict[str, Any]:
    """A logarithmic axis from ``low`` to ``high`` with ticks written as plain numbers: 0.5, 1, 2, 5, 10."""
    steps = (1.0, 2.0, 5.0) if high < 300 * low else (1.0,)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    at = [step * 10.0**decade for decade in decades for step in steps]
    ends = [math.log10(low), math.log10(high)]
    return {"type": "log", "range": ends, "tickvals": at, "ticktext": [f"{value:.6g}" for value in at]}


def _note(text: str, ink: Ink) -> dict[str, Any]:
    return {"text": text, "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False,
            "bgcolor": ink.paper, "borderpad": 6, "font": {"size": 14, "color": ink.text}}  # fmt: skip


def cloud(
    x: Channel, y: np.ndarray, label: str, inside: np.ndarray | None, ink: Ink, key: str, band: float = 0.0,
    color: str = "",
) -> Figure:  # fmt: skip
    """``y`` (N,) against a signal, the samples of the chosen region on top in the colour of a highlight."""
    good = np.isfinite(y) & np.isfinite(x.values)
    every = 1 + int(good.sum()) // SCATTER_POINTS
    chosen = np.flatnonzero(good)[::every]
    layout = base_layout(ink, key)
    layout["margin"] |= {"t": 26, "r": 10}
    layout["xaxis"], layout["yaxis"] = axis_style(ink, x.label), axis_style(ink, label)
    data = [
        _dots(x.values[chosen], y[chosen], color or ink.residual, "all samples" if inside is not None else "", 0.35)
    ]
    if inside is not None:
        within = chosen[inside[chosen]]
        data.append(_dots(x.values[within], y[within], FREE_RUN, "in the region", 0.9))
    if band > 0:
        layout["shapes"] = [{"type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": "y", "y0": -band, "y1": band,
                             "line": {"width": 0}, "fillcolor": "rgba(140,140,140,0.3)", "layer": "below"}]  # fmt: skip
    layout["hovermode"] = "closest"
    return _figure(data, layout)


def _dots(x: np.ndarray, y: np.ndarray, color: str, name: str, opacity: float) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, "showlegend": bool(name),
        "marker": {"color": color, "size": 3.5, "opacity": opacity}, "hovertemplate": "%{x:.4g}, %{y:.4g}<extra></extra>",
    }  # fmt: skip


# --- decisions ---


def verdict_of(item: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> str:
    """What became of one candidate, in words."""
    if item["effect"] in diagnosis["effects"]:
        return "cannot be told apart" if diagnosis["verdict"] == "ambiguous" else "accepted"
    return "not refitted" if item["hold_out_error_ratio"] is None else "rejected"


COLORS = {"accepted": ACCEPTED, "cannot be told apart": FREE_RUN, "rejected": REJECTED, "not refitted": NEUTRAL}


def ranking_chart(diagnosis: Mapping[str, Any], ink: Ink, most: int = 12) -> Figure:
    """Candidates, those refitted first: predicted drop of the cost, and what the held-out runs said of those refitted."""
    rows = sorted(diagnosis["ranking"], key=lambda item: item["hold_out_error_ratio"] is None)[:most]
    names = [item["effect"] for item in rows]
    data: list[dict[str, Any]] = []
    for words, color in COLORS.items():
        own = [item for item in rows if verdict_of(item, diagnosis) == words]
        if own:
            data.append({"type": "bar", "orientation": "h", "y": [item["effect"] for item in own], "name": words,
                         "x": [100 * max(item["screen_gain"], 0.0) for item in own], "marker": {"color": color},
                         "width": 0.62, "hovertemplate": "%{x:.2f} %<extra></extra>"})  # fmt: skip
            tested = [item for item in own if item["hold_out_error_ratio"] is not None]
            data.append({"type": "scatter", "mode": "markers", "xaxis": "x2", "y": [item["effect"] for item in tested],
                         "x": [min(item["hold_out_error_ratio"], 2.0) for item in tested], "showlegend": False,
                         "marker": {"color": color, "size": 13}, "name": words,
                         "hovertemplate": "%{x:.3f} times the error without it<extra></extra>"})  # fmt: skip
    layout = base_layout(ink, "ranking")
    layout["margin"] |= {"l": 190, "r": 225, "t": 84, "b": 10}
    layout["legend"] |= {"yref": "container", "y": 1.0, "yanchor": "top"}
    # the axes stand above the rows, so that the best candidates can be read without scrolling
    layout["xaxis"] = axis_style(ink, "predicted drop of the cost (%)") | {
        "domain": [0, 0.46], "rangemode": "tozero", "side": "top",
    }  # fmt: skip
    layout["xaxis2"] = axis_style(ink, "held-out error, with it / without it (–)") | {
        "domain": [0.54, 1.0], "anchor": "y", "side": "top", "range": [0, 1.15 * max([1.0, *_ratios(rows)])],
    }  # fmt: skip
    layout["yaxis"] = axis_style(ink, "") | {
        "categoryorder": "array",
        "categoryarray": names[::-1],
        "tickfont": {"size": 13},
    }
    layout["shapes"] = [{"type": "line", "xref": "x2", "yref": "paper", "x0": 1, "x1": 1, "y0": 0, "y1": 1,
                         "line": {"color": "#8c8c8c", "width": 2}}]  # fmt: skip
    layout["annotations"] = [
        {"xref": "paper", "x": 1.01, "xanchor": "left", "y": item["effect"], "text": _evidence(item), "showarrow": False,
         "font": {"size": 12, "color": ink.text}}
        for item in rows if item["hold_out_error_ratio"] is not None
    ]  # fmt: skip
    layout["hovermode"] = "closest"
    return _figure(data, layout)


def _ratios(rows: Sequence[Mapping[str, Any]]) -> list[float]:
    return [min(item["hold_out_error_ratio"], 2.0) for item in rows if item["hold_out_error_ratio"] is not None]


def _evidence(item: Mapping[str, Any]) -> str:
    words = [f"{item['hold_out_error_ratio']:.2f}"]
    if item["excess_explained"] is not None:
        words.append(f"explains {percent(max(item['excess_explained'], 0.0))}")
    if item["p_value"] is not None:
        words.append(f"p {probability(item['p_value'])}")
    return ", ".join(words)


def shape_chart(item: Mapping[str, Any], ink: Ink) -> Figure:
    """The measured defect in bins with two standard errors, and what an effect at its screened size takes of it."""
    layout = base_layout(ink, f"shape {item['effect']}")
    layout["margin"] |= {"l": 92, "t": 30, "r": 10}
    layout["xaxis"] = axis_style(ink, item["x_label"])
    layout["yaxis"] = axis_style(ink, item["y_label"]) | {"zeroline": True, "zerolinecolor": "#8c8c8c"}
    layout["hovermode"] = "x"
    data = [
        {"type": "scatter", "mode": "markers", "name": "measured", "x": item["at"], "y": item["measured"],
         "marker": {"color": ink.measured, "size": 7},
         "error_y": {"type": "data", "array": [2 * value for value in item["spread"]], "thickness": 1, "width": 3}},
        {"type": "scatter", "mode": "lines", "name": item["effect"], "x": item["at"], "y": item["taken"],
         "line": {"color": ink.simulated, "width": 2.5}},
    ]  # fmt: skip
    return _figure(data, layout)


def unknown_chart(item: Mapping[str, Any], ink: Ink) -> Figure:
    """An unknown function with two standard errors either side."""
    layout = base_layout(ink, "unknown function")
    layout["margin"] |= {"t": 30, "r": 10}
    layout["xaxis"] = axis_style(ink, item["x_label"])
    layout["yaxis"] = axis_style(ink, item["y_label"]) | {"zeroline": True, "zerolinecolor": "#8c8c8c"}
    layout["hovermode"] = "x"
    low, high = ([value + side * 2 * std for value, std in zip(item["value"], item["std"], strict=True)] for side in (-1, 1))
    edge: dict[str, Any] = {"type": "scatter", "mode": "lines", "x": item["at"], "line": {"width": 0}, "hoverinfo": "skip"}
    data = [
        edge | {"y": low, "showlegend": False},
        edge | {"y": high, "fill": "tonexty", "fillcolor": "rgba(140,140,140,0.3)", "name": "two standard errors"},
        {"type": "scatter", "mode": "lines", "name": "unknown function", "x": item["at"], "y": item["value"],
         "line": {"color": ink.simulated, "width": 2.5}},
    ]  # fmt: skip
    return _figure(data, layout)


def rung_errors(rungs: Sequence[Mapping[str, Any]]) -> list[dict[str, float]]:
    """Held-out (else training) error of every rung per signal, in noise floors of the last accepted rung."""
    accepted = [rung for rung in rungs if rung["accepted"]] or list(rungs)
    floors = accepted[-1]["noise_floor"] if accepted else {}
    return [
        {name: value / floors[name] if floors.get(name) else math.inf
         for name, value in (rung["hold_out"] or rung["train"]).items()}
        for rung in rungs
    ]  # fmt: skip


def overall(errors: Mapping[str, float]) -> float:
    """Root mean square over the signals."""
    return math.sqrt(sum(value**2 for value in errors.values()) / len(errors)) if errors else math.inf


def rung_name(rung: Mapping[str, Any]) -> str:
    """What the rung added, or the model it is."""
    if rung["added"]:
        return f"+ {rung['added']}"
    return "base model" if not rung["effects"] else f"model with {', '.join(rung['effects'])}"


def ladder_chart(rungs: Sequence[Mapping[str, Any]], ink: Ink) -> Figure:
    """Every model step, oldest first: error over noise floor on a log axis, accepted filled, rejected open."""
    errors = rung_errors(rungs)
    totals = [overall(item) for item in errors]
    labels = [f"{k + 1}. {rung_name(rung)}" for k, rung in enumerate(rungs)]
    finite = [value for item in errors for value in item.values() if math.isfinite(value) and value > 0] or [1.0]
    low, high = min(0.7, 0.85 * min(finite)), 1.3 * max([*finite, 2.0])
    data: list[dict[str, Any]] = []
    path = [k for k, rung in enumerate(rungs) if rung["accepted"]]
    steps = [(min(totals[k], high), labels[k]) for k in path]
    data.append({"type": "scatter", "mode": "lines", "x": [x for x, _ in steps], "y": [y for _, y in steps],
                 "line": {"color": ACCEPTED, "width": 3, "shape": "vh"}, "showlegend": False, "hoverinfo": "skip"})  # fmt: skip
    for name in sorted({name for item in errors for name in item}):
        mark = PLOTLY_MARKS.get(MARKS.get(name, "o"), "circle-open")
        data.append({"type": "scatter", "mode": "markers", "name": name, "x": [item.get(name) for item in errors],
                     "y": labels, "marker": {"symbol": mark, "size": 9, "color": "#8c8c8c"},
                     "hovertemplate": f"{name}: %{{x:.3g}} noise floors<extra></extra>"})  # fmt: skip
    for words, color, accepted in (("accepted", ACCEPTED, True), ("rejected", REJECTED, False)):
        own = [k for k, rung in enumerate(rungs) if rung["accepted"] == accepted]
        if own:
            data.append({"type": "scatter", "mode": "markers", "name": words, "x": [min(totals[k], high) for k in own],
                         "y": [labels[k] for k in own],
                         "marker": {"size": 17, "color": color, "symbol": "circle" if accepted else "circle-open",
                                    "line": {"width": 3, "color": color}},
                         "hovertemplate": "%{x:.3g} noise floors over all signals<extra></extra>"})  # fmt: skip
    layout = base_layout(ink, f"ladder{len(rungs)}")
    layout["margin"] |= {"l": 230, "r": 190}
    held = any(rung["hold_out"] for rung in rungs)
    title = f"error on {'held-out' if held else 'training'} runs / noise floor (large mark: rms over the signals)"
    layout["xaxis"] = axis_style(ink, title) | log_axis(low, high)
    layout["yaxis"] = axis_style(ink, "") | {"categoryorder": "array", "categoryarray": labels[::-1], "tickfont": {"size": 13},
                                             "range": [-0.6, len(labels) - 0.4]}  # fmt: skip
    layout["shapes"] = [{"type": "rect", "xref": "x", "yref": "paper", "x0": low, "x1": 1, "y0": 0, "y1": 1,
                         "line": {"width": 0}, "fillcolor": "rgba(140,140,140,0.3)", "layer": "below"}]  # fmt: skip
    layout["annotations"] = [
        {"xref": "paper", "x": 1.01, "xanchor": "left", "y": label, "showarrow": False, "font": {"size": 13, "color": ink.text},
         "text": f"{times(total) if math.isfinite(total) else 'diverged'}, {rung['parameters']} parameters"}
        for label, total, rung in zip(labels, totals, rungs, strict=True)
    ]  # fmt: skip
    layout["hovermode"] = "closest"
    return _figure(data, layout)


# --- control ---

_STUDY_LIGHT = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#e69f00", "#56b4e9", "#332288", "#8c8c8c")
_STUDY_DARK = ("#2a94db", "#f0782a", "#14c592", "#e08fd0", "#e6b440", "#9bd7f7", "#a79bf0", "#b5b5b5")
_STUDY_MARKS = ("circle", "square", "diamond", "triangle-up", "x", "star", "cross", "hexagon")
ATMOSPHERE = 101_325.0


def study_chart(results: Sequence[Mapping[str, Any]], reference: str, metric: str, label: str, ink: Ink) -> Figure:
    """A metric of every controller and model over supply pressure; seeds by their root mean square, scaled to ``label``."""
    own = [row for row in results if row["reference"] == reference and row["metrics"] is not None]
    series = list(dict.fromkeys((row["controller"], row["model"]) for row in own))
    models = list(dict.fromkeys(model for _, model in series))
    controllers = list(dict.fromkeys(controller for controller, _ in series))
    colors = _STUDY_DARK if ink is DARK else _STUDY_LIGHT
    data = []
    for controller, model in series:
        rows = [row for row in own if (row["controller"], row["model"]) == (controller, model)]
        supplies = sorted({row["supply"] for row in rows})
        k = controllers.index(controller) % len(colors)
        values = [_rms([row["metrics"].get(metric) for row in rows if row["supply"] == supply]) for supply in supplies]
        data.append({"type": "scatter", "mode": "lines+markers", "x": [(supply - ATMOSPHERE) / 1e5 for supply in supplies],
                     "y": values, "name": controller if len(models) < 2 else f"{controller}, {model}",
                     "line": {"color": colors[k], "width": 2, "dash": "solid" if model == models[0] else "dash"},
                     "marker": {"size": 9, "symbol": _STUDY_MARKS[k]}})  # fmt: skip
    layout = base_layout(ink, f"study {reference} {metric}")
    layout["legend"] = {"x": 1.01, "y": 1.0, "font": {"size": 13}}
    layout["margin"] |= {"r": 320}
    at = sorted({(row["supply"] - ATMOSPHERE) / 1e5 for row in own})
    layout["xaxis"] = axis_style(ink, "supply pressure (bar gauge)") | {
        "tickvals": at, "ticktext": [f"{value:.3g}" for value in at],
    }  # fmt: skip
    layout["yaxis"] = axis_style(ink, label) | _study_axis(data)
    layout["hovermode"] = "closest"
    return _figure(data, layout)


def _study_axis(data: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    good = [value for trace in data for value in trace["y"] if value] or [0.1, 1.0]
    return log_axis(0.8 * min(good), 1.25 * max(good))


def _rms(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return 1e3 * math.sqrt(sum(value**2 for value in known) / len(known)) if known else None
