"""From model to model: each round screens, refits and accepts, until nothing more is gained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pneuid.criticism.decision.acceptance import (
    LEAST_SHARE,
    Tried,
    accepted,
    costs,
    least_drop,
    moves_break_away_alone,
    shown_in_training,
    stands_out,
)
from pneuid.criticism.decision.all_runs import beyond_doubt, far_beyond_chance, least_shown, shown_by_training
from pneuid.criticism.decision.ascent import Chosen
from pneuid.criticism.decision.beyond import explains_alone
from pneuid.criticism.decision.break_away import AT_BREAK_AWAY, BESIDE_OTHERS, leading_friction, shown_at_break_away
from pneuid.criticism.decision.diagnosis import Candidate
from pneuid.criticism.decision.evidence import as_refitted
from pneuid.criticism.decision.leftover import DEFECT_RATIO, astray, explained_away, loudest
from pneuid.criticism.decision.revision import Revision
from pneuid.criticism.decision.rivals import alike, alike_in_training, led, lookalikes, outvoted, stayed_behind
from pneuid.criticism.decision.rounds import (
    all_explained,
    leaves_much,
    open_to_second_looks,
    overtaking,
    refitted,
    second_looks,
    worth_the_same_care,
)
from pneuid.criticism.decision.together import Joined, joined
from pneuid.criticism.decision.walk_on_all import WalkOnAll
from pneuid.criticism.refitting.restarts import NEXT_TO_NOTHING, followed, follows, settled, to_the_end
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score
from pneuid.criticism.unknown.function_search import Found, search
from pneuid.estimation.fit import Fit

IN_TURN = "each held-out run is predicted by fits to all runs but it, with this effect and without"

OUTSIDE = "they know nothing of what the run left out asks for; but only with the effect a fit to all runs leaves noise alone"

OPEN = "noise and what the training runs leave open explain the held-out error; now all runs are fitted together"
TRAINING = (
    "{} is what the training runs show: with it noise alone is left of them, and their cost falls by {:.0f}, more than the "
    "{:.0f} of chance and the method; the held-out runs cannot judge it, but do not speak against it"
)
UNEXPLAINED = "nothing that the training runs suggest explains the held-out runs; now all runs are fitted together"

PARTLY = (
    "{} is named beside what is still missing: runs left out are predicted by {:.2f} floors without it and by {:.2f} with it"
)

ASTRAY = (
    "{} is not named all the same: fitted to all runs but the one judged it leaves {:.2f} floors of the held-out error, {:.2f} "
    "without it, and more than they leave open"
)

MINOR = 0.5
"""Share of the excess explained, below which what was found stands in for something else, or beside something larger."""

EQUALS = 3
"""Effects at most that are started again with the same care as the best one, those that promise most first."""

HARDLY_LESS = 0.75
"""Share of the excess from which second looks at an effect are not taken again: of 105 floors of a machine that shakes a soft
mounting and a look-alike left 92, and second looks at what had been refitted without them were half of 24 minutes."""


@dataclass
class Walk(Revision):
    """Where a diagnosis on held-out runs stands.

    by_all_runs : whether all runs decided, to which then the trials are fitted; partly : whether what they show predicts runs
    that it was not fitted to hardly better, or worse; lacking : the model fitted to all runs, where nothing was named although
    an effect lowers their cost by more than chance; slow : whether the recordings are too slow to show break-away;
    function : what a function of a signal explains of the base model's rest, where it was looked for; beyond : whether that
    ended the walk; second_looked : the held-out error when an effect was last refitted in a round with second looks;
    roots : what was tried when the first effect was accepted.
    """

    by_all_runs: bool = False
    partly: bool = False
    lacking: Trial | None = None
    slow: bool = False
    function: Found | None = None
    beyond: bool = False
    second_looked: dict[str, float] = field(default_factory=dict)
    roots: Tried = field(default_factory=list)

    def step(self) -> bool:
        """One round; False where there is nothing more to gain."""
        if self._cannot_judge():
            return not self.named and (self._by_training_runs() or self._by_all_runs(OPEN))
        scores = self._screened(self.current)
        tried = self._first_looks(scores, least_drop(self.current))
        # a pair that leaves next to nothing needs no second look at what it hides
        if self._take_two(tried, self._best(tried), NEXT_TO_NOTHING):
            return True
        if self._beyond_catalogue(scores, tried):
            return self._take(None, tried)
        tried, chosen = self._round(scores, tried)
        self.roots = self.roots if self.named else tried
        if self._take_two(tried, chosen):
            return True
        chosen = None if outvoted(chosen, tried, self.current, self.judge) else chosen
        at_break_away, named = chosen is None, len(self.named)
        before, alike_there = self.current, tried
        if at_break_away:
            tried, chosen = self._at_break_away(tried)
            # most effects change the usual windows as little as this one
            alike_there = [pair for pair in tried if shown_at_break_away(pair[1], self.current, self.judge)]
        if self._take(chosen, tried, alike_there):
            if at_break_away and len(self.named) > named:
                said = BESIDE_OTHERS if named else AT_BREAK_AWAY
                self.moved.append(said.format(self.named[-1], np.sqrt(before.whole), np.sqrt(self.current.whole)))
            return True
        return self._instead(tried) if self.named else self._by_all_runs(UNEXPLAINED)

    def _at_break_away(self, tried: Tried) -> tuple[Tried, Chosen | None]:
        """Those tried, and what of them shows at break-away alone, in the few windows that the usual error leaves out.

        Where nothing is named yet no balance may be loud; beside others, whose forms may leave one so, it must stand out.
        """
        pair = leading_friction(tried, self.current, self.judge)
        if pair is None or not (stands_out(pair[0]) if self.named else loudest(self.current) <= DEFECT_RATIO):
            return tried, None
        score, trial = pair[0], settled(*pair, self.current, self.judge, self.refitter, self.say)
        found = (score, trial) if shown_at_break_away(trial, self.current, self.judge) else None
        return [(score, trial) if one is pair else one for one in tried], found

    def _beyond_catalogue(self, scores: Sequence[Score], tried: Tried) -> bool:
        """Whether a function of a signal explains nearly all, and far more than what promises most of the catalogue.

        Looked for once, before the second looks: these take minutes.
        """
        how = self.current, self.first, self.judge
        if self.named or self.function is not None or not open_to_second_looks(scores, tried, self._best(tried), *how):
            return False
        runs = [run.recording for run in self.judge.held]
        self.function = search(self.current.fit, runs, self.judge.floor.value, self.say)
        self.beyond = explains_alone(self.function, scores, tried, self.current)
        return self.beyond

    def _cannot_judge(self) -> bool:
        """Whether the held-out error says nothing of what is missing.

        Where no exact fit stands behind the model and it is far off on the training runs as well, these may say it.
        """
        return not self.by_all_runs and explained_away(self.current, self.judge) and not astray(self.current, self.judge)

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
        both = WalkOnAll(self.judge, base, base, self.catalogue, self.refitter, self.say, ranking=self.ranking,
                         zeros=self.zeros, refused=self.refused)
        tried = both.rounds()
        self.moved += both.moved
        for name in both.named:
            self._take_shown(name, both.first, both)
        suspicion = None if self.named else both.suspected(tried)
        if suspicion is not None:
            self.lacking = both.first
            self.moved.append(suspicion)
        return False

    def _take_shown(self, name: str, base: Trial, both: WalkOnAll) -> None:
        """Name what the walk on all runs named, unless it predicts runs that it was not fitted to worse than without it."""
        others = [self._in_turn(base.fit), self._in_turn(both.current.fit, name)]
        without = self.judge.across(base.fit, others[0], None)
        trial = self.judge.across(both.current.fit, others[1], name)
        share = (without.error - trial.error) / max(without.error - 1.0, 1e-12)
        asked = MINOR if without.error - 1.0 > self.judge.small else 0.0
        # a single held-out run has no others to learn from: what the training runs leave open may hide any gain
        may = share > 0.0 or len(others[1]) == 1
        better = share > asked or (may and self.judge.explains_across(trial, others[1]))
        clean = beyond_doubt(base, both.current, self.judge)
        if not better and not clean and not (share > LEAST_SHARE and far_beyond_chance(base, both.current)):
            self.rungs.append(self.rung(trial, False))
            self.moved.append(ASTRAY.format(name, np.sqrt(trial.whole), np.sqrt(without.whole)))
            return
        errors = np.sqrt(without.whole), np.sqrt(trial.whole)
        self.moved += [IN_TURN, *([] if better else [OUTSIDE] if clean else [PARTLY.format(name, *errors)])]
        self.rungs = [self.rung(without, True), *self.rungs[1:], self.rung(trial, True)]
        self.first, self.current = without, trial
        self.named, self.ambiguous, self.by_all_runs, self.partly = [name], both.ambiguous, True, not better

    def _on_all(self, fit: Fit) -> Fit:
        return self.refitter.on(fit, (*self.current.fit.runs, *self.judge.held))

    def _in_turn(self, fit: Fit, added: str | None = None) -> list[Fit]:
        """A model that was fitted to all runs, with the effect ``added`` if any, fitted to all but each of the held-out ones.

        Each to its exact end, if that is the better one, where it cannot follow its own runs. A film that lags by 33 ms ended
        at 320 in relaxed fits, five floors off its own runs; their exact fits left noise there, and of the run left out.
        """
        held, training = self.judge.held, self.current.fit.runs
        ends = [self.refitter.on(fit, (*training, *(run for run in held if run is not one))) for one in held]
        trials = [self.judge.trial(end, added) for end in ends]
        how = self.judge, self.refitter, self.say
        return [one.fit if self.judge.learned(one) else to_the_end(one, *how).fit for one in trials]

    def _first_looks(self, scores: Sequence[Score], least: float) -> Tried:
        """Trials with what promises most, by the floor of the best model so far."""
        made = refitted(self.current, self.first, scores, self.judge, self.refitter, self.say, least)
        made = overtaking(self.current, self.first, scores, made, self.judge, self.refitter, self.say)
        return self._followed(self._by_one_floor(made))

    def _round(self, scores: Sequence[Score], tried: Tried) -> tuple[Tried, Chosen | None]:
        """Trials of one round, those ``tried`` at first among them, and the one to accept, if any."""
        chosen, known, looked, rivalled = self._best(tried), set[str](), False, False
        while True:
            # a leading effect that does not bear other starts may have kept others from being looked at
            how = chosen, self.current, self.first, self.judge
            if not (looked or self.refitter.late()) and (open_ones := open_to_second_looks(scores, tried, *how)):
                known_well = self._known_well()
                again = second_looks(self.current, open_ones, tried, self.judge, self.refitter, self.say, known_well)
                self.second_looked |= dict.fromkeys({one.effect.name for one, _ in again} - known_well, self.current.error)
                tried, looked = self._by_one_floor(again), True
                chosen = self._best(tried)
            chosen = chosen or shown_in_training(tried, known, self.current, self.judge)
            if chosen is None:
                return tried, chosen
            if chosen[0].effect.name in known and not self.refitter.late():
                rivalled = True
                tried, chosen = self._with_rivals(scores, tried, chosen)
            if chosen is None or chosen[0].effect.name in known:
                return tried, chosen
            # a look-alike has taken the place of one whose equals were started again
            equals = [] if rivalled or self.refitter.late() else worth_the_same_care(chosen, tried, self.current)[:EQUALS]
            behind = set[str]()
            for one in (chosen, *equals):
                if one[0].effect.name in known or one[0].effect.name in behind:
                    continue
                known.add(one[0].effect.name)
                better = settled(*one, self.current, self.judge, self.refitter, self.say)
                tried = [(score, better if score is one[0] else trial) for score, trial in tried]
                if one is not chosen:
                    continue
                if follows(better):
                    break  # nothing is wrong with what follows whole runs to their noise
                # those start from where this one led
                behind = {score.effect.name for score, _ in stayed_behind((one[0], better), equals, self.current)}
            # what fits the training runs better may predict worse; then another is the best, or none
            chosen = self._best(tried)

    def _known_well(self) -> set[str]:
        """Effects that a round with second looks has refitted, where what was accepted since took little of what was left."""
        least = self.current.error - 1.0
        return {name for name, then in self.second_looked.items() if least > HARDLY_LESS * (then - 1.0)}

    def _with_rivals(
        self, scores: Sequence[Score], tried: Tried, chosen: Chosen
    ) -> tuple[Tried, Chosen | None]:
        """Those tried and the one to accept, once what promised as much, or is easily confused with the chosen effect, was
        fitted from where that one led."""
        how = self.current, self.judge, self.refitter, self.say
        tried = self._by_one_floor([*led(chosen, tried, *how), *lookalikes(chosen, scores, tried, *how)])
        return tried, self._best(tried)

    def _followed(self, tried: Tried) -> Tried:
        """Those tried; what fits the training runs best, and what fits them alike, followed to exact fits where much is left.

        A relaxed fit sees little of a break-away, and may leave most of the held-out error for it.
        """
        alike_ones = [pair for pair, near in zip(tried, alike_in_training(tried, self.current), strict=True) if near]
        ended = {score.effect.name: trial for score, trial in tried}
        for score, trial in sorted(alike_ones, key=lambda pair: self.judge.usually_fits(pair[1])):
            end = followed(trial, self.current, self.judge, self.refitter, self.say)
            ended[score.effect.name] = end
            if follows(end) or all_explained(end, self.current, self.judge):
                break  # rivals that promised as much start from where this one led
        return self._by_one_floor([(score, ended[score.effect.name]) for score, _ in tried])

    def _best(self, tried: Tried) -> Chosen | None:
        """The trial to accept, if any, as the held-out runs say."""
        found = accepted(tried, self.current, self.first, self.judge)
        return None if found is not None and self.slow and moves_break_away_alone(found[1], self.current) else found

    def _take_two(self, tried: Tried, chosen: Chosen | None, most: float = np.inf) -> bool:
        """Whether two effects were accepted at once, where one alone would leave much; ``most`` as in ``joined``."""
        if self.current.added is not None or self.refitter.late() or not leaves_much(chosen, self.current):
            return False
        catalogue = list(self.catalogue.values())
        both = joined(self.current, self.first, tried, chosen, self.judge, self.refitter, catalogue, self.say, most)
        if both is None or self.zeros.deny(both.trial.fit):
            return False
        self._accept_both(both, tried)
        return True

    def _accept_both(self, both: Joined, tried: Tried) -> None:
        """Accept two effects at once."""
        self.judge, self.current, self.first = both.judge, both.current, both.original
        for score, trial in (*tried, both.firsts[0], (both.second, both.trial)):
            self._record(score, trial, keep=False)
        self.rungs += [self.rung(trial, False) for _, trial in tried]
        self._accept(both.names, both.firsts[0], both.firsts)

    def _alike(self, chosen: Chosen, tried: Tried) -> Tried:
        return alike(chosen, tried, self.current, self.judge)

    def _evidence(self, score: Score, trial: Trial) -> Candidate:
        return as_refitted(score, trial, self.current, self.first)
