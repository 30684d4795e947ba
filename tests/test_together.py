"""Two effects at once: what only both explain is found, named and ranked as one step."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import JUDGE, score, stub, walking

from pneuid.criticism.decision import together, walk
from pneuid.criticism.decision.evidence import as_screened
from pneuid.criticism.decision.walk import Walk
from pneuid.effects import CATALOGUE

pytestmark = pytest.mark.usefixtures("amplitudes_inside")


class Making:
    """Makes the trials it was given, by the names of the effects in them."""

    def __init__(self, **ends) -> None:
        self.ends, self.order, self.asked = ends, list(CATALOGUE), []

    def each(self, base, asked):
        for one in asked:
            names = f"{base.name}, {one.effect.name}"
            self.asked.append(names)
            yield one, lambda names=names: self.ends[names.replace(", ", "_and_")]


def named_stub(error: float, cost: float, name: str):
    found = stub(error, cost, name)
    found.fit.name = name
    found.fit.problem.values, found.fit.relaxed_values = {}, {}
    return found


ALONE = [
    (score("sensor_offset_p1", 9e4), named_stub(8000.0, 11_000.0, "sensor_offset_p1")),
    (score("gravity", 8e3), named_stub(9000.0, 12_000.0, "gravity")),
    (score("friction_pressure", 2e4), named_stub(5800.0, 40_000.0, "friction_pressure")),
]
"""Two that fit the training runs four times as well and predict worse, and one that does a little of both."""


def _joined(monkeypatch, ends, tried=ALONE, alone=None, most=float("inf"), **foretold):
    base = stub(7000.0, 43_000.0)
    seconds = [score("leakage_internal", 9e3), score("valve_offset", 8e3)]
    monkeypatch.setattr(together, "screen", lambda *_: seconds)
    monkeypatch.setattr(together, "same_floor", lambda judge, current, first, found: (judge, current, first, found))
    monkeypatch.setattr(together, "read_anew", lambda trial, *_: trial)
    judge = SimpleNamespace(
        **vars(JUDGE) | foretold, judged=lambda trial: trial,
        trial=lambda made, added: named_stub(*made, added),
    )
    refitter = Making(**ends)
    found = together.joined(base, base, tried, alone, judge, refitter, [], lambda _: None, most)
    return found, refitter.asked


PAIRS = {
    "sensor_offset_p1_and_leakage_internal": (450.0, 7_000.0), "sensor_offset_p1_and_valve_offset": (840.0, 7_500.0),
    "gravity_and_leakage_internal": (220.0, 7_100.0),
}  # fmt: skip


def test_what_only_two_effects_explain_is_found_and_every_first_one_is_tried_with_the_second(monkeypatch):
    found, asked = _joined(monkeypatch, PAIRS, alone=ALONE[2])
    assert found is not None and found.names == ["gravity", "leakage_internal"]
    assert found.trial.error == 220.0
    # friction_pressure fits no better by half, so it is no foothold
    assert asked == [
        "sensor_offset_p1, leakage_internal", "sensor_offset_p1, valve_offset", "gravity, leakage_internal",
    ]  # fmt: skip


@pytest.mark.parametrize(("whole", "usual", "foothold"), [(45.0, 45.0, True), (60.0, 45.0, False), (45.0, 60.0, False)])
def test_what_halves_the_errors_on_the_training_runs_is_a_foothold_though_loose_jumps_hide_the_cost(
    whole, usual, foothold, monkeypatch
):
    """A dead volume beside a friction that bends took 24 % of the cost, 55 % of these errors, and predicted worse."""

    def foretold(left):
        return lambda trial: left if trial.added == "friction_pressure" else 100.0

    ends = {f"friction_pressure_and_{name}": (450.0, 30_000.0) for name in ("leakage_internal", "valve_offset")}
    found, asked = _joined(monkeypatch, ends, ALONE[2:], ALONE[2], fits=foretold(whole), usually_fits=foretold(usual))
    assert bool(asked) == foothold
    assert not foothold or found.names == ["friction_pressure", "leakage_internal"]


@pytest.mark.parametrize(
    ("name", "servo", "looked"), [("sensor_lag_F", False, False), ("friction_dwell", True, True), ("gravity", False, True)]
)
def test_on_a_bench_a_cost_that_the_jumps_of_an_effects_own_state_buy_is_no_foothold(name, servo, looked, monkeypatch):
    """A lag of the force took 98.7 % of the cost on a friction that grows with pressure, and 6 % of the errors."""
    base = stub(7000.0, 43_000.0)
    base.fit.plant.servo = servo
    monkeypatch.setattr(together, "screen", lambda *_: [])
    said: list[str] = []
    tried = [(score(name, 4e4), named_stub(6800.0, 600.0, name))]
    assert together.together(base, tried, JUDGE, Making(), [], said.append) is None
    assert bool(said) == looked


@pytest.mark.parametrize(
    ("tried", "alone", "ends"),
    [
        (ALONE[2:], ALONE[2], PAIRS),  # nothing fits far better
        (ALONE, (ALONE[2][0], stub(300.0, 20_000.0)), PAIRS),  # one effect predicts nearly as well
        (ALONE, None, dict.fromkeys(PAIRS, (3600.0, 7000.0))),  # two predict little better than none
    ],
)
def test_two_effects_are_not_taken_for_what_one_or_none_explains(tried, alone, ends, monkeypatch):
    found, _ = _joined(monkeypatch, ends, tried, alone)
    assert found is None


@pytest.mark.parametrize(("turned", "kept"), [(2.2, 2.2), (900.0, 450.0)])
def test_the_pair_is_fitted_from_where_its_second_effect_led_alone_as_well(turned, kept, monkeypatch):
    """In place of a sensor's lag a silencer ended far off, and left 11.3 floors beside it; the other way round 1.5."""
    tried = [ALONE[0], (score("valve_offset", 9e3), named_stub(6000.0, 30_000.0, "valve_offset"))]
    ends = {
        "sensor_offset_p1_and_leakage_internal": (840.0, 7_500.0), "sensor_offset_p1_and_valve_offset": (450.0, 7_000.0),
        "valve_offset_and_sensor_offset_p1": (turned, 7_000.0),
    }  # fmt: skip
    by_error = {"fits": lambda trial: trial.error, "usually_fits": lambda trial: trial.error}
    found, asked = _joined(monkeypatch, ends, tried, **by_error)
    assert asked[-1] == "valve_offset, sensor_offset_p1"
    assert found is not None and found.trial.error == kept and found.names == ["sensor_offset_p1", "valve_offset"]


@pytest.mark.parametrize(("most", "taken"), [(0.05, True), (0.03, False)])
def test_before_second_looks_two_effects_must_leave_next_to_nothing(most, taken, monkeypatch):
    """They leave 3.1 % of the excess."""
    found, _ = _joined(monkeypatch, PAIRS, most=most)
    assert (found is not None) is taken


@pytest.mark.parametrize("late", [False, True])
def test_once_the_time_is_over_no_two_effects_are_tried_at_once(late, monkeypatch):
    asked = []
    monkeypatch.setattr(walk, "joined", lambda *_: asked.append("two"))
    at = walking(refitter=SimpleNamespace(late=lambda: late))
    assert not at._take_two(ALONE, None) and asked == ([] if late else ["two"])


@pytest.mark.parametrize("denied", [False, True])
def test_a_zero_reading_may_deny_two_effects(denied, monkeypatch):
    found, _ = _joined(monkeypatch, PAIRS)
    monkeypatch.setattr(walk, "joined", lambda *_: found)
    at, accepted = walking(), []
    at.zeros = SimpleNamespace(deny=lambda _: denied)
    monkeypatch.setattr(at, "_accept_both", lambda *_: accepted.append("both"))
    assert at._take_two(ALONE, None) is not denied and accepted == ([] if denied else ["both"])


def test_both_effects_are_named_ranked_and_one_rung(monkeypatch):
    found, _ = _joined(monkeypatch, PAIRS)
    at = walking()
    at.ranking = {name: as_screened(score(name, 1e3)) for name in CATALOGUE}
    monkeypatch.setattr(Walk, "rung", lambda _self, trial, accepted: (trial.added, accepted))
    monkeypatch.setattr(Walk, "_record", lambda own, one, *_, **__: own.ranking.update({one.effect.name: "refitted"}))
    at._accept_both(found, ALONE)
    assert at.named == ["gravity", "leakage_internal"] and at.current is found.trial
    assert at.rungs[-1] == ("gravity, leakage_internal", True) and not any(taken for _, taken in at.rungs[:-1])
    assert {name for name, item in at.ranking.items() if item == "refitted"} == {
        "gravity", "leakage_internal", "sensor_offset_p1", "friction_pressure",
    }  # fmt: skip
