"""Whether a function of a signal makes further looks at the catalogue needless."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pneuid.criticism.decision.acceptance import Tried, costs
from pneuid.criticism.prediction.uncovered import MUCH
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score
from pneuid.criticism.unknown.function_search import LEAKS, Found

ALONE, LEAVES = ((0.9, 2.0), (0.5, 10.0)), 0.5
"""Shares of the held-out excess that a function of a signal must explain, each with the times that it must take of what any
effect took or promises of the training cost, and share of what each of those refitted leaves that it may leave, for no more of
them to be tried. Of 47 rigs on which effects of the catalogue hide one function that explains nine tenths takes 1.4 times as
much at most, and what takes more than 2.3 times as much explains nothing; of 30 on which none hides 14 take 2.6 to 36 times as
much and explain 77 to 100 %. Two functions, both flows over the command, take 2.2 times as much in place of a silencer."""


def explains_alone(function: Found, scores: Sequence[Score], tried: Tried, current: Trial) -> bool:
    """Whether a function of a signal, inside its range, explains most of what the base model leaves, takes far more of the
    training cost than any effect took or promises, and leaves far less than any of those refitted."""
    over = {(term.signal, term.factor) for term in function.joint.terms}
    # a hole or a leak is one function in two balances
    one = len(function.joint.terms) == 1 or (len(over) == 1 and over <= set(LEAKS))
    left = min((trial.whole - 1.0 for _, trial in tried), default=np.inf)
    if not one or function.beyond > MUCH or function.after - 1.0 > LEAVES * left:
        return False
    took = [costs(current, trial) for _, trial in tried]
    effects = [*(standing - ended for standing, ended in took), *(score.drop for score in scores)]
    more = function.gain / max([1e-12, *effects])
    return any(function.explained > share and more > times for share, times in ALONE)
