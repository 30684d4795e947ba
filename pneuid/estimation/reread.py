"""The bristle read again at friction laws that follow pressure or position, once a relaxed fit has found them."""

from __future__ import annotations

from pneuid.estimation.first_guess import follows_state
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import INTERRUPTED
from pneuid.estimation.stages import End, Relaxed
from pneuid.estimation.task import Task, relaxed_fit, values_at

REREADS = 2
"""Times at most that the bristle is read again at the friction laws found."""

REREAD_GAIN = 0.01
"""Relative fall of the relaxed cost that makes another reading worth it."""


def reread(task: Task, found: tuple[Shooting, Relaxed]) -> tuple[Shooting, Relaxed]:
    """The relaxed fit again with the bristle read at the friction laws just found, until it is near or no longer comes down.

    Laws start at zero, so the first bristle is that of no pressure: a stick under another one then breaks away in the wrong
    interval, and no step leads out of that.
    """
    if not follows_state(task.plant):
        return found
    for _ in range(REREADS):
        problem, soft = found
        if soft.outcome.status == INTERRUPTED or End(problem, soft).near:
            break
        again = relaxed_fit(task, values_at(problem, soft.outcome.X))
        interrupted = again[1].outcome.status == INTERRUPTED
        if not (interrupted or End(*again).near or End(*again).loose_cost < (1.0 - REREAD_GAIN) * End(*found).loose_cost):
            break
        found = again
    return found
