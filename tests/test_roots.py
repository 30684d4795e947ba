"""Which effect a walk begins with: others that took as much of the training cost, where what it named leaves much."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import FIRST, JUDGE, score, stub, walking

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision import roots
from pneuid.criticism.decision.roots import from_another_root

ALONE = {"gravity": (25.0, 40_000.0), "sensor_offset_p2": (36.7, 39_800.0), "load_spring": (25.4, 40_100.0),
         "valve_lag": (140.0, 41_500.0)}  # fmt: skip
"""Held-out error (squared floors) and training cost of each effect alone, beside a base of 145 and 43 000."""


def rung(names: str, accepted: bool) -> Rung:
    effects = tuple(names.split())
    return Rung(effects, effects[-1] if effects else None, accepted, {}, {}, {}, 8)


def ended(
    monkeypatch, error=5.06, named=("gravity", "heat_transfer"), beside=(1.2, 30_000.0), late=False, by_all_runs=False,
    ends=None,
):  # fmt: skip
    """A walk that named a weight and heat at the walls, and what was tried beside the others it may have begun with.

    beside : held-out error and cost of what helps beside the offset, None where nothing does.
    """
    judge = SimpleNamespace(**vars(JUDGE), judged=lambda trial: trial)
    walk = walking(judge, SimpleNamespace(late=lambda: late), stub(error, 33_000.0))
    walk.named, walk.by_all_runs = list(named), by_all_runs
    walk.roots = [(score(name, 43_000.0 - cost), stub(left, cost, name)) for name, (left, cost) in ALONE.items()]
    walk.rungs = [rung("", True), rung("load_spring", False), rung("gravity", True), rung("gravity heat_transfer", True)]
    begun, climbed = [], []

    def first_looks(self, _scores, _least):
        begun.append(self.named[0])
        if beside is None or self.named[0] != "sensor_offset_p2":
            return []
        return [(score("valve_asymmetry", 9000.0), stub(*beside, "valve_asymmetry"))]

    monkeypatch.setattr(roots.Rooted, "_screened", lambda _self, _current: [])
    monkeypatch.setattr(roots.Rooted, "_first_looks", first_looks)
    monkeypatch.setattr(roots.Rooted, "_best", lambda _self, tried: tried[0] if tried else None)
    monkeypatch.setattr(roots.Rooted, "_record", lambda *_, **__: None)
    monkeypatch.setattr(
        roots.Rooted, "rung", lambda self, trial, accepted: rung(" ".join((*self.named, trial.added)), accepted)
    )
    monkeypatch.setattr("pneuid.criticism.decision.ascent.better_without", lambda *_: None)

    def climb(begun_walk):
        climbed.append(begun_walk)
        begun_walk.current = stub(ends, 30_000.0) if ends else begun_walk.current

    monkeypatch.setattr(roots, "climb", climb)
    return walk, from_another_root(walk), begun, climbed


def test_a_walk_that_begins_with_another_that_took_as_much_replaces_one_that_leaves_much(monkeypatch):
    walk, found, begun, climbed = ended(monkeypatch)
    assert begun == ["sensor_offset_p2"], "what took most comes first, and leaves next to nothing"
    assert found.named == ["sensor_offset_p2", "valve_asymmetry"] and climbed == [found]
    assert found.first is FIRST and found.current.error == 1.2
    assert [(one.added, one.accepted) for one in found.rungs] == [
        (None, True), ("load_spring", False), ("gravity", False), ("heat_transfer", False),
        ("sensor_offset_p2", True), ("valve_asymmetry", True),
    ], "what the first walk accepted is a rejected step of the ladder"  # fmt: skip
    assert "beginning with sensor_offset_p2 in place of gravity" in found.moved[-1]
    assert walk.named == ["gravity", "heat_transfer"]


def test_others_are_tried_too_unless_they_took_far_less(monkeypatch):
    _, found, begun, _ = ended(monkeypatch, beside=(1.5, 30_000.0))
    assert begun == ["sensor_offset_p2", "load_spring"] and found.named[0] == "sensor_offset_p2"


@pytest.mark.parametrize(
    "changed",
    [
        {"error": 3.9},  # less than two floors are left
        {"named": ("gravity",)}, {"by_all_runs": True}, {"late": True}, {"beside": None},
        {"beside": (3.1, 30_000.0)},  # leaves more than half of what is left
        {"beside": (1.2, 33_100.0)},  # costs more
    ],
)  # fmt: skip
def test_otherwise_the_walk_stands(changed, monkeypatch):
    walk, found, _, climbed = ended(monkeypatch, **changed)
    assert found is walk and not climbed


def test_a_walk_that_ends_no_better_is_left(monkeypatch):
    walk, found, _, climbed = ended(monkeypatch, ends=5.1)
    assert found is walk and climbed
