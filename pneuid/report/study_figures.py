"""Counterparts of the data figures of the 2011 study (2 to 16), on whatever pressure pairs were recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pneuid.estimation.bench.laws import TARGETS
from pneuid.estimation.bench.presliding import Loop
from pneuid.estimation.bench.steady import Condition
from pneuid.estimation.bench.study import LOWEST_VS, Study
from pneuid.report import style
from pneuid.report.quantities import fixed, handy
from pneuid.report.style import new_figure, styled, ticks

EQUAL = 30.0e3
"""Pressures closer than this count as equal, Pa."""

SLOW_PART = 6.0e-3
"""Speed up to which the falling part of the curves is enlarged, m/s."""

LOG_RANGE = 10.0
"""Ratio of speeds from which they are drawn on a logarithmic axis."""

UNITS = {"Fc": "N", "Fs": "N", "vs": "m/s", "sigma2": "N*s/m"}
SYMBOLS = {"Fc": "Fc", "Fs": "Fs", "vs": "vₛ", "sigma2": "σ₂"}
MARKERS = "osD^v<>Ph"


@dataclass(frozen=True)
class StudyResult:
    """The classic route, the coefficients of the joint fit (value and 1-sigma or None, SI) and of the truth where known."""

    study: Study
    joint: Mapping[str, tuple[float, float | None]]
    truth: Mapping[str, float] | None = None

    @property
    def joint_values(self) -> dict[str, float]:
        """Values of the joint fit, SI."""
        return {name: value for name, (value, _) in self.joint.items()}


@dataclass(frozen=True)
class StudyFigure:
    """One picture: the study's number, what it shows."""

    number: int
    name: str
    words: str
    figure: Figure


def law(coefficients: Mapping[str, float], target: str, ps: np.ndarray | float, dp: np.ndarray | float) -> np.ndarray:
    """``target`` at gauge pressures (Pa) from its value at zero gauge and its two slopes, with the contract's floor of vs."""
    first, second = TARGETS[target]
    found = coefficients[target] + coefficients.get(first, 0.0) * ps + coefficients.get(second, 0.0) * dp
    return np.asarray(np.maximum(found, LOWEST_VS) if target == "vs" else found)


def steady(coefficients: Mapping[str, float], v: np.ndarray, ps: float, dp: float) -> np.ndarray:
    """Steady friction (N,) in N by the laws at speeds ``v`` (m/s); eq. 5 and 13. Coefficients that are absent are zero."""
    Fc = float(law(coefficients, "Fc", ps, dp))
    Fs = max(float(law(coefficients, "Fs", ps, dp)), Fc) if "Fs" in coefficients else Fc
    vs = float(law(coefficients, "vs", ps, dp)) if "vs" in coefficients else LOWEST_VS
    viscous = max(float(law(coefficients, "sigma2", ps, dp)), 0.0) if "sigma2" in coefficients else 0.0
    return np.asarray((Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2))) * np.sign(v) + viscous * v)


def study_figures(result: StudyResult) -> list[StudyFigure]:
    """Every figure of the study for which pressure pairs were recorded, in its order."""
    study = result.study
    equal = [item for item in study.conditions if abs(item.p1 - item.p2) < EQUAL]
    swept = _swept(study)
    level = equal if len(equal) > 1 else list(study.conditions)
    what = "equal pressures" if len(equal) > 1 else "all pressure pairs"
    lowest = min(study.conditions, key=lambda item: item.p1 + item.p2)
    made: list[StudyFigure] = []

    def add(number: int, name: str, words: str, draw: Callable[[], Figure]) -> None:
        figure = draw()
        with style.drawing():
            figure.axes[0].set_title(f"Study, figure {number}: {words}")
        made.append(StudyFigure(number, name, words, figure))

    add(2, "friction_velocity_lowest", "friction over speed at the lowest pressures",
        lambda: curves(result, [lowest]))  # fmt: skip
    first = [item.loop for item in study.presliding if item.loop is not None][:1]
    if first:
        add(3, "loop_lowest", "driving force over displacement, two cycles of slow reciprocation",
            lambda: loops(result, [lowest], drive=True))  # fmt: skip
    add(4, "friction_velocity_ps", f"friction over speed, {what}",
        lambda: curves(result, level))  # fmt: skip
    seen = {*study.laws, *result.joint}
    for number, target in ((5, "Fc"), (6, "sigma2"), (7, "vs"), (8, "Fs")):
        if target not in seen:
            continue
        add(number, f"{target}_ps", f"{SYMBOLS[target]} over working pressure, {what}",
            lambda target=target: coefficient(result, level, target, "ps"))  # type: ignore[misc]  # fmt: skip
    if len(swept) > 1:
        add(9, "friction_velocity_dp", "friction over speed under pressure difference",
            lambda: curves(result, swept))  # fmt: skip
        for number, target in ((10, "Fc"), (11, "sigma2"), (12, "vs"), (13, "Fs")):
            if target not in seen:
                continue
            add(number, f"{target}_dp", f"{SYMBOLS[target]} over pressure difference, p₁ held",
                lambda target=target: coefficient(result, swept, target, "dp"))  # type: ignore[misc]  # fmt: skip
    if first:
        add(14, "loops_ps", f"friction over displacement, {what}",
            lambda: loops(result, level))  # fmt: skip
        if len(swept) > 1:
            add(15, "loops_dp", "friction over displacement under pressure difference",
                lambda: loops(result, swept))  # fmt: skip
    if study.held_out:
        add(
            16,
            "verification",
            "verification at pressures kept out (the study: within 2 N)",
            lambda: verification(result),
        )
    return made


def _swept(study: Study) -> list[Condition]:
    """Pressure pairs of one p1 and several p2: the largest such set, by falling p2."""
    best: list[Condition] = []
    for item in study.conditions:
        same = [other for other in study.conditions if abs(other.p1 - item.p1) < EQUAL]
        if len(same) > max(len(best), 1):
            best = same
    spread = max((item.p2 for item in best), default=0.0) - min((item.p2 for item in best), default=0.0)
    return sorted(best, key=lambda item: -item.p2) if spread > EQUAL else []


def _colors(count: int) -> list[str]:
    """Light to dark; seven shades of one colour could not be told apart."""
    ramp = mpl.colormaps["viridis_r"]
    return [mpl.colors.to_hex(ramp(0.15 + 0.85 * k / max(count - 1, 1))) for k in range(count)]


def _words(item: Condition, patm: float) -> str:
    return f"p₁ {fixed((item.p1 - patm) / 1e3, 0)}, p₂ {fixed((item.p2 - patm) / 1e3, 0)} kPa"


@styled
def curves(result: StudyResult, chosen: Sequence[Condition]) -> Figure:
    """Points with scatter and the curve of eq. 8 of every pressure pair; enlarged at slow speed, extending alone."""
    patm = result.study.rig.patm
    speeds = [point.v for item in chosen for point in item.points]
    top = max(abs(v) for v in speeds)
    slow = any(0.0 < v <= SLOW_PART for v in speeds) and top > SLOW_PART
    figure = new_figure(4.4)
    panels = list(figure.subplots(1, 2, width_ratios=[1.25, 1.0])) if slow else [figure.subplots()]
    for item, color, mark in zip(chosen, _colors(len(chosen)), _cycled(len(chosen)), strict=True):
        words = _words(item, patm)
        _one_curve(panels[0], item, (color, mark, words), -top, top)
        if slow:
            _one_curve(panels[1], item, (color, mark, None), 0.0, SLOW_PART)
    for axes in panels:
        axes.set_xlabel("speed v (mm/s)")
        axes.set_ylabel("friction (N)")
        axes.xaxis.set_major_locator(ticks(6))
    if slow:
        panels[1].set_title("slow, extending", loc="right")
        panels[1].set_ylim(bottom=min(0.0, panels[1].get_ylim()[0]))
    meaning = "pressures gauge; marks: mean over a stroke ± standard deviation of its samples; line: eq. 5 fitted"
    if any(item.Fs is None for item in chosen):
        meaning += "\n(dashed: Fs and vs not seen by the classic route, the line is Fc + σ₂ v)"
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=min(4, len(chosen)), title=meaning
    )
    return figure


def _one_curve(axes: Axes, item: Condition, look: tuple[str, str, str | None], low: float, high: float) -> None:
    """One pressure pair from speed ``low`` to ``high`` (m/s); ``look`` : colour, mark and label."""
    color, mark, label = look
    for first, last in ((low, -1e-3 * high), (1e-3 * high, high)):
        if first < last:  # apart at zero, where friction jumps
            v = np.linspace(first, last, 400)
            axes.plot(1e3 * v, item.steady(v), color=color, lw=1.2, ls="-" if item.Fs is not None else "--")
    offset = 0.0 if item.offset is None else item.offset.value
    inside = [p for p in item.points if 1.001 * low <= p.v <= 1.001 * high]
    axes.errorbar(
        [1e3 * p.v for p in inside], [p.force - offset for p in inside], [p.scatter for p in inside], fmt=mark, ms=3.8,
        color=color, mfc="white", lw=0.8, label=label,
    )  # fmt: skip


def _cycled(count: int) -> str:
    return (MARKERS * (count // len(MARKERS) + 1))[:count]


@styled
def coefficient(result: StudyResult, chosen: Sequence[Condition], target: str, along: str) -> Figure:
    """One coefficient over ps or dp: per pressure pair, and the laws of both routes and of the truth."""
    patm = result.study.rig.patm
    unit, factor = handy(UNITS[target])
    ps, dp = np.array([item.p1 - patm for item in chosen]), np.array([item.p1 - item.p2 for item in chosen])
    at = ps if along == "ps" else dp
    figure = new_figure(3.6, 6.4)
    axes = figure.subplots()
    order = np.argsort(at)
    dense = np.linspace(at.min(), at.max(), 60)
    other = np.interp(dense, at[order], (dp if along == "ps" else ps)[order])
    pair = (dense, other) if along == "ps" else (other, dense)
    if result.truth is not None:
        axes.plot(dense / 1e3, factor * law(result.truth, target, *pair), color=style.FLOOR, lw=3.0, label="truth")
    if target in result.study.laws:
        line = law({name: value.value for name, value in result.study.coefficients().items()}, target, *pair)
        axes.plot(dense / 1e3, factor * line, color=style.MEASURED, lw=1.1, label="law, classic route")
    if target in result.joint_values:
        line = law(result.joint_values, target, *pair)
        axes.plot(dense / 1e3, factor * line, color=style.SIMULATED, lw=1.3, ls="--", label="law, joint fit")
    seen = [
        (x, value) for x, value in zip(at, (getattr(item, target) for item in chosen), strict=True) if value is not None
    ]
    if seen:
        axes.errorbar(
            [x / 1e3 for x, _ in seen], [factor * value.value for _, value in seen], [factor * value.std for _, value in seen],
            fmt="o", ms=5, color=style.MEASURED, mfc="white", lw=1.0, label="per pressure pair, classic (± std)",
        )  # fmt: skip
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    hidden = [x / 1e3 for x, item in zip(at, chosen, strict=True) if getattr(item, target) is None]
    if hidden:
        axes.plot(
            hidden, np.zeros(len(hidden)), "x", ms=7, mew=1.6, color=style.REJECTED, clip_on=False, zorder=5,
            transform=axes.get_xaxis_transform(), label="not seen by the classic route",
        )  # fmt: skip
    axes.set_xlabel(
        "working pressure ps = p₁ (kPa gauge)" if along == "ps" else "pressure difference dp = p₁ − p₂ (kPa)"
    )
    axes.set_ylabel(f"{SYMBOLS[target]} ({unit})")
    axes.legend(loc="best")
    return figure


@styled
def loops(result: StudyResult, chosen: Sequence[Condition], drive: bool = False) -> Figure:
    """Force over displacement in slow reciprocation, displacement from the middle of each loop."""
    patm = result.study.rig.patm
    by_pressure = {(item.p1, item.p2): item.loop for item in result.study.presliding}
    figure = new_figure(4.2, 7.2)
    axes = figure.subplots()
    for item, color in zip(chosen, _colors(len(chosen)), strict=True):
        loop = by_pressure[item.p1, item.p2]
        if loop is not None:
            _one_loop(axes, loop, color, _words(item, patm), drive)
    axes.set_xlabel("displacement (mm)")
    axes.set_ylabel("driving force F (N)" if drive else "friction (N)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title="gauge")
    return figure


def _one_loop(axes: Axes, loop: Loop, color: str, label: str, drive: bool) -> None:
    """A loop as means over short stretches, so that noise does not hide the others."""
    size = max(loop.x.size // 1500, 1)
    count = loop.x.size // size * size
    x, force = (
        values[:count].reshape(-1, size).mean(axis=1) for values in (loop.x, loop.drive if drive else loop.friction)
    )
    middle = 0.5 * (loop.x.min() + loop.x.max())
    axes.plot(1e3 * (x - middle), force, color=color, lw=0.9, label=label)


@styled
def verification(result: StudyResult) -> Figure:
    """The pressure pairs kept out: measured points, the curves of both routes, and what is left."""
    study = result.study
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.8, 1.0])
    for item, mark in zip(study.held_out, _cycled(len(study.held_out)), strict=True):
        ps, dp = item.p1 - study.rig.patm, item.p1 - item.p2
        offset = 0.0 if item.offset is None else item.offset.value
        v, force = (np.array(column) for column in zip(*((p.v, p.force - offset) for p in item.points), strict=True))
        above.errorbar(
            1e3 * np.abs(v), np.sign(v) * force, [p.scatter for p in item.points], fmt=mark, ms=4.5, color=style.MEASURED,
            mfc="white", lw=0.8, label=f"measured, {_words(item, study.rig.patm)}",
        )  # fmt: skip
        dense = np.geomspace(np.abs(v).min(), np.abs(v).max(), 300)
        classic = {name: value.value for name, value in study.coefficients().items()}
        routes = (
            ("classic route", style.FREE_RUN, "-", classic),
            ("joint fit", style.SIMULATED, "--", result.joint_values),
        )
        for name, color, dash, values in routes:
            if "Fc" not in values:
                continue
            above.plot(1e3 * dense, steady(values, dense, ps, dp), color=color, ls=dash, label=name)
            left = np.sign(v) * force - steady(values, np.abs(v), ps, dp)
            below.plot(1e3 * np.abs(v), left, mark, ms=4.5, color=color, mfc="white" if dash == "-" else color)
    below.axhline(0.0, color="#555555", lw=0.7)
    speeds = [abs(p.v) for item in study.held_out for p in item.points]
    if max(speeds) > LOG_RANGE * min(speeds):
        below.set_xscale("log")
        style.plain_log(below.xaxis)
    above.set_ylim(bottom=0.0)
    below.set_xlabel("speed |v| (mm/s)")
    below.set_ylabel("measured − curve (N)")
    above.set_ylabel("friction (N)")
    above.legend()
    figure.align_ylabels()
    return figure
