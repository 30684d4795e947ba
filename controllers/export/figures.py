"""Figures of the python-control export; with ``controllers.figures`` the only modules of the controllers that draw."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from controllers.export.limit_cycles import LimitCycleMap
from controllers.export.linear import LoopCase, Sliding


def bode_png(cases: Sequence[Sliding], patm: float) -> bytes:
    """Command to speed: the linearisations as lines, swept sines on the nonlinear model as dots."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    dense = np.geomspace(2.0, 80.0, 200)
    for case in sorted(cases, key=lambda case: bool(case.answers)):
        about = case.measured_about
        measured = about is not None
        s = 2j * np.pi * dense
        line = s * np.asarray((case.system if about is None else about)(s))[0, 0]
        label = (
            f"{(case.point.supply - patm) / 1e5:.3g} bar gauge, {1e3 * case.point.state[0]:.0f} mm"
            if measured
            else None
        )
        style: dict[str, Any] = {"lw": 1.5} if measured else {"lw": 0.6, "color": "0.7"}
        (drawn,) = upper.loglog(dense, np.abs(line), label=label, **style)
        lower.semilogx(dense, np.degrees(np.unwrap(np.angle(line))), **style)
        if measured:
            at = np.array([answer.frequency for answer in case.answers])
            speed = 2j * np.pi * at * np.array([answer.x for answer in case.answers])
            upper.loglog(at, np.abs(speed), "o", ms=4, color=drawn.get_color())
            lower.semilogx(at, np.degrees(np.unwrap(np.angle(speed))), "o", ms=4, color=drawn.get_color())
    upper.set(ylabel="|v / u| [m/(s V)]", title="Command to speed, sliding; dots: swept sine on the nonlinear model")
    upper.plot([], [], color="0.7", lw=0.6, label="other positions, inward")
    upper.legend(fontsize="small")
    lower.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    for axes in (upper, lower):
        axes.grid(visible=True, which="both", alpha=0.3)
    return _png(figure)


def loop_png(cases: Sequence[LoopCase], patm: float) -> bytes:
    """Nyquist curves of the servo's loop opened at the command, one per pressure condition."""
    figure = Figure(figsize=(6.5, 6.0), layout="constrained")
    axes = figure.subplots()
    for case in cases:
        gain = case.margins.loop_gain
        axes.plot(gain.real, gain.imag, ".-", lw=1.0, ms=4, label=f"{(case.supply - patm) / 1e5:.3g} bar gauge")
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    axes.plot(circle.real, circle.imag, "k:", lw=0.8)
    axes.plot(-1.0, 0.0, "k+", ms=10)
    axes.set(xlim=(-3.0, 1.5), ylim=(-3.0, 1.5), aspect="equal", xlabel="real", ylabel="imaginary")
    axes.set_title("Loop gain of the servo, opened at the command")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize="small")
    return _png(figure)


def limit_cycle_png(found: LimitCycleMap) -> bytes:
    """Standstill motion over alpha and loop gain."""
    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    axes = figure.subplots()
    micrometres = 1e6 * found.wander
    image = axes.imshow(
        np.log10(np.maximum(micrometres, 1.0)), origin="lower", aspect="auto", vmin=0.0, vmax=3.0, cmap="magma"
    )
    for (i, j), value in np.ndenumerate(micrometres):
        text = "diverged" if np.isnan(value) else f"{value:.0f}"
        axes.text(
            j, i, text, ha="center", va="center", color="white" if not value > 100.0 else "black", fontsize="small"
        )
    axes.set_xticks(range(found.factors.size), [f"{value:g}" for value in found.factors])
    axes.set_yticks(range(found.alphas.size), [f"{value:g}" for value in found.alphas])
    axes.set(xlabel="bandwidth relative to the tuned one", ylabel="alpha")
    axes.set_title(f"Standstill motion, peak to peak [um]; friction of the axis {found.friction:g} of the model's")
    figure.colorbar(image, ax=axes, label="log10 of um")
    return _png(figure)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    return stream.getvalue()
