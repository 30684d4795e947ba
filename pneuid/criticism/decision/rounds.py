"""One round of the diagnosis: which effects are refitted, from where and in which order."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from pneuid.criticism.comparison.defects import ACTING_ON, equation_defects
from pneuid.criticism.decision.acceptance import (
    CLEAR_DROP,
    LEAST_DROP,
    LEAST_PART,
    LEAST_SHARE,
    NO_FORM,
    WITHIN,
    Tried,
    costs,
    stands_out,
)
from pneuid.criticism.decision.leftover import DEFECT_RATIO, FAR_OFF, astray, leaves_more, loudest
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import (
    NEXT_TO_NOTHING,
    Say,
    best_end,
    follows,
    from_standing,
    large_starts,
    read_anew,
    typical_start,
)
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.jumps import jumped
from pneuid.criticism.screening.scores import Score
from pneuid.estimation.fit import Fit

REFITS, LATER_REFITS = 3, 2
"""Leading effects refitted in the first round and in a later one, the leader's group mates besides."""

WORTH_REFITTING = 0.15
"""Share of the leading effect's predicted drop below which another is not refitted."""

WORTH_ADDING = 0.01
"""Predicted relative drop of the cost below which a later effect is not refitted: the right effect in the catalogue's form
leaves up to that much to others where the rig's own form differs."""

STILL_OFF = 2.0
"""Held-out error in floors from which a later effect need only promise the less of that share and of a part of what came
before: beside heat at the walls a skew of the channels and beside friction by pressure a dead zone, both hidden, promised 0.8 %
of the cost, and 2.8 floors were left; beside friction by pressure a spring promised 2 %, and 5.8 floors were left."""

CLOSE = 0.5
"""Share of the leading effect's predicted drop above which another is refitted although the leading one explains all, or though
it promises less than a later effect must: beside a weight a dead volume promised 5.3 % of the cost and was named, a mounting
that gives way, which was hidden, 3.8 % and was not looked at."""


SECOND_LOOKS = 6
"""Effects on the loudest balance refitted where the leading ones do not help: a linear prediction misses what acts in jerks."""

ALIKE = 0.95
"""Share of the chosen effect's predicted drop from which another's break-away is read anew as well before the choice."""

ENDED_NEAR = 2.0
"""Times the excess that the chosen effect leaves below which another one is said to have ended near it."""

FAR = 0.25
"""Share of the excess left by the best of the leading effects above which others get a second look as well: a lag or a
memory shows little of itself in a linear prediction from zero, and its place is taken by what imitates it."""

SMALL = 0.5
"""Share of a typical amplitude below which a refit has not been where a second look starts."""

OVERTAKES, STEPS = 1.2, 2
"""Times the leading prediction that a step of a typical size must promise for its effect to be refitted from there although it
promises little at zero, and how many at most: a silencer is not felt while the edge before it stays choked. On twenty rigs two
silencers promised 1.47 and 1.54 times as much, a cushion, hidden as well, 2.3 times; nothing else promised more than the
leader."""


def refitted(
    current: Trial, first: Trial, scores: Sequence[Score], judge: Judge, refitter: Refitter, say: Say,
    least: float = LEAST_DROP,
) -> Tried:  # fmt: skip
    """Trials with the leading effects and their group mates added to the current model, best predicted first.

    ``first`` is the base model's trial; ``least`` the predicted drop below which an effect is not refitted in the first round.
    What comes after the runner-up is spared where one before explains all there is.
    """
    newly = current.added is None
    alone = not newly and bool(scores) and stands_out(scores[0])
    worthy = LEAST_DROP if alone else _worthy(current, first, least)
    chosen = list(_shortlist(scores, REFITS if newly else LATER_REFITS, worthy))
    if not chosen:
        return []
    leader = scores[0]
    related = {leader.effect.name, *leader.group}
    servo, thorough = current.fit.plant.servo, newly or alone
    ways = {one.effect.name: _ways(one, one is leader, thorough and one.effect.name in related, servo) for one in chosen}
    makes = _by_effect(refitter.each(current.fit, [asked for each in ways.values() for asked in each]))
    tried: Tried = []
    for score in chosen:
        explained = any(all_explained(trial, current, judge) for _, trial in tried)
        minor = score.effect.name not in related and score.drop < CLOSE * leader.drop
        if minor and len(tried) > 1 and explained:
            continue
        each = makes[score.effect.name][: 1 if explained else None]
        ends = (_tried(current, score, make, judge, say) for make in each)
        trial = from_standing(score, _first_that_explains(ends, current, judge), current, judge, refitter, say)
        if not newly and score.gain > CLEAR_DROP and score.effect.equation in ACTING_ON["force"]:
            trial = _with_break_away(trial, current, score, judge, refitter, say)
        tried.append((score, trial))
    return tried


def _worthy(current: Trial, first: Trial, least: float) -> float:
    """Predicted drop below which an effect is not refitted: ``least``, or beside others a part of what these brought."""
    if current.added is None:
        return least
    before, now = costs(first, current)
    cost = current.fit.relaxed_cost
    part, some = min(LEAST_PART * (before - now), CLEAR_DROP * cost), WORTH_ADDING * cost
    return max(least, LEAST_DROP, (min if current.error > STILL_OFF**2 else max)(part, some))


def overtaking(
    current: Trial, first: Trial, scores: Sequence[Score], tried: Tried, judge: Judge, refitter: Refitter, say: Say
) -> Tried:
    """Those tried, and trials with effects that promise little at zero but most of all at a step of a typical size.

    Beside others only where these leave more than noise, and for as much as another one must promise.
    """
    noise_alone = current.added is not None and current.error - 1.0 < judge.small
    if not scores or noise_alone or any(all_explained(trial, current, judge) for _, trial in tried):
        return tried
    known = {score.effect.name for score, _ in tried}
    typical = {one.effect.name: typical_start(current, one) for one in scores if one.effect.name not in known}
    steps = jumped(current.fit, scores, typical, refitter.order)
    asked_for = max(OVERTAKES * scores[0].drop, _worthy(current, first, 0.0))
    ahead = [one for one in scores if one.effect.name in steps and steps[one.effect.name].drop > asked_for]
    ahead = sorted(ahead, key=lambda one: -steps[one.effect.name].drop)[:STEPS]
    asked = [Asked(one.effect, steps[one.effect.name].start, one.gain, way=1.0) for one in ahead]
    makes = refitter.each(current.fit, asked)
    promised = [replace(one, drop=steps[one.effect.name].drop) for one in ahead]
    return [*tried, *((one, _tried(current, one, make, judge, say)) for one, (_, make) in zip(promised, makes, strict=True))]


def _with_break_away(trial: Trial, current: Trial, score: Score, judge: Judge, refitter: Refitter, say: Say) -> Trial:
    """The trial, or where it leaves much the best of it and of ones that read break-away anew or start from the data alone.

    Break-away has excused so far what the effect does, and may not come back: beside a valve's hysteresis a viscous friction
    that bends left 11.5 of 12.2 floors from there, read anew 6.6, from the data alone 6.4.
    """
    if not leaves_much((score, trial), current):
        return trial
    again = [Asked(score.effect, score.whole_start, score.gain, way=1.0, anew=True)]
    if current.fit.plant.servo:
        again.append(Asked(score.effect, score.whole_start, score.gain, cold=True))
    ends = [_tried(current, score, make, judge, say) for _, make in refitter.each(current.fit, again)]
    return best_end([trial, *ends], judge)


def _helps(trial: Trial, current: Trial) -> bool:
    """Whether a refit predicts better at all."""
    return trial.error < current.error - LEAST_SHARE * (current.error - 1.0)


def open_to_second_looks(
    scores: Sequence[Score], tried: Tried, chosen: tuple[Score, Trial] | None, current: Trial, first: Trial, judge: Judge
) -> Sequence[Score]:
    """Effects that deserve second looks: all, or beside others that leave more than two floors what promises most, if it was
    not refitted.

    Beside an offset that left 2.8 floors a soft mounting promised 0.2 % of the cost. Break-away fills few windows: beside inlet
    mixing a static friction that grows promised 0.1 %, and 1.6 floors were left without the worst tenth of the windows, 2.7 of
    all and 3.3 of the training runs; with it 1.1, 1.3 and 1.5.
    """
    if second_looks_needed(chosen, current, first, judge):
        return scores
    known = {score.effect.name for score, _ in tried}
    left = max(current.error, current.whole, judge.fits(current))
    still_off = current.added is not None and chosen is None and left > STILL_OFF**2
    return [one for one in scores[:1] if still_off and one.drop > LEAST_DROP and one.effect.name not in known]


def second_looks_needed(chosen: tuple[Score, Trial] | None, current: Trial, first: Trial, judge: Judge) -> bool:
    """Whether much is left that the leading effects do not explain: on a balance, or, far off, at break-away alone.

    Of the training runs as well where nothing helps: a servo rig that lacks nothing mostly has an exact fit (15 of 15).
    Beside others where no leading effect helps and something else would be said to act, or the training runs are far off:
    beside a shifted null, which left 100 of 152 floors, a silencer was not among what promised most; beside a spring that
    left 7.9 of 42 floors, but 21 of the training runs, a soft mounting promised 0.3 % of the cost.
    """
    if current.added is not None:
        unlearned = judge.usually_fits(current) > NO_FORM**2
        if chosen is not None or not (unlearned or leaves_more(current, first)):
            return False
    if not leaves_much(chosen, current) and not leaves_far(chosen, current):
        return False
    far = max(current.error, current.whole) > FAR_OFF**2 or (chosen is None and astray(current, judge))
    return far or loudest(current) > DEFECT_RATIO


def second_looks(
    current: Trial, scores: Sequence[Score], tried: Tried, judge: Judge, refitter: Refitter, say: Say,
    known_well: Collection[str] = (),
) -> Tried:  # fmt: skip
    """Those tried, and trials with others from typical amplitudes, until one explains all: those that act on the loudest
    balance, and those that promise as much as was worth a refit before others led.

    Of those that promise most, at zero or at a step of a typical size or of a part of it, from where that step leads, the ones
    with a state of their own come last: their refits take ten times as long, and they start from several sizes.
    An effect whose refit set out far below a typical amplitude, or that promised much and did not help, is tried again, and the
    better trial kept; none that is ``known_well``, from a look at it beside much the same model.
    """
    loud = max(equation_defects(current.fit), key=lambda item: item.rms / max(item.expected_rms, 1e-12), default=None)
    acting = ACTING_ON[loud.equation if loud else "force"]
    known = {score.effect.name: trial for score, trial in tried}
    worth = WORTH_REFITTING * scores[0].drop if scores else 0.0
    open_ones = [
        score for score in scores
        if score.effect.name not in known_well and ((score.effect.equation in acting and (
            score.effect.name not in known or _set_out_small(current, score)
            or ((score.gain > CLEAR_DROP or large_starts(current, score)) and not _helps(known[score.effect.name], current))
        )) or (score.effect.name not in known and score.drop > worth))
    ]  # fmt: skip
    if not open_ones:
        return list(tried)
    say(f"these leave much; a second look at what acts on {', '.join(acting)}, or promises much")
    typical = {score.effect.name: typical_start(current, score) for score in open_ones}
    jumps = jumped(current.fit, scores, typical, refitter.order)
    left = sorted(open_ones, key=lambda score: -max(score.drop, jumps[score.effect.name].drop))[:SECOND_LOOKS]
    starts = {score.effect.name: [jumps[score.effect.name].start, *large_starts(current, score)] for score in left}
    left.sort(key=lambda score: len(starts[score.effect.name]) > 1)
    servo = current.fit.plant.servo
    ways = (False, True) if servo else (True,)
    asked = [
        Asked(score.effect, start, score.gain, not servo, 1.0, anew)
        for score in left for start in starts[score.effect.name] for anew in ways
    ]  # fmt: skip
    looked = {score.effect.name: (score, trial) for score, trial in tried}
    makes = _by_effect(refitter.each(current.fit, asked))
    for score in left:
        name = score.effect.name
        ends = (_tried(current, score, make, judge, say) for make in makes[name])
        trial = _first_that_explains(ends, current, judge)
        if _half_way(trial, current):
            trial = read_anew(trial, judge, refitter, say)
        if name not in known or trial.error < known[name].error:
            looked[name] = score, trial
        if all_explained(trial, current, judge) or refitter.late():
            break  # nothing is left for the others to explain, or no time
    return list(looked.values())


def _ways(score: Score, leads: bool, thorough: bool, servo: bool) -> list[Asked]:
    """How an effect is refitted: from what stood; where it shall be thorough from break-away read anew as well, and the one
    that ``leads``, on a servo rig, from the data's own guess, from which a thorough refit on a bench starts in any case."""
    first = Asked(score.effect, score.whole_start, score.gain, thorough)
    if not thorough or score.effect.richer_law:
        return [first]
    anew = Asked(score.effect, score.whole_start, score.gain, thorough=servo, way=1.0, anew=True)
    return [first, anew, *([Asked(score.effect, score.whole_start, score.gain, cold=True)] if leads and servo else [])]


def _by_effect(each: Iterable[tuple[Asked, Callable[[], Fit]]]) -> dict[str, list[Callable[[], Fit]]]:
    """What makes the fits, by the effects that they add."""
    makes: dict[str, list[Callable[[], Fit]]] = {}
    for one, make in each:
        makes.setdefault(one.effect.name, []).append(make)
    return makes


def _first_that_explains(ends: Iterator[Trial], current: Trial, judge: Judge) -> Trial:
    """The first of the ends of one model that explains all, else the best of them."""
    found = []
    for trial in ends:
        found.append(trial)
        if all_explained(trial, current, judge):
            return trial
    return best_end(found, judge)


def promised_alike(chosen: Score, tried: Tried) -> Tried:
    """The trials of effects of which screening expects as much as of the chosen one; without the same care they seem worse.

    None where it expects nothing of that one, which a second look has found.
    """
    if chosen.drop < LEAST_DROP:
        return []
    return [pair for pair in tried if pair[0] is not chosen and pair[0].drop > ALIKE * chosen.drop]


def worth_the_same_care(chosen: tuple[Score, Trial], tried: Tried, current: Trial) -> Tried:
    """The trials of effects that are started again with the chosen one's care: those that promised alike, and those that
    promised half as much and start from several sizes, beside others or where the chosen one leaves more than two floors and
    they ended near it.

    A linear prediction from zero sees little of these: beside a weight a mounting that gives way promised 0.7 times what a dead
    volume did, and left 5.2 floors while this left 3.8; from larger sizes 2.1. A regulator's droop promised 0.94 times what a
    critical ratio did, and left 3.2 floors while this left 2.5; from larger sizes 2.1.
    """
    score, trial = chosen
    if score.drop < LEAST_DROP:
        return []
    if current.added is None and trial.error <= STILL_OFF**2:
        return promised_alike(score, tried)
    near = np.inf if current.added is not None else ENDED_NEAR * (trial.error - 1.0)
    close = [pair for pair in tried if pair[0] is not score and pair[0].drop > CLOSE * score.drop]
    return [
        pair for pair in close
        if pair[0].drop > ALIKE * score.drop or (pair[1].error - 1.0 < near and large_starts(current, pair[0]))
    ]  # fmt: skip


def leaves_much(chosen: tuple[Score, Trial] | None, current: Trial) -> bool:
    """Whether the best of the effects refitted so far, if any, leaves much of the excess."""
    return chosen is None or chosen[1].error - 1.0 > FAR * (current.error - 1.0)


def leaves_far(chosen: tuple[Score, Trial] | None, current: Trial) -> bool:
    """Whether the best so far leaves predictions far off, and more than next to nothing of the excess.

    What is like the right effect explains most, such as a tube's resistance in place of a silencer's.
    """
    if chosen is None or follows(chosen[1]):
        return False
    return chosen[1].error > WITHIN**2 and chosen[1].error - 1.0 > NEXT_TO_NOTHING * (current.error - 1.0)


def same_floor(judge: Judge, current: Trial, first: Trial, tried: Tried) -> tuple[Judge, Trial, Trial, Tried]:
    """Everything by the floor of the best model so far."""
    if not tried:
        return judge, current, first, tried
    judge = judge.again(min((trial for _, trial in tried), key=lambda trial: trial.error), current)
    again = [(score, judge.judged(trial)) for score, trial in tried]
    return judge, judge.judged(current), judge.judged(first), again


def _shortlist(scores: Sequence[Score], most: int, least: float) -> Iterator[Score]:
    """The leading effects whose predicted drop is above ``least``, or close to that of a leader above it, then the group mates
    of the first."""
    if not scores or scores[0].drop <= least:
        return
    least = max(min(least, max(LEAST_DROP, CLOSE * scores[0].drop)), WORTH_REFITTING * scores[0].drop)
    chosen = [score for score in scores if score.drop > least][:most]
    yield from chosen
    mates = {name for score in chosen[:1] for name in score.group} - {score.effect.name for score in chosen}
    yield from (score for score in scores if score.effect.name in mates and score.drop > LEAST_DROP)


def _tried(current: Trial, score: Score, make: Callable[[], Fit], judge: Judge, say: Say) -> Trial:
    name = score.effect.name
    say(f"refitting with {name}")
    trial = judge.trial(make(), name)
    say(f"with {name}: held-out error {np.sqrt(current.error):.2f} -> {np.sqrt(trial.error):.2f} floors")
    return trial


def all_explained(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether a trial leaves next to nothing of what the standing model left."""
    return trial.error - 1.0 < max(judge.small, NEXT_TO_NOTHING * (current.error - 1.0))


def _set_out_small(current: Trial, score: Score) -> bool:
    """Whether every amplitude that screening suggests is far below a typical one."""
    typical = typical_start(current, score)
    moves = [
        (score.start.get(item.name, item.off) - item.off, typical[item.name] - item.off)
        for item in score.effect.parameters(current.fit.plant.rig, current.fit.plant.law)
        if item.off is not None
    ]
    return all(abs(screened) < SMALL * abs(usual) for screened, usual in moves)


def _half_way(trial: Trial, current: Trial) -> bool:
    """Whether a refit predicts better but costs more on the training runs: most of its sticks still break away elsewhere."""
    now, after = costs(current, trial)
    return _helps(trial, current) and after > now - LEAST_DROP


