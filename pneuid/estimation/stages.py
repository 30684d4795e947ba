"""The stages of an identification: relaxed, then continuous, then exact with a finer step.

Relaxed: defects penalised, coarse smoothing; from rough starts and with wrong models. Continuous: the parameters move along
simulated paths until continuity holds everywhere. Exact: continuity as equalities, at a time step whose error is small
beside the standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import LOOSE, TIGHT, Shooting
from pneuid.estimation.solver import INTERRUPTED, Monitor, Outcome, solve_chained, solve_exact, solve_relaxed
from pneuid.estimation.uncertainty import Uncertainty, uncertainty
from pneuid.physics.smoothing import FINE
from pneuid.step import fastest_rates

TIGHTEN_BELOW = 0.25
"""Mean square of the loose defects, in their own spread, below which the tight relaxed problem is worth solving."""

DEFECT_GATE = 0.6
"""Mean square of the relaxed defects, in their own spread, above which the exact stage is not tried: the model is too
wrong for it. A right model leaves about 0.15, a missing effect of twice the noise more than 1."""

NEAR_RELAXED = 2.0
"""Cost of an acceptable exact solution, in units of the relaxed one; beyond it a slip happens at the wrong time."""

CUT_ABOVE = (3.5, 2.0)
"""Defects, in units of their median, at which the path is cut to let the parameters move past a slip."""

LARGEST_CUTS = 0.1
"""Share of the intervals that may be cut."""

STEP_SHARE = 0.4
"""Error of the stiffness from the time step, in units of its standard error, that the last stage may leave."""

FINEST = 16
"""Substeps per sample of the last stage are not raised beyond this by the wish for accuracy."""


@dataclass(frozen=True)
class Relaxed:
    """The relaxed solution; level : mean square of its defects in their own spread; loose_cost : cost with loose defects."""

    outcome: Outcome
    level: float
    loose_cost: float


@dataclass(frozen=True)
class Exact:
    """The exact solution, the problem (with its time step) it solves, and its covariance."""

    outcome: Outcome
    problem: Shooting
    spread: Uncertainty


def relaxed_stage(problem: Shooting, X0: np.ndarray, monitor: Monitor | None) -> Relaxed:
    """Loose defects first; tight ones where the model is near enough."""
    links = max(problem.linked.size * problem.ns, 1)
    problem.relaxation = LOOSE
    soft = solve_relaxed(problem, X0, monitor)
    level, loose = 2 * soft.penalty / links, soft.cost + soft.penalty
    if level < TIGHTEN_BELOW and soft.status != INTERRUPTED:
        problem.relaxation = TIGHT
        soft = solve_relaxed(problem, soft.X, monitor)
        level = 2 * soft.penalty / links
    return Relaxed(soft, level, loose)


def exact_stage(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Exact | None:
    """The exact fit from the relaxed one, or None where no continuous path comes near it.

    Raises ``KeyboardInterrupt`` where it is stopped: before continuity holds there is no better point than the relaxed one.
    """
    fine = _like(problem, soft.X, problem.substeps)
    path = _continuous(fine, soft, monitor)
    if path is None:
        return None
    spread = uncertainty(fine, path.X)
    wanted = _accurate_substeps(fine, path.X, spread)
    if wanted > fine.substeps:
        fine = _like(fine, path.X, wanted)
    hard = polished(fine, path.X, path.cost * 1.02, monitor)
    return Exact(hard, fine, uncertainty(fine, hard.X))


def polished(problem: Shooting, X: np.ndarray, limit: float, monitor: Monitor | None) -> Outcome:
    """The exact solution near a nearly continuous path ``X``, whose cost should stay below ``limit``.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    hard = solve_exact(problem, X, monitor)
    if hard.status == INTERRUPTED:
        raise KeyboardInterrupt
    if hard.success and hard.cost <= limit:
        return hard
    # what is left to move is the change of the step or of a pinned parameter, which a simulated path takes up
    walked = Chained(problem)
    again = solve_chained(walked, walked.from_base(X), monitor)
    if again.status == INTERRUPTED:
        raise KeyboardInterrupt
    return replace(again, X=walked.to_base(again.X), success=bool(np.isfinite(again.cost)))


def _like(problem: Shooting, X: np.ndarray, substeps: int) -> Shooting:
    """The same problem at fine smoothing with another step; stiffness bounds follow the step."""
    values = problem.values | dict(zip(problem.free, problem.scaling.to_values(X[: problem.nq]), strict=True))
    made = Shooting(problem.plant, problem.runs, problem.free, values, problem.ranges, substeps, problem.samples)
    made.set_smoothing(FINE)
    made.relaxation = problem.relaxation
    return made


def _continuous(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Outcome | None:
    """Best path of one simulation per run, found from the relaxed nodes; through a path with cuts where it must be."""
    enough = NEAR_RELAXED * (soft.cost + soft.penalty)
    end, _ = problem.evaluate_values(soft.X)
    jump = np.abs(problem.defects(end, soft.X)).max(axis=1, initial=0.0)
    tried: list[tuple[int, ...]] = [()]
    for size in CUT_ABOVE:
        cuts = problem.linked[jump > size * np.median(jump)] if jump.size else np.zeros(0, dtype=int)
        if 0 < cuts.size <= max(LARGEST_CUTS * problem.nint, 3):
            tried.append(tuple(int(i) for i in cuts))
    for cuts in dict.fromkeys(tried):
        X = soft.X
        if cuts:
            broken = Chained(problem, cuts)
            X = broken.to_base(solve_chained(broken, broken.from_base(X), monitor).X)
        whole = Chained(problem)
        found = solve_chained(whole, whole.from_base(X), monitor)
        if found.status == INTERRUPTED:
            raise KeyboardInterrupt
        if np.isfinite(found.cost) and found.cost < enough:
            return replace(found, X=whole.to_base(found.X))
    return None


def _accurate_substeps(problem: Shooting, X: np.ndarray, spread: Uncertainty) -> int:
    """Substeps at which the midpoint rule's error of the stiffness drops below ``STEP_SHARE`` standard errors.

    The rule slows an oscillation of frequency w by the share ``(h w)^2 / 6``, so a stiffness comes out ``(h w)^2 / 3`` low.
    Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), section I.5.
    """
    if "sigma0" not in problem.free:
        return problem.substeps
    j = problem.free.index("sigma0")
    values = problem.values | dict(zip(problem.free, problem.scaling.to_values(X[: problem.nq]), strict=True))
    rates: Mapping[str, float] = fastest_rates(problem.plant, problem.plant.theta(values, problem.ranges))
    if not rates or spread.std[j] <= 0.0:
        return problem.substeps
    interval = float(np.median(problem.data[0]))
    allowed = STEP_SHARE * spread.std[j] / values["sigma0"]
    wanted = interval * rates["bristle"] / np.sqrt(3.0 * allowed)
    found = problem.substeps
    while found < wanted and 2 * found <= max(FINEST, problem.substeps):
        found *= 2  # powers of two, so that few functions have to be compiled
    return found
