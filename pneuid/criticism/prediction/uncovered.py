"""What held-out runs ask for that no training run shows: samples outside the range of the training runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pneuid.effects._spline import Term
from pneuid.estimation.curves import signal_of, visited
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run

MUCH, MARGIN = 0.1, 0.05
"""Share of the held-out samples outside the range of a signal in the training runs from which nothing has shown what happens
there, and the margin of that range, in its width."""

SHOWN = {"p1": ("bar abs", 1e-5), "p2": ("bar abs", 1e-5), "v": ("m/s", 1.0), "x": ("mm", 1e3)}
"""Signals that are looked at, each with the unit it is said in and its factor from SI."""

SAID = "held-out samples lie outside the range of the training runs, where nothing has shown what the model does: {}"
EACH = "{:.0f} % by {} ({:.3g} to {:.3g} {} in training)"


def outside(fit: Fit, term: Term, held: Sequence[Run]) -> float:
    """Share of the samples of ``held`` at which the signal of ``term`` is outside its range in the runs fitted to."""
    low, high = visited(fit.runs, term, fit)
    margin = MARGIN * (high - low)
    seen = np.concatenate([signal_of(run, term.signal, fit) for run in held])
    return float(np.mean((seen < low - margin) | (seen > high + margin)))


def uncovered(fit: Fit, held: Sequence[Run]) -> list[str]:
    """A sentence on the signals that leave their range in the training runs for much of the held-out ones, if any does."""
    words = []
    for signal, (unit, factor) in SHOWN.items():
        term = Term("force", signal)
        share = outside(fit, term, held)
        if share > MUCH:
            low, high = (factor * end for end in visited(fit.runs, term, fit))
            words.append(EACH.format(100 * share, signal, low, high, unit))
    return [SAID.format(", ".join(words))] if words else []
