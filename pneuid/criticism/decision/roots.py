"""Which effect a walk begins with: where those that it named leave much, others that took as much of the training cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pneuid.criticism.decision.acceptance import Tried, costs, least_drop
from pneuid.criticism.decision.ascent import Chosen
from pneuid.criticism.decision.rounds import STILL_OFF
from pneuid.criticism.decision.walk import Walk
from pneuid.criticism.refitting.restarts import NEXT_TO_NOTHING
from pneuid.criticism.refitting.trial import Trial

MOST_ROUNDS = 4
"""Rounds of the walk, each of which accepts an effect, two at once, or a better start."""

AS_MUCH = 0.75
"""Share of what the first effect took of the training cost that another must have taken to be one to begin with."""

ROOTS = 3
"""How many others are tried, those first that took most."""

HALF = 0.5
"""Share of the held-out excess that a walk from another root, after as many effects, may leave of what the first one left."""

BEGAN = "beginning with {} in place of {}, which took about as much of the training cost, leaves {:.2f} and not {:.2f} floors"


def climb(walk: Walk) -> None:
    """Rounds of the walk until one gains nothing and nothing is dropped from what they led to, or the time is over.

    What is dropped was put in for what is still missing: of a load spring and a friction that differs by direction a payload
    stood in for both, and without it the spring alone showed the other.
    """
    for _ in range(MOST_ROUNDS):
        if not (not walk.refitter.late() and walk.step()) and not walk.backward():
            return
    walk.backward()


def from_another_root(walk: Walk) -> Walk:
    """The walk, or one that began with another effect and explains far more.

    Which of several that take one constant predicts best alone is told by what the second one leaves: in place of an offset of
    p2 beside a valve whose sides differ a weight left 5.0 floors and the offset 6.1, then heat at the walls 2.2; beside the
    offset that valve leaves 1.1.
    """
    if len(walk.named) < 2 or walk.by_all_runs or walk.current.error <= STILL_OFF**2:
        return walk
    best, least = None, HALF
    for pair in _roots(walk):
        if walk.refitter.late() or least < NEXT_TO_NOTHING:
            break
        begun = Rooted.at(walk, pair)
        if (left := begun.look_beside(walk.current)) < least:
            best, least = begun, left
    if best is None:
        return walk
    best.go_on()
    climb(best)
    before = best.judge.judged(walk.current)
    if best.current.error >= before.error:
        return walk
    floors = (np.sqrt(trial.whole) for trial in (best.current, before))
    best.moved.append(BEGAN.format(_root(best), _root(walk), *floors))
    return best


def _root(walk: Walk) -> str:
    """The effect accepted first."""
    return next((rung.added for rung in walk.rungs[1:] if rung.accepted and rung.added is not None), "")


def _roots(walk: Walk) -> Tried:
    """Effects tried at first, none of them named, that took nearly as much of the training cost as the one accepted did."""
    first = [pair for pair in walk.roots if pair[0].effect.name == _root(walk)]
    others = [pair for pair in walk.roots if pair[0].effect.name not in walk.named and not pair[0].effect.richer_law]
    if not first or not others:
        return []
    before, taken, *ends = costs(walk.first, first[0][1], *(trial for _, trial in others))
    low = [pair for pair in zip(ends, others, strict=True) if before - pair[0] > AS_MUCH * (before - taken)]
    return [pair for _, pair in sorted(low, key=lambda item: item[0])[:ROOTS]]


class Rooted(Walk):
    """A walk that began with an effect which another walk did not take first."""

    found: tuple[Tried, Chosen | None] = ([], None)
    """What was tried beside the root at a first look, and what helps."""

    @classmethod
    def at(cls, walk: Walk, pair: Chosen) -> Rooted:
        """From the same base; what the other walk accepted becomes a rejected step of the ladder."""
        base, *others = walk.rungs
        walk.say(f"{pair[0].effect.name} took about as much of the training cost as {_root(walk)}; looking beside it")
        begun = cls(
            walk.judge, walk.first, walk.first, walk.catalogue, walk.refitter, walk.say,
            rungs=[base, *(replace(rung, accepted=False) for rung in others)], ranking=dict(walk.ranking),
            moved=list(walk.moved), zeros=walk.zeros, refused=dict(walk.refused), slow=walk.slow, function=walk.function,
            roots=walk.roots,
        )  # fmt: skip
        begun._accept([pair[0].effect.name], pair, [])
        return begun

    def look_beside(self, other: Trial) -> float:
        """Share of another model's held-out excess that is left with what helps beside the root; all where that costs more."""
        tried = self._first_looks(self._screened(self.current), least_drop(self.current))
        chosen = self._best(tried)
        self.found = tried, chosen
        if chosen is None:
            return np.inf
        standing = self.judge.judged(other)
        before, after = costs(standing, chosen[1])
        return (chosen[1].error - 1.0) / max(standing.error - 1.0, 1e-12) if after < before else np.inf

    def go_on(self) -> None:
        """Take what was found to help."""
        tried, chosen = self.found
        self._take(chosen, tried)
