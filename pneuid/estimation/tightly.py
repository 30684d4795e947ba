"""Relaxed fits with tight defects from the start, with break-away from what was found and from typical seals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial

from pneuid.ahead import in_turn
from pneuid.estimation.shooting import TIGHT, Shooting
from pneuid.estimation.solver import INTERRUPTED
from pneuid.estimation.stages import End, Relaxed, tight_stage
from pneuid.estimation.starts import damped, seals
from pneuid.estimation.task import Task, relaxed_fit, values_at

Found = tuple[Shooting, Relaxed]

ROUNDS = 4
"""Times at most that the best end so far is read anew."""

SURE = 5.0
"""Half the sum of squares by which another start's end must be better: 3 standard deviations of a parameter."""


def tightly(task: Task, found: Found) -> Found:
    """The cheapest of a relaxed fit and of others with tight defects from the start, with which the same end costs more.

    Loose defects take up what a break-away does, and let the bristle become stiff and undamped, or its static friction high and
    narrow, from where tight ones do not come back. From break-away as it was found, or of a typical seal, with every node read
    anew from the data, tight defects at once find the way, in a third of the time. The best one is read anew while that helps.
    """
    if task.plant.law.static:
        return found
    task = replace(task, known={}, again=True)  # a seal too stiff for the samples is no slow recording
    values = values_at(found[0], found[1].outcome.X)
    softest, *others = seals(task.plant, values)
    best = _cheapest(task, found, [values, softest])
    if best[1].outcome.status == INTERRUPTED or (best is found and found[0].relaxation != TIGHT):
        return best  # as a rule the model lacks something, where loose defects cost less
    best = _cheapest(task, best, others)
    for _ in range(ROUNDS):
        if best is found or best[1].outcome.status == INTERRUPTED:
            break
        before, values = best, values_at(best[0], best[1].outcome.X)
        best = _cheapest(task, best, [values, damped(task.plant, values)], _to_its_end)
        if best is before:
            break
    return best


def _once(task: Task, start: Mapping[str, float]) -> Found:
    """The relaxed fit with tight defects from ``start``."""
    return relaxed_fit(task, start, tight_stage)


def _to_its_end(task: Task, start: Mapping[str, float]) -> Found:
    """The same, once more from the parameters it came to where its iterations did not suffice.

    What holds it up then is a node's bristle, stuck on the wrong side of a kink, and seldom the parameters.
    """
    found = _once(task, start)
    if found[1].outcome.success or found[1].outcome.status == INTERRUPTED:
        return found
    again = _once(task, values_at(found[0], found[1].outcome.X))
    stopped = again[1].outcome.status == INTERRUPTED
    return again if stopped or End(*again).relaxed_cost < End(*found).relaxed_cost else found


def _cheapest(
    task: Task, found: Found, starts: Sequence[Mapping[str, float]], fitted: Callable[..., Found] = _once
) -> Found:
    """The relaxed fit ``found``, or one ``fitted`` from the ``starts`` that costs clearly less; labelled so where stopped."""
    best, stopped = found, False
    with closing(in_turn([partial(fitted, task, start) for start in starts], (task.plant, *task.runs))) as ends:
        try:
            for other in ends:
                stopped = other[1].outcome.status == INTERRUPTED
                if stopped:
                    break
                if End(*other).relaxed_cost < End(*best).relaxed_cost - SURE:
                    best = other
        except KeyboardInterrupt:
            stopped = True
    problem, soft = best
    return (problem, replace(soft, outcome=replace(soft.outcome, status=INTERRUPTED))) if stopped else best
