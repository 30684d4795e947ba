"""The rules of a round: what is refitted, and what is spared."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from trials import ALONE, FIRST, Counting, score, stub

from pneuid.criticism.decision import rounds
from pneuid.criticism.prediction.noise_floor import NoiseFloor
from pneuid.criticism.refitting.trial import Judge, Trial
from pneuid.criticism.screening.scores import Score
from pneuid.effect import Parameter
from pneuid.effects import LAW_STEPS
from pneuid.estimation.shooting import Scaling


def _round(scores, errors, current=FIRST, first=FIRST):
    refitter = Counting()
    errors = iter(errors)
    judge = SimpleNamespace(
        spread=0.02,
        small=0.15,
        trial=lambda _fit, name: stub(next(errors), 27_000.0, name),
        fits=lambda _: 1.0,
        usually_fits=lambda _: 1.0,
    )
    tried = rounds.refitted(current, first, scores, judge, refitter, lambda _: None)
    return refitter, [item.effect.name for item, _ in tried]


LEADING = {"heat_transfer": 9000.0, "channel_skew": 4000.0, "valve_hysteresis": 3000.0, "gravity": 2000.0}
SCORES = [score(name, drop) for name, drop in LEADING.items()]


def test_three_leading_effects_are_refitted_and_the_third_is_spared_where_all_is_explained():
    found = _round(SCORES, [100.0] * 4)[0]
    assert found.made == ["heat_transfer", "heat_transfer", "channel_skew", "valve_hysteresis"], (
        "the leader from two starts"
    )
    refitter, tried = _round(SCORES, [1.1, 100.0])
    assert refitter.made == tried == ["heat_transfer", "channel_skew"]


def test_a_group_mate_and_a_close_runner_up_are_not_spared():
    mates = [score("heat_transfer", 9000.0, ("gravity",)), *SCORES[1:]]
    assert _round(mates, [1.1, 100.0, 100.0])[0].made == ["heat_transfer", "channel_skew", "gravity"]
    close = [SCORES[0], score("channel_skew", 8000.0), score("valve_hysteresis", 7000.0)]
    assert len(_round(close, [1.1, 100.0, 100.0])[0].made) == 3


def test_on_a_bench_the_leader_and_its_group_start_cold_and_from_break_away_read_anew_in_the_first_round_alone():
    mates = [score("heat_transfer", 9000.0, ("valve_hysteresis",)), *SCORES[1:]]
    refitter, _ = _round(mates, [100.0] * 5)
    assert [(one.effect.name, one.thorough, one.anew, one.cold) for one in refitter.asked] == [
        ("heat_transfer", True, False, False), ("heat_transfer", False, True, False), ("channel_skew", False, False, False),
        ("valve_hysteresis", True, False, False), ("valve_hysteresis", False, True, False),
    ]  # fmt: skip
    refitter, _ = _round(mates, [20.0] * 3, current=ALONE)
    assert [(one.thorough, one.anew) for one in refitter.asked] == [(False, False)] * 3


def test_on_a_servo_rig_the_leader_and_its_group_start_again_until_one_explains_all(monkeypatch):
    current = stub(145.0, 43_000.0)
    current.fit.plant.servo = True
    mates = [score("heat_transfer", 9000.0, ("valve_hysteresis",)), *SCORES[1:]]
    refitter, _ = _round(mates, [100.0] * 6, current=current)
    assert [(one.effect.name, one.anew, one.cold) for one in refitter.asked] == [
        ("heat_transfer", False, False), ("heat_transfer", True, False), ("heat_transfer", False, True),
        ("channel_skew", False, False), ("valve_hysteresis", False, False), ("valve_hysteresis", True, False),
    ]  # fmt: skip
    assert len(refitter.made) == 6
    # beside one that explains all its mates start once
    found = _round(mates, [1.1, 100.0, 90.0], current=current)[0]
    assert found.made == ["heat_transfer", "channel_skew", "valve_hysteresis"]


def test_a_law_of_friction_has_no_break_away_that_could_be_kept():
    law = Score(LAW_STEPS["law:stribeck"], 500.0, 0.1, 1, {}, ())
    assert [one.anew for one in rounds._ways(law, True, True, True)] == [False]


def test_nothing_promises_as_much_as_what_screening_does_not_see():
    tried = [(score(name, drop), stub(90.0, 27_000.0, name)) for name, drop in (("gravity", 70.0), ("load_mass", 66.0))]
    assert rounds.promised_alike(score("friction_lag", 0.1), tried) == []
    assert [one.effect.name for one, _ in rounds.promised_alike(score("backlash", 72.0), tried)] == ["gravity"]


def test_beside_others_what_starts_from_several_sizes_gets_the_same_care_at_half_the_promise():
    drops = {"dead_volume": 900.0, "mounting_compliance": 640.0, "valve_offset": 640.0, "friction_lag": 440.0, "gravity": 870.0}
    tried = [(score(name, drop), stub(90.0, 27_000.0, name)) for name, drop in drops.items()]

    def alike(current, drop=900.0):
        chosen = replace(tried[0][0], drop=drop)
        given = [(chosen, tried[0][1]), *tried[1:]]
        return [one.effect.name for one, _ in rounds.worth_the_same_care(given[0], given, current)]

    beside = stub(30.8, 27_600.0, "gravity")
    beside.fit.plant = SimpleNamespace(servo=True, effects=(), rig=SimpleNamespace(mass=1.0, A1=8e-4), law=None)
    assert alike(beside) == ["mounting_compliance", "gravity"]
    assert alike(ALONE) == ["gravity"], "a bench has one start for each"
    assert alike(FIRST) == ["gravity"]
    assert alike(beside, drop=1.0) == [], "screening expects nothing of what another look found"


@pytest.mark.parametrize(
    ("leaves", "left", "again"),
    [(6.0, 10.2, True), (6.0, 11.1, False), (3.9, 5.0, False)],  # below two floors nothing is worth that much time
)
def test_what_ends_near_a_leader_that_leaves_two_floors_gets_the_same_care_where_it_starts_from_several_sizes(
    leaves, left, again
):
    servo = SimpleNamespace(servo=True, effects=(), rig=SimpleNamespace(mass=1.0, A1=8e-4), law=None)
    base = stub(180.0, 40_000.0)
    base.fit.plant = servo
    leader = score("valve_critical_ratio", 1000.0), stub(leaves, 28_000.0, "valve_critical_ratio")
    promised = (("supply_droop", 940.0), ("dead_volume", 940.0))
    others = [(score(name, drop), stub(left, 28_100.0, name)) for name, drop in promised]
    given = [leader, *others, (score("heat_transfer", 490.0), stub(left, 28_100.0, "heat_transfer"))]
    found = [one.effect.name for one, _ in rounds.worth_the_same_care(leader, given, base)]
    assert found == (["supply_droop"] if again else [])


NEAR = stub(3.9, 27_600.0, "valve_null_leakage")
"""What leaves less than two floors."""


def test_a_later_effect_must_promise_a_part_of_what_came_before():
    # 5 % of the 15 400 that the first effect brought is 770
    assert _round([score("gravity", 700.0)], [], current=NEAR)[0].made == []
    assert _round([score("gravity", 900.0)], [3.0], current=NEAR)[0].made == ["gravity"]


def test_where_much_is_left_it_need_only_promise_a_hundredth_of_the_cost():
    # 276 of 27 600
    assert _round([score("gravity", 270.0)], [], current=ALONE)[0].made == []
    assert _round([score("gravity", 282.0)], [20.0], current=ALONE)[0].made == ["gravity"]


def test_beside_a_later_leader_what_promises_half_as_much_is_looked_at_too():
    pair = [score("dead_volume", 900.0), score("mounting_compliance", 500.0)]
    assert _round(pair, [40.0, 30.0], current=NEAR)[0].made == ["dead_volume", "mounting_compliance"]
    assert _round([pair[0], score("mounting_compliance", 440.0)], [40.0], current=NEAR)[0].made == ["dead_volume"]
    assert _round([replace(one, drop=0.8 * one.drop) for one in pair], [], current=NEAR)[0].made == []
    assert _round([replace(pair[0], drop=20.0), replace(pair[1], drop=14.0)], [40.0, 30.0, 20.0])[1] == ["dead_volume"], (
        "what chance promises is not looked at in the first round"
    )


def test_a_strong_first_effect_does_not_hide_a_second_one():
    # 5 % of the 402 400 that the first effect brought would be 20 120; 5 % of what is left is 1 380
    strong = stub(145.0, 430_000.0)
    assert _round([score("gravity", 2000.0)], [1.1], current=NEAR, first=strong)[0].made == ["gravity"]
    assert _round([score("gravity", 1000.0)], [], current=NEAR, first=strong)[0].made == []


@pytest.mark.parametrize(("left", "made"), [(4.1, ["gravity"]), (3.9, [])])
def test_where_two_floors_are_left_a_later_effect_need_not_promise_a_hundredth_of_the_cost(left, made):
    # 276 of 27 600; 5 % of the 2 000 that the first effect brought is 100
    beside = stub(left, 27_600.0, "friction_pressure")
    assert _round([score("gravity", 110.0)], [3.0], current=beside, first=stub(24.0, 29_600.0))[0].made == made
    assert _round([score("gravity", 90.0)], [], current=beside, first=stub(24.0, 29_600.0))[0].made == []


def test_what_stands_out_is_refitted_whatever_came_before_and_from_every_start():
    memory = score("friction_presliding_memory", 90.0, ahead=6.0)
    assert _round([memory], [40.0] * 3, current=ALONE)[0].made == [memory.effect.name] * 2, "a bench starts cold in any case"
    for less in (replace(memory, ahead=4.0), replace(memory, drop=14.0)):
        assert _round([less], [], current=NEAR)[0].made == []
    assert _round([memory, score("gravity", 14.0)], [40.0] * 3, current=ALONE)[0].made == [memory.effect.name] * 2


@pytest.mark.parametrize(
    ("name", "drop", "errors", "made"),
    [
        ("friction_warmup", 3000.0, [40.0, 12.0], 2),  # it made things worse with the break-away that excused it
        ("friction_warmup", 3000.0, [12.0, 9.0], 2),  # it helped, and left more than a quarter
        ("friction_warmup", 3000.0, [8.0], 1),
        ("friction_warmup", 1450.0, [40.0], 1),  # it promises less than a twentieth
        ("valve_offset", 3000.0, [40.0], 1),  # friction has not excused a valve
    ],
)
def test_a_later_friction_effect_that_leaves_much_has_break_away_read_anew(name, drop, errors, made):
    refitter, _ = _round([score(name, drop)], errors, current=ALONE)
    assert refitter.made == [name] * made
    assert refitter.asked[-1].anew is (made == 2)


def _making(*errors):
    """Makes trials with these held-out errors, one after the other, and keeps what was asked."""
    ends, asked = iter([stub(error, 27_000.0) for error in errors]), []

    def each(_, given):
        for one in given:
            asked.append(one)
            yield one, lambda: next(ends)

    return SimpleNamespace(each=each, asked=asked)


@pytest.mark.parametrize(("first", "second", "foreseen"), [(40.0, 12.0, 12.0), (40.0, 55.0, 55.0)])
def test_of_both_readings_of_break_away_the_one_that_predicts_the_training_runs_is_kept(first, second, foreseen):
    judge = SimpleNamespace(
        spread=0.02, small=0.15, trial=lambda made, _: made, fits=lambda trial: abs(trial.error - foreseen),
        usually_fits=lambda trial: abs(trial.error - foreseen),
    )  # fmt: skip
    promises = [score("friction_warmup", 3000.0)]
    (_, trial), *_ = rounds.refitted(ALONE, FIRST, promises, judge, _making(first, second), lambda _: None)
    assert trial.error == foreseen


@pytest.mark.parametrize("servo", [False, True])
def test_a_later_friction_effect_starts_from_the_data_alone_too_where_a_bench_has_not_done_so_already(servo):
    current, refitter = stub(30.8, 27_600.0), _making(12.0, 9.0)
    current.fit.plant.servo = servo
    judge = SimpleNamespace(small=0.15, trial=lambda made, _: made, fits=lambda t: t.error, usually_fits=lambda t: t.error)
    found = rounds._with_break_away(
        stub(20.0, 27_000.0), current, score("friction_warmup", 3000.0), judge, refitter, lambda _: None
    )
    assert [(one.anew, one.cold) for one in refitter.asked] == [(True, False), (False, True)][: 1 + servo]
    assert found.error == (9.0 if servo else 12.0)


def test_a_weak_amplitude_in_a_wide_range_is_not_on_its_bound():
    wide = Parameter("k", "k", "N/m", 0.0, 1e5, 0.0, 10.0, "x", off=0.0)
    scaling = Scaling([wide])
    assert list(scaling.on_bound(scaling.to_q(np.array([5.7])))) == [False]
    assert list(scaling.on_bound(scaling.to_q(np.array([1e-4])))) == [True]
    assert list(scaling.on_bound(scaling.to_q(np.array([1e5])))) == [True]


def test_the_floor_is_that_of_the_best_model_and_never_rises(monkeypatch):
    floors = ({"x": 2.0}, {"x": 3.0})
    made = [NoiseFloor(dict(one), {"x": 0.1}) for one in floors]
    monkeypatch.setattr("pneuid.criticism.refitting.trial.noise_floors", lambda *_: made)
    monkeypatch.setattr("pneuid.criticism.refitting.trial.Frozen.of", lambda fit: fit)
    judge = Judge((), *(NoiseFloor({"x": value}, {"x": 0.1}) for value in (4.0, 1.0)))
    better = judge.again(stub(30.0, 1.0), FIRST)
    assert (better.floor.value, better.usual.value) == ({"x": 2.0}, {"x": 1.0})
    assert judge.again(stub(144.0, 1.0), FIRST) is judge
    assert np.isclose(better.spread, 0.2)


def test_errors_on_the_training_runs_are_in_the_floors_of_their_kind():
    judge = Judge((), *(NoiseFloor({"x": value}, {"x": 0.1}) for value in (4.0, 1.0)))
    trial = Trial(stub(1.0, 1.0).fit, 1.0, 1.0, {"x": 8.0}, {}, {}, {"x": 3.0})
    assert (judge.fits(trial), judge.usually_fits(trial)) == (4.0, 9.0)
