"""Pictures of what the numbers are worth: the correlation map of a fit, and the pressure laws of friction with their band."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from pneuid.criticism.comparison.comparison import Comparison, Spread
from pneuid.criticism.comparison.trust import NORMAL_95, STRONG, trust
from pneuid.model import Model
from pneuid.report import style
from pneuid.report.quantities import fixed, handy
from pneuid.report.signal_units import axis_label, shown
from pneuid.report.style import new_figure, plain, styled, ticks

_DIVERGING = LinearSegmentedColormap.from_list("correlation", ["#b35806", "#fdb863", "#ffffff", "#80b1d3", "#08519c"])
"""Orange through white to blue: told apart under every common colour blindness, equal in grey at equal strength."""

MOST_PARAMETERS = 26
"""Parameters beyond this number are left out of the map, those with the weakest correlations first."""

_TERM = re.compile(r"((?:1/)?[^\W\d_]+)(?:_([A-Za-z0-9]+)|([0-9]+))?")
"""One term of a symbol: letters, then an index behind a line or digits."""

DP_ROUND = 10.0e3
"""Pressure differences of the laws' curves are rounded to this, Pa."""

LAW_POINTS = 60

LEAST_CHANGE = 1e-3
"""Relative change over the pressures below which a coefficient does not depend on them."""


def symbol(text: str) -> str:
    """A declared symbol such as ``F_c``, ``σ0``, ``F_s - F_c`` or ``k1 (dFc/dps)`` as mathematics, else as it stands."""
    head, _, _ = text.partition(" (")
    terms = [_TERM.fullmatch(word) for word in head.split(" - ")]
    shown_terms = [
        f"{found[1]}_{{\\mathrm{{{found[2] or found[3]}}}}}" if found[2] or found[3] else found[1] for found in terms if found
    ]
    return f"${' - '.join(shown_terms)}$" if all(terms) else plain(text, 16)


# --- correlation ---


def mapped(spread: Spread) -> list[int]:
    """Numbers of the parameters that the map shows: those with a standard error, the most correlated of too many."""
    free = [k for k, std in enumerate(spread.std) if std > 0.0]
    if len(free) <= MOST_PARAMETERS:
        return free
    strength = np.abs(spread.correlation[np.ix_(free, free)] - np.eye(len(free))).max(axis=1)
    kept = np.sort(np.argsort(-strength)[:MOST_PARAMETERS])
    return [free[k] for k in kept]


@styled
def correlation_map(model: Model, spread: Spread) -> Figure:
    """Correlation of the parameters' errors, lower triangle, every value printed; strong pairs are framed."""
    chosen = mapped(spread)
    symbols = dict(zip(model.values, (item.symbol for item in trust(model)), strict=True))
    names = [spread.names[k] for k in chosen]
    r = spread.correlation[np.ix_(chosen, chosen)]
    n = len(chosen)
    figure = new_figure(1.2 + max(0.36 * n, 1.6))
    axes = figure.subplots()
    image = axes.imshow(np.ma.masked_where(np.triu(np.ones((n, n)), 1) > 0, r), cmap=_DIVERGING, vmin=-1, vmax=1)
    size = 8.0 if n <= 12 else 6.5
    for i in range(n):
        for j in range(i):
            strong = abs(r[i, j]) > STRONG
            axes.text(
                j, i, _short(r[i, j]), ha="center", va="center", fontsize=size, fontweight="bold" if strong else "normal",
                color="white" if abs(r[i, j]) > 0.75 else "#222222",
            )  # fmt: skip
            if strong:
                axes.add_patch(Rectangle((j - 0.47, i - 0.47), 0.94, 0.94, fill=False, ec=style.MEASURED, lw=1.6))
    marks = [symbol(symbols[name]) for name in names]
    axes.set_xticks(range(n), marks)
    axes.set_yticks(range(n), [f"{plain(name, 28)}   {mark}" for name, mark in zip(names, marks, strict=True)])
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    figure.colorbar(image, ax=axes, label="correlation r (1)", shrink=0.8, ticks=[-1, -0.5, 0, 0.5, 1])
    if any(abs(r[i, j]) > STRONG for i in range(n) for j in range(i)):
        frame = Patch(fill=False, ec=style.MEASURED, lw=1.6, label=f"|r| > {STRONG:g}: told apart badly by these data")
        figure.legend(handles=[frame], loc="outside upper left")
    return figure


def _short(r: float) -> str:
    """Two decimals, never rounded up to 1 and without a sign at zero."""
    rounded = round(float(r), 2)
    if abs(rounded) >= 1.0:
        rounded = float(np.copysign(0.99, r))
    return fixed(rounded, 2)


# --- pressure laws ---


def _laws(model: Model, p1: np.ndarray, p2: np.ndarray) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Fitted friction coefficients ``(nk, N)`` at absolute pressures (N,), and their slopes ``(nk, N, np)`` in the shared
    parameters, SI; at the middle of the fitted positions, effects' states at rest.
    """
    plant = model.plant
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    k = plant.evaluate(s, w, theta).coefficients
    names = tuple(name for name in ("Fc", "Fs", "vs", "sigma2") if name in plant.law.fitted)
    values = ca.vertcat(*(getattr(k, name) for name in names))
    count = len(plant.parameter_names)
    slopes = ca.densify(ca.jacobian(values, theta)[:, :count])
    function = ca.Function("laws", [s, w, theta], [ca.densify(values), ca.reshape(slopes, -1, 1)])
    known: dict[str, Any] = {"p1": p1, "p2": p2, "x": 0.5 * (model.ranges["x_low"] + model.ranges["x_high"])}
    known |= {"psup": model.rig.supply if plant.servo else 0.0}
    known |= {state.name: state.initial for state in plant.effect_states}

    def columns(order: Sequence[str]) -> np.ndarray:
        return np.vstack([np.broadcast_to(known.get(name, 0.0), p1.shape) for name in order])

    numbers = np.tile(model.theta()[:, None], (1, p1.size))
    found, steep = function(columns(plant.states), columns(plant.inputs), numbers)
    slope = np.asarray(steep).reshape(count, len(names), p1.size)
    return names, np.asarray(found), np.moveaxis(slope, 0, 2)


def depends_on_pressure(model: Model) -> bool:
    """Whether a friction coefficient of the model changes over the pressures it was fitted on."""
    r = model.ranges
    low, high = np.array([r["p1_low"], r["p2_low"]]), np.array([r["p1_high"], r["p2_high"]])
    p1, p2 = np.array([low[0], high[0], low[0], high[0]]), np.array([low[1], low[1], high[1], high[1]])
    _, values, _ = _laws(model, p1, p2)
    return bool(np.any(np.ptp(values, axis=1) > LEAST_CHANGE * np.abs(values).max(axis=1)))


def _differences(comparison: Comparison) -> list[float]:
    """Up to three pressure differences (Pa) that the data hold: low, middle, high."""
    found = []
    for item in comparison.predictions:
        signals = item.run.recording.signals
        if "p1" in signals and "p2" in signals:
            found.append((signals["p1"] - signals["p2"])[:: 1 + item.run.n // 5000])
    if not found:
        return [0.0]
    levels = np.percentile(np.concatenate(found), [10, 50, 90])
    return [float(level) for level in np.unique(DP_ROUND * np.round(levels / DP_ROUND))]


@styled
def pressure_laws(comparison: Comparison) -> Figure:
    """Fc, Fs, vs and sigma2 over p1 at up to three pressure differences, each with its 95 % band where known."""
    model, spread = comparison.model, comparison.spread
    patm = model.rig.patm
    levels = _differences(comparison)
    names = tuple(name for name in ("Fc", "Fs", "vs", "sigma2") if name in model.plant.law.fitted)
    units = {item.name: item.unit for item in model.parameters}
    figure = new_figure(2.5 * -(-len(names) // 2) + 0.6)
    panels = figure.subplots(-(-len(names) // 2), 2, sharex=True, squeeze=False).ravel()
    tops = np.zeros(len(names))
    for k, dp in enumerate(levels):
        r = model.ranges
        low, high = max(r["p1_low"], r["p2_low"] + dp), min(r["p1_high"], r["p2_high"] + dp)
        if high - low < 1e3:
            continue
        p1 = np.linspace(low, high, LAW_POINTS)
        _, values, slopes = _laws(model, p1, p1 - dp)
        color = style.LEVELS[{1: (1,), 2: (0, 2), 3: (0, 1, 2)}[len(levels)][k]]
        half = _half_width(model, spread, slopes) if spread is not None else None
        for i, (axes, name) in enumerate(zip(panels, names, strict=False)):
            factor = handy(units[name])[1]
            at = shown("p1", p1, patm)
            axes.plot(at, factor * values[i], color=color, lw=1.8, zorder=3)
            tops[i] = max(tops[i], factor * float(values[i].max()))
            if half is not None:
                low_band = np.maximum(values[i] - half[i], 0.0)
                axes.fill_between(at, factor * low_band, factor * (values[i] + half[i]), color=color, alpha=0.2, lw=0)
    for axes, name, top in zip(panels, names, tops, strict=False):
        _law_frame(axes, name, units[name], float(top))
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    for axes in panels[max(len(names) - 2, 0) : len(names)]:
        axes.set_xlabel(axis_label("p1"))
        axes.tick_params(labelbottom=True)
    figure.legend(handles=_law_legend(levels, spread is not None), loc="outside upper left", ncols=4)
    return figure


def _half_width(model: Model, spread: Spread, slopes: np.ndarray) -> np.ndarray:
    """Half width ``(nk, N)`` of the 95 % band to first order in the parameters."""
    order = model.plant.parameter_names
    place = [spread.names.index(name) for name in order]
    covariance = spread.covariance[np.ix_(place, place)]
    return np.asarray(NORMAL_95 * np.sqrt(np.maximum(np.einsum("kni,ij,knj->kn", slopes, covariance, slopes), 0.0)))


def _law_frame(axes: Axes, name: str, unit: str, top: float) -> None:
    """Zero in the picture; a band far wider than the law itself leaves it."""
    signs = {"Fc": "$F_c$", "Fs": "$F_s$", "vs": "$v_s$", "sigma2": "$σ_2$"}
    axes.set_ylabel(f"{signs[name]} ({handy(unit)[0]})")
    axes.set_ylim(0.0, min(1.05 * axes.get_ylim()[1], 3.0 * max(top, 1e-9)))
    axes.yaxis.set_major_locator(ticks(5))
    axes.xaxis.set_major_locator(ticks(6))


def _law_legend(levels: Sequence[float], band: bool) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = []
    for k, dp in enumerate(levels):
        color = style.LEVELS[{1: (1,), 2: (0, 2), 3: (0, 1, 2)}[len(levels)][k]]
        handles.append(Line2D([], [], color=color, lw=1.8, label=f"p₁ − p₂ = {fixed(1e-3 * dp, 0)} kPa"))
    if band:
        handles.append(Patch(color=style.FLOOR, alpha=0.35, label="95 % band"))
    return handles
