"""Figures of a study; the only module of the controllers, beside the export's, that draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from controllers.candidates import WITH, WITHOUT
from controllers.grid import Result
from controllers.registry import CONTROLLERS
from controllers.tables import chosen, label_of, largest, rms, variants

_PALETTE = ("#8c8c8c", "#e69f00", "#009e73", "#d62728", "#b48ade", "#1f4e9c")
_COLOURS = dict(zip(CONTROLLERS, _PALETTE, strict=True))
_HATCHES = ("", "///", "...", "xxx")
_HEAT = LinearSegmentedColormap.from_list("heat", ["#7cc58d", "#f7f3c4", "#e8735a"])
_DASHES = ("-", "--", ":", "-.")
DPI = 110


def _models(results: Sequence[Result]) -> list[str]:
    return list(dict.fromkeys(result.model for result in results))


def _bars(supplies: Sequence[float], patm: float) -> list[str]:
    return [f"{(supply - patm) / 1e5:.0f}" for supply in supplies]


def draw_errors(axes: Axes, results: Sequence[Result], reference: str, patm: float) -> Axes:
    """Bars of the RMS error on one reference, by supply pressure; one bar per controller and model, log scale."""
    own = chosen(results, reference=reference)
    supplies = sorted({result.supply for result in own})
    pairs, models = variants(own), _models(own)
    width = 0.84 / len(pairs)
    for i, (controller, model) in enumerate(pairs):
        heights = [_finite(rms(chosen(own, controller=controller, model=model, supply=at))) for at in supplies]
        axes.bar(
            np.arange(len(supplies)) + (i + 0.5) * width - 0.42, heights, width, label=label_of(results, controller, model),
            color=_COLOURS[controller], hatch=_HATCHES[models.index(model) % len(_HATCHES)], edgecolor="white", linewidth=0.4,
        )  # fmt: skip
    axes.set_xticks(range(len(supplies)), _bars(supplies, patm))
    axes.set(yscale="log", title=reference, xlabel="supply pressure [bar gauge]", ylabel="RMS tracking error [mm]")
    _plain_ticks(axes.yaxis)
    axes.grid(visible=True, axis="y", alpha=0.3)
    return axes


def _plain_ticks(axis: Axis) -> None:
    """A log axis marked 0.1, 0.2, 0.5, 1 and so on; no words for what lies between."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_formatter(NullFormatter())


def _finite(value: float) -> float:
    return value if np.isfinite(value) else float("nan")


def draw_tracking(axes: Sequence[Axes], results: Sequence[Result]) -> Sequence[Axes]:
    """Position, error and command over time of the given loops, one below the other (three axes)."""
    models = _models(results)
    for result in results:
        run = result.run
        if run is None:
            continue
        style: dict[str, Any] = {
            "color": _COLOURS[result.controller],
            "ls": _DASHES[models.index(result.model) % len(_DASHES)],
        }
        axes[0].plot(run.t, run.x * 1e3, lw=1.0, **style)
        axes[1].plot(run.t, run.error * 1e3, lw=1.0, label=label_of(results, result.controller, result.model), **style)
        axes[2].plot(run.t, run.u, lw=0.6, **style)
    known = next((result.run for result in results if result.run is not None), None)
    if known is not None:
        axes[0].plot(known.t, known.reference[:, 0] * 1e3, "k--", lw=0.8, label="reference")
        axes[0].legend(loc="upper right", fontsize="small")
    axes[0].set_ylabel("x [mm]")
    # a log-like scale: the baselines' millimetres and the best controllers' hundredths in one picture
    axes[1].set_yscale("symlog", linthresh=0.1)
    axes[1].set_ylabel("error [mm]")
    axes[2].set(ylabel="u [V]", xlabel="t [s]")
    return axes


def errors_figure(results: Sequence[Result], patm: float, title: str = "") -> Figure:
    """RMS error by supply pressure under the first condition, one panel per reference, one legend."""
    first = chosen(results, condition=results[0].condition)
    references = list(dict.fromkeys(result.reference for result in first))
    columns = min(3, len(references))
    rows = -(-len(references) // columns)
    figure = Figure(figsize=(4.6 * columns, 3.2 * rows + 1.0), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    for axes, reference in zip(grid, references, strict=False):
        draw_errors(axes, first, reference, patm)
        axes.label_outer()
    for axes in grid[len(references) :]:
        axes.set_visible(False)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, columns + 1), fontsize="small")
    figure.suptitle(title)
    return figure


def tracking_figure(results: Sequence[Result], patm: float) -> Figure:
    """The loops whose signals were kept, over each other."""
    drawn = [result for result in results if result.run is not None]
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    if drawn:
        draw_tracking(axes, drawn)
        figure.suptitle(f"{drawn[0].reference}, {(drawn[0].supply - patm) / 1e5:.0f} bar gauge, {drawn[0].condition}")
        handles, labels = axes[1].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
    return figure


def draw_map(axes: Axes, values: np.ndarray, rows: Sequence[str], columns: Sequence[str], digits: int) -> Axes:
    """Numbers ``(rows, columns)`` on a logarithmic colour scale, red is bad; a loop that diverged is black."""
    known = values[np.isfinite(values) & (values > 0.0)]
    axes.set_facecolor("black")
    if known.size:
        low, high = float(known.min()), float(max(known.max(), 1.001 * known.min()))
        axes.imshow(np.ma.masked_invalid(values), cmap=_HEAT, norm=LogNorm(low, high), aspect="auto")
    for i, j in np.ndindex(values.shape):
        words = f"{values[i, j]:.{digits}f}" if np.isfinite(values[i, j]) else "-"
        axes.text(j, i, words, ha="center", va="center", fontsize=8, color="black" if words != "-" else "white")
    axes.set_xticks(range(len(columns)), columns, rotation=25, ha="right", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    return axes


def heat_map(
    results: Sequence[Result], title: str, measure: Callable[[Sequence[Result]], float], digits: int
) -> Figure:
    """``measure`` per condition and controller."""
    conditions = list(dict.fromkeys(result.condition for result in results))
    pairs = variants(results)
    values = np.array(
        [[measure(chosen(results, condition=c, controller=a, model=m)) for a, m in pairs] for c in conditions]
    )
    figure = Figure(figsize=(2.6 + 1.15 * len(pairs), 1.9 + 0.34 * len(conditions)), layout="constrained")
    draw_map(figure.subplots(), values, conditions, [label_of(results, *pair) for pair in pairs], digits)
    figure.suptitle(title, fontsize=10)
    return figure


def pressure_figure(results: Sequence[Result], patm: float) -> Figure:
    """Uniformity and effort: RMS error over the supply, and over the valve's movement, first condition."""
    first = chosen(results, condition=results[0].condition)
    supplies, models = sorted({result.supply for result in first}), _models(first)
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for controller, model in variants(first):
        own = chosen(first, controller=controller, model=model)
        errors = [_finite(rms(chosen(own, supply=at))) for at in supplies]
        efforts = [
            _finite(float(np.mean([r.metrics.travel for r in chosen(own, supply=at) if r.metrics]))) for at in supplies
        ]
        style = {
            "color": _COLOURS[controller],
            "ls": _DASHES[models.index(model) % len(_DASHES)],
            "marker": "o",
            "ms": 4,
        }
        left.plot([(at - patm) / 1e5 for at in supplies], errors, label=label_of(first, controller, model), **style)
        right.plot(efforts, errors, **style)
    left.set(yscale="log", xlabel="supply pressure [bar gauge]", ylabel="RMS error over all references [mm]")
    left.set_xticks([(at - patm) / 1e5 for at in supplies], _bars(supplies, patm))
    _plain_ticks(left.yaxis)
    right.set_xscale("log")
    _plain_ticks(right.xaxis)
    right.set(xlabel="valve movement, mean over references [V/s]")
    for axes in (left, right):
        axes.grid(visible=True, which="both", alpha=0.25)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")
    return figure


def price_figure(results: Sequence[Result], patm: float) -> Figure:
    """One panel per controller: error without (hollow) and with (filled) each effect in its model, by supply."""
    effects = list(dict.fromkeys(result.condition for result in results))
    controllers = list(dict.fromkeys(result.controller for result in results))
    supplies = sorted({result.supply for result in results})
    figure = Figure(figsize=(5.2 * len(controllers), 2.1 + 0.42 * len(effects)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(controllers), sharex=True, sharey=True))
    colours = mpl.colormaps["viridis"](np.linspace(0.15, 0.85, len(supplies)))
    for axes, controller in zip(panels, controllers, strict=True):
        for i, effect in enumerate(effects):
            here = chosen(results, condition=effect, controller=controller)
            for j, supply in enumerate(supplies):
                at = i + 0.24 * (j - 0.5 * (len(supplies) - 1))
                was, now = (_finite(rms(chosen(here, supply=supply, model=w + effect))) for w in (WITHOUT, WITH))
                axes.plot([was, now], [at, at], color=colours[j], lw=1.2)
                axes.plot(was, at, "o", mfc="white", mec=colours[j], ms=6)
                label = f"{(supply - patm) / 1e5:.0f} bar" if i == 0 else None
                axes.plot(now, at, "o", color=colours[j], ms=5, label=label)
        axes.set(
            xscale="log", title=CONTROLLERS[controller].label, xlabel="RMS error [mm]; hollow: effect not in the model"
        )
        _plain_ticks(axes.xaxis)
        axes.set_yticks(range(len(effects)), effects)
        axes.grid(visible=True, which="both", axis="x", alpha=0.25)
    panels[0].invert_yaxis()
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(supplies), fontsize="small"
    )
    return figure


def save_figures(results: Sequence[Result], title: str, patm: float, folder: Path) -> list[Path]:
    """Write the pictures that the results allow into ``folder``; returns the paths."""
    figures: dict[str, Figure] = {}
    if any(result.model.startswith(WITHOUT) for result in results):
        figures["prices"] = price_figure(results, patm)
    else:
        figures = {
            "errors": errors_figure(results, patm, title), "tracking": tracking_figure(results, patm),
            "pressure": pressure_figure(results, patm),
        }  # fmt: skip
        if len({result.condition for result in results}) > 1:
            figures["conditions"] = heat_map(results, "RMS error [mm] over supplies, references and seeds", rms, 3)
            figures["standstill"] = heat_map(
                results, "Worst standstill motion, peak to peak [um]", lambda r: largest(r, lambda m: m.wander, 1e6), 0
            )
    paths = []
    for name, figure in figures.items():
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=80 if name == "tracking" else DPI)  # noise does not compress
    return paths
