"""Where the exact stage leads from one relaxed fit: tried again from what most often went wrong, until only noise is left or
windows from two starts agree that the model cannot follow the data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from pneuid.ahead import in_turn
from pneuid.estimation.growing import Grown, agree
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import INTERRUPTED
from pneuid.estimation.stages import (
    End,
    Exact,
    Relaxed,
    exact_by_windows,
    exact_directly,
    exact_from,
    exact_past_slips,
    exact_stage,
    relaxed_again,
    within_reach,
)
from pneuid.estimation.starts import break_aways
from pneuid.estimation.task import Task, inside, values_at
from pneuid.estimation.tightly import tightly

DEARER = 0.01
"""Relative rise of the relaxed cost up to which a break-away seen along windows is taken: that cost hardly sees it."""

LIKELY = 2
"""Ways to the exact fit that are tried where it is asked for soon: straight, where that is near, and windows from one start."""

NO_SLACK = 1.0
"""Cost along windows, in units of the limit of the whole path, at which they are given up there: of paths that led to an exact
fit none cost more than 1.4 times the shortest windows on the way."""

Way = Callable[[], Exact | None]
"""One attempt at the exact fit; None where it leads to none."""


def exact_end(task: Task, problem: Shooting, soft: Relaxed) -> End:
    """The exact stage, where the relaxed one came near enough; from a cheaper relaxed fit, where that leads to no good end."""
    end = End(problem, soft, interrupted=soft.outcome.status == INTERRUPTED)
    if end.interrupted:
        return end
    end = _by_ways(task, end)
    if end.interrupted or not end.doubtful:
        return end
    found = tightly(task, (end.problem, end.soft))
    if found[1] is end.soft:
        return end
    other = End(*found, interrupted=found[1].outcome.status == INTERRUPTED, lacking=end.lacking)
    if not (other.interrupted or end.lacking):
        other = _by_ways(task, other, LIKELY)
    return other if end.hard is None else better(end, other)


def _by_ways(task: Task, end: End, most: int | None = None) -> End:
    """``end`` with the best exact fit to which one way after the other leads, of so many at ``most``."""
    problem, soft = end.problem, end.soft
    if not end.near:
        return end
    grown: list[Grown] = []

    def windows(X: np.ndarray) -> Exact | None:
        hard, found = exact_by_windows(problem, soft.outcome, X, task.monitor)
        grown.append(found)
        return hard

    paths = 0
    for way in islice(_ways(task, problem, soft, windows), most):
        found = _sharp(task, end, way)
        end, paths = better(end, found), paths + (found.hard is not None)
        if end.interrupted or not end.doubtful:
            break
        if end.settled and paths > 1:
            break  # paths from two starts leave so much that the model must differ from the rig: a third does not mend that
        if len(grown) > 1 and agree(*grown[-2:]):
            return _relaxed_at(end, grown, task)  # from elsewhere it would take long to end nowhere
    return end


def likely_end(task: Task, problem: Shooting, soft: Relaxed) -> End:
    """Where the likeliest ways lead, of which the first exact fit is taken: soon decided whether the model is right or not.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    end = End(problem, soft)

    def windows(X: np.ndarray) -> Exact | None:
        return exact_by_windows(problem, soft.outcome, X, task.monitor, NO_SLACK)[0]

    if not end.near:
        return end
    near, at = within_reach(problem, soft.outcome), (problem, soft.outcome, task.monitor)
    if near and (hard := exact_directly(*at)) is not None:
        return replace(end, hard=hard)
    along = [partial(windows, start) for start in window_starts(task, problem, soft)]
    ways: list[Way] = [partial(exact_past_slips, *at), *along] if near else [*along, partial(exact_stage, *at)]
    with closing(in_turn(ways[:LIKELY], (problem.plant, *problem.runs))) as ends:
        return replace(end, hard=next((hard for hard in ends if hard is not None), None))


def _ways(task: Task, problem: Shooting, soft: Relaxed, windows: Callable[[np.ndarray], Exact | None]) -> Iterator[Way]:
    """What is tried one after the other: straight, along ``windows`` from several starts, straight from other break-aways."""

    def straight(X: np.ndarray) -> Way:
        return partial(exact_stage, problem, replace(soft.outcome, X=X), task.monitor)

    # straight first where that may well lead there, for it takes a tenth of the time
    near, X = within_reach(problem, soft.outcome), soft.outcome.X
    if near:
        yield straight(X)
    for start in window_starts(task, problem, soft):
        yield partial(windows, start)
    if not near:
        yield straight(X)
    relaxed = values_at(problem, X)
    for other in break_aways(problem.plant, relaxed):
        yield straight(np.concatenate([inside(problem, relaxed | other), X[problem.nq :]]))


def _relaxed_at(end: End, grown: Sequence[Grown], task: Task) -> End:
    """The end of a model that lacks something, its relaxed fit at the break-away that short windows show.

    The relaxed fit hardly sees a break-away, and no exact one puts it right.
    """
    end = replace(end, lacking=True)
    shown = [one.held for one in grown if one.held is not None]
    if end.hard is not None or not shown:
        return end
    soft = relaxed_again(end.problem, shown[0], task.monitor)
    found = replace(end, soft=soft, interrupted=soft.outcome.status == INTERRUPTED)
    return found if found.relaxed_cost < (1.0 + DEARER) * end.relaxed_cost else replace(end, interrupted=found.interrupted)


def window_starts(task: Task, problem: Shooting, soft: Relaxed) -> list[np.ndarray]:
    """Starts of windows that merge, in the variables of ``problem``, the likeliest first; the last is the relaxed fit.

    A break-away that the relaxed fit has found far off seldom leads anywhere, so that of the data's own guess comes first.
    """
    return [*task.fresh_starts(problem, soft.outcome.X), soft.outcome.X]


def _sharp(task: Task, end: End, way: Way) -> End:
    """``end`` with the exact fit that one way leads to; where that is to be doubted, also with the first states read anew."""
    try:
        end = replace(end, hard=way())
        if end.hard is None or not end.doubtful:
            return end
        values = task.guess | values_at(end.hard.problem, end.hard.outcome.X)
        nodes = task.nodes(values, end.hard.problem.samples)
        return better(end, replace(end, hard=exact_from(end.hard, nodes, task.monitor)))
    except KeyboardInterrupt:
        return replace(end, interrupted=True)


def better(one: End, later: End) -> End:
    """Which of two ends leaves less; stopped where the later one was."""
    best = min(one, later, key=lambda end: end.misfit)
    return replace(best, interrupted=later.interrupted, lacking=one.lacking or later.lacking)
