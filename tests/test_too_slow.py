"""Recordings too slow to show break-away are no evidence of a missing force or friction."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from helpers import base_fit
from trials import JUDGE, stub

from pneuid.criticism.decision import verdict
from pneuid.criticism.decision.too_slow import too_slow
from pneuid.criticism.decision.walk import Walk
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import Fit


def sampled(every: float) -> Fit:
    """The fit of a rig that lacks nothing, as if its samples were ``every`` times as far apart."""
    found = base_fit("", 3)
    runs = []
    for run in found.runs:
        data = run.data.copy()
        data[0] *= every
        runs.append(replace(run, data=data))
    return replace(found, exact=None, runs=tuple(runs))


@pytest.mark.parametrize(("every", "slow"), [(1.0, False), (2.0, False), (10.0, True)])
def test_few_samples_per_swing_are_too_slow(every, slow):
    words = too_slow(sampled(every))
    assert (words is not None) == slow
    assert words is None or "100 Hz are" in words


def test_an_exact_fit_speaks_for_itself():
    assert too_slow(replace(sampled(10.0), exact=base_fit("", 3).relaxed)) is None


def test_a_stiffness_that_a_missing_effect_drives_up_does_not_count():
    usual = sampled(2.0)
    assert too_slow(replace(usual, values=usual.values | {"sigma0": 1e3 * usual.values["sigma0"]})) is None


@pytest.mark.parametrize("slow", [None, "140 Hz are too slow"])
def test_slow_recordings_are_not_asked_for_what_acts_on_the_piston(slow, monkeypatch):
    known, base = [], stub(25.0, 14_000.0)
    monkeypatch.setattr(verdict, "too_slow", lambda _: slow)
    monkeypatch.setattr(verdict, "judge_of", lambda *_: SimpleNamespace(**vars(JUDGE), trial=lambda _: base, held=()))
    monkeypatch.setattr(verdict, "uncovered", lambda *_: [])
    monkeypatch.setattr(verdict, "loudest", lambda _: 3.0)
    monkeypatch.setattr(verdict, "_rest", lambda _: None)
    monkeypatch.setattr(Walk, "rung", lambda *_: None)
    monkeypatch.setattr(Walk, "step", lambda own: known.append(set(own.catalogue)) or False)
    fitted, refitter = SimpleNamespace(plant=None, noise=None), SimpleNamespace(late=lambda: False)
    found = verdict.diagnose(fitted, [], CATALOGUE, refitter).diagnosis
    forces = {"gravity", "mounting_compliance", "friction_direction"}
    assert "leakage_internal" in known[0] and (known[0] & forces == (forces if slow is None else set()))
    assert found.verdict == ("unknown" if slow is None else "adequate")
    assert (slow in found.sentences) == (slow is not None)
