"""The rules of a round: what is refitted, what is spared, what is accepted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from trials import FIRST, JUDGE, score, stub

from pneuid.criticism import rounds
from pneuid.criticism.jumps import Jump
from pneuid.criticism.noise_floor import NoiseFloor
from pneuid.criticism.refits import Asked
from pneuid.criticism.screening import Score
from pneuid.criticism.trial import Judge, Trial
from pneuid.effect import Parameter
from pneuid.effects import CATALOGUE
from pneuid.estimation.shooting import Scaling

INSIDE = rounds.inside_bounds


@pytest.fixture(autouse=True)
def _amplitudes_are_inside(monkeypatch):
    monkeypatch.setattr(rounds, "inside_bounds", lambda *_: True)


ALONE = stub(30.8, 27_600.0, "valve_null_leakage")
"""A null leak in another form than the catalogue's: what is left attracts a dead zone."""


@pytest.mark.parametrize(
    ("current", "error", "cost", "taken"),
    [
        (FIRST, 30.8, 27_600.0, True),  # removes most
        (FIRST, 144.97, 27_600.0, False),  # no more than noise gives
        (FIRST, 135.0, 42_000.0, False),  # less than a tenth
        (FIRST, 30.8, 42_990.0, False),  # the training runs know nothing of it
        (ALONE, 12.0, 27_000.0, False),  # 63 % of what is left, but 4 % of what the first brought
        (ALONE, 12.0, 26_000.0, True),
        (ALONE, 24.0, 26_000.0, True),  # a fifth of what is left, and a twentieth of the cost
        (ALONE, 24.0, 26_700.0, False),
        (ALONE, 26.0, 26_000.0, False),
    ],
)
def test_what_is_accepted(current, error, cost, taken):
    tried = [(score("valve_dead_zone", 500.0), stub(error, cost, "valve_dead_zone"))]
    found = rounds.accepted(tried, current, FIRST, JUDGE)
    assert (found is not None) == taken


@pytest.mark.parametrize(
    ("error", "fits", "cost", "taken"),
    [
        (1.3, 50.0, 26_300.0, True),  # 20.8 to 7 floors on the training runs, 95 % of the excess; the cost rose
        (1.3, 150.0, 26_300.0, False),  # the training runs are predicted hardly better
        (3.0, 50.0, 26_300.0, False),  # two thirds of the excess
        (3.0, 50.0, 26_000.0, True),  # which is enough where the cost falls
        (1.3, 150.0, 26_000.0, True),
    ],
)
def test_where_break_away_is_at_stake_predictions_of_both_kinds_of_runs_take_the_place_of_the_cost(
    error, fits, cost, taken, monkeypatch
):
    """A rest's effect at its right size: the relaxed cost was higher than without it, whose zigzag had stopped elsewhere."""
    current = stub(7.2, 26_150.0)
    tried = [(score("friction_dwell", 10.0), stub(error, cost, "friction_dwell"))]
    monkeypatch.setattr(JUDGE, "fits", lambda trial: fits if trial.added else 432.0)
    assert (rounds.accepted(tried, current, current, JUDGE) is not None) == taken
    far_off = stub(270.0, 26_150.0)
    left = [(score("friction_dwell", 10.0), stub(45.0, 26_300.0, "friction_dwell"))]
    assert rounds.accepted(left, far_off, far_off, JUDGE) is None, "seven floors left of sixteen: something else is wrong"


@pytest.mark.parametrize(
    ("error", "cost", "taken"), [(6.0, 26_000.0, True), (12.0, 26_000.0, False), (6.0, 26_500.0, False)]
)
def test_beside_a_strong_first_effect_a_second_one_must_explain_nearly_all_that_is_left(error, cost, taken):
    """The first brought 402 400, more than any second one can: here 83 or 63 % of what is left, 6 or 4 % of its cost."""
    tried = [(score("valve_dead_zone", 500.0), stub(error, cost, "valve_dead_zone"))]
    found = rounds.accepted(tried, ALONE, stub(14_500.0, 430_000.0), JUDGE)
    assert (found is not None) == taken


def test_costs_are_compared_with_loose_defects_where_one_has_no_others():
    """A base model too wrong for tight ones: what a later effect brings with tight ones says nothing beside it."""

    def mixed(error: float, loose: float, tight: float) -> Trial:
        found = stub(error, tight, "leakage_internal")
        found.fit.loose_cost = loose
        return found

    first = stub(15_000.0, 67_100.0, relaxation=1.0)
    current, offset = mixed(63.0, 26_300.0, 35_700.0), mixed(40.0, 25_600.0, 30_300.0)
    assert rounds.costs(first, current, offset) == [67_100.0, 26_300.0, 25_600.0]
    assert rounds.costs(current, offset) == [35_700.0, 30_300.0]
    assert rounds.accepted([(score("valve_offset", 5e3), offset)], current, first, JUDGE) is None
    # what takes nearly all that is left, and shows with tight defects, stands although loose ones absorb it
    gravity = mixed(6.0, 26_100.0, 27_000.0)
    assert rounds.accepted([(score("gravity", 5e3), gravity)], current, first, JUDGE) is not None
    unseen = mixed(6.0, 26_100.0, 35_000.0)
    assert rounds.accepted([(score("gravity", 5e3), unseen)], current, first, JUDGE) is None


@pytest.mark.parametrize(("unseen", "taken"), [(4.0, True), (13.0, False)])
def test_a_gain_read_off_the_judged_runs_themselves_does_not_count(unseen, taken):
    """A warmth that starts anew in each run is a free level of friction: without it 4 or 13 of 20 squared floors are left."""
    current, warm = stub(20.0, 30_000.0), stub(2.0, 25_000.0, "friction_warmup")
    judge = SimpleNamespace(**{**vars(JUDGE), "unseen": lambda _: unseen})
    found = rounds.accepted([(score("friction_warmup", 5e3), warm)], current, current, judge)
    assert (found is not None) is taken



def test_the_best_on_held_out_runs_is_accepted_not_the_best_on_training_runs():
    tried = [(score("gravity", 900.0), stub(20.0, 26_000.0)), (score("load_mass", 800.0), stub(10.0, 27_000.0))]
    found = rounds.accepted(tried, FIRST, FIRST, JUDGE)
    assert found is not None and found[0].effect.name == "load_mass"


class Counting:
    """Makes nothing and counts what it was asked to make."""

    def __init__(self) -> None:
        self.asked: list[Asked] = []
        self.made: list[str] = []

    def each(self, _base, asked):
        self.asked = list(asked)
        for one in asked:
            yield one, lambda one=one: self.made.append(one.effect.name)


def _round(scores, errors, current=FIRST, first=FIRST):
    refitter = Counting()
    errors = iter(errors)
    judge = SimpleNamespace(
        spread=0.02, small=0.15, trial=lambda _fit, name: stub(next(errors), 27_000.0, name)
    )
    tried = rounds.refitted(current, first, scores, judge, refitter, lambda _: None)
    return refitter, [item.effect.name for item, _ in tried]


LEADING = {"heat_transfer": 9000.0, "channel_skew": 4000.0, "valve_hysteresis": 3000.0, "gravity": 2000.0}
SCORES = [score(name, drop) for name, drop in LEADING.items()]


def test_three_leading_effects_are_refitted_and_the_third_is_spared_where_all_is_explained():
    assert _round(SCORES, [100.0, 100.0, 100.0])[0].made == ["heat_transfer", "channel_skew", "valve_hysteresis"]
    refitter, tried = _round(SCORES, [1.1, 100.0])
    assert refitter.made == tried == ["heat_transfer", "channel_skew"]


def test_a_group_mate_and_a_close_runner_up_are_not_spared():
    mates = [score("heat_transfer", 9000.0, ("gravity",)), *SCORES[1:]]
    assert _round(mates, [1.1, 100.0, 100.0])[0].made == ["heat_transfer", "channel_skew", "gravity"]
    close = [SCORES[0], score("channel_skew", 8000.0), score("valve_hysteresis", 7000.0)]
    assert len(_round(close, [1.1, 100.0, 100.0])[0].made) == 3


def test_only_the_leader_and_its_group_start_twice_and_only_in_the_first_round():
    mates = [score("heat_transfer", 9000.0, ("valve_hysteresis",)), *SCORES[1:]]
    refitter, _ = _round(mates, [100.0] * 3)
    assert [one.thorough for one in refitter.asked] == [True, False, True]
    refitter, _ = _round(mates, [20.0] * 3, current=ALONE)
    assert [one.thorough for one in refitter.asked] == [False, False, False]


def test_a_later_effect_must_promise_a_part_of_what_came_before():
    # 5 % of the 15 400 that the first effect brought is 770
    assert _round([score("gravity", 700.0)], [], current=ALONE)[0].made == []
    assert _round([score("gravity", 900.0)], [20.0], current=ALONE)[0].made == ["gravity"]


@pytest.mark.parametrize(
    ("start", "declared", "on_bound", "inside"),
    [
        ({"k1": 1e-4, "k2": 1e-4}, ("Fc", "k1", "k2"), (False, True, False), True),
        ({"k1": 1e-4, "k2": 1e-4}, ("Fc", "k1", "k2"), (False, True, True), False),
        # a friction law's start is no parameter of the model that it makes
        ({"dFs_stribeck": 8.0}, ("Fc", "Fs", "vs"), (False, False, True), True),
    ],
)
def test_an_amplitude_that_stays_at_its_bound_is_no_effect_and_a_law_has_none(start, declared, on_bound, inside):
    problem = SimpleNamespace(
        declared=[SimpleNamespace(name=name) for name in declared], nq=len(declared),
        scaling=SimpleNamespace(on_bound=lambda _: np.array(on_bound)),
    )  # fmt: skip
    fit = SimpleNamespace(problem=problem, relaxed=SimpleNamespace(X=np.zeros(9)))
    assert INSIDE(SimpleNamespace(start=start), SimpleNamespace(fit=fit)) is inside


def test_a_strong_first_effect_does_not_hide_a_second_one():
    # 5 % of the 402 400 that the first effect brought would be 20 120; 5 % of what is left is 1 380
    strong = stub(145.0, 430_000.0)
    assert _round([score("gravity", 2000.0)], [20.0], current=ALONE, first=strong)[0].made == ["gravity"]
    assert _round([score("gravity", 1000.0)], [], current=ALONE, first=strong)[0].made == []


@pytest.mark.parametrize(
    ("name", "drop", "errors", "made"),
    [
        ("friction_warmup", 3000.0, [40.0, 12.0], 2),  # it made things worse with the break-away that excused it
        ("friction_warmup", 3000.0, [12.0], 1),
        ("friction_warmup", 1450.0, [40.0], 1),  # it promises less than a twentieth
        ("valve_offset", 3000.0, [40.0], 1),  # friction has not excused a valve
    ],
)
def test_a_later_friction_effect_that_does_not_help_has_break_away_read_anew(name, drop, errors, made):
    refitter, _ = _round([score(name, drop)], errors, current=ALONE)
    assert refitter.made == [name] * made
    assert refitter.asked[-1].anew is (made == 2)


def test_of_both_readings_of_break_away_the_better_one_is_kept():
    judge = SimpleNamespace(spread=0.02, small=0.15, trial=lambda made, _: made)
    for first, second in ((40.0, 12.0), (40.0, 55.0)):
        ends = iter([stub(first, 27_000.0), stub(second, 27_000.0)])
        refitter = SimpleNamespace(each=lambda _, asked, ends=ends: ((one, lambda: next(ends)) for one in asked))
        (_, trial), *_ = rounds.refitted(ALONE, FIRST, [score("friction_warmup", 3000.0)], judge, refitter, lambda _: None)
        assert trial.error == min(first, second)


def _looks(monkeypatch, errors, scores, tried=(), defects=(), afresh=None, jumps=None, large=()):
    """A second look with scripted held-out errors, and costs of the training runs where not 27 000; what it made, and found.

    ``jumps`` are drops that steps of a typical size promise, none where it has none.
    """
    promised = {one.effect.name: Jump((jumps or {}).get(one.effect.name, 0.0), {}) for one in scores}
    monkeypatch.setattr(rounds, "jumped", lambda *_: promised)
    monkeypatch.setattr(rounds, "equation_defects", lambda _: defects)
    monkeypatch.setattr(rounds, "typical_start", lambda *_: {})
    monkeypatch.setattr(rounds, "_set_out_small", lambda _, one: one.start.get("small", False))
    monkeypatch.setattr(rounds, "large_starts", lambda *_: large)
    judge = SimpleNamespace(
        spread=0.02, small=0.15, trial=lambda fit, name: fit if isinstance(fit, Trial) else stub(*errors[name], name),
        fits=lambda trial: trial.fit.relaxed_cost,
    )  # fmt: skip
    refitter = Counting()
    refitter.order = list(CATALOGUE)  # type: ignore[attr-defined]
    refitter.afresh = lambda _: afresh  # type: ignore[attr-defined]
    refitter.by_sliding = lambda _: []  # type: ignore[attr-defined]
    return refitter, rounds.second_looks(FIRST, scores, list(tried), judge, refitter, lambda _: None)


@pytest.mark.parametrize(
    ("left", "promised", "made"), [(15.0, 15_000.0, ["exhaust_restriction"]), (15.0, 13_000.0, []), (1.05, 15_000.0, [])]
)
def test_what_promises_most_at_a_typical_step_is_refitted_from_there(left, promised, made, monkeypatch):
    """Where the leading effect leaves something: it promises 9000, the silencer 39 at zero."""
    start = {"r_exhaust": 1.5}
    scores = [score("heat_transfer", 9000.0), score("gravity", 2000.0), score("exhaust_restriction", 39.0)]
    steps = {"exhaust_restriction": Jump(promised, start), "gravity": Jump(2000.0, {})}
    monkeypatch.setattr(rounds, "jumped", lambda *_: steps)
    monkeypatch.setattr(rounds, "typical_start", lambda *_: {})
    judge = SimpleNamespace(spread=0.02, small=0.15, trial=lambda _fit, name: stub(1.2, 20_000.0, name))
    refitter, tried = Counting(), [(scores[0], stub(left, 30_000.0, "heat_transfer"))]
    refitter.order = list(CATALOGUE)  # type: ignore[attr-defined]
    found = rounds.overtaking(FIRST, scores, tried, judge, refitter, lambda _: None)
    assert refitter.made == made and [one.effect.name for one, _ in found] == ["heat_transfer", *made]
    assert not made or (refitter.asked[0].start == start and refitter.asked[0].way == 1.0)


def _small(name: str, drop: float) -> Score:
    return replace(score(name, drop), start={"small": True})


def test_a_second_look_takes_what_acts_on_the_loudest_balance_and_was_not_there_yet(monkeypatch):
    loud = [
        SimpleNamespace(equation=name, rms=rms, expected_rms=1.0) for name, rms in (("force", 5.0), ("pressure_1", 2.0))
    ]
    others = [score(name, 4.0) for name in ("heat_transfer", "valve_hysteresis")]
    scores = [score("load_mass", 30.0), _small("backlash", 5.0), *others, score("friction_lag", 2.0)]
    tried = [(scores[0], stub(144.0, 43_000.0, "load_mass")), (scores[1], stub(40.0, 27_000.0, "backlash"))]
    errors = {"backlash": (50.0, 27_000.0), "friction_lag": (50.0, 27_000.0)}
    refitter, found = _looks(monkeypatch, errors, scores, tried, loud)
    assert refitter.made == ["backlash", "friction_lag"]
    better = {item.effect.name: trial.error for item, trial in found}
    assert better == {"load_mass": 144.0, "backlash": 40.0, "friction_lag": 50.0}, "the better trial of an effect is kept"


@pytest.mark.parametrize(("promised", "made"), [(350.0, ["end_cushion"]), (100.0, [])])
def test_a_second_look_takes_what_promises_much_on_another_balance_behind_three_that_do_not_help(promised, made, monkeypatch):
    """A cushion promised 46 % of what the leader did, on a pressure where force was the loudest, and was never refitted."""
    scores = [score("friction_position", 767.0), score("load_mass", 649.0), score("end_cushion", promised)]
    tried = [(one, stub(140.0, 42_000.0, one.effect.name)) for one in scores[:2]]
    errors = {"end_cushion": (11.0, 27_000.0)}
    refitter, _ = _looks(monkeypatch, errors, scores, tried, [SimpleNamespace(equation="force", rms=5.0, expected_rms=1.0)])
    assert refitter.made == made


@pytest.mark.parametrize(("error", "looked_at"), [(150.0, ["friction_warmup"]), (100.0, [])])
def test_what_promised_much_and_did_not_help_gets_a_second_look(error, looked_at, monkeypatch):
    one = score("friction_warmup", 2600.0)
    tried = [(one, stub(error, 42_000.0, "friction_warmup"))]
    refitter, found = _looks(monkeypatch, {"friction_warmup": (5.0, 27_000.0)}, [one], tried)
    assert refitter.made == looked_at
    assert found[0][1].error == (5.0 if looked_at else error)


@pytest.mark.parametrize(("large", "error", "made"), [(1, 150.0, 1), (0, 150.0, 0), (1, 100.0, 0)])
def test_what_did_not_help_from_a_small_start_is_looked_at_again_from_a_large_one(large, error, made, monkeypatch):
    one = score("friction_dwell", 20.0)
    tried = [(one, stub(error, 42_000.0, "friction_dwell"))]
    starts = [{"Fs_dwell": 40.0}] * large
    refitter, _ = _looks(monkeypatch, {"friction_dwell": (5.0, 27_000.0)}, [one], tried, large=starts)
    assert refitter.made == ["friction_dwell"] * made, "the first of its two starts explains all"


def test_a_second_look_ends_with_the_effect_that_explains_all(monkeypatch):
    errors = {"gravity": (50.0, 27_000.0), "backlash": (1.05, 27_000.0), "friction_lag": (1.0, 27_000.0)}
    _, found = _looks(monkeypatch, errors, [score(name, 5.0) for name in errors])
    assert [item.effect.name for item, _ in found] == ["gravity", "backlash"]


def test_a_second_look_begins_with_what_promises_most_at_zero_or_at_a_step(monkeypatch):
    errors = dict.fromkeys(("gravity", "backlash", "friction_lag", "load_mass"), (140.0, 27_000.0))
    scores = [score(name, drop) for name, drop in zip(errors, (40.0, 3.0, 2.0, 1.0), strict=True)]
    refitter, _ = _looks(monkeypatch, errors, scores, jumps={"backlash": 75.0, "load_mass": 35.0})
    assert refitter.made == ["backlash", "gravity", "load_mass", "friction_lag"]


@pytest.mark.parametrize(("error", "cost", "read"), [(50.0, 43_500.0, True), (50.0, 42_000.0, False), (140.0, 43_500.0, False)])
def test_a_look_that_predicts_better_but_costs_more_gets_its_break_away_read_anew(monkeypatch, error, cost, read):
    again = stub(30.0, 26_000.0, "friction_dwell")
    _, found = _looks(monkeypatch, {"friction_dwell": (error, cost)}, [score("friction_dwell", 5.0)], afresh=again)
    assert found[0][1].error == (30.0 if read else error)


@pytest.mark.parametrize(
    ("ends", "taken", "made"),
    [
        ([(30.0, 26_500.0), (60.0, 26_000.0)], 1, 2),  # what fits the training runs best, whatever the held-out ones say
        ([(60.0, 26_000.0), (30.0, 26_500.0)], 0, 2),
        ([(1.05, 27_000.0), (1.0, 26_000.0)], 0, 1),  # nothing is left for another start
    ],
)
def test_of_the_starts_of_a_second_look_the_best_on_the_training_runs_is_kept(ends, taken, made):
    trials, asked = [stub(*end, "friction_dwell") for end in ends], []
    judge = SimpleNamespace(small=0.15, fits=lambda trial: trial.fit.relaxed_cost)
    coming = (asked.append(trial) or trial for trial in trials)
    assert rounds._first_that_explains(coming, FIRST, judge) is trials[taken] and len(asked) == made


def test_a_second_look_starts_at_a_typical_step_and_where_amplitudes_are_large(monkeypatch):
    large = [{"tau_L": 0.08}]
    refitter, _ = _looks(monkeypatch, {"friction_lag": (50.0, 27_000.0)}, [score("friction_lag", 5.0)], large=large)
    assert [one.start for one in refitter.asked] == [{}, *large] and all(one.anew for one in refitter.asked)


def test_an_amplitude_far_below_typical_is_a_small_start():
    plant = SimpleNamespace(rig=SimpleNamespace(mass=1.0, A1=8e-4, A2=7e-4, patm=1e5), law=None)
    current = SimpleNamespace(fit=SimpleNamespace(plant=plant))
    for b_play, small in ((1e-5, True), (-2e-4, False), (2e-4, False)):
        found = rounds._set_out_small(current, Score(CATALOGUE["backlash"], 5.0, 1e-4, 1, {"b_play": b_play}, ()))
        assert found is small, b_play


@pytest.mark.parametrize(
    ("error", "per_sample", "far"), [(20.0, 1.5, True), (20.0, 1.1, False), (8.9, 1.5, False), (None, 1.5, True)]
)
def test_what_explains_most_and_leaves_predictions_far_off_may_stand_in_for_something_like_it(error, per_sample, far):
    """A tube's resistance leaves 7.8 of the 20 floors of a silencer, which leaves 1.1."""
    trial = stub(error or 1.0, 27_000.0, "line_delay")
    trial.fit.exact, trial.fit.cost_per_sample = "an exact fit", per_sample
    assert rounds.leaves_far(None if error is None else (SCORES[0], trial), FIRST) is far


def test_next_to_nothing_of_a_huge_error_is_not_far():
    huge = stub(1e4, 43_000.0)
    assert not rounds.leaves_far((SCORES[0], stub(400.0, 27_000.0)), huge)
    assert rounds.leaves_far((SCORES[0], stub(600.0, 27_000.0)), huge)


@pytest.mark.parametrize(("left", "much"), [(0.3, True), (0.2, False)])
def test_a_leading_effect_that_leaves_a_quarter_of_the_excess_leaves_much(left, much):
    excess = FIRST.error - 1.0
    assert rounds.leaves_much((SCORES[0], stub(1.0 + left * excess, 1.0)), FIRST) is much
    assert rounds.leaves_much(None, FIRST)


def test_a_weak_amplitude_in_a_wide_range_is_not_on_its_bound():
    wide = Parameter("k", "k", "N/m", 0.0, 1e5, 0.0, 10.0, "x", off=0.0)
    scaling = Scaling([wide])
    assert list(scaling.on_bound(scaling.to_q(np.array([5.7])))) == [False]
    assert list(scaling.on_bound(scaling.to_q(np.array([1e-4])))) == [True]
    assert list(scaling.on_bound(scaling.to_q(np.array([1e5])))) == [True]


def test_the_floor_is_that_of_the_best_model_and_never_rises(monkeypatch):
    floors = ({"x": 2.0}, {"x": 3.0})
    made = [NoiseFloor(dict(one), {"x": 0.1}) for one in floors]
    monkeypatch.setattr("pneuid.criticism.trial.noise_floors", lambda *_: made)
    monkeypatch.setattr("pneuid.criticism.trial.Frozen.of", lambda fit: fit)
    judge = Judge((), *(NoiseFloor({"x": value}, {"x": 0.1}) for value in (4.0, 1.0)))
    better = judge.again(stub(30.0, 1.0), FIRST)
    assert (better.floor.value, better.usual.value) == ({"x": 2.0}, {"x": 1.0})
    assert judge.again(stub(144.0, 1.0), FIRST) is judge
    assert np.isclose(better.spread, 0.2)
