"""Where a run touches an end stop: how a stop throws the piston back is not modelled, so nothing is concluded across one."""

from __future__ import annotations

import numpy as np

END_MARGIN = 1.0e-3
"""Samples within this distance of an end of the stroke count as contact, m."""


def contact(x: np.ndarray, stroke: float) -> np.ndarray:
    """``(N,)`` where the piston is at an end stop; ``x`` and ``stroke`` in m."""
    return np.asarray((x < END_MARGIN) | (x > stroke - END_MARGIN))


def stretches(touching: np.ndarray, every: int) -> tuple[np.ndarray, np.ndarray]:
    """First intervals of the stretches that can be followed, and the samples ``(N,)`` that they hold.

    ``every`` samples make an interval. A stretch ends with the first sample at an end stop; the next begins with the first
    interval that is clear of it for at least half its length, which is enough to tell the state from.
    """
    first, held, lost = [0], np.zeros(touching.size, dtype=bool), False
    for k, start in enumerate(range(0, touching.size, every)):
        behind = np.logical_or.accumulate(touching[start : start + every])
        if lost and np.count_nonzero(~behind) >= every / 2:
            first.append(k)
            lost = False
        held[start : start + every] = False if lost else ~behind
        lost = lost or bool(behind[-1])
    return np.array(first), held
