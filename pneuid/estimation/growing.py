"""From the nodes of the relaxed fit to one path per run, along windows that merge.

One simulation of a whole run sees a break-away that comes a little too early as everything after it being wrong, and no step
leads out of that. A window of two intervals sees it as it is. Every window has a first state of its own, so each set of
windows is a fit without jumps inside them. Then neighbours merge where one simulation across both is not far off; where it
is, a slip happens at the wrong time, and its windows wait until the others have moved the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneuid.estimation.chained import Chained
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import CLOSE, INTERRUPTED, ROUGHLY, Monitor, Outcome, Settling, solve_chained

SHORTEST, SAMPLES = 2, 20
"""Length of the first windows in steps, and samples that a step has at least: with fewer the first states of the windows take
up what the parameters should."""

ACROSS = 30.0
"""Weighted squared error per sample and signal that one simulation across two windows may add for them to merge, where noise
alone is 1. At 1 windows that show what the parameters lack stay apart and teach nothing; at 1000 one slip at the wrong time
bends all parameters (random rigs 5804 and 6001)."""

FURTHER, FURTHEST = 10.0, 1e6
"""Factor by which that is raised where no windows merge, and where all do."""

SLACK = 3.0
"""Cost along windows, in units of the limit of the whole path, at which they are given up: a slip at the wrong time costs much
just before the parameters move to where it happens at the right one."""


RISEN, SAME = 1.15, 0.1
"""Cost along windows, in units of that along the shortest, from which it tells what the model lacks, and the difference
within which two starts tell the same, relative to the smaller."""


@dataclass(frozen=True)
class Grown:
    """path : the best one of one simulation per stretch, None where it or windows on the way there cost far too much; costs :
    along every set of windows on the way, the shortest first; held : variables along the last of those that cost little more
    than the shortest, None without any."""

    path: Outcome | None
    costs: tuple[float, ...]
    held: np.ndarray | None = None


def walked(whole: Chained, X: np.ndarray, monitor: Monitor | None, settling: Settling = CLOSE) -> Outcome:
    """Best path from the first states of ``X``, in the variables of the short intervals.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    found = solve_chained(whole, whole.from_base(X), monitor, settling)
    if found.status == INTERRUPTED:
        raise KeyboardInterrupt
    return replace(found, X=whole.to_base(found.X), success=bool(np.isfinite(found.cost)))


def grown(
    problem: Shooting, X: np.ndarray, limit: float, monitor: Monitor | None, settling: Settling = CLOSE, slack: float = SLACK
) -> Grown:
    """Best path of one simulation per stretch from ``X`` (variables of ``problem``); none where it ends above the cost
    ``limit``, or windows on the way there above ``slack`` times that.

    Raises ``KeyboardInterrupt`` where it is stopped.
    """
    length = SHORTEST * -(-SAMPLES // problem.samples)
    spans = zip(problem.stretches, np.append(problem.stretches[1:], problem.nint), strict=True)
    cuts = [i - 1 for first, end in spans for i in range(first + length, end, length)]
    costs: list[float] = []
    held = None
    while cuts:
        found = walked(Chained(problem, cuts), X, monitor, ROUGHLY)
        costs.append(found.cost)
        if not found.cost < slack * limit:
            return Grown(None, tuple(costs), held)
        if found.cost <= RISEN * costs[0]:
            held = found.X
        X, cuts = found.X, merged(problem, cuts, found.X)
    path = walked(Chained(problem), X, monitor, settling)
    return Grown(path if path.success and path.cost < limit else None, tuple(costs), held)


def agree(one: Grown, other: Grown) -> bool:
    """Whether windows from two starts show that no parameters of the model follow what was measured: neither led to a path, and
    where both begin to cost more than the shortest ones they cost the same.

    A slip at the wrong time costs each start what it pleases; the drift of what the model lacks costs all the same.
    """
    if one.path is not None or other.path is not None:
        return False
    least = min([*one.costs[:1], *other.costs[:1]], default=np.inf)
    for costs in zip(one.costs, other.costs, strict=False):
        if min(costs) > RISEN * least:
            return max(costs) < (1.0 + SAME) * min(costs)
    return False


def merged(problem: Shooting, cuts: Sequence[int], X: np.ndarray) -> list[int]:
    """The ``cuts`` (intervals after which a window ends) that are left at ``X`` where neighbours merge; always fewer."""
    added = _added(problem, cuts, X)
    edges = np.unique([*problem.stretches, *(cut + 1 for cut in cuts), problem.nint])
    allowed = 0.5 * ACROSS * problem.weighted / problem.nint
    while allowed < FURTHEST * problem.weighted / problem.nint:
        gone: set[int] = set()
        for cut in [*cuts[::2], *cuts[1::2]]:
            before, after = edges[np.searchsorted(edges, cut + 1) + np.array([-1, 1])]
            # a window merges with one neighbour at a time, so that both were simulated as they will be
            if added[cut] < allowed * (after - cut - 1) and not {before - 1, after - 1} & gone:
                gone.add(cut)
        if gone:
            return [cut for cut in cuts if cut not in gone]
        allowed *= FURTHER
    return []


def _added(problem: Shooting, cuts: Sequence[int], X: np.ndarray) -> dict[int, float]:
    """What a simulation from the window before adds to the cost of the window after every one of the ``cuts``."""
    edges = np.unique([*problem.stretches, *(cut + 1 for cut in cuts), problem.nint])
    apart, added = _costs(problem, cuts, X), {}
    for kept, dropped in ((cuts[1::2], cuts[::2]), (cuts[::2], cuts[1::2])):
        across = _costs(problem, kept, X)
        for cut in dropped:
            window = slice(cut + 1, edges[np.searchsorted(edges, cut + 1) + 1])
            added[cut] = float(np.sum(across[window] - apart[window]))
    return added


def _costs(problem: Shooting, cuts: Sequence[int], X: np.ndarray) -> np.ndarray:
    """Data cost of every interval ``(nint,)`` along windows that end after ``cuts``."""
    windows = Chained(problem, cuts)
    return windows.interval_costs(windows.from_base(X))
