"""What all runs together show where the held-out runs cannot judge."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from trials import score, stub

from pneuid.criticism.decision import acceptance, ascent, leftover, walk, walk_on_all
from pneuid.criticism.decision import all_runs as module
from pneuid.criticism.decision.acceptance import unresolved
from pneuid.criticism.decision.all_runs import beyond_doubt, least_shown, shown
from pneuid.criticism.decision.diagnosis import NOTHING_MISSING, Candidate, Diagnosis
from pneuid.criticism.decision.leftover import explained_away
from pneuid.criticism.decision.walk import Walk
from pneuid.diagnose import _next
from pneuid.effects import CATALOGUE

BASE = stub(1.2, 14_000.0)
"""A bench's model that lacks something, fitted to all runs."""


def judge(learned: float = 1.1) -> SimpleNamespace:
    """Training errors stand in the cost here: all trials have learned unless their cost says otherwise."""
    return SimpleNamespace(
        spread=0.02, small=0.15, explains=lambda _: True, learned=lambda trial: trial.fit.relaxed_cost < 14_000.0 * learned,
        fits=lambda _: 1.0, held=("held",),
    )  # fmt: skip


@pytest.fixture(autouse=True)
def _amplitudes_count(monkeypatch):
    monkeypatch.setattr(module, "inside_bounds", lambda *_: True)
    for user in (module, walk_on_all):
        monkeypatch.setattr(user, "unresolved", lambda *_: False)


def names(*ends: tuple[str, float], by: SimpleNamespace | None = None) -> list[str]:
    tried = [(score(name, 500.0), stub(1.0, cost, name)) for name, cost in ends]
    return [one.effect.name for one, _ in shown(tried, BASE, by or judge())]


@pytest.mark.parametrize(("cost", "named"), [(13_900.0, True), (13_935.0, False), (13_975.0, False)])
def test_what_all_runs_show(cost, named):
    """Half a percent of the cost is asked for, as what smoothing leaves grows with the number of samples."""
    assert names(("load_mass", cost)) == (["load_mass"] if named else [])


def test_of_few_samples_chance_is_asked_to_be_exceeded():
    assert least_shown(stub(1.2, 1_000.0)) == module.SHOWN_DROP


def test_what_does_not_leave_noise_alone_is_not_shown():
    assert names(("load_mass", 13_000.0), by=judge(learned=0.9)) == []


@pytest.mark.parametrize(("weighted", "named"), [(21_600, False), (21_700, True)])
def test_what_the_relaxed_fit_leaves_counts_where_a_simulation_is_far_off(weighted, named):
    """A run full of break-aways is simulated badly by a model that lacks nothing."""
    trial = stub(1.0, 13_000.0, "load_mass", weighted=weighted)
    found = shown([(score("load_mass", 500.0), trial)], BASE, judge(learned=0.9))
    assert bool(found) == named


def test_the_largest_fall_is_named_and_what_cannot_be_told_from_it_beside_it():
    ends = [("friction_position", 13_700.0), ("load_mass", 13_200.0), ("gravity", 13_210.0)]
    assert names(*ends) == ["load_mass", "gravity"]
    assert names(*ends[:2]) == ["load_mass"]


class Refits:
    """Stands for refits: the model that is asked for, fitted to the runs that are asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[object, ...]] = []

    def on(self, _: object, runs: tuple[object, ...]) -> SimpleNamespace:
        self.asked.append(runs)
        return SimpleNamespace(runs=runs, relaxed_cost=14_000.0, loose_cost=14_000.0, problem=SimpleNamespace(relaxation=0.1))


def walking(
    monkeypatch, drop: float, cost: float, learned: float = 1.1, left: tuple[float, float] = (2.1, 1.05)
) -> tuple[Walk, Refits, list[float]]:
    """A bench's walk whose screening promises ``drop`` of load_mass on all runs, with which the cost ends at ``cost``.

    ``left`` is the squared error of held-out runs, each by the fits to the other runs, without load_mass and with it.
    """
    least: list[float] = []
    promised = score("load_mass", drop)
    made = stub(1.0, cost, "load_mass")
    made.fit.runs = ("slow", "held")

    def refits(*given: object) -> list[object]:
        least.append(given[-1])  # type: ignore[arg-type]
        return [(promised, made)]

    monkeypatch.setattr(ascent, "screen", lambda *_: [promised])
    for judging in (walk, walk_on_all):
        monkeypatch.setattr(judging, "refitted", refits)
        monkeypatch.setattr(judging, "settled", lambda _, trial, *__: trial)
    monkeypatch.setattr(ascent, "same_floor", lambda by, current, first, found: (by, current, first, found))
    monkeypatch.setattr(walk, "loudest", lambda _: 1.0)
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    monkeypatch.setattr(ascent.Ascent, "rung", lambda _, trial, accepted: (trial.added, accepted, trial.fit.runs))
    base, by, refitter = stub(1.8, 14_000.0), judge(learned), Refits()
    base.fit.runs, base.fit.plant = ("slow",), SimpleNamespace(servo=False)
    by.trial = lambda fit, added=None: SimpleNamespace(fit=fit, added=added, error=1.2, whole=1.2)

    def across(fit: SimpleNamespace, others: list[SimpleNamespace], added: str | None) -> SimpleNamespace:
        error = left[added is not None]
        return SimpleNamespace(fit=fit, added=added, error=error, whole=error, others=tuple(one.runs for one in others))

    by.across = across
    by.explains = lambda trial: trial.added is None
    by.explains_across = lambda *_: False
    by.held = ("fast", "held")
    monkeypatch.setattr(walk, "explained_away", lambda *_: True)
    return Walk(by, base, base, {"load_mass": CATALOGUE["load_mass"]}, refitter, lambda _: None), refitter, least


@pytest.mark.parametrize(("drop", "learned", "asked"), [(60.0, 1.1, 0), (90.0, 1.1, 1), (60.0, 0.9, 0)])
def test_refits_are_made_where_all_runs_may_show_something(drop, learned, asked, monkeypatch):
    going, _, least = walking(monkeypatch, drop, 14_000.0, learned)
    assert not going.step()
    assert least == [70.0] * asked and going.named == []


def test_what_all_runs_show_is_named_and_judged_on_each_held_out_run_by_fits_to_the_others(monkeypatch):
    going, refitter, _ = walking(monkeypatch, 500.0, 13_500.0)
    assert not going.step(), "where the held-out runs cannot judge, nothing follows"
    assert going.named == ["load_mass"] and going.by_all_runs and not going.partly and going.lacking is None
    in_turn = [("slow", "held"), ("slow", "fast")]
    assert refitter.asked == [("slow", "fast", "held"), *in_turn, *in_turn], "all, then without the effect and with it"
    assert going.current.others == going.first.others == tuple(in_turn)
    assert going.rungs == [(None, True, ("slow", "fast", "held")), ("load_mass", True, ("slow", "held"))]
    assert (going.first.error, going.current.error) == (2.1, 1.05), "both by the same runs"
    assert any("fitted to the held-out runs as well" in sentence for sentence in going.moved)
    assert walk.IN_TURN in going.moved


@pytest.mark.parametrize(("fits", "followed"), [(1.1, False), (58.0, True)])
def test_what_cannot_follow_its_own_runs_is_followed_to_its_exact_end_before_it_predicts_the_one_left_out(
    fits, followed, monkeypatch
):
    """A film that lags ended at ten times its time in relaxed fits to all runs but one, and at the right one in exact fits."""
    going, refitter, _ = walking(monkeypatch, 500.0, 13_500.0)
    exact = SimpleNamespace(fit=SimpleNamespace(runs="exact"))
    asked = []
    monkeypatch.setattr(walk, "to_the_end", lambda trial, *_: asked.append((trial.added, trial.fit.runs)) or exact)
    going.judge.learned = lambda trial: fits < 1.15 or trial.fit.runs[-1] != "fast"
    ends = going._in_turn(stub(1.0, 13_000.0).fit, "friction_lag")
    assert asked == ([("friction_lag", ("slow", "fast"))] if followed else []), "and what is said of it names the effect"
    assert [one.runs for one in ends] == [("slow", "held"), "exact" if followed else ("slow", "fast")]
    assert refitter.asked == [("slow", "held"), ("slow", "fast")]


@pytest.mark.parametrize(
    ("left", "named"), [((2.1, 1.5), True), ((2.1, 1.7), False), ((1.1, 1.05), True), ((1.1, 1.2), False), ((2.1, 9.0), False)]
)
def test_what_predicts_the_run_left_out_hardly_better_is_not_named(left, named, monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_700.0, left=left)
    assert not going.step()
    assert (going.named == ["load_mass"]) == named == going.by_all_runs == (going.lacking is None)
    if not named:
        assert going.current.added is None and going.rungs[-1][:2] == ("load_mass", False)
        assert any("is not named all the same" in sentence for sentence in going.moved)
        assert any("something of its kind may be missing" in sentence for sentence in going.moved)


@pytest.mark.parametrize(
    ("left", "held", "named"),
    [((2.1, 2.0), ("fast", "held"), True), ((2.1, 2.2), ("fast", "held"), False), ((2.1, 2.2), ("held",), True)],
)
def test_what_leaves_only_what_the_fits_in_turn_leave_open_is_named_unless_others_predict_worse(left, held, named, monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_700.0, left=left)
    going.judge.held = held
    going.judge.explains_across = lambda _trial, others: len(others) == len(held)
    assert not going.step()
    assert (going.named == ["load_mass"]) == named


def test_what_lowers_the_cost_but_leaves_more_than_noise_makes_the_model_lacking(monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_500.0, learned=0.9)
    assert not going.step()
    assert going.named == [] and going.lacking is not None and going.lacking.fit.runs == ("slow", "fast", "held")


@pytest.mark.parametrize(
    ("again", "promise", "named", "rounds"), [(14.0, 14.0, [], 1), (14.0, 90.0, [], 2), (500.0, 500.0, ["load_mass"], 1)]
)
def test_beside_a_better_start_of_the_base_an_effect_is_measured_against_that(again, promise, named, rounds, monkeypatch):
    """The effect lowers the cost of a base at a wrong optimum by 1000, of one from another start by what it shows of itself."""
    going, _, least = walking(monkeypatch, 1_000.0, 13_000.0)
    better = stub(1.1, 13_000.0 + again)
    better.fit.runs = ("slow", "better")
    starts = iter([better])
    monkeypatch.setattr(ascent, "better_without", lambda *_: next(starts, None))
    promised = iter([1_000.0, promise])
    monkeypatch.setattr(ascent, "screen", lambda *_: [score("load_mass", next(promised))])
    assert not going.step()
    assert going.named == named and going.lacking is None
    assert any("fits better from another start" in sentence for sentence in going.moved)
    assert len(least) == rounds, "another where the better start promises something"


@pytest.mark.parametrize(
    ("base", "error", "cost", "learned", "sure"),
    [(1.4, 1.05, 13_600.0, 1.1, True), (1.4, 1.05, 13_700.0, 1.1, False), (1.1, 1.05, 13_600.0, 1.1, False),
     (1.4, 1.2, 13_600.0, 1.1, False), (1.4, 1.05, 13_600.0, 0.9, False)],
)  # fmt: skip
def test_noise_alone_with_the_effect_and_more_without_it_is_beyond_doubt(base, error, cost, learned, sure):
    """Five times the 70 asked of 14 000."""
    trial = stub(error, cost, "load_mass")
    assert beyond_doubt(stub(base, 14_000.0), trial, judge(learned)) is sure


def test_what_is_beyond_doubt_is_named_although_the_run_left_out_is_predicted_worse(monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_500.0, left=(1.8, 60.0))
    monkeypatch.setattr(walk, "beyond_doubt", lambda *_: True)
    assert not going.step()
    assert going.named == ["load_mass"] and going.by_all_runs and going.partly and going.current.error == 60.0
    assert walk.OUTSIDE in going.moved


@pytest.mark.parametrize(
    ("left", "cost", "named"),
    [
        ((2.1, 1.9), 13_600.0, True),  # 18 % of the excess, 5.7 times the least drop of the cost
        ((2.1, 2.0), 13_600.0, False),  # 9 %
        ((2.1, 1.9), 13_700.0, False),
    ],
)
def test_what_all_runs_show_far_beyond_chance_and_helps_a_little_is_named_beside_an_unknown(left, cost, named, monkeypatch):
    """Of a memory of pre-sliding: 9 times the least drop of the cost, 2.07 floors without it and 1.86 with it."""
    going, _, _ = walking(monkeypatch, 500.0, cost, left=left)
    monkeypatch.setattr(walk, "beyond_doubt", lambda *_: False)
    assert not going.step()
    assert (going.named == ["load_mass"]) == named == going.partly == going.by_all_runs == (going.lacking is None)
    assert any("named beside what is still missing" in sentence for sentence in going.moved) == named


@pytest.mark.parametrize("out", [True, False])
def test_an_outvoted_effect_is_left_to_all_runs(out, monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_500.0)
    monkeypatch.setattr(walk, "explained_away", lambda *_: False)
    monkeypatch.setattr(walk, "outvoted", lambda *_: out)
    lag = score("friction_lag", 30.0), stub(1.5, 13_900.0, "friction_lag")
    lag[1].fit.runs = ("slow",)
    for name, made in {"_screened": [], "_first_looks": [], "_take_two": False, "_round": ([lag], lag)}.items():
        monkeypatch.setattr(going, name, lambda *_, made=made: made)
    taken = []
    monkeypatch.setattr(going, "_at_break_away", lambda tried: (tried, None))
    monkeypatch.setattr(going, "_take", lambda chosen, *_: taken.append(chosen) or chosen is not None)
    monkeypatch.setattr(going, "_by_all_runs", lambda why: taken.append(why) or False)
    assert going.step() is not out
    assert taken == ([None, walk.UNEXPLAINED] if out else [lag])


def lag_of(tau: float, bandwidth: float = 500.0, servo: bool = False) -> SimpleNamespace:
    """A trial with the force lagging by ``tau``, on runs of 1 kHz and 2 kHz whose motion was smoothed to a bandwidth, Hz."""
    motion = SimpleNamespace(bandwidth=bandwidth)
    runs = tuple(SimpleNamespace(data=np.full((1, 9), dt), motion=motion) for dt in (5e-4, 1e-3))
    plant = SimpleNamespace(servo=servo, rig=SimpleNamespace(A1=8e-4), law=None)
    trial = stub(1.2, 13_000.0, "sensor_lag_F")
    trial.fit.runs, trial.fit.plant, trial.fit.values = runs, plant, {"tau_F": tau, "delta_m": 1e-5}
    return trial


@pytest.mark.parametrize(("tau", "counts"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_lag_shorter_than_a_sample_is_what_smoothing_of_the_motion_leaves(tau, counts, monkeypatch):
    trial = lag_of(tau)
    for user in (module, walk_on_all):
        monkeypatch.setattr(user, "unresolved", unresolved)
    assert bool(shown([(score("sensor_lag_F", 500.0), trial)], BASE, judge())) == counts
    going, _, _ = walking(monkeypatch, 500.0, 13_000.0)
    base = going.judge.trial(going._on_all(going.current.fit))
    both = walk_on_all.WalkOnAll(going.judge, base, base, going.catalogue, going.refitter, going.say)
    assert (both.suspected([(score("sensor_lag_F", 500.0), trial)]) is not None) == counts


@pytest.mark.parametrize(
    ("tau", "bandwidth", "servo", "counts"),
    [(1.7e-3, 72.0, False, False), (2.3e-3, 72.0, False, True), (1.7e-3, 100.0, False, True), (1e-4, 72.0, True, True)],
)
def test_nor_is_one_named_that_is_shorter_than_the_motion_is_resolved(tau, bandwidth, servo, counts, monkeypatch):
    """Noise of 5 um in the position of a seal as stiff as 0.9 N/um hides 2.2 ms. The position of a servo rig is no input."""
    monkeypatch.setattr(acceptance, "inside_bounds", lambda *_: True)
    monkeypatch.setattr(acceptance, "_qualifies", lambda *_: True)
    tried = [(score("sensor_lag_F", 500.0), lag_of(tau, bandwidth, servo))]
    by = SimpleNamespace(**vars(judge()) | {"usually_fits": lambda _: 1.0, "unseen": lambda trial: trial.error})
    assert (acceptance.accepted(tried, BASE, BASE, by) is not None) == counts


def test_only_times_are_counted_in_samples():
    assert not unresolved(score("sensor_offset_F", 500.0), lag_of(1e-4))


@pytest.mark.parametrize(
    ("by_all", "said"), [(True, "--data a.csv b.csv --diagnosis"), (False, "--data a.csv --hold-out b.csv")]
)
def test_the_next_command_fits_to_the_runs_that_showed_the_effect(by_all, said):
    found = Diagnosis("effect", ("load_mass",), (), by_all_runs=by_all)
    assert said in _next(found, Path("monday/model.json"), (["a.csv"], ["b.csv"]), Path("why"), [])


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (Diagnosis("adequate", (), (), sentences=(NOTHING_MISSING,)), "ready for use"),
        (Diagnosis("adequate", (), (), sentences=("the training runs leave it open",)), "record what the sentences"),
        (Diagnosis("unknown", ("load_mass",), ()), "--add load_mass"),
        (Diagnosis("unknown", (), ()), "first of the ranking"),
        (Diagnosis("ambiguous", ("load_mass", "gravity"), ()), "measure what it asks for"),
        (Diagnosis("ambiguous", ("sensor_offset_F", "gravity"), (), next_experiment={"zero_reading": ["F"]}),
         "record a zero reading, zero.csv, and: python -m pneuid.diagnose monday/model.json --data a.csv --hold-out b.csv"),
    ],
)
def test_what_comes_next_follows_from_the_verdict(found, said):
    assert said in _next(found, Path("monday/model.json"), (["a.csv"], ["b.csv"]), Path("why"), [])


def test_on_a_servo_rig_all_runs_are_not_asked(monkeypatch):
    going, refitter, _ = walking(monkeypatch, 500.0, 13_500.0)
    going.current.fit.plant.servo = True
    assert not going.step()
    assert refitter.asked == [] and going.named == [] and going.lacking is None
    assert set(going.ranking) == {"load_mass"}, "the model as it stands is screened all the same"


def test_the_ranking_claims_nothing_held_out_of_a_fit_to_all_runs(monkeypatch):
    going, _, _ = walking(monkeypatch, 500.0, 13_500.0)
    going.step()
    found: Candidate = going.ranking["load_mass"]
    assert found.hold_out_error_ratio is None and found.excess_explained is None
    assert found.p_value is not None and found.p_value < 1e-9


@pytest.mark.parametrize(("trained", "defect", "excused"), [(4.0, 2.7, True), (200.0, 1.2, True), (200.0, 2.7, False)])
def test_what_does_not_explain_the_training_runs_is_not_excused_by_what_they_leave_open(trained, defect, excused, monkeypatch):
    monkeypatch.setattr(leftover, "loudest", lambda _: defect)
    by = judge()
    by.fits = lambda _: trained
    assert explained_away(BASE, by) == excused


def test_what_training_runs_leave_open_that_the_model_cannot_follow_is_no_excuse(monkeypatch):
    monkeypatch.setattr(leftover, "loudest", lambda _: 1.2)
    far, small = (stub(error, 1e4) for error in (9.0, 1.01))
    for trial in (far, small):
        trial.fit.lacking = True
    by = judge()
    by.explains, by.fits = lambda _: True, lambda _: 4.0
    assert not explained_away(far, by) and explained_away(small, by)
