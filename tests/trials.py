"""Trials made up of the few numbers that the rules of a diagnosis look at."""

from __future__ import annotations

from types import SimpleNamespace

from pneuid.criticism.decision.walk import Walk
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score
from pneuid.effects import CATALOGUE

JUDGE = SimpleNamespace(
    spread=0.02, small=0.15, explains=lambda trial: trial.error - 1.0 < 0.15, learned=lambda trial: trial.error - 1.0 < 0.15,
    fits=lambda _: 1.0, usually_fits=lambda _: 1.0, unseen=lambda trial: trial.error,
)


def stub(error: float, cost: float, added: str | None = None, relaxation: float = 0.1, weighted: int = 20_000) -> Trial:
    """A trial on a bench with the held-out error (squared floors) and cost of the training runs that matter here."""
    problem = SimpleNamespace(relaxation=relaxation, weighted=weighted)
    plant = SimpleNamespace(servo=False, effects=())
    fit = SimpleNamespace(
        relaxed_cost=cost, loose_cost=cost, problem=problem, lacking=False, exact=None, cost_per_sample=1.5, plant=plant,
    )  # fmt: skip
    return Trial(fit, error, error, {}, {}, {}, {}, added)  # type: ignore[arg-type]


def score(name: str, drop: float, group: tuple[str, ...] = (), ahead: float = 1.0) -> Score:
    return Score(CATALOGUE[name], drop, drop / 3e4, 1, {}, group, ahead=ahead)


FIRST = stub(145.0, 43_000.0)
ALONE = stub(30.8, 27_600.0, "valve_null_leakage")
"""A null leak in another form than the catalogue's: what is left attracts a dead zone."""


class Counting:
    """Makes nothing and counts what it was asked to make."""

    def __init__(self) -> None:
        self.asked: list[Asked] = []
        self.made: list[str] = []

    def late(self) -> bool:
        return False

    def each(self, _base, asked):
        self.asked = list(asked)
        for one in asked:
            yield one, lambda one=one: self.made.append(one.effect.name)


def walking(judge=JUDGE, refitter=None, current=FIRST) -> Walk:
    """A walk from ``current``, by whose refitter no fit leads to an exact one."""
    refitter = refitter or SimpleNamespace(completed=lambda fit: fit, late=lambda: False)
    return Walk(judge, current, FIRST, CATALOGUE, refitter, lambda _: None)


def one_round(walk: Walk, scores: list[Score]):
    """What a walk tries in one round, and what it would accept."""
    return walk._round(scores, walk._first_looks(scores, 15.0))
