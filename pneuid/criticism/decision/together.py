"""Two effects at once: where one alone fits the training runs far better and predicts no better, the other one hides it.

A leak spoils every prediction of a pressure, so a load that is found beside it may not show in the held-out error at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.decision.acceptance import LEAST_DROP, Tried, accepted, costs
from pneuid.criticism.decision.rounds import WORTH_ADDING, same_floor
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import Say, best_end, read_anew
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect

FOOTHOLD = 0.5
"""Cost of the training runs, or squared error of predicting them, in all windows and in the usual ones, relative to the
standing model's, below which an effect is worth a look at what comes with it. A dead volume beside a friction that bends took
24 % of that cost, as loose jumps hide the rest, but left 45 % of these errors, and held out 19.8 floors where 13.6 had been."""

FIRSTS, SECONDS = 4, 2
"""How many such effects are tried with the second one, and how many second ones are refitted beside the best of them."""

ONE_OF_TWO = 0.5
"""Share of the excess, of the standing model and of the best with one effect, that two may leave at most."""


@dataclass(frozen=True)
class Joined:
    """Two effects accepted at once, by the floor of the model with both.

    firsts : scores of effects that were tried as the first of the two, with their trials, the accepted one first.
    """

    second: Score
    firsts: Tried
    judge: Judge
    current: Trial
    original: Trial

    @property
    def trial(self) -> Trial:
        """The model with both."""
        return self.firsts[0][1]

    @property
    def names(self) -> list[str]:
        """The two effects."""
        return [self.firsts[0][0].effect.name, self.second.effect.name]


def joined(
    current: Trial, original: Trial, tried: Tried, alone: tuple[Score, Trial] | None, judge: Judge, refitter: Refitter,
    candidates: Sequence[Effect], say: Say, most: float = np.inf,
) -> Joined | None:  # fmt: skip
    """Two effects that explain at once what none alone does, else None.

    original : the base model's trial; alone : the effect to be accepted otherwise; most : share of the excess that the two may
    leave before their break-away is read anew.
    """
    found = together(current, tried, judge, refitter, candidates, say)
    if found is None or found[1][0][1].error - 1.0 > most * (current.error - 1.0):
        return None
    second, firsts = found
    judge, current, original, firsts = same_floor(judge, current, original, firsts)
    score, trial = firsts[0]
    firsts[0] = score, read_anew(trial, judge, refitter, say)
    least = min(item.error for item in (current, *([judge.judged(alone[1])] if alone else [])))
    enough = firsts[0][1].error - 1.0 < ONE_OF_TWO * (least - 1.0)
    if not enough or accepted(firsts[:1], current, original, judge) is None:
        return None
    return Joined(second, firsts, judge, current, original)


def together(
    current: Trial, tried: Tried, judge: Judge, refitter: Refitter, candidates: Sequence[Effect], say: Say
) -> tuple[Score, Tried] | None:
    """The effect that helps beside others, and trials of it with each of those; None where no effect is a foothold.

    tried : effects refitted alone, and their trials; the score of each is that of the first of two. Best prediction first.
    """
    firsts = _footholds(current, tried, judge)
    if not firsts:
        return None
    alone, trial = firsts[0]
    name = alone.effect.name
    scores = screen(trial.fit, candidates, refitter.order)
    worth = [score for score in scores if score.drop > max(LEAST_DROP, WORTH_ADDING * trial.fit.relaxed_cost)]
    say(f"{name} fits far better and leaves much of the prediction; looking for a second effect that hides it")
    beside = [score for score in worth if not score.effect.richer_law][:SECONDS]
    asked = [Asked(score.effect, score.whole_start, score.gain) for score in beside]
    pairs = []
    for second, (_, make) in zip(beside, refitter.each(trial.fit, asked), strict=True):
        pairs.append((second, judge.trial(make(), f"{name}, {second.effect.name}")))
        _tell(pairs[-1][1], current, say)
    if not pairs:
        return None
    second, best = min(pairs, key=lambda pair: pair[1].error)
    found = [(alone, _other_way_round(alone, second, best, tried, judge, refitter, say))]
    known = {**best.fit.problem.values, **best.fit.relaxed_values}
    start = {part: known[part] for part in second.whole_start}
    for score, other in firsts[1:]:
        if score.effect.name == second.effect.name:
            continue
        (_, make), *_ = refitter.each(other.fit, [Asked(second.effect, start, second.gain)])
        found.append((score, judge.trial(make(), f"{score.effect.name}, {second.effect.name}")))
        _tell(found[-1][1], current, say)
    return second, sorted(found, key=lambda pair: pair[1].error)


def _other_way_round(
    first: Score, second: Score, both: Trial, tried: Tried, judge: Judge, refitter: Refitter, say: Say
) -> Trial:
    """The trial of ``both``, or of the same model from where the second of them led alone, where that was tried.

    Alone the first may have ended where it stands in for the second: in place of a sensor's lag a silencer with a volume ended
    five times as narrow and 140 times as slow as it was, and left 11.3 floors beside that lag.
    """
    alone = next((trial for score, trial in tried if score.effect.name == second.effect.name), None)
    if alone is None or both.error - 1.0 < judge.small:
        return both
    (_, make), *_ = refitter.each(alone.fit, [Asked(first.effect, first.whole_start, first.gain)])
    turned = judge.trial(make(), both.added)
    say(f"the other way round: held-out error {np.sqrt(both.error):.2f} -> {np.sqrt(turned.error):.2f} floors")
    return best_end([both, turned], judge)


def _footholds(current: Trial, tried: Tried, judge: Judge) -> Tried:
    """Effects that lower the cost of the training runs, or the errors of predicting them, by half and more, the best first.

    On a bench an effect with states of its own must lower the errors: jumps of those states buy the relaxed cost. A lag of the
    force took 98.7 % of it on a friction that grows with pressure, and 6 % of the errors.
    """
    servo = current.fit.plant.servo

    def left(score: Score, trial: Trial) -> float:
        errors = max(error(trial) / error(current) for error in (judge.fits, judge.usually_fits))
        if score.effect.states and not servo:
            return errors
        now, after = costs(current, trial)
        return min(after / now, errors)

    low = [pair for pair in tried if not pair[0].effect.richer_law and left(*pair) < FOOTHOLD]
    return sorted(low, key=lambda pair: left(*pair))[:FIRSTS]


def _tell(trial: Trial, current: Trial, say: Say) -> None:
    say(f"with {trial.added}: held-out error {np.sqrt(current.error):.2f} -> {np.sqrt(trial.error):.2f} floors")
