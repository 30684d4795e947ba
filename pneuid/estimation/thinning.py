"""Sections of long runs: as many samples as the parameters need to come near, spread evenly over all that was recorded.

What takes many iterations is finding the parameters and the sticks and slips they make. A part of the record shows
enough for that; the whole of it is then fitted from there, in a few iterations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pneuid.estimation.differentiate import Motion
from pneuid.estimation.preparation import Run

SECTION = 1000
"""Samples of one section: long beside its first states, which are unknown."""

ENOUGH, SHARE = 7_000, 0.05
"""Samples of all sections together, about: that many, or a larger record's share, whose parameters are near enough to its own
for a few steps to do."""

LONG = 30_000
"""Samples from which a record is long."""

SEEN = 0.5
"""Share of its measured values that must count for a section to be of use."""


def sections(runs: Sequence[Run], turn: int = 0) -> tuple[Run, ...]:
    """Sections of ``runs``, each a run of its own; empty where the runs are too short, or masked too much, for it to pay.

    Every run in which something counts gives at least one. A section keeps its run's name, and so what the run has for
    itself. The first of a run begins with it; on another ``turn`` they lie half way between those.
    """
    total = sum(run.n for run in runs)
    if total < LONG:
        return ()
    wanted = max(ENOUGH, SHARE * total) / SECTION
    found = []
    for run in runs:
        seen = np.flatnonzero(run.weights.any(axis=0))
        if not seen.size:
            continue
        start, length = int(seen[0]), min(SECTION, int(np.ptp(seen)) + 1)
        count = max(1, round(wanted * run.n / total))
        spacing = (int(np.ptp(seen)) + 1 - length) / max(count - 1, 1)
        firsts = [start + int((k + 0.5 * turn) * spacing) for k in range(max(count - turn, 1))]
        found += [section(run, first, first + length) for first in firsts]
    used = tuple(one for one in found if np.count_nonzero(one.weights) >= SEEN * one.weights.size)
    size = sum(one.n for one in used)
    return used if ENOUGH / 3 <= size <= total / 2 else ()


def section(run: Run, first: int, last: int) -> Run:
    """The samples from ``first`` up to ``last`` of a run that is prepared already: smoothed and masked as a whole."""
    part, recording, motion = slice(first, last), run.recording, run.motion
    held = replace(
        recording, t=recording.t[part],
        signals={name: y[part] for name, y in recording.signals.items()},
        weights={name: weight[part] for name, weight in recording.weights.items()},
    )  # fmt: skip
    moved = Motion(motion.x[part], motion.v[part], motion.a[part], motion.bandwidth)
    # its time goes on from the run's, so that the section that begins the run can be told
    return replace(run, t=run.t[part], data=run.data[:, part], recording=held, motion=moved, contact=run.contact[part])
