"""Pre-sliding: bristle stiffness from the slope at reversals (eq. 12), its damping from an assumed ratio (eq. 11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pneuid.errors import UserError
from pneuid.estimation.bench.sections import Section, constant_velocity_sections
from pneuid.estimation.bench.steady import SAME_SPEED, Condition, Value, friction_of
from pneuid.estimation.motion import refined_motion
from pneuid.recording import Recording
from pneuid.rig import Rig

USUAL = (0.2, 0.7)
"""Damping ratios that the study calls usual."""

LONGEST_TURN = 0.3
"""Rest between two strokes in s beyond which they are not one reversal."""

SLOW = 2.0e-3
"""Speed in m/s above which a reversal is not slow: inertia and bristle damping would count."""

NEAR_ZERO = 0.3
"""Share of the sliding friction within which the slope is taken, about its zero."""

LEAST_SAMPLES = 12
"""Samples in that window below which the pre-sliding is not resolved."""


@dataclass(frozen=True)
class Loop:
    """Slow reciprocation of one run: x (m), driving force and friction (N), each (N,)."""

    run: str
    x: np.ndarray
    drive: np.ndarray
    friction: np.ndarray


@dataclass(frozen=True)
class Presliding:
    """Slopes at the reversals of one pressure pair.

    sigma0 : N/m, the median slope, None where no reversal is resolved; slopes : of every reversal, N/m; loop : for the
    picture; verdict : in words.
    """

    p1: float
    p2: float
    sigma0: Value | None
    slopes: tuple[float, ...]
    loop: Loop | None
    verdict: str


def presliding(rig: Rig, condition: Condition, runs: Sequence[Recording], noise: float) -> Presliding:
    """The pre-sliding of ``condition``; ``runs`` hold at least its runs; ``noise`` of the position, m.

    ``dF/dx`` is taken where friction passes through zero: there LuGre's slope is ``sigma0``, while it is twice as much
    at the reversal itself, where the loaded bristle unloads and loads at once. What is left is ``sigma1 |v| / g`` of it.
    """
    slopes: list[float] = []
    loop: Loop | None = None
    loop_turns = 0
    for run in runs:
        if run.name not in condition.runs:
            continue
        sections = constant_velocity_sections(run.t, run.signals["x"], noise)
        turns = [pair for pair in pairwise(sections) if _turns(run, *pair)]
        if not turns:
            continue
        force = friction_of(rig, run)
        found = [_slope(run, force, noise, *pair) for pair in turns]
        slopes += [slope for slope in found if slope is not None]
        speeds = np.array([abs(section.v) for pair in turns for section in pair])
        # strokes of several speeds are no loop
        if len(turns) > max(loop_turns, 1) and np.ptp(speeds) < SAME_SPEED * speeds.max():
            loop_turns = len(turns)
            part = slice(turns[0][0].first, turns[-1][1].last)
            loop = Loop(run.name, run.signals["x"][part], run.signals["F"][part], force[part])
    if not slopes:
        verdict = f"no slow reversal with {LEAST_SAMPLES} samples in its pre-sliding: sigma0 and sigma1 not seen"
        return Presliding(condition.p1, condition.p2, None, (), loop, verdict)
    spread = float(np.std(slopes, ddof=1)) if len(slopes) > 1 else float("nan")
    mean = float(np.median(slopes))
    std = 1.25 * spread / np.sqrt(len(slopes)) if len(slopes) > 1 else 0.2 * mean
    verdict = f"{len(slopes)} reversals"
    return Presliding(condition.p1, condition.p2, Value(mean, float(std)), tuple(slopes), loop, verdict)


def check_ratio(xi: float) -> None:
    """Raises ``UserError`` for a damping ratio that is none."""
    if not 0.0 < xi < 1.5:
        raise UserError(f"--xi: {xi:g} is no damping ratio; the study takes {USUAL[0]:g} to {USUAL[1]:g}")


def damping(sigma0: Value, sigma2: float, mass: float, xi: float) -> Value:
    """``sigma1`` (N s/m) of eq. 11 at the damping ratio ``xi``; an assumption, so its error is that of ``USUAL`` ratios."""
    per_ratio = 2.0 * float(np.sqrt(max(sigma0.value, 0.0) * mass))
    return Value(max(per_ratio * xi - sigma2, 0.0), per_ratio * (USUAL[1] - USUAL[0]) / float(np.sqrt(12.0)))


def _turns(run: Recording, before: Section, after: Section) -> bool:
    """Whether a slow reversal lies between two sections that follow each other."""
    gap = float(run.t[max(after.first, before.last - 1)] - run.t[before.last - 1])
    return before.v * after.v < 0.0 and max(abs(before.v), abs(after.v)) < SLOW and gap < LONGEST_TURN


def _slope(run: Recording, force: np.ndarray, noise: float, before: Section, after: Section) -> float | None:
    """``dF/dx`` where friction passes through zero between two sections, None where too few samples show it."""
    levels = float(np.mean(force[before.middle])), float(np.mean(force[after.middle]))
    if levels[0] * levels[1] >= 0.0:
        return None
    part = slice(before.middle.stop, after.middle.start)
    t, measured, F = run.t[part], run.signals["x"][part], force[part]
    limit = NEAR_ZERO * min(abs(levels[0]), abs(levels[1]))
    # means of five keep single noisy samples of the plateaus out
    inside = np.abs(np.convolve(F, np.full(5, 0.2), mode="same")) < limit
    inside[:2] = inside[-2:] = False
    if np.count_nonzero(inside) < LEAST_SAMPLES:
        return None
    first, last = np.flatnonzero(inside)[[0, -1]]
    window = slice(first, last + 1)
    x = refined_motion(t, measured, noise).x[window]
    s = x - np.mean(x)
    return float(s @ F[window] / (s @ s)) if float(s @ s) > 0.0 else None
