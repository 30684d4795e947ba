"""What a round accepts: whether held-out and training runs both speak for an effect, and for which of several."""

from __future__ import annotations

import numpy as np

from pneuid.criticism.comparison.defects import ACTING_ON
from pneuid.criticism.refitting.restarts import CLEARLY, DEARER
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import TELLABLE, Score
from pneuid.effect import Effect
from pneuid.estimation.fit import comparable_costs

LEAST_DROP = 15.0
"""Predicted drop of half the sum of squares below which an effect is not refitted; null data stay below 8."""

NEARLY_NOISE = 1.5
"""Held-out error in floors up to which a fit that cannot follow its training runs is not said to lack something: of random
benches with nothing hidden, whose motion is smoothed, three were told so at 1.13 to 1.27 floors."""

LEAST_SHARE = 0.10
"""Share of the excess over the noise floor that an effect must remove on held-out runs."""

CLEAR_SHARE = 0.50
"""Share of what is left that a later, weaker effect must remove when it is less than LEAST_SHARE of the first excess."""

SOME_SHARE, CLEAR_DROP = 0.20, 0.05
"""The same for one that lowers the cost of the training runs by more than the second: far more than a form that differs."""

LEAST_PART = 0.05
"""Drop of the training cost, relative to what the effects before it brought, that a later effect must bring: where the rig
differs in form from the catalogue, what is left attracts others, by 2 to 4 %."""

NEARLY_ALL = 0.8
"""Share of what is left from which a later effect need not bring that part: what only differs in form leaves more."""

FORESEEN, WITHIN = 0.5, 3.0
"""Share of the error of predicting the training runs, of all windows or without the worst tenth, and held-out error in
floors, below which nearly all of the held-out excess explained is enough: where break-away alone is at stake, two relaxed fits
differ in cost by where their zigzag across the slips has stopped. What still leaves more has another cause, mostly a base
model at a wrong optimum, unless both errors of the training runs fall below that share at about the cost: beside a soft
mounting, whose swings loose defects absorb, a leak past the spool took 85 % of 14 floors held out, 60 and 72 % of the errors on
the training runs, and cost 5 % more. A film that lags took 95 % of the excess held out and 76 % of the usual error on the
training runs at the same cost, with break-away elsewhere in a few windows; its exact end left noise."""

FORETOLD = 0.64
"""Share of the squared error on the training runs below which a fifth of what is left held out is enough for a later effect
on another balance that takes a twentieth of the cost. Beside a base that loose defects alone carry, which absorb forces, a
viscous friction that bends took 3 and 0.5 % of what a valve's hysteresis had brought, but with tight ones 19 and 7 % of the
cost, and left 31 and 53 % of that squared error. On the same balance the first one's own form leaves as much: beside a dead
zone with soft edges a leak took 0.5 and 7 %, and left 54 %. Not where it stands out, takes a fifth and leaves half held out:
beside a valve's hysteresis an unlisted volume took 4 and 22 %, left 58 % of it, and promised 41 times what any other did."""

STANDS_OUT = 5.0
"""Times what any effect outside its group promises, from which a later effect need not take a part of the cost that the first
ones set: a memory of pre-sliding took 0.4 and 0.2 % of it, beside a valve whose sides differ and a friction that bends, and 91
and 64 % of what was left held out, 93 and 77 % of the same on the training runs. On another balance it need not take a fifth
either where errors of the training runs fall by half: beside a valve's hysteresis, whose own form left eight floors, a memory
took 19 % of these, and 57 % of what was left of the training runs."""

NO_FORM = 10.0
"""Held-out error in floors from which another form of what stands is not taken to leave nearly all of what an effect that is
easily confused with it removes, on either kind of runs: beside a lag of the valve that left 23 floors its hysteresis, which was
hidden beside a skew of the channels, left 5.9, and a fifth of the squared error on the training runs."""

LEVEL = 3.0
"""Times the noise of the held-out error by which two effects must differ to be told apart by it: friction by direction and
by time at rest left 1.79 and 1.82 floors, but 3.8 and 1.9 of the training runs."""

FAR_BETTER = 0.5
"""Share of the held-out excess left by what was to be accepted, below which another, clearly better on the training runs, is
accepted although the relaxed cost does not fall: play in the joint left 5.7 floors, a compliant mounting, 4 % cheaper, 8.9."""

FAR_MORE = 3.0
"""Times what the chosen effect takes of the training cost from which those runs show another far more, which is its rival at
least although it predicts worse: a dead zone took 17 and half of a held-out excess of 2.7 floors, the leak past the spool that
was hidden 219 and a fifth."""

HARDLY = 1.25
"""Times the held-out excess of the best up to which what is shown far more is accepted in its place, where more than three
floors are left: of friction by the pressure across a seal, which pushes either way, a friction over the stroke left 6.3 of 11.5
floors and took 16 % of the training cost, the affine friction by pressure 6.9 and 61 %."""

HALF = 0.5
"""Share of the excess that must go where recordings do not show break-away, and of the error on the training runs that may stay
where an effect stands out."""

OWN_GAIN = 0.5
"""Share of its gain on a bench's held-out runs that an effect must keep where these do not tell how its slow states start."""

Tried = list[tuple[Score, Trial]]


def least_drop(current: Trial) -> float:
    """Drop of the training cost below which an effect is neither refitted nor accepted in the first round.

    Where no parameters of the model follow the runs it lacks something, and loose jumps may hide all but a little of it.
    """
    lacking = current.fit.lacking and current.error > NEARLY_NOISE**2
    return TELLABLE if lacking else LEAST_DROP


def costs(*trials: Trial) -> list[float]:
    """Costs of the training runs that can be compared."""
    return comparable_costs(*(trial.fit for trial in trials))


def stands_out(score: Score) -> bool:
    """Whether screening expects more than chance of an effect, and far more than of any outside its group."""
    return score.drop > LEAST_DROP and score.ahead > STANDS_OUT


def accepted(tried: Tried, current: Trial, first: Trial, judge: Judge) -> tuple[Score, Trial] | None:
    """The trial to accept, None where none qualifies."""
    known = (pair for pair in tried if inside_bounds(*pair) and not unresolved(*pair))
    good = [pair for pair in known if _qualifies(*pair, current, first, judge)]
    if not good:
        return None
    sound = [pair for pair in tried if inside_bounds(*pair) and not confused(pair[0].effect, current)]
    shown = _shown_far_more(_best_of(good, judge), good, current, judge)
    best = _foreseen_far_better(shown, sound, judge)
    return best if keeps_its_gain(best[1], current, judge) else _best_of(good, judge)


def _qualifies(score: Score, trial: Trial, current: Trial, first: Trial, judge: Judge) -> bool:
    """Whether enough of the held-out error goes, and enough of the cost of the training runs or of their predictions.

    Of a later effect the cost need not fall by as much as form takes where half of what is left goes of held-out and of
    training runs alike: beside a friction by pressure, whose form left 5.8 floors, a spring took 4.7 % of what that had
    brought, and 78 % of what was left of either. Nor need it fall where screening expects it of nothing else: a memory of
    pre-sliding took 68 % of 2.5 floors and 98 % of the squared error on the training runs, and cost 3 % more until its exact
    end, 1.2 floors off.
    """
    excess, fall = current.error - 1.0, current.error - trial.error
    if excess <= 0 or fall <= 3 * judge.spread or not keeps_its_gain(trial, current, judge):
        return False
    part = fall / excess
    before, now, after = costs(first, current, trial)
    # beside a first model that only loose defects can carry, these two may have tight ones, which absorb no force
    standing, ended = costs(current, trial)
    telling = stands_out(score) or standing - ended >= CLEAR_DROP * standing
    halved = stands_out(score) and part >= LEAST_SHARE and _halves_training(trial, current, judge)
    some = halved or (part >= SOME_SHARE and telling)
    if fall < LEAST_SHARE * (first.error - 1.0) and part < CLEAR_SHARE and not some:
        return False
    nearly_all, halves = part >= NEARLY_ALL, _halves_training(trial, current, judge)
    of_its_form = confused(score.effect, current) and not (nearly_all and halves and current.error > NO_FORM**2)
    foretold = halved or (part >= SOME_SHARE and judge.usually_fits(trial) < FORETOLD * judge.usually_fits(current))
    unrivalled = stands_out(score) and part >= CLEAR_SHARE and standing - ended >= SOME_SHARE * standing
    explains = telling and (nearly_all or (foretold and (unrivalled or _on_another_balance(score.effect, current))))
    agreed = part >= CLEAR_SHARE and halves
    if (explains or agreed) and not of_its_form:
        enough = standing - ended > least_drop(current)
    else:
        enough = now - after > max(least_drop(current), LEAST_PART * (before - now))
    foreseen = [error(trial) < FORESEEN**2 * error(current) for error in (judge.fits, judge.usually_fits)]
    about = ended < DEARER * standing
    near = any(foreseen) if trial.error < WITHIN**2 else all(foreseen) and about
    expected = agreed and about and stands_out(score)
    return enough or (((nearly_all and near) or expected) and not of_its_form)


def _halves_training(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether the squared error on the training runs falls by half, of all windows and of the usual ones."""
    return all(error(trial) < HALF * error(current) for error in (judge.fits, judge.usually_fits))


def keeps_its_gain(trial: Trial, current: Trial, judge: Judge) -> bool:
    """Whether the gain does not come from a level of friction per run, read off the run that is judged: that passes for a slow
    state of the seal.

    Where the standing model has such a state it does without that level as well: beside a seal that warms up a heavier mass,
    which took four fifths of the training cost, left 1.6 floors of 2.4.
    """
    return judge.unseen(current) - judge.unseen(trial) > OWN_GAIN * (current.error - trial.error)


def confused(effect: Effect, current: Trial) -> bool:
    """Whether an effect is easily confused with one of the standing model, so that it may take up what that one's form leaves.

    A sensor whose filter is a running average left 2.6 floors with a first-order lag, and a skew of all channels, which brought
    2.4 % of what the lag had, 1.2.
    """
    return any(effect.resembles(other) for other in current.fit.plant.effects)


def _on_another_balance(effect: Effect, current: Trial) -> bool:
    """Whether no effect of the standing model acts on a balance on which this one acts; what a sensor reads tells of each."""
    standing = [other.equation for other in current.fit.plant.effects]
    acting = [on for on in ACTING_ON.values() if effect.equation in on]
    read = any(equation.startswith("sensor_") for equation in standing)
    return bool(acting) and not read and not any(equation in on for equation in standing for on in acting)


def _best_of(good: Tried, judge: Judge) -> tuple[Score, Trial]:
    """What predicts the held-out runs best; of what noise does not tell from it there, what clearly predicts the training runs
    better and costs less."""
    best = min(good, key=lambda item: item[1].error)
    level = [pair for pair in good if pair[1].error - best[1].error < LEVEL * judge.spread * best[1].error]
    nearest = min(level, key=lambda item: judge.usually_fits(item[1]))
    cost, other = costs(best[1], nearest[1])
    clearly = judge.usually_fits(nearest[1]) < CLEARLY * judge.usually_fits(best[1])
    return nearest if clearly and other < cost else best


def _shown_far_more(best: tuple[Score, Trial], good: Tried, current: Trial, judge: Judge) -> tuple[Score, Trial]:
    """The best that qualifies, or far off what leaves hardly more of the held-out excess and the training runs show far more.

    Of two that do not explain the held-out runs the nearer one is so by chance.
    """
    if best[1].error <= WITHIN**2:
        return best
    found = [best]
    for score, trial in good:
        now, own, other = costs(current, best[1], trial)
        near = trial.error - 1.0 < HARDLY * (best[1].error - 1.0)
        if near and now - other > FAR_MORE * (now - own) and judge.usually_fits(trial) < judge.usually_fits(best[1]):
            found.append((score, trial))
    return min(found, key=lambda item: costs(current, item[1])[1])


def _foreseen_far_better(best: tuple[Score, Trial], sound: Tried, judge: Judge) -> tuple[Score, Trial]:
    """The best that qualifies, or what of the ``sound`` ones predicts held-out and training runs far better at about its cost.

    Something is accepted then in any case, and of two relaxed fits that leave noise the cheaper one is not the better one.
    """
    if best[1].error <= WITHIN**2:
        return best
    found = [best]
    for score, trial in sound:
        cost, other = costs(best[1], trial)
        held_out = trial.error - 1.0 < FAR_BETTER * (best[1].error - 1.0)
        foreseen = judge.usually_fits(trial) < CLEARLY * judge.usually_fits(best[1])
        if held_out and foreseen and other < DEARER * cost:
            found.append((score, trial))
    return min(found, key=lambda item: item[1].error)


def moves_break_away_alone(trial: Trial, current: Trial) -> bool:
    """Whether a trial leaves more than half of the excess and lowers the training cost by next to nothing.

    Where recordings do not show break-away, its errors are what is left, and whatever moves it a little takes a part of them:
    of a rig sampled 2.2 times a swing with nothing hidden, five effects took 13 to 15 % of 5.1 floors and 0.2 % of the cost.
    """
    now, after = costs(current, trial)
    return trial.error - 1.0 > HALF * (current.error - 1.0) and now - after < CLEAR_DROP * now


def inside_bounds(score: Score, trial: Trial) -> bool:
    """At least one amplitude of the effect has left its off-value, and none but shapes lies on a bound.

    A richer friction law has no amplitude that could be zero: its parameters are those of the model it makes.
    """
    names = set(score.start)
    problem = trial.fit.problem
    q = trial.fit.relaxed.X[: problem.nq]
    on_bound = problem.scaling.on_bound(q)
    amplitudes = [j for j, item in enumerate(problem.declared) if item.name in names]
    return not amplitudes or not all(on_bound[j] for j in amplitudes)


def unresolved(score: Score, trial: Trial) -> bool:
    """Whether on a bench the effect is a delay or a lag that ended shorter than its runs resolve the motion: a sample, or the
    time constant of the liveliest moment that noise in the position leaves.

    A smoothed motion begins before the piston breaks away, so that any force seems to lag it: on the three that promise most of
    40 random benches that lack nothing by 0.2 to 0.6 of a sample, for up to 1.2 % of the cost; on one whose seal turns the
    position's noise of 5 um into 4 N, by 1.7 ms, of 2.2 resolved, for 14 %.
    """
    plant, runs = trial.fit.plant, trial.fit.runs
    amplitudes = [one for one in score.effect.parameters(plant.rig, plant.law) if one.off is not None]
    if plant.servo or not amplitudes or any(one.unit != "s" for one in amplitudes):
        return False
    sample = max(float(np.median(run.data[0])) for run in runs)
    shortest = max(sample, float(np.median([1.0 / (2.0 * np.pi * run.motion.bandwidth) for run in runs])))
    return all(abs(trial.fit.values[one.name] - one.off) < shortest for one in amplitudes if one.off is not None)


def shown_in_training(tried: Tried, known: set[str], current: Trial, judge: Judge) -> tuple[Score, Trial] | None:
    """Beside other effects that are not easily confused with it, the one that the training runs show most, if it takes a part
    of their cost and predicts them better, in all windows and in the usual ones; none that is ``known``, and beside none.

    Where the held-out runs do not bear it out it may have ended at a wrong optimum, and deserves other starts.
    """
    if current.added is None:
        return None
    shown: list[tuple[Score, Trial]] = []
    for score, trial in tried:
        standing, ended = costs(current, trial)
        clear = standing - ended > CLEAR_DROP * standing
        better = all(error(trial) < error(current) for error in (judge.usually_fits, judge.fits))
        if clear and better and score.effect.name not in known and not confused(score.effect, current):
            shown.append((score, trial))
    return min(shown, key=lambda pair: judge.usually_fits(pair[1]), default=None)
