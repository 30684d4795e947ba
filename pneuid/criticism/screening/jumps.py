"""Jumps: what effects promise that act in jerks only, and show nothing of themselves in a column at zero.

Play, a film's lag or a memory change nothing at first order, so that screening predicts no drop for them. A step of a typical
size does, as seen by the same projection orthogonal to what is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pneuid.ahead import in_turn
from pneuid.criticism.screening.batches import Batch, batches, in_order
from pneuid.criticism.screening.fitted import Fitted
from pneuid.criticism.screening.scores import RUNS_AWAY, Score
from pneuid.effect import Effect, Parameter
from pneuid.estimation.fit import Fit

JUMPS, LEAPS = (1.0, 0.3, -0.3, -1.0), (5.0, -5.0)
"""Shares of a typical size at which an effect is looked at that may act in jerks; and those besides of one without a state of
its own, or that promises nothing there: a silencer ten times as narrow as usual is not felt at a typical size, where the edge
before it stays choked."""

NOTHING, HARDLY = 15.0, 0.01
"""Predicted drop, and share of the leading one's, below which a step of a typical size shows next to nothing: what chance
leaves, below which nothing is refitted, and what is lost beside what leads."""

FURTHEST = 2.0
"""Largest multiple of a jump's change that counts."""


@dataclass(frozen=True)
class Jump:
    """The best of an effect's sizable steps: predicted drop of half the sum of squares, and where the step leads (SI)."""

    drop: float
    start: dict[str, float]


def jumped(
    fit: Fit, scores: Sequence[Score], sizes: Mapping[str, Mapping[str, float]], order: Sequence[str]
) -> dict[str, Jump]:
    """What steps up and down promise, for the effects that ``sizes`` names with their values (SI) at a typical size.

    ``scores`` are those of the screening of ``fit``, ``order`` the catalogue's. The drop is that of the best multiple of the
    change that a step makes.
    """
    fitted = Fitted(fit)
    little = max(NOTHING, HARDLY * max((score.drop for score in scores), default=0.0))
    every = in_order((score.effect for score in scores), order)
    looks = []
    for batch in batches(fit.plant, every):  # those of the screening, whose plants are compiled already
        wanted = [effect for effect in batch if effect.name in sizes]
        if wanted:
            looks.append(partial(_jumps, fitted, Batch(fitted, batch, order), wanted, sizes, little))
    return {name: jump for found in in_turn(looks) for name, jump in found.items()}


def _jumps(
    fitted: Fitted, batch: Batch, wanted: Sequence[Effect], sizes: Mapping[str, Mapping[str, float]], little: float
) -> dict[str, Jump]:
    """The best jump of every wanted effect of one batch; further out where one promises less than ``little``."""
    found = {}
    for effect in wanted:
        best = _best_step(fitted, batch, effect, sizes[effect.name], JUMPS)
        if not effect.states or best.drop < little:
            further = _best_step(fitted, batch, effect, sizes[effect.name], LEAPS)
            best = max(best, further, key=lambda jump: jump.drop)
        found[effect.name] = best
    return found


def _best_step(fitted: Fitted, batch: Batch, effect: Effect, size: Mapping[str, float], parts: Sequence[float]) -> Jump:
    """The step of an effect by one of the ``parts`` of its ``size`` that promises most."""
    items = [item for item in batch.amplitudes if item.name in size]
    best = Jump(0.0, dict(size))
    steps = [dict(size) | {item.name: _stepped(batch, item, size, part) for item in items} for part in parts]
    for moved, nodes in zip(steps, batch.followed(steps) if effect.states else [batch.nodes] * len(steps), strict=True):
        change = batch.change(moved, nodes)
        if 0.0 < np.abs(change).max() < RUNS_AWAY:
            drop = _drop_along(fitted, change)
            best = Jump(drop, moved) if drop > best.drop else best
    return best


def _stepped(batch: Batch, item: Parameter, size: Mapping[str, float], part: float) -> float:
    """Value of an amplitude at a ``part`` of the way from off to its ``size``, within its bounds."""
    off = batch.off[item.name]
    return float(np.clip(off + part * (size[item.name] - off), item.lower, item.upper))


def _drop_along(fitted: Fitted, change: np.ndarray) -> float:
    """Drop of half the sum of squares by the best multiple of a change, what is fitted following."""
    cross = fitted.cross(change[:, None])[:, 0]
    solved = fitted.solver.solve(cross)
    curvature = max(float(change @ change - cross @ solved), 1e-12)
    slope = float(change @ fitted.residual - solved @ fitted.gradient)
    multiple = np.clip(-slope / curvature, 0.0, FURTHEST)
    return float(-(slope * multiple + 0.5 * curvature * multiple**2))
