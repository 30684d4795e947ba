"""Sanity checks of a valve-driven rig: what is the wrong way round, and which reference or unit the pressures have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pneuid.plausibility.balance import Line, Signals, fit, pooled
from pneuid.plausibility.finding import Finding
from pneuid.plausibility.units import factors_into
from pneuid.recording import Recording
from pneuid.rig import Rig

_SIGN_OF_FLOW, _SIGN_OF_MOTION = 0.2, 0.3
"""Least partial correlation, in each chamber, for a sign to count. Clean rigs show 0.6 to 1.0; slow motion down to 0.2."""
_BETTER = 0.5
"""A reference shifted by one atmosphere is suspected when it halves the misfit in both chambers ..."""
_ALL_BETTER = 0.9
"""... or, where supply and chambers would shift together, lowers it in both and moves n back into its range."""
_EXPONENTS = (0.98, 1.45)
"""Exponents n that an unshifted rig may show: 1 to 1.4, and a little for dead volumes off by some percent."""
_VACUUM_SHARE = 0.05
_LOW, _HIGH = 0.2, 1.5
"""Gauge chamber pressure over gauge supply pressure (95 % of the samples are below it) outside which the unit is suspected."""


def swapped_chambers(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """The columns of p1 and p2 exchanged: a filling chamber loses pressure, an extending piston raises p1."""
    return _turned(
        rig, runs, (-1, -1), "swapped_chambers", "p1, p2",
        "where the valve fills a chamber its pressure falls, and the piston's motion changes both the wrong way",
        "p1 and p2 are swapped", "p1 belongs to the cap side; exchange the columns in [columns] in rig.toml",
    )  # fmt: skip


def reversed_command(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """The sign of u the wrong way: motion and pressures agree with each other, the valve's flow with neither."""
    return _turned(
        rig, runs, (-1, 1), "reversed_command", "u",
        "the pressures follow the piston's motion, but a chamber that the valve fills loses air",
        "the sign of u is reversed",
        'u above null must pressurise chamber 1, the cap side; give u a gain = "-1" in [columns] in rig.toml',
    )  # fmt: skip


def reversed_position(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """The sign of x the wrong way: the pressures follow the valve, but compression by the piston is the other way round."""
    stroke = f"{rig.stroke * 1e3:g} mm" if rig.kind == "servo" else "stroke"
    return _turned(
        rig, runs, (1, -1), "reversed_position", "x",
        "the pressures follow the valve, but a chamber's pressure falls while x says that it is compressed",
        "x is counted from the rod end",
        f'x counts from the cap end; give x gain = "-1" and offset = "{stroke}" in [columns] in rig.toml',
    )  # fmt: skip


def _turned(
    rig: Rig, runs: Sequence[Recording], signs: tuple[int, int], check: str, signal: str, words: str, slip: str, do: str
) -> Finding | None:
    lines = _lines(rig, runs)
    if lines is None or any(_signs(line) != signs for line in lines):
        return None
    numbers = "; ".join(
        f"chamber {number}: correlation with the valve's flow {line.flow_correlation:+.2f}, "
        f"with the piston's motion {line.motion_correlation:+.2f}"
        for number, line in enumerate(lines, start=1)
    )
    return Finding(check, signal, f"{words} ({numbers}; both should be positive)", slip, do)


def _lines(rig: Rig, runs: Sequence[Recording], change: float = 0.0, supply: float = 0.0) -> tuple[Line, Line] | None:
    """The chamber balances with ``change`` [Pa] added to p1 and p2 and ``supply`` [Pa] to psup; None off a servo rig."""
    if rig.kind != "servo":
        return None
    tried = []
    for run in runs:
        signals = Signals.of(run)
        if change or supply:
            # a shift on trial may lead below vacuum or below ambient, where the flow law has no value
            p1, p2 = (np.maximum(p + change, 1e3) for p in (signals.p1, signals.p2))
            signals = replace(signals, p1=p1, p2=p2, psup=np.maximum(signals.psup + supply, rig.patm + 1e4))
        tried.append(signals)
    first, second = (fit(found) for found in pooled(rig, tried))
    return None if first is None or second is None else (first, second)


def _signs(line: Line) -> tuple[int, int]:
    """Signs of flow and motion, 0 where these data do not tell."""
    flow = int(np.sign(line.flow)) if abs(line.flow_correlation) > _SIGN_OF_FLOW else 0
    motion = int(np.sign(line.motion)) if abs(line.motion_correlation) > _SIGN_OF_MOTION else 0
    return flow, motion


def upright(rig: Rig, runs: Sequence[Recording]) -> tuple[Line, Line] | None:
    """The balances of a servo rig whose signs are all as they should be; None otherwise."""
    lines = _lines(rig, runs)
    return lines if lines is not None and all(_signs(line) == (1, 1) for line in lines) else None


def pressure_reference(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Gauge taken for absolute or the reverse: the compression work ``p dV`` is off by one atmosphere."""
    if rig.kind != "servo":
        return None
    below = max(float(np.mean(run.signals[name] < 0.7 * rig.patm)) for run in runs for name in ("p1", "p2"))
    if rig.pressure_convention == "abs" and below > _VACUUM_SHARE:
        seen = f"{100 * below:.0f} % of the samples are more than 0.3 bar below ambient, which valve and piston cannot draw"
        return _reference(rig, seen)
    lines = upright(rig, runs)
    if lines is None or unit_of_pressure(rig, runs) is not None:
        return None
    change = -rig.patm if rig.pressure_convention == "gauge" else rig.patm
    alone = _lines(rig, runs, change)
    if alone is not None and _ratio(alone, lines) < _BETTER:
        return _reference(rig, _work(change, alone, lines))
    together = _lines(rig, runs, change, change)
    if together is None or not _ratio(together, lines) < _ALL_BETTER:
        return None
    inside = [all(_EXPONENTS[0] <= 1.2 * line.motion <= _EXPONENTS[1] for line in two) for two in (lines, together)]
    if inside == [False, True]:
        return _reference(rig, _work(change, together, lines) + ", supply and chambers alike")
    return None


def _ratio(tried: tuple[Line, Line], lines: tuple[Line, Line]) -> float:
    """The larger of the two chambers' misfits over what they are as recorded."""
    return max(new.misfit / max(old.misfit, 1e-12) for new, old in zip(tried, lines, strict=True))


def _work(change: float, tried: tuple[Line, Line], lines: tuple[Line, Line]) -> str:
    was, now = (" and ".join(f"{1.2 * line.motion:.2f}" for line in two) for two in (lines, tried))
    left = f"{100 * max(line.misfit for line in lines):.1f} % to {100 * max(line.misfit for line in tried):.1f} %"
    return (
        f"with pressures {change / 1e3:+.1f} kPa the misfit of the chamber balances falls from {left} "
        f"and their exponent goes from {was} to {now} (1 to 1.4 is possible)"
    )


def _reference(rig: Rig, seen: str) -> Finding:
    told, meant = ("gauge", "abs") if rig.pressure_convention == "gauge" else ("abs", "gauge")
    slip = f"{meant} pressures declared as {told}"
    do = f'compare a vented chamber with ambient, then set [conventions] pressure = "{meant}" or an offset in [columns]'
    return Finding("pressure_reference", "p1, p2", seen, slip, do)


def unit_of_pressure(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """Pressures far above the supply, or far below it while the valve's flow is too small by as much: a wrong unit."""
    if rig.kind != "servo":
        return None
    each = {name: max(_share(rig, run, name) for run in runs) for name in ("p1", "p2")}
    share, which = max(each.values()), "p1, p2"
    if share <= 0.0:
        return None
    if _LOW <= share < _HIGH:
        alone = _far_below(rig, runs, each)
        if alone is None:
            return None
        share, which = each[alone], alone
    elif share < _LOW:
        lines = _lines(rig, runs)
        # a leaking or slowly driven rig may stay at low pressure; then the valve's flow still fits the pressures
        if lines is None or max(abs(line.flow) for line in lines) > 0.5:
            return None
    column = rig.columns.get(which[:2])
    names = factors_into(share, stated=column.unit if column else None)
    whose = "p1 and p2, or that of the supply," if which == "p1, p2" else which
    slip = f"the unit of {whose} is wrong{f' ({names})' if names else ''}"
    who = "the chambers reach" if which == "p1, p2" else "this chamber reaches"
    seen = f"{who} {share:.3g} times the supply's gauge pressure (0.3 to 1 is usual)"
    do = "compare the unit in the header and in [columns] with the sensor's data sheet, and supply.pressure in rig.toml"
    return Finding("unit_of_pressure", which, seen, slip, do)


def _share(rig: Rig, run: Recording, name: str) -> float:
    """Gauge pressure of a chamber (95 % of the samples are below it) over that of the supply."""
    own = rig.run(run.name).supply
    supply = (rig.supply if own is None else own) - rig.patm
    return (float(np.percentile(run.signals[name], 95)) - rig.patm) / supply


def _far_below(rig: Rig, runs: Sequence[Recording], each: dict[str, float]) -> str | None:
    """The chamber whose pressure stays far below the supply, and whose flow far below the other's; None if there is none."""
    low = min(each, key=lambda name: each[name])
    lines = _lines(rig, runs)
    if lines is None or not 0.0 < each[low] < _LOW:
        return None
    flow, other = (abs(line.flow) for line in (lines if low == "p1" else lines[::-1]))
    return low if flow < _LOW * other and flow < 0.5 else None
