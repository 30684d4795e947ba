"""Where the exact stage leads from one relaxed fit: tried again from what most often went wrong, until only noise is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import INTERRUPTED
from pneuid.estimation.stages import End, Relaxed, exact_again, exact_from, exact_stage
from pneuid.estimation.starts import break_aways
from pneuid.estimation.task import Task, inside, values_at


def exact_end(task: Task, problem: Shooting, soft: Relaxed, known: tuple[np.ndarray, int] | None = None) -> End:
    """The exact stage, where the relaxed one came near enough; shorter where parameters and time step are ``known``."""
    end = End(problem, soft, interrupted=soft.outcome.status == INTERRUPTED)
    if end.interrupted or not end.near:
        return end
    if known is not None:
        try:
            return replace(end, hard=exact_again(problem, soft.outcome, *known, task.monitor))
        except KeyboardInterrupt:
            return replace(end, interrupted=True)
    relaxed = values_at(problem, soft.outcome.X)
    end = _sharp(task, end, soft.outcome.X)
    for other in break_aways(problem.plant, relaxed):
        if end.interrupted or not end.doubtful:
            break
        X = np.concatenate([inside(problem, relaxed | other), soft.outcome.X[problem.nq :]])
        end = better(end, _sharp(task, End(problem, soft), X))
    return end


def _sharp(task: Task, end: End, X: np.ndarray) -> End:
    """Relaxed ``end`` with the exact fit from ``X``; where that is to be doubted, also with the first states read anew."""
    try:
        end = replace(end, hard=exact_stage(end.problem, replace(end.soft.outcome, X=X), task.monitor))
        if end.hard is None or not end.doubtful:
            return end
        values = task.guess() | values_at(end.hard.problem, end.hard.outcome.X)
        nodes = task.nodes(values, end.hard.problem.samples)
        return better(end, replace(end, hard=exact_from(end.hard, nodes, task.monitor)))
    except KeyboardInterrupt:
        return replace(end, interrupted=True)


def better(one: End, later: End) -> End:
    """Which of two ends leaves less; stopped where the later one was."""
    return replace(min(one, later, key=lambda end: end.misfit), interrupted=later.interrupted)
