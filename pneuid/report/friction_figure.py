"""Picture of friction: the model's steady curve over speed beside the force balance of the data, by pressure."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pneuid.criticism.comparison.comparison import Comparison
from pneuid.estimation.first_guess import resisting_force
from pneuid.estimation.preparation import Run
from pneuid.model import Model
from pneuid.physics.friction import steady_bristle_force
from pneuid.physics.motion import GRAVITY, pressure_force
from pneuid.physics.smoothing import absolute
from pneuid.report import style
from pneuid.report.quantities import fixed
from pneuid.report.signal_units import axis_label, shown
from pneuid.report.style import new_figure, styled, ticks

LEAST_SPREAD = 20.0e3
"""Mean chamber pressures closer together than this are one condition, Pa."""

STEADY_SHARE = 0.25
"""Samples whose inertia force exceeds this share of the typical force are not quasi-steady."""

STEADY_SECONDS = 0.02
"""Nor are samples whose speed changes by its own size within this time: sticking, breaking away, reversing."""

MOVED = 5.0
"""Nor are samples that move less than so many times the position's noise within that time."""

SAME = 0.01
"""Curves that differ by less than this share of the largest force are drawn as one."""

LEAST_NEAR = 50
"""Samples near zero speed below which that panel is left out."""

POINTS = 400_000
"""Samples beyond this number are thinned evenly."""


@dataclass(frozen=True)
class Sliding:
    """Quasi-steady samples: speed (m/s), resisting force (N), pressures (Pa absolute), number of the run, each (N,)."""

    v: np.ndarray
    force: np.ndarray
    p1: np.ndarray
    p2: np.ndarray
    run: np.ndarray

    def part(self, chosen: np.ndarray) -> Sliding:
        """Some of the samples."""
        return Sliding(self.v[chosen], self.force[chosen], self.p1[chosen], self.p2[chosen], self.run[chosen])


def steady_resistance(model: Model, v: np.ndarray, x: float, p1: float, p2: float) -> np.ndarray:
    """Force (N,) in N that resists steady motion at speeds ``v``: friction and what effects add to the force balance.

    Gravity on the stated incline is not in it, as in ``resisting_force``. Pressures absolute, effects' states at rest.
    """
    plant = model.plant
    s, w, theta = (
        ca.SX.sym("s", len(plant.states)),
        ca.SX.sym("w", len(plant.inputs)),
        ca.SX.sym("theta", len(plant.theta_names)),
    )
    stages = plant.evaluate(s, w, theta)
    named = {name: theta[i] for i, name in enumerate(plant.theta_names)}
    speed = s[plant.states.index("v")] if plant.servo else w[plant.inputs.index("v")]
    k = stages.coefficients
    bristle = steady_bristle_force(k, speed) * speed / absolute(speed, named["smooth_speed"]) / k.sigma0
    given = s if plant.servo else w
    names = plant.states if plant.servo else plant.inputs
    a, b = given[names.index("p1")], given[names.index("p2")]
    pushing = pressure_force(a, b, named["A1"], named["A2"], named["patm"])
    gravity = named["mass_run"] * GRAVITY * ca.sin(named["incline"])
    if plant.servo:
        # only the pressure force holds p1 A1, so its mixed derivative is one over the mass the model moves
        acceleration = stages.explicit[1]
        mass = 1 / ca.jacobian(ca.jacobian(acceleration, named["A1"]), a)
        resisting = pushing - mass * acceleration - gravity
    else:
        resisting = stages.outputs["F"] + pushing - gravity
    both = ca.Function("steady", [s, w, theta], [bristle, resisting])
    fixed = {"x": x, "p1": p1, "p2": p2, "u": model.rig.null, "psup": model.rig.supply, "a": 0.0, "z": 0.0}
    fixed |= {state.name: state.initial for state in plant.effect_states}

    def columns(order: Sequence[str], z: np.ndarray) -> np.ndarray:
        known = {"v": v, "z": z}
        return np.vstack([np.broadcast_to(known.get(name, fixed.get(name, 0.0)), v.shape) for name in order])

    numbers = np.tile(model.theta()[:, None], (1, v.size))
    z, _ = both(columns(plant.states, np.zeros(v.size)), columns(plant.inputs, np.zeros(v.size)), numbers)
    found = both(columns(plant.states, np.asarray(z).ravel()), columns(plant.inputs, np.zeros(v.size)), numbers)[1]
    return np.asarray(found, dtype=float).ravel()


def sliding_samples(model: Model, runs: Sequence[Run]) -> Sliding:
    """The samples of ``runs`` that are near enough to steady for the force balance to show friction."""
    plant, rig = model.plant, model.rig
    parts = []
    thin = 1 + sum(run.n for run in runs) // POINTS
    for k, run in enumerate(runs):
        still = np.full(run.n, rig.patm)
        signals = run.recording.signals
        v = run.input("v") if "v" in run.inputs else run.motion.v
        inertia = run.own.mass * run.motion.a
        force = resisting_force(plant, run, run.motion)
        p1, p2 = signals.get("p1", still), signals.get("p2", still)
        used = np.all(run.weights > 0, axis=0)
        parts.append(np.vstack([v, force, p1, p2, np.full(run.n, k), inertia, run.motion.a])[:, used][:, ::thin])
    v, force, p1, p2, number, inertia, a = np.hstack(parts)
    inertia = np.abs(inertia)
    steady = inertia <= max(STEADY_SHARE * float(np.median(np.abs(force))), float(np.percentile(inertia, 30)))
    slowest = MOVED * model.noise.get("x", 0.0) / STEADY_SECONDS
    sliding = steady & (np.abs(v) > np.maximum(np.abs(a) * STEADY_SECONDS, slowest))
    return Sliding(v, force, p1, p2, number.astype(int)).part(sliding if sliding.sum() > 50 else steady)


def conditions(data: Sliding) -> np.ndarray:
    """Number (N,) of the pressure condition of each sample, 0 lowest, at most three; -1 for samples of none.

    Where every run holds its pressures, conditions are the settings (the lowest, a middle and the highest of them);
    else three groups of mean chamber pressure.
    """
    level = 0.5 * (data.p1 + data.p2)
    runs = [data.part(data.run == k) for k in np.unique(data.run)]
    if all(max(np.std(run.p1), np.std(run.p2)) < 0.5 * LEAST_SPREAD for run in runs):
        return _settings(data, runs)
    if np.ptp(np.percentile(level, [2, 98])) < LEAST_SPREAD:
        return np.zeros(level.size, dtype=int)
    centres = np.unique(np.percentile(level, [5, 50, 95]))
    for _ in range(20):
        group = np.argmin(np.abs(level[:, None] - centres), axis=1)
        centres = np.array([level[group == k].mean() for k in range(centres.size) if np.any(group == k)])
    kept = [centres[0]]
    kept += [after for before, after in itertools.pairwise(centres) if after - before > 0.5 * LEAST_SPREAD]
    return np.asarray(np.argmin(np.abs(level[:, None] - np.array(kept)), axis=1))


def _settings(data: Sliding, runs: Sequence[Sliding]) -> np.ndarray:
    pairs: list[tuple[float, float]] = []
    for run in runs:
        own = (float(np.median(run.p1)), float(np.median(run.p2)))
        if not any(max(abs(own[0] - p1), abs(own[1] - p2)) < LEAST_SPREAD for p1, p2 in pairs):
            pairs.append(own)
    pairs.sort(key=sum)
    kept = pairs if len(pairs) <= 3 else [pairs[0], pairs[len(pairs) // 2], pairs[-1]]
    found = np.full(data.v.size, -1)
    for k, (p1, p2) in enumerate(kept):
        found[np.maximum(np.abs(data.p1 - p1), np.abs(data.p2 - p2)) < LEAST_SPREAD] = k
    return found


@styled
def friction_curve(comparison: Comparison) -> Figure:
    """Steady resisting force over speed: the model (lines) and the force balance of the data (marks)."""
    model, runs = comparison.model, [item.run for item in comparison.predictions]
    data = sliding_samples(model, runs)
    group = conditions(data)
    x = float(np.median(np.concatenate([run.motion.x for run in runs])))
    top = max(float(np.percentile(np.abs(data.v), 99.5)), 1e-6)
    near = float(np.clip(6.0 * model.values.get("vs", 0.01), 0.02 * top, 0.1 * top))
    panels = [("all speeds", top, 24)]
    if np.count_nonzero(np.abs(data.v) < near) >= LEAST_NEAR:
        panels.append(("near zero speed", near, 16))
    figure = new_figure(4.1)
    row = figure.subplots(1, len(panels), width_ratios=[1.3, 1.0][: len(panels)], squeeze=False)[0]
    kept = [data.part(group == k) for k in range(int(group.max()) + 1)]
    pressures = [(float(np.median(own.p1)), float(np.median(own.p2))) for own in kept]
    for axes, (title, reach, bins) in zip(row, panels, strict=True):
        for k, own in enumerate(kept):
            label = f"data{_condition_words(runs, *pressures[k], model.rig.patm)}"
            _data_marks(axes, own, reach, bins, _color(k, len(kept)), "osD"[k], label)
        _model_lines(axes, model, pressures, x, reach, runs)
        _frame(axes, data, reach)
        axes.set_title(title)
    row[0].set_ylabel("resisting force (N)")
    handles, labels = row[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2)
    return figure


def _frame(axes: Axes, data: Sliding, reach: float) -> None:
    """Limits, axes through zero and the label of speed; the frame belongs to the data, a model far off leaves it."""
    inside = data.force[np.abs(data.v) <= reach]
    low, high = np.percentile(inside if inside.size else data.force, [0.5, 99.5])
    margin = 0.25 * max(float(high - low), 1e-3)
    axes.set_ylim(min(low, 0.0) - margin, max(high, 0.0) + margin)
    axes.axhline(0.0, color="#555555", lw=0.7, zorder=1)
    axes.axvline(0.0, color="#555555", lw=0.7, zorder=1)
    axes.set_xlim(*(1.03 * shown("v", np.array([-reach, reach]), 0.0)))
    axes.set_xlabel(axis_label("v"))
    axes.xaxis.set_major_locator(ticks(6))


def _color(k: int, count: int) -> str:
    return style.LEVELS[{1: (1,), 2: (0, 2), 3: (0, 1, 2)}[count][k]]


def _model_lines(
    axes: Axes, model: Model, pressures: Sequence[tuple[float, float]], x: float, reach: float, runs: Sequence[Run]
) -> None:
    """One curve per pressure condition; a single one where the model does not depend on pressure."""
    # denser near zero, where the curve bends; a gap at zero, where it jumps
    speeds = reach * np.linspace(1e-2, 1.0, 300) ** 2
    both = np.concatenate([-speeds[::-1], speeds])
    drawn = shown("v", np.insert(both, speeds.size, 0.0), 0.0)
    forces = [np.insert(steady_resistance(model, both, x, *at), speeds.size, np.nan) for at in pressures]
    scale = max(float(np.nanmax(np.abs(force))) for force in forces)
    if len(forces) > 1 and max(float(np.nanmax(np.abs(force - forces[0]))) for force in forces) < SAME * scale:
        axes.plot(drawn, forces[0], color=style.MEASURED, lw=1.5, zorder=4, label="model, the same at every pressure")
        return
    for k, (at, force) in enumerate(zip(pressures, forces, strict=True)):
        label = f"model{_condition_words(runs, *at, model.rig.patm)}"
        axes.plot(drawn, force, color=_color(k, len(forces)), lw=1.7, zorder=4, label=label)


def _condition_words(runs: Sequence[Run], p1: float, p2: float, patm: float) -> str:
    """Pressures of a condition behind a comma; nothing on a rig without pressure sensors."""
    recorded = {name for run in runs for name in run.recording.recorded}
    values = {"p1": ("p₁", p1), "p2": ("p₂", p2)}
    words = ", ".join(
        f"{symbol} {fixed(float(shown(name, p, patm)), 0)}" for name, (symbol, p) in values.items() if name in recorded
    )
    return f", {words} kPa gauge" if words else ""


def _data_marks(axes: Axes, data: Sliding, reach: float, bins: int, color: str, mark: str, label: str) -> None:
    """Median and quartiles of the force in bins of speed."""
    edges = np.linspace(-reach, reach, bins + 1)
    which = np.digitize(data.v, edges) - 1
    rows = []
    for k in range(bins):
        inside = data.force[which == k]
        if inside.size >= 10:
            rows.append([np.median(data.v[which == k]), *np.percentile(inside, [25, 50, 75])])
    if not rows:
        return
    v, low, middle, high = np.array(rows).T
    axes.errorbar(
        shown("v", v, 0.0), middle, [middle - low, high - middle], fmt=mark, ms=4.5, color=color, mfc="white", lw=0.9,
        zorder=3, label=label,
    )  # fmt: skip
