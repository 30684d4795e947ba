"""When a function of a signal ends the search of the catalogue: before second looks, by its share and by what others take."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import FIRST, JUDGE, score, stub, walking

from pneuid.criticism.decision import ascent, verdict, walk
from pneuid.criticism.decision.beyond import explains_alone
from pneuid.criticism.decision.walk import Walk
from pneuid.effects._spline import Term

LEAK = (Term("flow_1", "x", "dp"), Term("flow_2", "x", "dp"))
DETENT = (Term("force", "x"),)


def function(explained: float, gain: float, terms=DETENT, beyond: float = 0.0):
    """What a function explains of the held-out excess of 144 floors, and takes of a training cost of 43 000."""
    after = FIRST.whole - explained * (FIRST.whole - 1.0)
    joint = SimpleNamespace(terms=terms)
    return SimpleNamespace(joint=joint, explained=explained, gain=gain, after=after, beyond=beyond)


@pytest.mark.parametrize(
    ("explained", "gain", "alone"),
    [
        (0.98, 2100.0, True), (0.98, 1900.0, False),  # twice what the best effect promises, 1000
        (0.89, 2100.0, False), (0.77, 11_000.0, True), (0.77, 9000.0, False), (0.45, 11_000.0, False),
    ],
)  # fmt: skip
def test_a_function_that_explains_most_must_take_far_more_than_any_effect_promises(explained, gain, alone):
    scores = [score("line_delay", 1000.0), score("valve_lag", 400.0)]
    tried = [(scores[0], stub(100.0, 42_500.0, "line_delay"))]
    assert explains_alone(function(explained, gain), scores, tried, FIRST) is alone  # type: ignore[arg-type]


def test_it_must_take_far_more_than_a_refitted_effect_took_and_leave_far_less():
    scores = [score("line_delay", 1000.0)]
    told = function(0.95, 4000.0)
    took = [(scores[0], stub(100.0, 43_000.0 - 2100.0, "line_delay"))]
    left_little = [(scores[0], stub(1.0 + 0.09 * 144.0, 42_000.0, "line_delay"))]
    far = [(scores[0], stub(1.0 + 0.11 * 144.0, 42_000.0, "line_delay"))]
    assert not explains_alone(told, scores, took, FIRST)  # type: ignore[arg-type]
    assert not explains_alone(told, scores, left_little, FIRST)  # type: ignore[arg-type]
    assert explains_alone(told, scores, far, FIRST)  # type: ignore[arg-type]


def test_two_functions_or_one_out_of_its_range_end_nothing_and_a_leak_across_the_piston_is_one():
    scores = [score("line_delay", 1000.0)]
    two, silencer = (Term("force", "dp"), Term("flow_1", "p1")), (Term("flow_2", "u"), Term("flow_1", "u"))
    assert not explains_alone(function(0.98, 9000.0, two), scores, [], FIRST)  # type: ignore[arg-type]
    assert not explains_alone(function(0.98, 9000.0, silencer), scores, [], FIRST)  # type: ignore[arg-type]
    assert not explains_alone(function(0.98, 9000.0, beyond=0.5), scores, [], FIRST)  # type: ignore[arg-type]
    assert explains_alone(function(0.98, 9000.0, LEAK), scores, [], FIRST)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("gain", "needed", "named", "searches", "rounds"),
    [
        (9000.0, True, [], 1, 0),  # it ends the walk
        (1100.0, True, [], 1, 1),  # the second looks follow
        (9000.0, False, [], 0, 1),  # nothing needs second looks
        (9000.0, True, ["gravity"], 0, 1),  # beside others the catalogue comes first
    ],
)
def test_the_function_is_looked_for_once_before_second_looks(gain, needed, named, searches, rounds, monkeypatch):
    seen, leading = [], [score("line_delay", 1000.0)]
    tried = [(leading[0], stub(100.0, 42_500.0, "line_delay"))]

    def round_(*_):
        seen.append("round")
        return tried, None

    monkeypatch.setattr(ascent, "screen", lambda *_: leading)
    monkeypatch.setattr(walk, "open_to_second_looks", lambda *_: leading if needed else [])
    monkeypatch.setattr(walk, "search", lambda *_: seen.append("search") or function(0.95, gain))
    for name, stand_in in (
        ("_cannot_judge", lambda _: False), ("_first_looks", lambda *_: tried), ("_take_two", lambda *_: False),
        ("_best", lambda *_: None), ("_round", round_), ("_at_break_away", lambda *_: (tried, None)),
        ("_by_all_runs", lambda *_: False), ("rung", lambda _self, trial, accepted: (trial.added, accepted)),
        ("_instead", lambda *_: bool(seen.append("instead"))),
    ):  # fmt: skip
        monkeypatch.setattr(Walk, name, stand_in)
    judge = SimpleNamespace(**vars(JUDGE), held=(), floor=SimpleNamespace(value={"F": 1.0}))
    one = walking(judge)
    one.named = list(named)
    assert not one.step()
    assert (seen.count("search"), seen.count("round")) == (searches, rounds)
    assert one.beyond is (searches == 1 and rounds == 0)
    assert ("instead" in seen) is bool(named), "where nothing helps beside what is named, others are tried in its place"
    assert one.rungs == [("line_delay", False)], "what was refitted stays on the ladder"
    one.step()
    assert seen.count("search") == searches


def test_a_walk_that_a_function_ended_says_unknown_and_why(monkeypatch):
    monkeypatch.setattr(verdict, "_rest", lambda trial: trial)
    monkeypatch.setattr(verdict, "explained_away", lambda *_: True)
    one = walking()
    one.beyond = True
    said = verdict._verdict(one)
    assert (said.verdict, said.effects) == ("unknown", ()) and verdict.BEYOND in said.sentences
