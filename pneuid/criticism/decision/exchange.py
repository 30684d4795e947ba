"""Of several effects accepted one of which stands in for another that it is easily confused with: that one takes its place.

Which first effect helps beside a second is told before either has reached its end. Beside a leak past the piston a load spring
whose force hardly changes over the stroke left 7.8 floors and a weight, which was hidden, 11.7; at their ends 3.8 and 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pneuid.criticism.decision.acceptance import LEAST_DROP, Tried, costs, inside_bounds
from pneuid.criticism.decision.rivals import alike, beats, contains, led_there
from pneuid.criticism.decision.rounds import Say
from pneuid.criticism.decision.zeros import NOTHING_READ, Zeros
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import CLEARLY
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect

Pair = tuple[Score, Trial]


@dataclass(frozen=True)
class Exchange:
    """What takes an effect's place, None where it stays, and what these data do not tell from the one that then stands."""

    taking: Pair | None = None
    rivals: tuple[Pair, ...] = ()


def exchanged(
    name: str, smaller: Trial, current: Trial, judge: Judge, refitter: Refitter, candidates: Sequence[Effect], say: Say,
    zeros: Zeros = NOTHING_READ,
) -> Exchange:  # fmt: skip
    """Whether one of a model's effects gives its place to another that does better there, or that a zero reading shows.

    name : the effect; smaller : trial of the model without it; what ``zeros`` confirm stays. To take its place both kinds of
    runs must tell the other from it, the training runs by their cost and by what is predicted of them: of a seal's friction by
    pressure a warmth cost a third less in relaxed fits, left 22.6 floors held out and not 23.3, and 8.3 of the training runs
    and not 6.8. Where it predicts the held-out runs clearly better, it may predict the training runs a little worse: beside a
    tube an offset of the right pressure left 3.1 and not 4.1 floors, and 3.5 and not 3.4 of the training runs.
    """
    if current.error - 1.0 < judge.small:
        return Exchange()
    scores = list(screen(smaller.fit, candidates, refitter.order))
    own = next((score for score in scores if score.effect.name == name), None)
    if own is None or zeros.confirms(current.fit, own.effect):
        return Exchange()
    standing = own, current
    there = led_there(standing, scores, [standing], smaller, judge, refitter, say)
    ends = zeros.possible([pair for pair in there if inside_bounds(*pair)])
    foretold = [pair for pair in ends if _foretold(pair[1], current, judge)]
    best = min((pair for pair in ends if beats(pair[1], current, judge)), key=lambda pair: pair[1].error, default=None)
    how = scores, {name}, ends, smaller, judge, refitter, say, zeros
    others = [pair for pair in foretold if pair is not best]
    if best is None or not _foretold(best[1], current, judge):
        rivals = _rivals(standing, foretold, smaller, judge)
    elif alike(best, [standing], smaller, judge):
        rivals = (best, *_rivals(standing, others, smaller, judge))
    else:
        return _shown_first(Exchange(best, _rivals(best, [*others, *_mates(best, *how)], smaller, judge)), zeros)
    # what is the same as a rival may be as good
    mates = [pair for one in rivals[:1] for pair in _mates(one, *how) if _foretold(pair[1], current, judge)]
    return _shown_first(Exchange(rivals=(*rivals, *_rivals(standing, mates, smaller, judge))), zeros)


def _shown_first(found: Exchange, zeros: Zeros) -> Exchange:
    """What a zero reading shows takes the place, and has no rivals."""
    every = (*(() if found.taking is None else (found.taking,)), *found.rivals)
    shown = next((pair for pair in every if zeros.confirms(pair[1].fit, pair[0].effect)), None)
    return found if shown is None else Exchange(shown)


def larger_part(tried: Tried, current: Trial, first: Trial) -> Pair | None:
    """Of those tried beside the only effect named, none of which helps, what takes more of the training cost than that one did.

    That it predicts no better beside that one may be that one's fault. Beside a tube a shifted null was told as a valve whose
    sides differ, 5.7 to 2.6 floors; with the tube beside it, which took half as much again of the training cost, 3.0; the null
    beside the tube 1.8.
    """
    before, now, *others = costs(first, current, *(trial for _, trial in tried))
    least = now - max(before - now, LEAST_DROP)
    larger = [pair for pair, cost in sorted(zip(tried, others, strict=True), key=lambda item: item[1]) if cost <= least]
    return next((pair for pair in larger if not pair[0].effect.richer_law), None)


def _foretold(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether what does better held out predicts the training runs no worse, or hardly worse where it is clearly better."""
    # of two that tell of one thing the other way round the clearer one counts
    clearly = trial.error < CLEARLY * current.error
    return judge.usually_fits(trial) <= judge.usually_fits(current) / (CLEARLY if clearly else 1.0)


def _rivals(one: Pair, others: Tried, smaller: Trial, judge: Judge) -> tuple[Pair, ...]:
    """The others that explain as much as one of them, but for what contains it and gains nothing by being more."""
    return tuple(pair for pair in alike(one, others, smaller, judge) if not contains(pair, one))


def _mates(
    best: Pair, scores: Sequence[Score], known: set[str], ends: Tried, smaller: Trial, judge: Judge, refitter: Refitter,
    say: Say, zeros: Zeros,
) -> Tried:  # fmt: skip
    """Trials with the group mates of what may take the place that have not been looked at, from where that one led.

    On a bench an offset of the force sensor took the place of a friction by direction; a weight is the same constant. In the
    place of a spring a weight was as good; the offset, which was hidden, is the same.
    """
    known = known | {score.effect.name for score, _ in ends} | {other.name for other in smaller.fit.plant.effects}
    found = []
    for score in scores:
        if score.effect.name in best[0].group and score.effect.name not in known:
            say(f"{score.effect.name} from where {best[0].effect.name} led")
            asked = Asked(score.effect, score.whole_start, score.gain)
            found.append((score, judge.trial(refitter.led(smaller.fit, best[1].fit, asked), score.effect.name)))
    return zeros.possible(found)
