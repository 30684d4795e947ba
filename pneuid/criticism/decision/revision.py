"""What becomes of the effects accepted so far: one is dropped, or gives its place to another."""

from __future__ import annotations

from dataclasses import dataclass, field

from pneuid.criticism.decision.acceptance import LEAST_DROP, LEAST_SHARE, Tried, accepted, costs, inside_bounds
from pneuid.criticism.decision.ascent import Ascent
from pneuid.criticism.decision.exchange import exchanged, larger_part
from pneuid.criticism.decision.rounds import STILL_OFF
from pneuid.criticism.refitting.restarts import followed
from pneuid.criticism.refitting.trial import Trial

MISSED, STAYS = 0.02, 0.25
"""Shares of the base model's excess, and of the error that is left, below which an effect's absence is not felt."""


@dataclass
class Revision(Ascent):
    """A walk that looks back.

    looked_at : named effects, each with those beside it, for which others were tried in their place.
    """

    looked_at: set[tuple[str, frozenset[str]]] = field(default_factory=set)

    def backward(self) -> bool:
        """Try to drop each accepted effect but the last; keep the smaller model where the held-out error hardly rises.

        Where it rises, what is easily confused with the effect may take its place. Whether the model changed: it may end
        elsewhere, where what it lacks shows. What remains is put in order of weight: first the effect without which the
        training runs cost most; the order of finding is that of predicted break-away. A richer friction law keeps its place.
        """
        smaller_models: dict[str, Trial] = {}
        before = list(self.named)
        for name in before:
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
            smaller_models[self._exchange(name, smaller)] = smaller
        # by defects that all of them have, as tight ones see more
        missed = dict(zip(smaller_models, costs(*smaller_models.values()), strict=True))
        order = iter(sorted(missed, key=lambda name: -missed[name]))
        self.named = [next(order) if name in missed else name for name in self.named]
        return set(self.named) != set(before)

    def _exchange(self, name: str, smaller: Trial) -> str:
        """The effect that stands in a named one's place: itself, or another that was confused with it."""
        place = frozenset(self.named) - {name}
        if (name, place) in self.looked_at or self.refitter.late():
            return name
        how = self.current, self.judge, self.refitter, list(self.catalogue.values()), self.say, self.zeros
        found = exchanged(name, smaller, *how)
        stands = found.taking[0].effect.name if found.taking else name
        self.looked_at |= {(name, place), (stands, place)}
        rivals = tuple(score.effect.name for score, _ in found.rivals)
        for score, trial in found.rivals:
            self._record(score, trial, keep=False)
        if found.taking is None:
            if rivals:
                self.say(f"as good in the place of {name}: {', '.join(rivals)}")
                self.ambiguous[name] = tuple(dict.fromkeys((*self.ambiguous.get(name, ()), *rivals)))
            return name
        score, trial = found.taking
        self.say(f"{stands} takes the place of {name}: held-out and training runs both say so")
        self.named = [stands if one == name else one for one in self.named]
        self.ambiguous.pop(name, None)
        self.ambiguous[stands] = rivals
        self._record(score, trial, keep=False)
        self.rungs.append(self.rung(trial, True))
        self.current = trial
        return stands

    def _not_missed(self, smaller: Trial) -> bool:
        """Whether a model without one of the effects predicts held-out runs, and fits the training runs, about as well."""
        before, without, now = costs(self.first, smaller, self.current)
        little = min(MISSED * (self.first.error - 1.0), STAYS * self.current.error)
        same_fit = without - now < max(LEAST_DROP, LEAST_SHARE * (before - now))
        return same_fit and smaller.error - self.current.error < max(3 * self.judge.spread, little)

    def _instead(self, tried: Tried) -> bool:
        """Whether, beside what does not help beside the only effect named, another takes that one's place, and helps."""
        if len(self.named) != 1 or self.current.error <= STILL_OFF**2 or self.refitter.late():
            return False
        larger = larger_part(tried, self.current, self.first)
        if larger is None:
            return False
        beside, both = self.zeros.preferred(larger, self._rivals(larger, tried))
        gone, second = self.named[0], beside.effect.name
        self.say(f"{second} takes more of the training cost than {gone} did; looking for what hides it")
        smaller = self.judge.trial(self.refitter.without(both.fit, gone), second)
        how = both, self.judge, self.refitter, list(self.catalogue.values()), self.say, self.zeros
        found = exchanged(gone, smaller, *how)
        if found.taking is None or accepted([found.taking], self.current, self.first, self.judge) is None:
            return False
        score, trial = found.taking
        if not inside_bounds(beside, trial) or self.zeros.deny(trial.fit):
            return False
        stands = score.effect.name
        self.say(f"{stands} takes the place of {gone} beside {second}")
        self.named = [stands, second]
        rivals = {stands: found.rivals, second: self._rivals((beside, both), tried)}
        self.ambiguous = {name: tuple(one.effect.name for one, _ in pairs) for name, pairs in rivals.items()}
        self.current = self.first  # what they explain is all of it, not what the one that is gone had left
        for one in (score, beside):
            self._record(one, trial, keep=False)
        self.rungs.append(self.rung(trial, True))
        self.current = trial
        return True
