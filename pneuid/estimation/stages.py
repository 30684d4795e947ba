"""The stages of an identification: relaxed, then continuous, then exact with a finer step.

Relaxed: defects penalised, coarse smoothing; from rough starts and with wrong models. Continuous: the parameters move along
simulated paths until continuity holds everywhere. Exact: continuity as equalities, at a time step whose error is small
beside the standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from pneuid.estimation.chained import Chained
from pneuid.estimation.growing import SLACK, Grown, grown, walked
from pneuid.estimation.refined import Refined
from pneuid.estimation.shooting import LOOSE, TIGHT, Shooting
from pneuid.estimation.solver import (
    CLOSE,
    CONVERGED,
    INTERRUPTED,
    NEAR,
    USUAL,
    Monitor,
    Outcome,
    Settling,
    solve_chained,
    solve_exact,
    solve_relaxed,
    solve_relaxed_again,
)  # fmt: skip
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

NO_DOUBT = 1.2
"""Cost of a path of sections, in units of the relaxed one, below which no other way is tried."""

REACH = 1e4
"""Cost of the simulation from the relaxed nodes, in the same units, above which windows that merge come before a path straight
from there, and parameters of sections are no start for the whole: of 28 random rigs 16 lie below 5e3, of which 15 lead there,
and 9 above 3e4, of which one does, by 41 iterations."""

STEP_SHARE = 0.4
"""Error of the stiffness from the time step, in units of its standard error, that the last stage may leave."""

FINEST = 16
"""Substeps per sample of the last stage are not raised beyond this by the wish for accuracy."""


COARSER = 4
"""Substeps of the last stage of a long record over those of its slopes; at 8 a parameter was 0.11 standard errors off."""

MISFIT = 1.2
"""Mean squared weighted residual above which standard errors are widened by its root, and the status says so."""

DOUBTFUL = 4.0
"""Standard deviations of the mean squared residual above 1 from which another start is tried."""


@dataclass(frozen=True)
class Relaxed:
    """The relaxed solution; level : mean square of its defects in their own spread; loose_cost : cost with loose defects,
    None where the fit did without."""

    outcome: Outcome
    level: float
    loose_cost: float | None


@dataclass(frozen=True)
class Exact:
    """The exact solution, the problem (with its time step) it solves, and its covariance."""

    outcome: Outcome
    problem: Shooting
    spread: Uncertainty


@dataclass(frozen=True)
class End:
    """Where one start has led; lacking : whether windows from several starts agree that the model cannot follow the data."""

    problem: Shooting
    soft: Relaxed
    hard: Exact | None = None
    interrupted: bool = False
    lacking: bool = False

    @property
    def loose_cost(self) -> float:
        """Cost of the relaxed fit with loose defects."""
        return loose_cost(self.problem, self.soft)

    @property
    def relaxed_cost(self) -> float:
        """Cost of the relaxed fit with the defects it ended with."""
        return self.soft.outcome.cost + self.soft.outcome.penalty

    @property
    def near(self) -> bool:
        """Whether the relaxed fit came near enough for the exact stage."""
        return self.problem.relaxation == TIGHT and self.soft.level < DEFECT_GATE

    @property
    def settled(self) -> bool:
        """Whether an exact fit was found that need not be doubted.

        One that leaves clearly more than the sensors' noise, but not so much that the model must be wrong, may be a
        local optimum of the pre-sliding parameters.
        """
        return self.hard is not None and (not self.doubtful or self.misfit >= MISFIT)

    @property
    def doubtful(self) -> bool:
        """Whether no exact fit was found, or one that leaves clearly more than the sensors' noise."""
        return self.misfit > 1.0 + DOUBTFUL * np.sqrt(2.0 / max(self.problem.weighted, 1))

    @property
    def misfit(self) -> float:
        """Mean squared weighted residual of the exact fit, infinite where there is none."""
        return np.inf if self.hard is None else 2 * self.hard.outcome.cost / max(self.problem.weighted, 1)


def loose_cost(problem: Shooting, soft: Relaxed) -> float:
    """Cost of the relaxed fit with loose defects; solved for from the tight solution where the fit did without."""
    if soft.loose_cost is not None:
        return soft.loose_cost
    loose = copy(problem)
    loose.relaxation = LOOSE
    found = solve_relaxed(loose, soft.outcome.X)
    return found.cost + found.penalty


def relaxed_stage(problem: Shooting, X0: np.ndarray, monitor: Monitor | None, settling: Settling = USUAL) -> Relaxed:
    """Loose defects first, until they have settled; tight ones where the model is near enough."""
    problem.relaxation = LOOSE
    soft = solve_relaxed(problem, X0, monitor, settling)
    level, loose = _level(problem, soft), soft.cost + soft.penalty
    if level < TIGHTEN_BELOW and soft.status != INTERRUPTED:
        problem.relaxation = TIGHT
        soft = solve_relaxed(problem, soft.X, monitor)
        level = _level(problem, soft)
    return Relaxed(soft, level, loose)


def tight_stage(problem: Shooting, X0: np.ndarray, monitor: Monitor | None, settling: Settling = USUAL) -> Relaxed:
    """Tight defects from the start, where break-away is about right."""
    problem.relaxation = TIGHT
    soft = solve_relaxed(problem, X0, monitor, settling)
    return Relaxed(soft, _level(problem, soft), None)


def relaxed_again(problem: Shooting, X0: np.ndarray, monitor: Monitor | None) -> Relaxed:
    """Tight defects at once, from parameters that are all but right already."""
    problem.relaxation = TIGHT
    soft = solve_relaxed_again(problem, X0, monitor)
    return Relaxed(soft, _level(problem, soft), None)


def unsolved(problem: Shooting, X: np.ndarray) -> Relaxed:
    """The point ``X`` of a fit that was stopped before it came to a step."""
    end, cost = problem.evaluate_values(X)
    penalty = 0.5 * float(np.sum((problem.defects(end, X) / problem.relaxation) ** 2))
    soft = Outcome(X, cost, penalty, INTERRUPTED, False, 0, 0.0)
    return Relaxed(soft, _level(problem, soft), cost + penalty)


def _level(problem: Shooting, soft: Outcome) -> float:
    return 2 * soft.penalty / max(problem.linked.size * problem.ns, 1)


def exact_stage(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Exact | None:
    """The exact fit straight from the relaxed one, or None where no continuous path comes near it.

    Raises ``KeyboardInterrupt`` where it is stopped: before continuity holds there is no better point than the relaxed one.
    """
    fine = finely(problem, soft.X, problem.substeps)
    return _finished(fine, _straight(fine, soft, monitor), monitor)


def exact_directly(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Exact | None:
    """The same without a path with cuts."""
    fine = finely(problem, soft.X, problem.substeps)
    return _finished(fine, _directly(fine, soft, soft.X, monitor), monitor)


def exact_past_slips(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Exact | None:
    """The same through paths with cuts alone."""
    fine = finely(problem, soft.X, problem.substeps)
    return _finished(fine, _past_slips(fine, soft, monitor), monitor)


def exact_by_windows(
    problem: Shooting, soft: Outcome, X: np.ndarray, monitor: Monitor | None, slack: float = SLACK
) -> tuple[Exact | None, Grown]:
    """The exact fit along windows that merge, from ``X`` (variables of ``problem``), as ``exact_stage``, and these windows.

    ``slack`` as in ``grown``.
    """
    fine = finely(problem, soft.X, problem.substeps)
    windows = grown(fine, X, NEAR_RELAXED * (soft.cost + soft.penalty), monitor, slack=slack)
    return _finished(fine, windows.path, monitor), windows


def _finished(fine: Shooting, path: Outcome | None, monitor: Monitor | None) -> Exact | None:
    """The exact fit from a nearly continuous path, at a time step that is small enough."""
    if path is None:
        return None
    spread = uncertainty(fine, path.X)
    wanted = _accurate_substeps(fine, path.X, spread)
    if wanted > fine.substeps:
        fine = finely(fine, path.X, wanted)
    hard = polished(fine, path.X, path.cost * 1.02, monitor)
    return Exact(hard, fine, uncertainty(fine, hard.X))


def exact_from(hard: Exact, nodes: np.ndarray, monitor: Monitor | None) -> Exact:
    """The exact fit from the parameters of ``hard`` and first states of the runs as in ``nodes`` (ns, nint), SI.

    A first state that once went far off, such as a bristle bent by more than friction can, stays there: the slips that it
    puts at the wrong time hold the parameters. Raises ``KeyboardInterrupt`` where it is stopped.
    """
    fine = hard.problem
    found = walked(Chained(fine), fine.join(hard.outcome.X[: fine.nq], nodes), monitor)
    return Exact(found, fine, uncertainty(fine, found.X)) if found.success else hard


def sharpened(
    problem: Shooting, soft: Outcome, starts: Sequence[np.ndarray], samples: int, monitor: Monitor | None
) -> Exact | None:
    """The exact fit of a part of a record of so many ``samples``, at the time step which the whole of it will ask for.

    ``starts`` (variables of ``problem``) of windows that merge, the likeliest first; None where no continuous path comes near.
    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    coarse = finely(problem, soft.X, problem.substeps)
    relaxed = soft.cost + soft.penalty
    path = _straight(coarse, soft, monitor, NEAR) if within_reach(problem, soft) else None
    if path is None or path.cost > NO_DOUBT * relaxed:
        limit = NEAR_RELAXED * relaxed if path is None else path.cost
        path = next((found for X in starts if (found := grown(coarse, X, limit, monitor, NEAR).path) is not None), path)
    if path is None:
        return None
    spread = uncertainty(coarse, path.X)
    expected = replace(spread, std=spread.std * np.sqrt(problem.total_samples / samples))
    wanted = _accurate_substeps(coarse, path.X, expected)
    if wanted == coarse.substeps:
        return Exact(path, coarse, spread)
    fine, slopes = finely(problem, path.X, wanted), finely(problem, path.X, max(problem.substeps, wanted // COARSER))
    return Exact(walked(Refined(fine, slopes), path.X, monitor, NEAR), fine, spread)


def exact_again(
    problem: Shooting, expected: float, X: np.ndarray, substeps: int, monitor: Monitor | None
) -> Exact | None:
    """The exact fit from parameters and first states ``X`` that are all but right already.

    None where the path from there is far from what was measured, or the fit's cost from what the relaxed one is ``expected``
    to have. Raises ``KeyboardInterrupt`` where it is stopped.
    """
    slopes = finely(problem, X, max(problem.substeps, substeps // COARSER))
    fine = finely(problem, X, substeps) if substeps > slopes.substeps else slopes
    whole = Chained(fine) if fine is slopes else Refined(fine, slopes)
    if not _reaches(whole, X, expected):
        return None
    found = walked(whole, X, monitor)
    if found.status != CONVERGED and fine is not slopes:
        found = walked(Chained(fine), found.X, monitor)  # with slopes that are a little off the last steps may not go down
    if not found.cost < NEAR_RELAXED * expected:
        return None
    return Exact(found, fine, uncertainty(slopes, found.X))


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
    return walked(Chained(problem), X, monitor)


def finely(problem: Shooting, X: np.ndarray, substeps: int) -> Shooting:
    """The same problem at fine smoothing with another step; stiffness bounds follow the step."""
    values = problem.values | dict(zip(problem.free, problem.scaling.to_values(X[: problem.nq]), strict=True))
    made = Shooting(problem.plant, problem.runs, problem.free, values, problem.ranges, substeps, problem.samples)
    made.set_smoothing(FINE)
    made.relaxation = problem.relaxation
    return made


def _straight(
    problem: Shooting, soft: Outcome, monitor: Monitor | None, settling: Settling = CLOSE
) -> Outcome | None:
    """Best path of one simulation per run, straight from the relaxed nodes; through a path with cuts where it must be."""
    return _directly(problem, soft, soft.X, monitor, settling) or _past_slips(problem, soft, monitor, settling)


def _directly(
    problem: Shooting, soft: Outcome, X: np.ndarray, monitor: Monitor | None, settling: Settling = CLOSE
) -> Outcome | None:
    """Best path of one simulation per run from ``X``, where it comes near the relaxed fit."""
    found = walked(Chained(problem), X, monitor, settling)
    return found if found.success and found.cost < NEAR_RELAXED * (soft.cost + soft.penalty) else None


def _past_slips(
    problem: Shooting, soft: Outcome, monitor: Monitor | None, settling: Settling = CLOSE
) -> Outcome | None:
    """The same from where a path leads that is cut at the slips that happen at a wrong time."""
    end, _ = problem.evaluate_values(soft.X)
    jump = np.abs(problem.defects(end, soft.X)).max(axis=1, initial=0.0)
    tried: list[tuple[int, ...]] = []
    for size in CUT_ABOVE:
        cuts = problem.linked[jump > size * np.median(jump)] if jump.size else np.zeros(0, dtype=int)
        if 0 < cuts.size <= max(LARGEST_CUTS * problem.nint, 3):
            tried.append(tuple(int(i) for i in cuts))
    for cuts in dict.fromkeys(tried):
        broken = Chained(problem, cuts)
        X = broken.to_base(solve_chained(broken, broken.from_base(soft.X), monitor).X)
        found = _directly(problem, soft, X, monitor, settling)
        if found is not None:
            return found
    return None


def within_reach(problem: Shooting, soft: Outcome) -> bool:
    """Whether the simulation from the relaxed nodes is near enough to what was measured for a path straight from there."""
    return _reaches(Chained(finely(problem, soft.X, problem.substeps)), soft.X, soft.cost + soft.penalty)


def _reaches(whole: Chained, X: np.ndarray, relaxed: float) -> bool:
    return whole.evaluate_values(whole.from_base(X))[1] < REACH * relaxed


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
