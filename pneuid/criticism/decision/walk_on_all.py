"""The walk on all runs together, where the held-out runs cannot judge: every trial is fitted to all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pneuid.criticism.decision.acceptance import Tried, costs, unresolved
from pneuid.criticism.decision.all_runs import least_shown, shown
from pneuid.criticism.decision.ascent import Ascent, Chosen
from pneuid.criticism.decision.diagnosis import Candidate
from pneuid.criticism.decision.evidence import chance
from pneuid.criticism.decision.rounds import refitted
from pneuid.criticism.refitting.restarts import settled
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score

SHOWN = (
    "{} is what all runs together show: fitted to the held-out runs as well, their cost falls by {:.0f}, more than the {:.0f} "
    "of chance and the method; the held-out runs alone cannot judge it: hold out one like the training runs, or fit to all"
)

SUSPECT = (
    "fitted to all runs together, {} lowers the cost by {:.0f}, more than the {:.0f} of chance and the method, but does not "
    "explain them: something of its kind may be missing; record longer runs of both kinds"
)

ROUNDS_ON_ALL = 2
"""Rounds on all runs together: the second where the first found a better start of the model that stood."""


class WalkOnAll(Ascent):
    """Where a diagnosis on all runs stands."""

    def _best(self, tried: Tried) -> Chosen | None:
        return next(iter(shown(tried, self.current, self.judge)), None)

    def _alike(self, chosen: Chosen, tried: Tried) -> Tried:  # noqa: ARG002
        return shown(tried, self.current, self.judge)

    def _evidence(self, score: Score, trial: Trial) -> Candidate:
        # nothing is held out
        return replace(self.ranking[score.effect.name], p_value=chance(score, trial, self.current))

    def _cannot_judge(self) -> bool:
        return False

    def _accept(self, names: list[str], chosen: Chosen, others: Tried) -> None:
        now, after = costs(self.current, chosen[1])
        self.moved.append(SHOWN.format(names[0], now - after, least_shown(self.current)))
        super()._accept(names, chosen, others)

    def rounds(self) -> Tried:
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

    def _round(self, scores: Sequence[Score], least: float) -> tuple[Tried, Chosen | None]:
        """Trials of one round and the one to accept, if any, each that leads from its best start."""
        made = refitted(self.current, self.first, scores, self.judge, self.refitter, self.say, least)
        tried, known = self._by_one_floor(made), set[str]()
        while True:
            chosen = self._best(tried)
            if chosen is None or chosen[0].effect.name in known:
                return tried, chosen
            known.add(chosen[0].effect.name)
            better = settled(*chosen, self.current, self.judge, self.refitter, self.say)
            tried = [(score, better if score is chosen[0] else trial) for score, trial in tried]

    def suspected(self, tried: Tried) -> str | None:
        """What is said where nothing was named although an effect lowers the cost of all runs by more than chance."""
        least = least_shown(self.first)
        told = [trial for score, trial in tried if not unresolved(score, trial)]
        drops = [(now - after, trial.added) for trial in told for now, after in [costs(self.first, trial)]]
        most, name = max(drops, key=lambda item: item[0], default=(0.0, None))
        return SUSPECT.format(name, most, least) if most > least else None
