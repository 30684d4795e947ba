"""What is easily confused with a chosen effect starts from where that one led, and may take its place."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from trials import FIRST, JUDGE, one_round, score, stub, walking

from pneuid.criticism.decision import ascent, rivals, walk
from pneuid.criticism.decision.rivals import LOOKALIKES, lookalikes
from pneuid.criticism.screening.jumps import Jump
from pneuid.effects import CATALOGUE, LAW_STEPS

pytestmark = pytest.mark.usefixtures("amplitudes_inside")

DIRECTION = score("friction_direction", 2100.0), stub(4.9, 52_000.0, "friction_direction")
TUBE = score("line_delay", 2700.0), stub(3.2, 27_000.0, "line_delay")


class _Making:
    """Refits that all leave the same, and what was asked for."""

    order = list(CATALOGUE)

    def __init__(self) -> None:
        self.asked, self.there, self.found = [], [], []

    def led(self, _base, there, asked):
        self.asked.append((asked.effect.name, asked.start))
        self.there.append(there)
        return asked.effect.name


def _looked_at(chosen, scores, tried=(), steps=None, current=FIRST, monkeypatch=None, end=(2.0, 26_000.0), by=JUDGE) -> _Making:
    made, promised = _Making(), steps or {}
    judge = SimpleNamespace(**vars(by), trial=lambda _, added: replace(stub(*end), added=added))
    monkeypatch.setattr(rivals, "typical_start", lambda *_: {"size": 3.0})
    monkeypatch.setattr(
        rivals, "jumped", lambda _, __, sizes, ___: {name: promised.get(name, Jump(0.0, sizes[name])) for name in sizes}
    )
    found = lookalikes(chosen, scores, [chosen, *tried], current, judge, made, lambda _: None)
    made.found = [pair[0].effect.name for pair in found]
    beats = end[0] < chosen[1].error and end[1] < chosen[1].fit.relaxed_cost
    assert by is not JUDGE or made.found == ([name for name, _ in made.asked] if beats else [])
    return made


def test_what_the_catalogue_says_is_easily_confused_starts_from_where_the_chosen_effect_led(monkeypatch):
    others = [score("friction_pressure", 1500.0), score("gravity", 1050.0), score("load_spring", 1060.0)]
    made = _looked_at(DIRECTION, others, monkeypatch=monkeypatch)
    assert [name for name, _ in made.asked] == ["friction_pressure", "gravity"], "a spring does not resemble it"
    assert all(there is DIRECTION[1].fit for there in made.there)
    tried = [(others[0], stub(57.0, 61_000.0, "friction_pressure"))]
    assert [name for name, _ in _looked_at(DIRECTION, others, tried, monkeypatch=monkeypatch).asked] == ["gravity"]


def test_those_come_first_that_promise_most_at_zero_or_at_a_step_and_start_where_that_leads(monkeypatch):
    others = [score(name, drop) for name, drop in (
        ("valve_lag", 300.0), ("dead_volume", 200.0), ("channel_skew", 100.0), ("exhaust_restriction", 0.0)
    )]  # fmt: skip
    steps = {"exhaust_restriction": Jump(2500.0, {"r_exhaust": 1.5})}
    made = _looked_at(TUBE, others, steps=steps, monkeypatch=monkeypatch)
    assert [name for name, _ in made.asked] == ["exhaust_restriction", "valve_lag", "dead_volume"]
    assert made.asked[0][1] == {"r_exhaust": 1.5} and len(made.asked) == LOOKALIKES


def test_none_is_looked_at_where_noise_alone_is_left_or_the_model_holds_it_or_a_law_is_chosen(monkeypatch):
    others = [score("gravity", 1050.0)]
    clean = DIRECTION[0], stub(1.1, 52_000.0, "friction_direction")
    assert not _looked_at(clean, others, monkeypatch=monkeypatch).asked
    beside = stub(145.0, 43_000.0)
    beside.fit.plant.effects = (CATALOGUE["gravity"],)
    assert not _looked_at(DIRECTION, others, current=beside, monkeypatch=monkeypatch).asked
    law = replace(score("friction_lag", 3000.0), effect=LAW_STEPS["law:lugre"]), stub(4.9, 52_000.0, "law:lugre")
    assert not _looked_at(law, [score("friction_dwell", 900.0)], monkeypatch=monkeypatch).asked
    dwell = score("friction_dwell", 900.0), stub(4.9, 52_000.0, "friction_dwell")
    assert not _looked_at(dwell, [law[0]], monkeypatch=monkeypatch).asked, "a law takes a place"


@pytest.mark.parametrize("end", [(4.5, 51_900.0), (4.5, 52_100.0), (5.3, 51_900.0)])
def test_one_that_the_held_out_or_the_training_runs_do_not_bear_out_is_dropped(end, monkeypatch):
    """A warmth that starts anew in each run for a friction by the pressure of each run: 12.6 floors for 13.3, but dearer."""
    assert _looked_at(DIRECTION, [score("friction_pressure", 90.0)], monkeypatch=monkeypatch, end=end).asked


@pytest.mark.parametrize(("unseen", "beaten"), [(2.5, True), (4.5, False)])
def test_one_that_gains_by_a_level_read_off_each_held_out_run_is_dropped(unseen, beaten, monkeypatch):
    """A warmth that starts anew in each run passes for a friction by the pressure of each run; itself it gains nothing."""
    by = SimpleNamespace(**{**vars(JUDGE), "unseen": lambda trial: 4.9 if trial is DIRECTION[1] else unseen})
    made = _looked_at(DIRECTION, [score("friction_pressure", 90.0)], monkeypatch=monkeypatch, by=by)
    assert made.asked and made.found == (["friction_pressure"] if beaten else [])


@pytest.mark.parametrize(("left", "named", "again"), [(1.2, "gravity", True), (9.0, "friction_direction", False)])
def test_one_that_leaves_less_takes_the_place_and_bears_other_starts_itself(left, named, again, monkeypatch):
    weight = score("gravity", 1050.0), stub(left, 51_800.0, "gravity")
    first, settled, asked = stub(145.0, 63_000.0), [], []

    def beside(chosen, *_):
        asked.append(chosen[0].effect.name)
        return [weight] if len(asked) == 1 else []

    other = score("friction_pressure", 1500.0), stub(57.0, 61_000.0, "friction_pressure")
    monkeypatch.setattr(walk, "refitted", lambda *_: [DIRECTION, other])
    monkeypatch.setattr(ascent, "same_floor", lambda judge, current, base, found: (judge, current, base, found))
    monkeypatch.setattr(walk, "settled", lambda _, trial, *__: settled.append(trial.added) or trial)
    monkeypatch.setattr(walk, "led", lambda _, found, *__: found)
    monkeypatch.setattr(walk, "lookalikes", beside)
    walked = walking(current=first)
    walked.first = first
    tried, chosen = one_round(walked, [])
    assert chosen[0].effect.name == named and ("gravity" in settled) is again
    assert [pair[0].effect.name for pair in tried][::2] == ["friction_direction", "gravity"], "told among those tried"
    assert "friction_pressure" not in settled, "what promised more than the look-alike has had its turn"
