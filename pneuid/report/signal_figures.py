"""Pictures of signals: measured beside predicted, the error against each signal, the error beside the noise floor."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pneuid.criticism.comparison.comparison import Comparison, SignalError
from pneuid.criticism.prediction.horizons import AHEAD_SECONDS, Prediction
from pneuid.plant import Plant
from pneuid.report import style
from pneuid.report.quantities import number, times
from pneuid.report.signal_units import axis_label, error_unit, shown
from pneuid.report.style import new_figure, plain, plain_log, quiet_grid, styled, thinned, ticks
from pneuid.signals import PRESSURES, SIGNALS

MAP_POINTS = 6000
"""Points of a residual map; more would only darken it."""

ZOOM_SECONDS, ZOOM_SHARE = 1.0, 0.06
"""Length of the enlarged stretch: at least so many seconds and so much of the run."""

LEAST_PRESSURE_RANGE = 10.0e3
"""A pressure that varies less than this is no axis worth drawing, Pa."""


def errors_of(comparison: Comparison, role: str) -> dict[str, SignalError]:
    """Errors per signal of one role; of the other where there are none."""
    chosen, other = comparison.train, comparison.hold_out
    if role == "hold_out":
        chosen, other = other, chosen
    return chosen or other


def role_word(comparison: Comparison, role: str) -> str:
    """``held-out``, ``training``, or ``compared`` for runs that the model was not fitted on."""
    if role == "hold_out":
        return "held-out"
    fitted = {item.sha256 for item in comparison.model.data if item.role == "train"}
    own = {
        item.run.recording.sha256 for item, r in zip(comparison.predictions, comparison.roles, strict=True) if r == role
    }
    return "training" if not fitted or not own or own & fitted else "compared"


def telling_run(comparison: Comparison) -> int:
    """Number of the prediction with the largest error in noise floors, a held-out one where there is one."""
    held = [k for k, role in enumerate(comparison.roles) if role == "hold_out"]
    candidates = [k for k in held or range(len(comparison.roles)) if comparison.predictions[k].index.size]
    if not candidates:
        return 0
    return max(candidates, key=lambda k: _misfit(comparison, k).mean())


def worst_span(comparison: Comparison, run: int) -> tuple[float, float]:
    """The stretch (s) of one run in which the error in noise floors is largest: 1 s, longer in a long run."""
    item = comparison.predictions[run]
    t = item.run.t[item.index]
    seconds = max(ZOOM_SECONDS, ZOOM_SHARE * float(item.run.t[-1] - item.run.t[0]))
    if t.size < 2 or t[-1] - t[0] <= seconds:
        return float(item.run.t[0]), float(item.run.t[-1])
    total = np.concatenate([[0.0], np.cumsum(_misfit(comparison, run))])
    last = np.searchsorted(t, t + seconds, side="right")
    inside = np.flatnonzero(t + seconds <= t[-1] + 1e-9)
    best = int(inside[np.argmax(total[last[inside]] - total[inside])])
    return float(t[best]), float(t[best] + seconds)


def _misfit(comparison: Comparison, run: int) -> np.ndarray:
    """Squared error over noise floor squared, summed over signals (N,); masked samples count nothing."""
    item = comparison.predictions[run]
    floors = errors_of(comparison, comparison.roles[run])
    total = np.zeros(item.index.size)
    for i, signal in enumerate(item.run.outputs):
        total += np.nan_to_num(item.error[i] / _positive(floors[signal].noise_floor), posinf=1e6, neginf=-1e6) ** 2
    return total


def _positive(floor: float) -> float:
    return floor if np.isfinite(floor) and floor > 0 else 1.0


# --- overlay ---


@styled
def overlay(
    comparison: Comparison,
    run: int | None = None,
    span: tuple[float, float] | None = None,
    mark: tuple[float, float] | None = None,
) -> Figure:
    """Measured and predicted signals of one run, each with its error beneath; the command or speed at the bottom.

    run : number of the prediction, the most telling one if None; span : from and to in s, the whole run if None;
    mark : a stretch (s) to shade.
    """
    k = telling_run(comparison) if run is None else run
    ahead, free = comparison.predictions[k], comparison.free[k]
    outputs, patm = ahead.run.outputs, comparison.model.rig.patm
    floors = errors_of(comparison, comparison.roles[k])
    t0, t1 = span or (float(ahead.run.t[0]), float(ahead.run.t[-1]))
    figure = new_figure(2.35 * len(outputs) + 1.5)
    axes = figure.subplots(2 * len(outputs) + 1, 1, sharex=True, height_ratios=[*([3.0, 1.3] * len(outputs)), 1.0])
    for i, signal in enumerate(outputs):
        _trace(axes[2 * i], ahead, free, i, patm, (t0, t1))
        _error_strip(axes[2 * i + 1], ahead, i, floors[signal].noise_floor, (t0, t1))
    _context(axes[-1], ahead, (t0, t1), patm)
    axes[-1].set_xlabel("t (s)")
    axes[-1].set_xlim(t0, t1)
    figure.align_ylabels(axes)
    if mark is not None:
        for panel in axes:
            panel.axvspan(*mark, color="#faf3dc", lw=0, zorder=0)
    stretch = f", {t0:.2f} s to {t1:.2f} s" if span else ""
    axes[0].set_title(f"{plain(ahead.run.name)}, {role_word(comparison, comparison.roles[k])} run{stretch}")
    figure.legend(handles=_overlay_legend(ahead is free), loc="outside upper left", ncols=5)
    return figure


def _overlay_legend(same: bool) -> list[Line2D | Patch]:
    predicted = "predicted, whole run" if same else f"predicted {1e3 * AHEAD_SECONDS:.0f} ms ahead"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=style.MEASURED, lw=1.6, label="measured"),
        Line2D([], [], color=style.SIMULATED, label=predicted),
    ]
    if not same:
        handles.append(Line2D([], [], color=style.FREE_RUN, ls="--", label="free run"))
    handles.append(Line2D([], [], color=style.RESIDUAL, label="error: measured − predicted"))
    handles.append(Patch(color=style.FLOOR, alpha=0.35, label=f"± {style.FLOOR_BAND:.0f} × noise floor"))
    return handles


def _trace(axes: Axes, ahead: Prediction, free: Prediction, i: int, patm: float, span: tuple[float, float]) -> None:
    signal = ahead.run.outputs[i]

    def draw(item: Prediction, y: np.ndarray, color: str, width: float, order: int, style: str = "-") -> np.ndarray:
        t = item.run.t[item.index]
        near = (t >= span[0] - 0.05) & (t <= span[1] + 0.05)
        values = shown(signal, y[near], patm)
        axes.plot(*thinned(t[near], values), style, color=color, lw=width, zorder=order)
        return np.asarray(values)

    measured = draw(free, np.where(free.used[i], free.measured[i], np.nan), style.MEASURED, 1.6, 2)
    near = draw(ahead, _broken(ahead, ahead.predicted[i]), style.SIMULATED, 1.1, 4)
    if free is not ahead:
        draw(free, free.predicted[i], style.FREE_RUN, 1.0, 3, "--")
    # the frame is for measured and predicted; a free run that leaves it is seen to leave
    both = np.concatenate([measured, near])
    both = both[np.isfinite(both)]
    if both.size:
        margin = 0.06 * max(float(np.ptp(both)), 1e-9) + 1e-12
        lowest, highest = float(both.min()) - 2 * margin, float(both.max()) + 2 * margin
        axes.set_ylim(lowest, highest)
    axes.set_ylabel(axis_label(signal))
    axes.yaxis.set_major_locator(ticks(4))


def _broken(item: Prediction, y: np.ndarray) -> np.ndarray:
    """Predictions with a gap at the start of each window, where a new start state is taken."""
    t = item.run.t[item.index]
    if item.index.size < 2 or item.index.size == item.run.n:
        return y
    windows = max(1, round((t[-1] - t[0]) / AHEAD_SECONDS))
    found = y.astype(float).copy()
    found[:: max(1, item.index.size // windows)] = np.nan
    return found


def _error_strip(axes: Axes, ahead: Prediction, i: int, floor: float, span: tuple[float, float]) -> None:
    signal = ahead.run.outputs[i]
    t = ahead.run.t[ahead.index]
    inside = (t >= span[0] - 0.05) & (t <= span[1] + 0.05)
    error = np.where(np.isfinite(ahead.error[i]), ahead.error[i], np.nan)[inside]
    size = float(np.nanmax(np.abs(error))) if np.isfinite(error).any() else _positive(floor)
    unit = error_unit(signal, size)
    if np.isfinite(floor):
        band = style.FLOOR_BAND * floor * unit.factor
        axes.axhspan(-band, band, color=style.FLOOR, alpha=0.35, lw=0, zorder=1)
    axes.plot(
        *thinned(t[inside], _broken_like(ahead, error, inside) * unit.factor), color=style.RESIDUAL, lw=0.9, zorder=3
    )
    reach = 1.1 * max(size, style.FLOOR_BAND * floor if np.isfinite(floor) else 0.0) * unit.factor
    axes.set_ylim(-reach, reach)
    axes.yaxis.set_major_locator(ticks(3))
    axes.set_ylabel(f"error\n({unit.unit})")


def _frame(error: np.ndarray, band: float, most: float = 100.0) -> tuple[float, float]:
    """Limits that hold ``most`` percent of the errors, the noise band and zero."""
    good = error[np.isfinite(error)]
    low, high = np.percentile(good, [100.0 - most, most]) if good.size else (0.0, 0.0)
    band = band if np.isfinite(band) and band > 0 else 1e-12
    low, high = min(float(low), -band), max(float(high), band)
    return low - 0.08 * (high - low), high + 0.08 * (high - low)


def _broken_like(item: Prediction, error: np.ndarray, inside: np.ndarray) -> np.ndarray:
    gaps = np.isnan(_broken(item, np.zeros(item.index.size)))[inside]
    return np.where(gaps, np.nan, error)


def _context(axes: Axes, ahead: Prediction, span: tuple[float, float], patm: float) -> None:
    run = ahead.run
    signal = "u" if "u" in run.inputs else "v"
    near = (run.t >= span[0] - 0.05) & (run.t <= span[1] + 0.05)
    axes.plot(*thinned(run.t[near], shown(signal, run.input(signal)[near], patm)), color=style.NEUTRAL, lw=1.1)
    axes.set_ylabel(axis_label(signal))
    axes.yaxis.set_major_locator(ticks(3))


# --- residual map ---


@styled
def residual_map(comparison: Comparison) -> Figure:
    """Error of every output against speed, position and pressures, with its mean over bins and the noise band."""
    items, floors = _judged(comparison)
    plant, patm = comparison.model.plant, comparison.model.rig.patm
    against = _map_features(items, plant)
    outputs = plant.outputs
    figure = new_figure(2.3 * len(outputs) + 0.5)
    axes = figure.subplots(len(outputs), len(against), squeeze=False, sharex="col", sharey="row")
    thin = 1 + sum(item.index.size for item in items) // MAP_POINTS
    for i, signal in enumerate(outputs):
        error = np.concatenate([item.error[i, ::thin] for item in items])
        good = error[np.isfinite(error)]
        # a few spikes shall not hide the rest: the frame holds 99.5 % of the samples
        size = float(np.percentile(np.abs(good), 99.5)) if good.size else 1.0
        unit = error_unit(signal, size)
        for j, name in enumerate(against):
            values = shown(name, np.concatenate([_feature(item, name)[::thin] for item in items]), patm)
            _map_panel(axes[i, j], values, error * unit.factor, floors[signal].noise_floor * unit.factor)
            axes[-1, j].set_xlabel(axis_label(name))
        band = style.FLOOR_BAND * floors[signal].noise_floor * unit.factor
        axes[i, 0].set_ylim(*_frame(error * unit.factor, band, 99.8))
        axes[i, 0].set_ylabel(f"{SIGNALS[signal].symbol} error ({unit.unit})")
    handles = [
        Line2D([], [], color=style.RESIDUAL, marker=".", ls="", alpha=0.6, label="error of one sample"),
        Line2D([], [], color=style.MEASURED, lw=1.6, label="mean of bins"),
        Patch(color=style.FLOOR, alpha=0.35, label=f"± {style.FLOOR_BAND:.0f} × noise floor"),
    ]
    figure.align_ylabels(axes[:, 0])
    figure.legend(handles=handles, loc="outside upper left", ncols=3)
    return figure


def _judged(comparison: Comparison) -> tuple[list[Prediction], dict[str, SignalError]]:
    """Held-out predictions with samples, else those of training runs, and their errors."""
    by_role: dict[str, list[Prediction]] = {"hold_out": [], "train": []}
    for item, role in zip(comparison.predictions, comparison.roles, strict=True):
        if item.index.size:
            by_role[role].append(item)
    role = "hold_out" if by_role["hold_out"] else "train"
    return by_role[role], errors_of(comparison, role)


def _feature(item: Prediction, name: str) -> np.ndarray:
    run = item.run
    if name in ("x", "v"):
        values = run.input("v") if name == "v" and "v" in run.inputs else getattr(run.motion, name)
    else:
        values = run.input(name) if name in run.inputs else run.recording.signals[name]
    return np.asarray(values[item.index])


def _map_features(items: list[Prediction], plant: Plant) -> list[str]:
    """Signals worth an axis: those that vary."""
    names = ("v", "x", "p1", "p2", "u") if plant.servo else ("v", "x", "p1", "p2")
    found = []
    for name in names:
        if name in PRESSURES and not all(name in item.run.recording.signals for item in items):
            continue
        values = np.concatenate([_feature(item, name) for item in items] or [np.zeros(1)])
        low, high = np.percentile(values, [1, 99])
        # a regulated pressure only shows its sensor's noise
        if high - low > (LEAST_PRESSURE_RANGE if name in PRESSURES else 1e-9):
            found.append(name)
    return found or ["v"]


def _map_panel(axes: Axes, values: np.ndarray, error: np.ndarray, floor: float) -> None:
    if np.isfinite(floor):
        axes.axhspan(-style.FLOOR_BAND * floor, style.FLOOR_BAND * floor, color=style.FLOOR, alpha=0.35, lw=0, zorder=1)
    axes.plot(values, error, ".", color=style.RESIDUAL, ms=1.6, alpha=0.25, rasterized=True, zorder=2)
    good = np.isfinite(error)
    low, high = np.percentile(values, [0.5, 99.5])
    edges = np.linspace(float(low), float(high), 25)
    if good.sum() > 50 and edges[-1] > edges[0]:
        which = np.clip(np.digitize(values[good], edges) - 1, 0, 23)
        count = np.bincount(which, minlength=24)
        mean = np.bincount(which, error[good], minlength=24) / np.maximum(count, 1)
        centre = 0.5 * (edges[1:] + edges[:-1])
        axes.plot(centre, np.where(count >= 8, mean, np.nan), color=style.MEASURED, lw=1.6, zorder=4)
    axes.xaxis.set_major_locator(ticks(4))
    axes.yaxis.set_major_locator(ticks(5))


# --- errors ---


@styled
def errors_bar(comparison: Comparison) -> Figure:
    """Error over noise floor per signal on training and held-out runs (bars) and in free run (marks), log axis."""
    roles = [role for role, found in (("train", comparison.train), ("hold_out", comparison.hold_out)) if found]
    outputs = comparison.model.plant.outputs
    rows = [(signal, role) for signal in outputs for role in roles]
    figure = new_figure(1.1 + 0.34 * len(rows))
    axes = figure.subplots()
    # the two roles of a signal stand together
    at = [k + 0.6 * (k // max(len(roles), 1)) for k in range(len(rows))]
    reached = [1.0]
    for y, (signal, role) in zip(at, rows, strict=True):
        reached += _error_row(axes, y, signal, errors_of(comparison, role)[signal], role)
    axes.axvline(1.0, color=style.FLOOR, lw=2.5, zorder=1)
    axes.set_xscale("log")
    axes.set_xlim(0.85 * min(reached), max(1.25 * max(reached), 3.0))
    plain_log(axes.xaxis)
    words = {role: role_word(comparison, role) for role in roles}
    axes.set_yticks(at, [f"{SIGNALS[signal].symbol}, {words[role]}" for signal, role in rows])
    axes.set_ylim(len(rows) + 0.6 * len(outputs) - 0.9, -0.7)
    axes.set_xlabel("error / noise floor (both rms)")
    quiet_grid(axes, "x")
    figure.legend(handles=_error_legend(words, comparison.model.plant.servo), loc="outside upper left", ncols=4)
    return figure


_ROLE_COLOR = {"train": style.NEUTRAL, "hold_out": style.SIMULATED}


def _error_legend(words: dict[str, str], servo: bool) -> list[Line2D]:
    def dot(color: str, label: str) -> Line2D:
        return Line2D([], [], color=color, marker="o", ms=8, lw=3, label=label)

    handles = [dot(_ROLE_COLOR[role], f"{word} runs") for role, word in words.items()]
    if servo:
        handles.append(Line2D([], [], color=style.FREE_RUN, marker="|", ms=12, mew=2.5, ls="", label="free run"))
    return [*handles, Line2D([], [], color=style.FLOOR, lw=2.5, label="noise floor")]


def _error_row(axes: Axes, y: float, signal: str, item: SignalError, role: str) -> list[float]:
    """One mark on its stem from the noise floor, with its words at the right; returns the ratios drawn."""
    floor = _positive(item.noise_floor)
    color = _ROLE_COLOR[role]
    drawn = []
    words = "diverged"
    if np.isfinite(item.rmse):
        drawn.append(item.rmse / floor)
        axes.plot([1.0, drawn[0]], [y, y], color=color, lw=3, zorder=2, solid_capstyle="butt")
        axes.plot(drawn[0], y, "o", color=color, ms=8, zorder=4)
        unit = error_unit(signal, item.rmse)
        words = f"{number(item.rmse * unit.factor)} {unit.unit} = {times(drawn[0])}"
    if item.free_run_rmse != item.rmse:
        if np.isfinite(item.free_run_rmse):
            drawn.append(item.free_run_rmse / floor)
            axes.plot(drawn[-1], y, "|", color=style.FREE_RUN, ms=12, mew=2.5, zorder=3)
            unit = error_unit(signal, item.free_run_rmse)
            words += f"; free run {number(item.free_run_rmse * unit.factor)} {unit.unit}"
        else:
            words += "; free run diverged"
    axes.text(1.01, y, words, transform=axes.get_yaxis_transform(), va="center", fontsize=8.5)
    return drawn
