"""What the python-control export holds: linear models, measured answers, loop margins, limit cycles, and their words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import control
import numpy as np

from controllers.export.io_system import OUTPUTS, OperatingPoint, linearised, operating_point, passing_point
from controllers.export.limit_cycles import LimitCycleMap, limit_cycle_map
from controllers.export.loop_gain import Answer, Margins, loop_margins, swept_sine
from controllers.export.pieces import Controllers
from controllers.model_plant import ModelPlant
from pneuid.errors import ComputationError

SCHEMA = 1
SPEED = 0.1
"""Speed of sliding at which everything is linearised, m/s."""
SWEPT = (5.0, 8.0, 12.0, 20.0, 35.0)
"""Frequencies of the swept sines, Hz."""
LOOP = tuple(np.geomspace(3.0, 450.0, 20).tolist())
"""Frequencies at which the loop gain is measured, Hz."""
ALPHAS = (0.4, 0.6, 0.8, 0.9, 1.0)
FACTORS = (0.6, 0.8, 1.0, 1.3, 1.7)
OVERESTIMATED = 0.7
"""Share of the model's friction that the axis of the limit-cycle map has: the model says 40 % too much."""


@dataclass(frozen=True)
class Sliding:
    """One operating point with its linear system.

    At mid-stroke also the measured answers, and the linear system about the state in which the axis was measured: its
    pressures had not come to rest.
    """

    point: OperatingPoint
    system: control.StateSpace
    answers: tuple[Answer, ...]
    measured_about: control.StateSpace | None


@dataclass(frozen=True)
class LoopCase:
    """Margins of the servo under one supply [Pa, absolute]."""

    supply: float
    margins: Margins


@dataclass(frozen=True)
class LinearExport:
    """Everything of ``--to control``."""

    cases: tuple[Sliding, ...]
    loops: tuple[LoopCase, ...]
    cycles: LimitCycleMap


def supplies_around(found: Controllers) -> tuple[float, ...]:
    """The design's supply and, in gauge, 60 % and 140 % of it; Pa absolute."""
    patm = found.model.value("patm")
    return tuple(patm + share * (found.design_supply - patm) for share in (0.6, 1.0, 1.4))


def linear_export(found: Controllers, doing: Callable[[str], None]) -> LinearExport:
    """Linearise over positions and supplies, sweep sines, measure the servo's loop and map its limit cycles.

    Raises ``ComputationError`` when the axis cannot slide at ``SPEED`` anywhere.
    """
    model, supplies = found.model, supplies_around(found)
    stroke, amplitude = model.value("stroke"), 0.01 * model.value("full_scale")
    plant = ModelPlant(model, x_noise=0.0, x_grid=1e-9, p_noise=0.0)
    doing(f"linearising at {SPEED:g} m/s")
    cases = []
    for supply in supplies:
        for share in (0.2, 0.5, 0.8):
            for way in (1.0, -1.0):
                point = _point(found, share * stroke, supply, way * SPEED)
                if point is None:
                    continue
                swept = way > 0 and share == 0.5
                answers = swept_sine(plant, share * stroke, supply, point.u, amplitude, SWEPT, 1e-3) if swept else []
                passed = passing_point(model, answers[0].passed, point.u, supply) if answers else None
                about = linearised(model, passed) if passed is not None else None
                cases.append(Sliding(point, linearised(model, point), tuple(answers), about))
    if not cases:
        raise ComputationError(f"the axis cannot slide at {SPEED:g} m/s under any supply tried; nothing to linearise")
    doing("measuring the loop gain of the servo")
    loops = tuple(
        LoopCase(supply, loop_margins(found.servo, plant, 0.5 * stroke, supply, SPEED, amplitude, LOOP))
        for supply in supplies
    )
    doing("mapping limit cycles")
    cycles = limit_cycle_map(found.servo, found.design_supply, ALPHAS, FACTORS, OVERESTIMATED)
    return LinearExport(tuple(cases), loops, cycles)


def _point(found: Controllers, x: float, supply: float, speed: float) -> OperatingPoint | None:
    try:
        return operating_point(found.model, x, supply, speed)
    except ComputationError:
        return None


def as_json(result: LinearExport, found: Controllers, name: str) -> dict[str, Any]:
    """Matrices, margins and map, SI."""
    return {
        "schema": SCHEMA, "model": name, "states": list(found.model.plant.states), "inputs": ["u", "psup"],
        "outputs": list(OUTPUTS),
        "operating_points": [
            {
                "x": case.point.state[0], "speed": case.point.speed, "supply": case.point.supply, "u": case.point.u,
                "state": case.point.state.tolist(),
                **{key: np.asarray(getattr(case.system, key)).tolist() for key in "ABCD"},
                "swept_sine": [_answer_json(answer) for answer in case.answers],
            }
            for case in result.cases
        ],
        "servo_loop": [
            {
                "supply": case.supply, "gain_margin": _finite(case.margins.gain),
                "phase_margin_deg": _finite(case.margins.phase), "modulus_margin": _finite(case.margins.modulus),
                "crossover_hz": _finite(case.margins.crossover), "frequencies": case.margins.frequencies.tolist(),
                "loop_gain": [[value.real, value.imag] for value in case.margins.loop_gain],
            }
            for case in result.loops
        ],
        "limit_cycles": {
            "friction": result.cycles.friction, "alpha": result.cycles.alphas.tolist(),
            "bandwidth_factor": result.cycles.factors.tolist(),
            "wander": [[_finite(value) for value in row] for row in result.cycles.wander],
        },
    }  # fmt: skip


def _answer_json(answer: Answer) -> dict[str, Any]:
    parts = {"x": answer.x, "p1": answer.p1, "p2": answer.p2}
    return {"frequency": answer.frequency, **{name: [value.real, value.imag] for name, value in parts.items()}}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def as_report(result: LinearExport, found: Controllers, name: str) -> str:
    """The short report, Markdown."""
    patm, cycles = found.model.value("patm"), result.cycles
    lines = [
        f"# {name}: linear models and margins", "",
        f"Linearised while sliding at {SPEED:g} m/s, out and in; `control.json` holds the matrices (SI, absolute pressures).",
        "`bode.png` shows them against swept sines on the nonlinear model.", "",
        "## The servo's loop, opened at the command", "",
        "Measured on the identified model by a sine on the command, with delay, sampling and observer inside.", "",
        "| supply, bar gauge | crossover, Hz | phase margin, deg | gain margin | distance to -1 |",
        "| --- | --- | --- | --- | --- |",
    ]  # fmt: skip
    for case in result.loops:
        m = case.margins
        numbers = f"{m.crossover:.1f} | {m.phase:.0f} | {m.gain:.1f} | {m.modulus:.2f}"
        lines.append(f"| {(case.supply - patm) / 1e5:.3g} | {numbers} |")
    lines += [
        "", "## Limit cycles", "",
        f"Standstill motion in um, peak to peak, on an axis with {cycles.friction:g} of the model's friction; hold band and",
        "learning off.",
        "", "| alpha | " + " | ".join(f"bandwidth x {factor:g}" for factor in cycles.factors) + " |",
        "| --- " * (1 + cycles.factors.size) + "|",
    ]  # fmt: skip
    for alpha, row in zip(cycles.alphas, cycles.wander, strict=True):
        cells = ["diverged" if np.isnan(value) else f"{1e6 * value:.0f}" for value in row]
        lines.append(f"| {alpha:g} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", "## In python-control", "", *_HOW, ""])


_HOW: Sequence[str] = (
    "    import control, pneuid",
    "    from controllers.export import to_control",
    "",
    '    axis = to_control(pneuid.load("model.json"))   # inputs u [V], psup [Pa]; outputs x, v, p1, p2',
    '    control.input_output_response(axis, T, [u, psup], x0, solve_ivp_method="LSODA")',
)
