"""From the nodes of the relaxed fit to one path per run, along windows that double in length.

One simulation of a whole run sees a break-away that comes a little too early as everything after it being wrong, and no step
leads out of that. A window of two intervals sees it as it is. Every window has a first state of its own, so each length is a
fit without jumps inside its windows; the next one starts where that has led.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import CLOSE, INTERRUPTED, USUAL, Monitor, Outcome, Settling, solve_chained

SHORT = (2, 4)
"""Lengths of the first windows, in steps of ``SAMPLES``. By the cost at the last of them the start is chosen: there the right
one is cheaper already, and the wrong ones have not yet cost much time."""

SAMPLES = 20
"""Samples that such a step has at least: with fewer the first states of the windows take up what the parameters should."""


def walked(whole: Chained, X: np.ndarray, monitor: Monitor | None, settling: Settling = CLOSE) -> Outcome:
    """Best path from the first states of ``X``, in the variables of the short intervals.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    found = solve_chained(whole, whole.from_base(X), monitor, settling)
    if found.status == INTERRUPTED:
        raise KeyboardInterrupt
    return replace(found, X=whole.to_base(found.X), success=bool(np.isfinite(found.cost)))


def grown(
    problem: Shooting, starts: Sequence[np.ndarray], limit: float, monitor: Monitor | None, settling: Settling = CLOSE
) -> Outcome | None:
    """Best path of one simulation per stretch, from that of the ``starts`` (variables of ``problem``) which is cheapest where
    windows are short; None where a length ends above the cost ``limit``.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    step = -(-SAMPLES // problem.samples)
    short = [n * step for n in SHORT]
    ends = [end for X in starts if (end := _along(problem, X, short, limit, monitor)) is not None]
    if not ends:
        return None
    longest, lengths = int(np.diff(np.append(problem.stretches, problem.nint)).max()), [2 * short[-1]]
    while 2 * lengths[-1] < longest:
        lengths.append(2 * lengths[-1])
    last = _along(problem, min(ends, key=lambda end: end.cost).X, lengths, limit, monitor)
    if last is None:
        return None
    path = walked(Chained(problem), last.X, monitor, settling)
    return path if path.success and path.cost < limit else None


def _along(
    problem: Shooting, X: np.ndarray, lengths: Sequence[int], limit: float, monitor: Monitor | None
) -> Outcome | None:
    """The end of windows of one length after the other; None where one ends above the cost ``limit``."""
    found = None
    for length in lengths:
        found = walked(Chained(problem, _cuts(problem, length)), X, monitor, USUAL)
        if not found.cost < limit:
            return None
        X = found.X
    return found


def _cuts(problem: Shooting, length: int) -> list[int]:
    """Intervals after which a new window of so many intervals begins."""
    ends = np.append(problem.stretches[1:], problem.nint)
    return [i - 1 for first, end in zip(problem.stretches, ends, strict=True) for i in range(first + length, end, length)]
