"""What all runs together show, where the held-out runs cannot judge.

Held-out runs that ask for what the training runs leave open of the parameters, or that do not excite an effect, say nothing
for or against it by their error alone. But no parameters of a model that lacks it fit both them and the training runs:
fitted together, the two show it beyond doubt all the same.
"""

from __future__ import annotations

from pneuid.criticism.decision.acceptance import Tried, costs, inside_bounds, unresolved
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score
from pneuid.estimation.stages import MISFIT

SHOWN_DROP, SHOWN_SHARE = 30.0, 0.005
"""Drop of half the sum of squares of all runs, and share of it, that show an effect: smoothing of the motion and the step's own
error leave traces that grow with the number of samples."""

BEYOND_DOUBT = 5.0
"""Times the least drop that leave no doubt, where besides noise alone is left with the effect and more without it. On 40 random
benches that lack nothing all runs showed up to 2.4 times the least; friction by pressure, held out at others, 9 times."""

TELLING = 0.03
"""Share of the held-out excess, or of the gain on the runs fitted to, by which the better of two effects must lead
to be told from the other: the error 200 ms ahead has heavy tails, at break-away, that make smaller leads accidental."""

SURE = 5.0
"""Half the sum of squares by which it must lead on the runs fitted to at least: 3 standard deviations."""


def least_shown(current: Trial) -> float:
    """Drop of half the sum of squares from which a model of all runs shows that it lacks an effect."""
    return max(SHOWN_DROP, SHOWN_SHARE * current.fit.relaxed_cost)


def fitted(trial: Trial, judge: Judge) -> bool:
    """Whether noise is enough to explain what the trial leaves of all runs: their simulation, or the relaxed fit to them.

    A simulation of runs full of break-aways may be far off although nothing is missing: 40 random benches that lack nothing
    leave up to 3.7 squared floors of their training runs, but no more than 1.12 of the noise in the relaxed fit.
    """
    return judge.learned(trial) or 2.0 * trial.fit.relaxed_cost / max(trial.fit.problem.weighted, 1) < MISFIT


def beyond_doubt(base: Trial, trial: Trial, judge: Judge) -> bool:
    """Whether of two fits to all runs only the one with the effect leaves noise alone, at a cost far below.

    Then the run left out is predicted badly because it asks for what no other run shows: a place that none visits.
    """
    clean = judge.learned(trial) and trial.error - 1.0 < judge.small <= base.error - 1.0
    return clean and far_beyond_chance(base, trial)


def far_beyond_chance(base: Trial, trial: Trial) -> bool:
    """Whether of two fits to all runs the one with the effect costs less by several times what chance and the method give."""
    now, after = costs(base, trial)
    return now - after > BEYOND_DOUBT * least_shown(base)


def shown(tried: Tried, current: Trial, judge: Judge) -> list[tuple[Score, Trial]]:
    """Effects that all runs show, and those that cannot be told from the best of them; the best one first.

    ``tried`` and ``current`` are fitted to the training and the held-out runs together; with each of the effects noise is
    enough to explain both.
    """
    least = least_shown(current)
    drops = [(now - after, score, trial) for score, trial in tried for now, after in [costs(current, trial)]]
    found = [
        (drop, score, trial)
        for drop, score, trial in sorted(drops, key=lambda item: -item[0])
        if drop > least and inside_bounds(score, trial) and fitted(trial, judge) and not unresolved(score, trial)
    ]
    return [(score, trial) for drop, score, trial in found if found[0][0] - drop < max(TELLING * found[0][0], SURE)]


def shown_by_training(tried: Tried, current: Trial, judge: Judge) -> tuple[Score, Trial] | None:
    """What the training runs show most, leaving noise alone of them, where the held-out runs do not speak against it; or None.

    For held-out runs that cannot judge, of a servo rig whose model leaves more than noise of the training runs.
    """
    least, worst = least_shown(current), current.error + 3 * judge.spread
    drops = [(now - after, score, trial) for score, trial in tried for now, after in [costs(current, trial)]]
    found = [
        (drop, score, trial)
        for drop, score, trial in drops
        if drop > least and judge.learned(trial) and trial.error < worst and inside_bounds(score, trial)
    ]
    return max(found, key=lambda item: item[0])[1:] if found else None
