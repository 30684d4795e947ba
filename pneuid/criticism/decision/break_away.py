"""What shows at break-away alone: which effect is looked at for it, and when it is accepted.

A static friction that grows with the time at rest leaves every balance quiet and most windows as they are: the piston breaks
away too early, or too late, in a few, which the usual error leaves out.
"""

from __future__ import annotations

from pneuid.criticism.decision.acceptance import LEAST_DROP, NEARLY_ALL, Tried
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score

FAR_IN_SOME = 2.0
"""Squared error of all held-out windows, in floors, from which one looks at break-away alone."""

HALVED = 0.5
"""Share that an effect may leave of the excess in all held-out windows, and of the error on the training runs unless it leaves
next to nothing of the usual excess."""

AT_BREAK_AWAY = (
    "{} shows at break-away alone: no balance leaves a defect above noise, but with it the error of all held-out windows falls "
    "from {:.2f} to {:.2f} floors"
)
BESIDE_OTHERS = (
    "{} shows at break-away: screening expects far more of it than of any other, and with it the error of all held-out windows "
    "falls from {:.2f} to {:.2f} floors"
)


def leading_friction(tried: Tried, current: Trial, judge: Judge) -> tuple[Score, Trial] | None:
    """The effect of friction of which screening expects most, or where that is chance the one that predicts the training runs
    best; None where not much is left, or on a bench, where all runs together decide."""
    friction = [pair for pair in tried if pair[0].effect.equation == "friction"]
    if not friction or not current.fit.plant.servo or current.whole < FAR_IN_SOME:
        return None
    most = max(friction, key=lambda pair: pair[0].drop)
    return most if most[0].drop > LEAST_DROP else min(friction, key=lambda pair: judge.fits(pair[1]))


def shown_at_break_away(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether an effect takes half of the held-out excess of all windows, and more than chance bears it out.

    That is half of the error on the training runs as well, or nearly all of the usual excess, which must not grow by more than
    noise.
    """
    training = judge.fits(trial) / judge.fits(current)
    usual = (trial.error - 1.0) / max(current.error - 1.0, 1e-12)
    halved = trial.whole - 1.0 < HALVED * (current.whole - 1.0)
    no_worse = trial.error < current.error + judge.spread and training < 1.0
    return halved and no_worse and (training < HALVED or usual < 1.0 - NEARLY_ALL)
