"""Picture of loops: the force that drives the piston against friction over its position, measured and simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import make_smoothing_spline
from scipy.signal import find_peaks

from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.prediction.horizons import Prediction
from pneuid.estimation.preparation import Run
from pneuid.model import Model
from pneuid.physics.motion import pressure_force
from pneuid.report import style
from pneuid.report.signal_figures import role_word
from pneuid.report.signal_units import axis_label, shown
from pneuid.report.style import new_figure, plain, styled, thinned, ticks

MOST_LOOPS = 6
"""Runs with a panel of their own; more are left out, those of least travel first."""

STROKES = 4
"""Strokes drawn of one run, those of the longest travel together: more only darken the picture."""

TURN = 0.08
"""Share of a run's travel by which a turning point must stand out to end a stroke."""


@dataclass(frozen=True)
class Loop:
    """One run's loop: samples of the stretch drawn, measured ``x`` (m) and force (N), simulated ones or None."""

    number: int
    t: tuple[float, float]
    travel: float
    x: np.ndarray
    force: np.ndarray
    simulated: tuple[np.ndarray, np.ndarray] | None


def moving_mass(model: Model, run: Run) -> float:
    """Mass in kg that the model moves in one run, effects included."""
    plant = model.plant
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    mass = ca.Function("mass", [s, w, theta], [plant.evaluate(s, w, theta).mass])
    own, shift = run.own.constants(model.values)
    numbers = plant.theta(model.values, model.ranges, own, supply_shift=shift)
    rest = np.full(s.numel(), model.rig.patm), np.full(w.numel(), model.rig.patm)
    return float(mass(*rest, numbers))


def _acceleration(t: np.ndarray, x: np.ndarray, bandwidth: float) -> np.ndarray:
    """Second derivative of ``x`` (m) through the low-pass that the measured position went through, m/s^2."""
    step = float(np.median(np.diff(t)))
    spline = make_smoothing_spline((t - t[0]) / step, x, lam=(1 / (2 * np.pi * step * bandwidth)) ** 4)
    return np.asarray(spline.derivative(2)((t - t[0]) / step) / step**2)


def stretch(t: np.ndarray, x: np.ndarray) -> slice:
    """Samples of the ``STROKES`` consecutive strokes with the longest travel together, the whole run where it has fewer."""
    reach = float(np.ptp(x))
    turns = np.sort(np.concatenate([find_peaks(sign * x, prominence=max(TURN * reach, 1e-12))[0] for sign in (1, -1)]))
    if turns.size <= STROKES:
        return slice(0, t.size)
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x[turns])))])
    first = int(np.argmax(travel[STROKES:] - travel[:-STROKES]))
    return slice(int(turns[first]), int(turns[first + STROKES]) + 1)


def loop_of(comparison: Comparison, k: int) -> Loop:
    """The loop of prediction ``k``; on a servo rig simulated in free run."""
    item: Prediction = comparison.free[k]
    run, model, rig = item.run, comparison.model, comparison.model.rig
    used = np.all(run.weights > 0, axis=0)
    x = run.motion.x
    drawn = stretch(run.t, x)
    if model.plant.servo:
        mass = moving_mass(model, run)
        p1, p2 = run.measured("p1"), run.measured("p2")
        force = pressure_force(p1, p2, rig.A1, rig.A2, rig.patm) - mass * run.motion.a
    else:
        mass, force = 0.0, run.measured("F")
    simulated = None
    if item.index.size == run.n and np.isfinite(item.predicted).all():
        if model.plant.servo:
            own, p1, p2 = (item.predicted[run.outputs.index(name)] for name in ("x", "p1", "p2"))
            pushing = pressure_force(p1, p2, rig.A1, rig.A2, rig.patm)
            simulated = own[drawn], (pushing - mass * _acceleration(run.t, own, run.motion.bandwidth))[drawn]
        else:
            simulated = x[drawn], item.predicted[run.outputs.index("F")][drawn]
    seconds = float(run.t[drawn][0]), float(run.t[drawn][-1])
    return Loop(
        k, seconds, float(np.ptp(x[drawn])), x[drawn], np.where(used, force, np.nan)[drawn], simulated
    )  # fmt: skip


@styled
def loops(comparison: Comparison) -> Figure:
    """One panel per run: force over position, measured beside simulated.

    Bench: the measured driving force. Servo: ``(p1-patm) A1 - (p2-patm) A2 - m a``, which is friction, gravity and what
    effects add.
    """
    found = [loop_of(comparison, k) for k, item in enumerate(comparison.free) if item.index.size]
    found = sorted(sorted(found, key=lambda item: -item.travel)[:MOST_LOOPS], key=lambda item: item.number)
    columns = min(len(found), 2) or 1
    rows = -(-len(found) // columns) or 1
    figure = new_figure(2.6 * rows + 0.5)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, item in zip(panels, found, strict=False):
        _panel(axes, comparison, item)
    for axes in panels[len(found) :]:
        axes.set_visible(False)
    servo = comparison.model.plant.servo
    figure.supylabel("p₁A₁ − p₂A₂ − m a (N)" if servo else axis_label("F"), fontsize=9.0)
    figure.legend(handles=_legend(servo, found), loc="outside upper left", ncols=2)
    return figure


def _panel(axes: Axes, comparison: Comparison, item: Loop) -> None:
    run = comparison.free[item.number].run
    order = np.arange(item.x.size, dtype=float)

    def draw(x: np.ndarray, force: np.ndarray, color: str, width: float, order_drawn: int) -> None:
        at, values = thinned(order, force)
        axes.plot(shown("x", x[at.astype(int)], 0.0), values, color=color, lw=width, zorder=order_drawn)

    draw(item.x, item.force, style.MEASURED, 1.5, 2)
    if item.simulated is not None:
        draw(*item.simulated, style.SIMULATED, 1.0, 3)
    good = item.force[np.isfinite(item.force)]
    if good.size:
        margin = 0.3 * max(float(np.ptp(np.percentile(good, [0.5, 99.5]))), 1e-9)
        axes.set_ylim(float(np.percentile(good, 0.5)) - margin, float(np.percentile(good, 99.5)) + margin)
    role = role_word(comparison, comparison.roles[item.number])
    axes.set_title(f"{plain(run.name, 28)}, {role}, {item.t[0]:.1f} s to {item.t[1]:.1f} s", fontsize=9.0)
    axes.axhline(0.0, color="#555555", lw=0.7, zorder=1)
    axes.set_xlabel(axis_label("x"))
    axes.xaxis.set_major_locator(ticks(6))
    axes.yaxis.set_major_locator(ticks(5))


def _legend(servo: bool, found: Sequence[Loop]) -> list[Line2D]:
    handles = [Line2D([], [], color=style.MEASURED, lw=1.5, label="measured")]
    if any(item.simulated is not None for item in found):
        label = "simulated, free run" if servo else "simulated"
        handles.append(Line2D([], [], color=style.SIMULATED, label=label))
    return handles
