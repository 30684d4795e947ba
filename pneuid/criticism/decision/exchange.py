"""Of several effects accepted one of which stands in for another that it is easily confused with: that one takes its place.

Which first effect helps beside a second is told before either has reached its end. Beside a leak past the piston a load spring
whose force hardly changes over the stroke left 7.8 floors and a weight, which was hidden, 11.7; at their ends 3.8 and 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pneuid.criticism.decision.acceptance import inside_bounds
from pneuid.criticism.decision.rivals import alike, lookalikes
from pneuid.criticism.decision.rounds import Say
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import CLEARLY
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect


@dataclass(frozen=True)
class Other:
    """An effect that does better in another's place, and the trial with it.

    told : whether both kinds of runs tell the two.
    """

    score: Score
    trial: Trial
    told: bool


def exchanged(
    name: str, smaller: Trial, current: Trial, judge: Judge, refitter: Refitter, candidates: Sequence[Effect], say: Say
) -> Other | None:
    """What takes the place of one of a model's effects, or is not told from it though it does better there; else None.

    name : the effect; smaller : trial of the model without it. To take its place both kinds of runs must tell the other from
    it, the training runs by their cost and by what is predicted of them: of a seal's friction by pressure a warmth cost a third
    less in relaxed fits, left 22.6 floors held out and not 23.3, and 8.3 of the training runs and not 6.8. Where it predicts
    the held-out runs clearly better, it may predict the training runs a little worse: beside a tube an offset of the right
    pressure left 3.1 and not 4.1 floors, and 3.5 and not 3.4 of the training runs.
    """
    if current.error - 1.0 < judge.small:
        return None
    scores = list(screen(smaller.fit, candidates, refitter.order))
    own = next((score for score in scores if score.effect.name == name), None)
    if own is None:
        return None
    standing = own, current
    found = [pair for pair in lookalikes(standing, scores, [standing], smaller, judge, refitter, say) if inside_bounds(*pair)]
    if not found:
        return None
    best = min(found, key=lambda pair: pair[1].error)
    # of two that tell of one thing the other way round the clearer one counts
    clearly = best[1].error < CLEARLY * current.error
    most = judge.usually_fits(current) / (CLEARLY if clearly else 1.0)
    worse = judge.usually_fits(best[1]) > most
    return None if worse else Other(*best, told=not alike(best, [standing], smaller, judge))
