"""What the training runs show by themselves, where the held-out runs cannot judge.

Held-out runs that ask for what the training runs leave open of the parameters, or that do not excite an effect, say nothing
for or against it. Thousands of samples of the training runs may show it beyond doubt all the same.
"""

from __future__ import annotations

from pneuid.criticism.rounds import NEARLY_ALL, Tried, costs, inside_bounds
from pneuid.criticism.screening import Score
from pneuid.criticism.trial import Judge, Trial

SHOWN_DROP = 30.0
"""Drop of half the sum of squares of the training runs that shows an effect by itself: of 35 rigs that lack nothing all but
one stay below 12, the other one at 27."""

FAINT_DROP = 8.0
"""The same where the held-out error falls to noise as well: a wrong effect does not do that by accident."""

TELLING = 0.03
"""Share of the held-out excess, or of the gain on the training runs, by which the better of two effects must lead
to be told from the other: the error 200 ms ahead has heavy tails, at break-away, that make smaller leads accidental."""

SURE = 5.0
"""Half the sum of squares by which it must lead on the training runs at least: 3 standard deviations."""


def shown(tried: Tried, current: Trial, judge: Judge) -> list[tuple[Score, Trial]]:
    """Effects that the training runs show, and those that cannot be told from the best of them; the best one first.

    With each of them noise is enough to explain the training runs, and noise and open parameters the held-out ones.
    """
    found = []
    for score, trial in tried:
        now, after = costs(current, trial)
        faint = now - after > FAINT_DROP and _falls_to_noise(trial, current, judge)
        if (faint or now - after > SHOWN_DROP) and inside_bounds(score, trial) and judge.learned(trial):
            found.append((now - after, score, trial))
    kept = [item for item in sorted(found, key=lambda item: -item[0]) if judge.explains(item[2])]
    if not kept:
        return []
    best = kept[0][0]
    return [(score, trial) for drop, score, trial in kept if best - drop < max(TELLING * best, SURE) or drop == best]


def _falls_to_noise(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether an effect takes nearly all of a held-out error that is more than noise."""
    excess, left = current.error - 1.0, trial.error - 1.0
    return excess > judge.small > left and excess - left > NEARLY_ALL * excess
