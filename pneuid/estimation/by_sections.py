"""A long record fitted from where its sections lead: first the exact fit of a part, then the whole in a few steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pneuid.estimation.exact_end import window_starts
from pneuid.estimation.reread import reread
from pneuid.estimation.shooting import TIGHT, Shooting
from pneuid.estimation.solver import INTERRUPTED, ROUGHLY
from pneuid.estimation.stages import NEAR_RELAXED, End, Exact, Relaxed, exact_again, relaxed_again, sharpened, unsolved
from pneuid.estimation.task import Task, inside, relaxed_fit, values_at
from pneuid.estimation.thinning import sections

DRAWS = 2
"""Times at most that sections are drawn from a long record: now and then a slip of one ends in the wrong place."""


def by_sections(task: Task, start: Mapping[str, float]) -> End | None:
    """A long record fitted from where its sections lead; None for a short one, and where that is no exact fit."""
    for turn in range(DRAWS):
        few = sections(task.runs, turn)
        if not few:
            return None
        part = replace(task, runs=few, known={}, loosely=ROUGHLY)
        problem, soft = reread(part, relaxed_fit(part, start))
        values = values_at(problem, soft.outcome.X)
        if soft.outcome.status == INTERRUPTED:
            return _stopped(task, values)
        if problem.relaxation != TIGHT:
            return None  # other sections will not make a wrong model right
        try:
            sharp = _sharpened(part, problem, soft, sum(run.n for run in task.runs))
            if sharp is not None:
                values = values_at(sharp.problem, sharp.outcome.X)
                return _whole(task, problem, soft, sharp)
        except KeyboardInterrupt:
            return _stopped(task, values)
    return None


def _sharpened(part: Task, problem: Shooting, soft: Relaxed, samples: int) -> Exact | None:
    """The exact fit of sections of a record of so many ``samples``, where the relaxed one came near enough."""
    if not End(problem, soft).near:
        return None
    return sharpened(problem, soft.outcome, window_starts(part, problem, soft), samples, part.monitor)


def _whole(task: Task, problem: Shooting, soft: Relaxed, sharp: Exact) -> End | None:
    """The whole record from the relaxed and the exact fit of its sections; None where that is no exact fit.

    The exact fit first: on its path the relaxed one has the least to do. Raises ``KeyboardInterrupt`` where it is stopped.
    """
    whole, X = _read(task, values_at(problem, soft.outcome.X), problem.substeps)
    expected = (soft.outcome.cost + soft.outcome.penalty) * whole.weighted / problem.weighted
    substeps = max(sharp.problem.substeps, whole.substeps)
    hard = exact_again(whole, expected, _starting(whole, X, sharp), substeps, task.monitor)
    if hard is None:
        return None
    again = relaxed_again(whole, hard.outcome.X, task.monitor)
    end = End(whole, again, hard, interrupted=again.outcome.status == INTERRUPTED)
    held = end.near and hard.outcome.cost < NEAR_RELAXED * end.relaxed_cost
    return end if held or end.interrupted else None


def _read(task: Task, values: Mapping[str, float], substeps: int) -> tuple[Shooting, np.ndarray]:
    """The whole record's problem, of at least so many ``substeps``, and its variables at ``values`` (SI)."""
    known = task.guess | dict(values)
    whole = task.problem(known, max(substeps, task.substeps(known)))
    return whole, whole.join(inside(whole, known), task.nodes(known, whole.samples))


def _stopped(task: Task, values: Mapping[str, float]) -> End:
    """The whole record at ``values`` (SI), where its fit was stopped."""
    whole, X = _read(task, values, 1)
    return End(whole, unsolved(whole, X), interrupted=True)


def _starting(whole: Shooting, X: np.ndarray, sharp: Exact) -> np.ndarray:
    """``X`` of the ``whole`` record with parameters of its sections' exact fit, and first states of those that begin a run."""
    part = sharp.problem
    q, nodes = whole.split(X)
    values, (_, known) = values_at(part, sharp.outcome.X), part.split(sharp.outcome.X)
    for run, first in zip(whole.runs, whole.first[:-1], strict=True):
        for one, at in zip(part.runs, part.first[:-1], strict=True):
            if one.name == run.name and one.t[0] == run.t[0]:
                nodes[:, first] = known[:, at]
    return whole.join(inside(whole, values_at(whole, q) | values), nodes)
