"""What the training runs show where the held-out runs cannot judge."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import score, stub

from pneuid.criticism import shown as module
from pneuid.criticism import walk
from pneuid.criticism.shown import shown
from pneuid.criticism.walk import Walk
from pneuid.effects import CATALOGUE

BASE = stub(1.8, 14_000.0)
"""A bench that its held-out runs find wrong by what the training runs leave open."""


def judge(learned: float = 1.1, explains: float = 2.2) -> SimpleNamespace:
    """Training errors stand in the cost here: all trials have learned unless their cost says otherwise."""
    return SimpleNamespace(
        spread=0.02, small=0.15, explains=lambda trial: trial.error < explains,
        learned=lambda trial: trial.fit.relaxed_cost < 14_000.0 * learned,
    )  # fmt: skip


@pytest.fixture(autouse=True)
def _amplitudes_are_inside(monkeypatch):
    monkeypatch.setattr(module, "inside_bounds", lambda *_: True)


def names(*ends: tuple[str, float, float], by: SimpleNamespace | None = None) -> list[str]:
    tried = [(score(name, 500.0), stub(error, cost, name)) for name, error, cost in ends]
    return [one.effect.name for one, _ in shown(tried, BASE, by or judge())]


@pytest.mark.parametrize(
    ("error", "cost", "named"),
    [
        (1.7, 13_900.0, True),
        (2.1, 13_900.0, True),  # worse ahead, but no worse than what stays open
        (1.7, 13_975.0, False),  # what noise, and a motion known to 0.3 um only, can bring
        (1.1, 13_988.0, True),  # as little, but the held-out error falls to noise
        (1.1, 13_996.0, False),
        (1.3, 13_988.0, False),
        (2.5, 13_000.0, False),  # what the training runs show predicts worse than anything left open
    ],
)
def test_what_the_training_runs_show(error, cost, named):
    assert names(("load_mass", error, cost)) == (["load_mass"] if named else [])


def test_what_does_not_leave_noise_alone_on_the_training_runs_is_not_shown():
    assert names(("load_mass", 1.7, 13_000.0), by=judge(learned=0.9)) == []


def test_the_largest_fall_is_named_and_what_cannot_be_told_from_it_beside_it():
    ends = [("friction_position", 1.2, 13_700.0), ("load_mass", 1.7, 13_200.0), ("gravity", 1.9, 13_210.0)]
    assert names(*ends) == ["load_mass", "gravity"]
    assert names(*ends[:2]) == ["load_mass"]


@pytest.mark.parametrize(("error", "drop", "asked"), [(1.05, 25.0, 0), (1.05, 40.0, 1), (1.8, 6.0, 0), (1.8, 12.0, 1)])
def test_refits_are_made_where_the_training_runs_may_show_something(error, drop, asked, monkeypatch):
    made = []
    monkeypatch.setattr(walk, "screen", lambda *_: [score("load_mass", drop)])
    monkeypatch.setattr(walk, "refitted", lambda *given: made.append(given[-1]) or [])
    monkeypatch.setattr(walk, "same_floor", lambda by, current, first, found: (by, current, first, found))
    monkeypatch.setattr(walk, "loudest", lambda _: 1.0)
    base = stub(error, 14_000.0)
    going = Walk(judge(), base, base, {"load_mass": CATALOGUE["load_mass"]}, SimpleNamespace(), lambda _: None)
    assert not going.step()
    assert len(made) == asked
