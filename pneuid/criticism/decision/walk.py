"""From model to model: each round screens, refits and accepts, until nothing more is gained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.acceptance import (
    LEAST_DROP,
    LEAST_SHARE,
    Tried,
    accepted,
    costs,
    least_drop,
    moves_break_away_alone,
)
from pneuid.criticism.decision.all_runs import beyond_doubt, least_shown, shown, shown_by_training, within_a_sample
from pneuid.criticism.decision.break_away import AT_BREAK_AWAY, leading_friction, shown_at_break_away
from pneuid.criticism.decision.diagnosis import Candidate
from pneuid.criticism.decision.evidence import as_refitted, as_screened, chance, leading
from pneuid.criticism.decision.leftover import DEFECT_RATIO, FAR_OFF, explained_away, loudest
from pneuid.criticism.decision.rivals import alike, alike_in_training, better_without, contains, led, lookalikes
from pneuid.criticism.decision.rounds import (
    Say,
    all_explained,
    leaves_far,
    leaves_much,
    overtaking,
    promised_alike,
    refitted,
    same_floor,
    second_looks,
)
from pneuid.criticism.decision.together import Joined, joined
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import followed, follows, settled
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit

SHOWN = (
    "{} is what all runs together show: fitted to the held-out runs as well, their cost falls by {:.0f}, more than the {:.0f} "
    "of chance and the method; the held-out runs alone cannot judge it: hold out one like the training runs, or fit to all"
)

IN_TURN = "each held-out run is predicted by fits to all runs but it, with this effect and without"

OUTSIDE = "they know nothing of what the run left out asks for; but only with the effect a fit to all runs leaves noise alone"

OPEN = "noise and what the training runs leave open explain the held-out error; now all runs are fitted together"
TRAINING = (
    "{} is what the training runs show: with it noise alone is left of them, and their cost falls by {:.0f}, more than the "
    "{:.0f} of chance and the method; the held-out runs cannot judge it, but do not speak against it"
)
UNEXPLAINED = "nothing that the training runs suggest explains the held-out runs; now all runs are fitted together"

ASTRAY = (
    "{} is not named all the same: fitted to all runs but the one judged it leaves {:.2f} floors of the held-out error, {:.2f} "
    "without it, and more than they leave open"
)

SUSPECT = (
    "fitted to all runs together, {} lowers the cost by {:.0f}, more than the {:.0f} of chance and the method, but does not "
    "explain them: something of its kind may be missing; record longer runs of both kinds"
)

MINOR = 0.5
"""Share of the excess explained, below which what was found stands in for something else, or beside something larger."""

ROUNDS_ON_ALL = 2
"""Rounds on all runs together: the second where the first found a better start of the model that stood."""

EQUALS = 3
"""Effects at most that are started again with the same care as the best one, those that promise most first."""

MISSED, STAYS = 0.02, 0.25
"""Shares of the base model's excess, and of the error that is left, below which an effect's absence is not felt."""

BETTER_START = (
    "the model that stood before fits better from another start ({:.2f} -> {:.2f} floors); all is measured against that"
)


@dataclass
class Walk:
    """Where the diagnosis stands.

    current, first : trials of the standing model and of the base; named : effects accepted so far; ambiguous : by the name
    of an accepted effect, those that explain as much; moved : what was said of better starts, and of what all runs show;
    pooled : whether all runs decide, to which then the trials are fitted; lacking : the model fitted to all runs, where nothing
    was named although an effect lowers their cost by more than chance; slow : whether the recordings are too slow to show
    break-away.
    """

    judge: Judge
    current: Trial
    first: Trial
    catalogue: dict[str, Effect]
    refitter: Refitter
    say: Say
    rungs: list[Rung] = field(default_factory=list)
    ranking: dict[str, Candidate] = field(default_factory=dict)
    named: list[str] = field(default_factory=list)
    ambiguous: dict[str, tuple[str, ...]] = field(default_factory=dict)
    moved: list[str] = field(default_factory=list)
    pooled: bool = False
    lacking: Trial | None = None
    slow: bool = False

    def step(self) -> bool:
        """One round; False where there is nothing more to gain."""
        if self._cannot_judge():
            return not self.named and (self._by_training_runs() or self._by_all_runs(OPEN))
        candidates = list(self.catalogue.values())
        scores = self._screened(self.current)
        tried, chosen = self._round(scores, least_drop(self.current))
        if self.current.added is None and leaves_much(chosen, self.current):
            both = joined(self.current, self.first, tried, chosen, self.judge, self.refitter, candidates, self.say)
            if both is not None:
                self._take_both(both, tried)
                return True
        at_break_away = chosen is None and not self.named
        before, alike_there = self.current, tried
        if at_break_away:
            tried, chosen = self._at_break_away(tried)
            # most effects change the usual windows as little as this one
            alike_there = [pair for pair in tried if shown_at_break_away(pair[1], self.current, self.judge)]
        if self._take(chosen, tried, alike_there):
            if at_break_away and self.named:
                self.moved.append(AT_BREAK_AWAY.format(self.named[0], np.sqrt(before.whole), np.sqrt(self.current.whole)))
            return True
        return not self.named and self._by_all_runs(UNEXPLAINED)

    def _at_break_away(self, tried: Tried) -> tuple[Tried, tuple[Score, Trial] | None]:
        """Those tried, and what of them shows at break-away alone, in the few windows that the usual error leaves out."""
        pair = leading_friction(tried, self.current, self.judge)
        if pair is None or loudest(self.current) > DEFECT_RATIO:
            return tried, None
        score, trial = pair[0], settled(*pair, self.current, self.judge, self.refitter, self.say)
        found = (score, trial) if shown_at_break_away(trial, self.current, self.judge) else None
        return [(score, trial) if one is pair else one for one in tried], found

    def _cannot_judge(self) -> bool:
        """Whether the held-out error says nothing of what is missing.

        Where no exact fit stands behind the model and it is far off on the training runs as well, these may say it.
        """
        return not self.pooled and explained_away(self.current, self.judge) and not self._astray()

    def _astray(self) -> bool:
        """Whether no exact fit stands behind the model and its predictions of the training runs are far off."""
        return self.current.fit.exact is None and self.judge.fits(self.current) > FAR_OFF**2

    def _by_training_runs(self) -> bool:
        """Accept what leaves noise alone of a servo rig's training runs; on a bench all runs together decide."""
        current = self.current
        if not current.fit.plant.servo or self.judge.learned(current):
            return False
        scores, least = self._screened(current), least_shown(current)
        tried = self._followed(
            self._by_one_floor(refitted(current, self.first, scores, self.judge, self.refitter, self.say, least))
        )
        chosen = shown_by_training(tried, self.current, self.judge)
        if chosen is None:
            return False
        name, (now, after) = chosen[0].effect.name, costs(self.current, chosen[1])
        took = self._take(chosen, tried)
        if name in self.named:
            self.moved.append(TRAINING.format(name, now - after, least))
        return took

    def _by_all_runs(self, why: str) -> bool:
        """Accept what all runs together show, the last that can be accepted; on a bench alone.

        On a servo rig the fit to more runs may end at another optimum, far off, and show what is not there.
        """
        if self.current.fit.plant.servo:
            if not self.ranking:
                self._screened(self.current)
            return False
        self.say(why)
        base = self.judge.trial(self._on_all(self.current.fit))
        both = Walk(self.judge, base, base, self.catalogue, self.refitter, self.say, ranking=self.ranking, pooled=True)
        tried = both._rounds_on_all()
        self.moved += both.moved
        for name in both.named:
            self._take_shown(name, both.first, both)
        if not self.named:
            self._suspect(tried, both.first)
        return False

    def _rounds_on_all(self) -> Tried:
        """A round on all runs, and another where it ended with a better start of the model that stood; those tried last."""
        tried: Tried = []
        for _ in range(ROUNDS_ON_ALL):
            standing = self.current
            scores, least = self._screened(standing), least_shown(standing)
            if not any(score.drop > least for score in scores):
                return []
            tried, chosen = self._round(scores, least)
            if not self._take(chosen, tried) or self.named:
                return tried
        return tried

    def _suspect(self, tried: Tried, base: Trial) -> None:
        """Where nothing was named although an effect lowers the cost of all runs by more than chance: something is lacking."""
        least = least_shown(base)
        told = [trial for score, trial in tried if not within_a_sample(score, trial)]
        drops = [(now - after, trial.added) for trial in told for now, after in [costs(base, trial)]]
        most, name = max(drops, key=lambda item: item[0], default=(0.0, None))
        if most > least:
            self.lacking = base
            self.moved.append(SUSPECT.format(name, most, least))

    def _take_shown(self, name: str, base: Trial, both: Walk) -> None:
        """Name what the walk on all runs named, unless it predicts runs that it was not fitted to worse than without it."""
        others = [self._in_turn(fit) for fit in (base.fit, both.current.fit)]
        without = self.judge.across(base.fit, others[0], None)
        trial = self.judge.across(both.current.fit, others[1], name)
        share = (without.error - trial.error) / max(without.error - 1.0, 1e-12)
        asked = MINOR if without.error - 1.0 > self.judge.small else 0.0
        # a single held-out run has no others to learn from: what the training runs leave open may hide any gain
        may = share > 0.0 or len(others[1]) == 1
        better = share > asked or (may and self.judge.explains_across(trial, others[1]))
        if not better and not beyond_doubt(base, both.current, self.judge):
            self.rungs.append(self.rung(trial, False))
            self.moved.append(ASTRAY.format(name, np.sqrt(trial.whole), np.sqrt(without.whole)))
            return
        self.moved += [IN_TURN] if better else [IN_TURN, OUTSIDE]
        self.rungs = [self.rung(without, True), *self.rungs[1:], self.rung(trial, True)]
        self.first, self.current = without, trial
        self.named, self.ambiguous, self.pooled = [name], both.ambiguous, True

    def _on_all(self, fit: Fit) -> Fit:
        return self.refitter.on(fit, (*self.current.fit.runs, *self.judge.held))

    def _in_turn(self, fit: Fit) -> list[Fit]:
        """A model that was fitted to all runs, fitted to all but each of the held-out ones."""
        held, training = self.judge.held, self.current.fit.runs
        return [self.refitter.on(fit, (*training, *(run for run in held if run is not one))) for one in held]

    def _screened(self, standing: Trial) -> list[Score]:
        """Every effect screened on a model; the first screening ranks."""
        scores = list(screen(standing.fit, list(self.catalogue.values()), list(self.catalogue)))
        for score in scores:
            self.ranking.setdefault(score.effect.name, as_screened(score))
        self.say(leading(scores))
        return scores

    def backward(self) -> bool:
        """Try to drop each accepted effect but the last; keep the smaller model where the held-out error hardly rises.

        Whether one was dropped: the smaller model may end elsewhere, where what it lacks shows.

        What remains is put in order of weight: first the effect without which the training runs cost most. The order in which
        effects were found is that of the prediction of break-away, which a small effect may turn first.
        """
        costlier: dict[str, float] = {}
        before = len(self.named)
        for name in list(self.named):
            if len(self.named) < 2 or name not in {effect.name for effect in self.current.fit.plant.effects}:
                continue  # a richer friction law took the simple one's place; without it the model is another
            smaller = self.judge.trial(self.refitter.without(self.current.fit, name))
            if self.current.fit.exact is not None:
                smaller = followed(smaller, self.current, self.judge, self.refitter, self.say)
            if name != self.named[-1] and self._not_missed(smaller):
                self.say(f"{name} dropped again: without it the held-out error stays")
                self.named = [other for other in self.named if other != name]
                self.current = smaller
                continue
            without, now = costs(smaller, self.current)
            costlier[name] = without - now
        self.named.sort(key=lambda name: -costlier.get(name, np.inf))
        return len(self.named) < before

    def _not_missed(self, smaller: Trial) -> bool:
        """Whether a model without one of the effects predicts held-out runs, and fits the training runs, about as well."""
        before, without, now = costs(self.first, smaller, self.current)
        little = min(MISSED * (self.first.error - 1.0), STAYS * self.current.error)
        same_fit = without - now < max(LEAST_DROP, LEAST_SHARE * (before - now))
        return same_fit and smaller.error - self.current.error < max(3 * self.judge.spread, little)

    def _round(self, scores: Sequence[Score], least: float) -> tuple[Tried, tuple[Score, Trial] | None]:
        """Trials of one round and the one to accept, if any, all by the floor of the best model so far."""
        made = refitted(self.current, self.first, scores, self.judge, self.refitter, self.say, least)
        if not self.pooled:
            made = overtaking(self.current, self.first, scores, made, self.judge, self.refitter, self.say)
        tried = self._followed(self._by_one_floor(made))
        chosen, known, looked, late = self._best(tried), set[str](), False, False
        while True:
            # a leading effect that does not bear other starts may have kept others from being looked at
            if not looked and self._needs_second_looks(chosen):
                again = second_looks(self.current, scores, tried, self.judge, self.refitter, self.say)
                tried, looked = self._by_one_floor(again), True
                chosen = self._best(tried)
            if chosen is None:
                return tried, chosen
            if chosen[0].effect.name in known:
                late = True
                tried, chosen = self._with_rivals(scores, tried, chosen)
            if chosen is None or chosen[0].effect.name in known:
                return tried, chosen
            # a look-alike has taken the place of one whose equals were started again
            equals = [] if self.pooled or late else promised_alike(chosen[0], tried)[:EQUALS]
            for one in (chosen, *equals):
                if one[0].effect.name in known:
                    continue
                known.add(one[0].effect.name)
                better = settled(*one, self.current, self.judge, self.refitter, self.say)
                tried = [(score, better if score is one[0] else trial) for score, trial in tried]
                if one is chosen and follows(better):
                    break  # nothing is wrong with what follows whole runs to their noise
            # what fits the training runs better may predict worse; then another is the best, or none
            chosen = self._best(tried)

    def _with_rivals(
        self, scores: Sequence[Score], tried: Tried, chosen: tuple[Score, Trial]
    ) -> tuple[Tried, tuple[Score, Trial] | None]:
        """Those tried and the one to accept, once what promised as much, or is easily confused with the chosen effect, was
        fitted from where that one led."""
        if self.pooled:
            return tried, chosen
        how = self.current, self.judge, self.refitter, self.say
        tried = self._by_one_floor([*led(chosen, tried, *how), *lookalikes(chosen, scores, tried, *how)])
        return tried, self._best(tried)

    def _followed(self, tried: Tried) -> Tried:
        """Those tried; what fits the training runs best, and what fits them alike, followed to exact fits where much is left.

        A relaxed fit sees little of a break-away, and may leave most of the held-out error for it.
        """
        if self.pooled:
            return tried
        alike_ones = [pair for pair, near in zip(tried, alike_in_training(tried, self.current), strict=True) if near]
        ended = {score.effect.name: trial for score, trial in tried}
        for score, trial in sorted(alike_ones, key=lambda pair: self.judge.usually_fits(pair[1])):
            end = followed(trial, self.current, self.judge, self.refitter, self.say)
            ended[score.effect.name] = end
            if follows(end) or all_explained(end, self.current, self.judge):
                break  # rivals that promised as much start from where this one led
        return self._by_one_floor([(score, ended[score.effect.name]) for score, _ in tried])

    def _best(self, tried: Tried) -> tuple[Score, Trial] | None:
        """The trial to accept, if any: what the held-out runs say, or all runs where those cannot judge."""
        if self.pooled:
            return next(iter(shown(tried, self.current, self.judge)), None)
        found = accepted(tried, self.current, self.first, self.judge)
        return None if found is not None and self.slow and moves_break_away_alone(found[1], self.current) else found

    def _needs_second_looks(self, chosen: tuple[Score, Trial] | None) -> bool:
        """Whether much is left that the leading effects do not explain: on a balance, or, far off, at break-away alone.

        Of the training runs as well where nothing helps: a servo rig that lacks nothing mostly has an exact fit (15 of 15).
        """
        much = leaves_much(chosen, self.current) or leaves_far(chosen, self.current)
        if self.pooled or self.current.added is not None or not much:
            return False
        far = max(self.current.error, self.current.whole) > FAR_OFF**2 or (chosen is None and self._astray())
        return far or loudest(self.current) > DEFECT_RATIO

    def _by_one_floor(self, tried: Tried) -> Tried:
        self.judge, self.current, self.first, tried = same_floor(self.judge, self.current, self.first, tried)
        return tried

    def _take(self, chosen: tuple[Score, Trial] | None, tried: Tried, others: Tried | None = None) -> bool:
        """Accept an effect, or a better start of the standing model; False where there is neither.

        Rivals are sought among the ``others``, those tried if left out.
        """
        others = tried if others is None else others
        smaller = None if chosen is None else better_without(chosen, self.current, self.judge, self.refitter)
        if smaller is not None:
            self.moved.append(BETTER_START.format(np.sqrt(self.current.whole), np.sqrt(smaller.whole)))
            self.say(self.moved[-1])
            self.first, self.current = (self.first if self.named else smaller), smaller
        for score, trial in tried:
            self._record(score, trial, keep=bool(self.named))
        if chosen is not None and smaller is None:
            chosen = self._plainest(chosen, others)
        self.rungs += [
            self.rung(trial, False) for _, trial in tried if chosen is None or trial.added != chosen[1].added
        ]
        if chosen is None:
            return False
        if smaller is not None:
            own = self.rung(smaller, True)
            self.rungs = [*self.rungs, own] if self.named else [own, *self.rungs[1:]]
            alone_exact = chosen[1].fit.exact is not None and self.current.fit.exact is None
            if (self._cannot_judge() and not alone_exact) or self._best([chosen]) is None:
                self.rungs.append(self.rung(chosen[1], False))
                return True
        self._accept([chosen[0].effect.name], chosen, others)
        return True

    def _take_both(self, both: Joined, tried: Tried) -> None:
        """Accept two effects at once."""
        self.judge, self.current, self.first = both.judge, both.current, both.original
        for score, trial in (*tried, both.firsts[0], (both.second, both.trial)):
            self._record(score, trial, keep=False)
        self.rungs += [self.rung(trial, False) for _, trial in tried]
        self._accept(both.names, both.firsts[0], both.firsts)

    def _accept(self, names: list[str], chosen: tuple[Score, Trial], others: Tried) -> None:
        trial = chosen[1]
        self.rungs.append(self.rung(trial, True))
        self.named += names
        if self.pooled:
            now, after = costs(self.current, trial)
            self.moved.append(SHOWN.format(names[0], now - after, least_shown(self.current)))
        self.ambiguous[names[0]] = tuple(score.effect.name for score, _ in self._rivals(chosen, others))
        errors = f"{np.sqrt(self.current.error):.1f} -> {np.sqrt(trial.error):.1f}"
        self.say(f"{' and '.join(names)} accepted: held-out error {errors} floors without the worst tenth")
        self.current = trial

    def _rivals(self, chosen: tuple[Score, Trial], tried: Tried) -> Tried:
        """Other effects that explain as much as the chosen one; a friction law that contains it is none."""
        found = shown(tried, self.current, self.judge) if self.pooled else alike(chosen, tried, self.current, self.judge)
        others = [pair for pair in found if pair[0] is not chosen[0]]
        return [pair for pair in others if not contains(pair, chosen)]

    def _plainest(self, chosen: tuple[Score, Trial], tried: Tried) -> tuple[Score, Trial]:
        """The chosen effect, or what it is in a limit where it gains nothing by being more."""
        plainer = [pair for pair in self._rivals(chosen, tried) if contains(chosen, pair)]
        return min(plainer, key=lambda pair: len(pair[1].fit.plant.parameters), default=chosen)

    def _record(self, score: Score, trial: Trial, keep: bool) -> None:
        """Put a refit's evidence into the ranking; that of the first round stands. Of one to all runs nothing is held out."""
        name, known = score.effect.name, self.ranking[score.effect.name]
        if keep and known.hold_out_error_ratio is not None:
            return
        if self.pooled:
            self.ranking[name] = replace(known, p_value=chance(score, trial, self.current))
        else:
            self.ranking[name] = as_refitted(score, trial, self.current, self.first)

    def rung(self, trial: Trial, accepted: bool) -> Rung:
        """The trial as a rung of the ladder."""
        names, floor = tuple(effect.name for effect in trial.fit.plant.effects), dict(self.judge.floor.value)
        return Rung(names, trial.added, accepted, trial.train, trial.hold_out, floor, len(trial.fit.plant.parameters))
