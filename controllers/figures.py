"""Figures of a study; the only module of the controllers that draws."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from controllers.grid import Result
from controllers.registry import CONTROLLERS

_COLOURS = dict(zip(CONTROLLERS, mpl.colormaps["tab10"].colors, strict=False))  # type: ignore[attr-defined]
_HATCHES = ("", "//", "..", "xx")


def draw_errors(axes: Axes, results: Sequence[Result], reference: str, patm: float) -> Axes:
    """Bars of the RMS error on one reference, by supply pressure; one bar per controller and model, log scale."""
    chosen = [result for result in results if result.reference == reference]
    supplies = sorted({result.supply for result in chosen})
    pairs = list(dict.fromkeys((result.controller, result.model) for result in chosen))
    models = list(dict.fromkeys(model for _, model in pairs))
    width = 0.8 / len(pairs)
    for i, (controller, model) in enumerate(pairs):
        heights = [_rms(chosen, controller, model, supply) for supply in supplies]
        label = CONTROLLERS[controller].label if len(models) == 1 else f"{CONTROLLERS[controller].label}, {model}"
        axes.bar(
            np.arange(len(supplies)) + (i + 0.5) * width - 0.4, heights, width, label=label,
            color=_COLOURS[controller], hatch=_HATCHES[models.index(model) % len(_HATCHES)], edgecolor="white",
        )  # fmt: skip
    axes.set_xticks(range(len(supplies)), [f"{(supply - patm) / 1e5:.0f}" for supply in supplies])
    axes.set(yscale="log", title=reference, xlabel="supply pressure [bar gauge]", ylabel="RMS tracking error [mm]")
    axes.grid(visible=True, axis="y", alpha=0.3)
    return axes


def draw_tracking(axes: Sequence[Axes], results: Sequence[Result]) -> Sequence[Axes]:
    """Position, error and command over time of the given loops, one below the other (three axes)."""
    for result in results:
        run, colour = result.run, _COLOURS[result.controller]
        if run is None:
            continue
        axes[0].plot(run.t, run.x * 1e3, color=colour, lw=1.0)
        axes[1].plot(run.t, run.error * 1e3, color=colour, lw=1.0, label=CONTROLLERS[result.controller].label)
        axes[2].plot(run.t, run.u, color=colour, lw=0.6)
    shown = next((result.run for result in results if result.run is not None), None)
    if shown is not None:
        axes[0].plot(shown.t, shown.reference[:, 0] * 1e3, "k--", lw=0.8, label="reference")
        axes[0].legend(loc="upper right", fontsize="small")
    axes[0].set_ylabel("x [mm]")
    axes[1].set_ylabel("error [mm]")
    axes[2].set(ylabel="u [V]", xlabel="t [s]")
    # a log-like scale: the baselines' millimetres and the best controllers' hundredths in one picture
    axes[1].set_yscale("symlog", linthresh=0.1)
    axes[1].legend(loc="upper right", fontsize="x-small", ncols=3)
    return axes


def save_figures(results: Sequence[Result], title: str, design_supply: float, patm: float, folder: Path) -> list[Path]:
    """Write ``errors.png`` and one ``tracking_*.png`` per model (the busiest reference, at the supply nearest the
    design's) into ``folder``; returns the paths."""
    references = list(dict.fromkeys(result.reference for result in results))
    columns = min(3, len(references))
    rows = -(-len(references) // columns)
    figure = Figure(figsize=(5.0 * columns, 3.6 * rows + 0.8), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes, reference in zip(grid, references, strict=False):
        draw_errors(axes, results, reference, patm)
    for axes in grid[len(references) :]:
        axes.set_visible(False)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")
    figure.suptitle(title)
    paths = [folder / "errors.png"]
    figure.savefig(paths[0], dpi=130)
    for number, model in enumerate(dict.fromkeys(result.model for result in results), start=1):
        paths.append(folder / f"tracking_{number}.png")
        _tracking(results, model, design_supply, patm).savefig(paths[-1], dpi=130)
    return paths


def errors_figure(results: Sequence[Result], patm: float) -> Figure:
    """RMS error by supply pressure, one panel per reference, one legend."""
    references = list(dict.fromkeys(result.reference for result in results))
    figure = Figure(figsize=(11.0, 5.0), layout="constrained")
    for axes, reference in zip(figure.subplots(1, len(references), squeeze=False)[0], references, strict=True):
        draw_errors(axes, results, reference, patm)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize="small")
    return figure


def _tracking(results: Sequence[Result], model: str, design_supply: float, patm: float) -> Figure:
    own = [result for result in results if result.model == model and result.run is not None]
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    if not own:
        return figure
    supply = min((result.supply for result in own), key=lambda value: abs(value - design_supply))
    busiest = max(own, key=lambda result: float(np.sum(np.abs(result.run.reference[:, 3])))).reference  # type: ignore[union-attr]
    seed = own[0].seed
    chosen = [r for r in own if (r.supply, r.reference, r.seed) == (supply, busiest, seed)]
    draw_tracking(axes, chosen)
    figure.suptitle(f"{busiest}, {(supply - patm) / 1e5:.0f} bar gauge, model: {model}")
    return figure


def _rms(results: Sequence[Result], controller: str, model: str, supply: float) -> float:
    """RMS error in mm over the seeds; NaN when none of the loops survived."""
    chosen = [r for r in results if (r.controller, r.model, r.supply) == (controller, model, supply)]
    squares = [r.metrics.rms**2 for r in chosen if r.metrics is not None]
    return 1e3 * float(np.sqrt(np.mean(squares))) if squares else float("nan")
