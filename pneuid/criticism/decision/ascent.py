"""What a walk from model to model does whoever judges: screen, take an effect or a better start, and keep the rungs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.acceptance import Tried
from pneuid.criticism.decision.diagnosis import Candidate
from pneuid.criticism.decision.evidence import as_screened, leading
from pneuid.criticism.decision.rivals import better_without, contains
from pneuid.criticism.decision.rounds import Say, same_floor
from pneuid.criticism.decision.zeros import Zeros
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit

Chosen = tuple[Score, Trial]

BETTER_START = (
    "the model that stood before fits better from another start ({:.2f} -> {:.2f} floors); all is measured against that"
)


@dataclass
class Ascent(ABC):
    """Where a diagnosis stands.

    current, first : trials of the standing model and of the base; named : effects accepted so far; ambiguous : by the name
    of an accepted effect, those that explain as much; moved : what was said of better starts, and of what all runs show;
    zeros : what a zero reading says; refused : fits by the name of the effect whose shift it contradicts.
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
    zeros: Zeros = field(default_factory=Zeros)
    refused: dict[str, Fit] = field(default_factory=dict)

    @abstractmethod
    def _best(self, tried: Tried) -> Chosen | None:
        """The trial to accept, if any."""

    @abstractmethod
    def _alike(self, chosen: Chosen, tried: Tried) -> Tried:
        """Effects that explain as much as the chosen one."""

    @abstractmethod
    def _evidence(self, score: Score, trial: Trial) -> Candidate:
        """What the ranking says of an effect whose refit ended there."""

    @abstractmethod
    def _cannot_judge(self) -> bool:
        """Whether the runs that decide say nothing of what is missing."""

    def _screened(self, standing: Trial) -> list[Score]:
        """Every effect screened on a model; the first screening ranks."""
        scores = list(screen(standing.fit, list(self.catalogue.values()), list(self.catalogue)))
        for score in scores:
            self.ranking.setdefault(score.effect.name, as_screened(score))
        self.say(leading(scores))
        return scores

    def _by_one_floor(self, tried: Tried) -> Tried:
        self.judge, self.current, self.first, tried = same_floor(self.judge, self.current, self.first, tried)
        return self._possible(tried)

    def _possible(self, tried: Tried) -> Tried:
        """Those tried that a zero reading does not contradict."""
        possible = self.zeros.possible(tried)
        left = {score.effect.name for score, _ in possible}
        self.refused |= {score.effect.name: trial.fit for score, trial in tried if score.effect.name not in left}
        return possible

    def _take(self, chosen: Chosen | None, tried: Tried, others: Tried | None = None) -> bool:
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
            chosen = self.zeros.preferred(chosen, self._rivals(chosen, others))
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

    def _accept(self, names: list[str], chosen: Chosen, others: Tried) -> None:
        trial = chosen[1]
        self.rungs.append(self.rung(trial, True))
        self.named += names
        self.ambiguous[names[0]] = tuple(score.effect.name for score, _ in self._rivals(chosen, others))
        errors = f"{np.sqrt(self.current.error):.1f} -> {np.sqrt(trial.error):.1f}"
        self.say(f"{' and '.join(names)} accepted: held-out error {errors} floors without the worst tenth")
        self.current = trial

    def _rivals(self, chosen: Chosen, tried: Tried) -> Tried:
        """Others that explain as much as the chosen one; none that contains it, or another of them, and gains nothing, and none
        beside one that a zero reading shows."""
        if self.zeros.confirms(chosen[1].fit, chosen[0].effect):
            return []
        others = [pair for pair in self._alike(chosen, tried) if pair[0] is not chosen[0]]
        return [pair for pair in others if not any(contains(pair, one) for one in (chosen, *others) if one is not pair)]

    def _plainest(self, chosen: Chosen, tried: Tried) -> Chosen:
        """The chosen effect, or what it is in a limit where it gains nothing by being more."""
        plainer = [pair for pair in self._rivals(chosen, tried) if contains(chosen, pair)]
        return min(plainer, key=lambda pair: len(pair[1].fit.plant.parameters), default=chosen)

    def _record(self, score: Score, trial: Trial, keep: bool) -> None:
        """Put a refit's evidence into the ranking; that of the first round stands."""
        name = score.effect.name
        if not keep or self.ranking[name].hold_out_error_ratio is None:
            self.ranking[name] = self._evidence(score, trial)

    def rung(self, trial: Trial, accepted: bool) -> Rung:
        """The trial as a rung of the ladder."""
        names, floor = tuple(effect.name for effect in trial.fit.plant.effects), dict(self.judge.floor.value)
        return Rung(names, trial.added, accepted, trial.train, trial.hold_out, floor, len(trial.fit.plant.parameters))
