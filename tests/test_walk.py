"""From model to model: what a round accepts, what stands beside it, and better starts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from trials import FIRST, JUDGE, score, stub, walking

from pneuid.criticism.decision import ascent, leftover, revision, verdict, walk
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.criticism.decision.exchange import Exchange
from pneuid.criticism.decision.rivals import better_without
from pneuid.criticism.decision.verdict import _verdict
from pneuid.criticism.decision.walk import Walk
from pneuid.criticism.refitting.restarts import NEXT_TO_NOTHING
from pneuid.criticism.screening.scores import Score
from pneuid.effects import CATALOGUE, LAW_STEPS
from pneuid.report.summary import verdict_lines

pytestmark = pytest.mark.usefixtures("amplitudes_inside")


def rivals(chosen, tried) -> tuple[str, ...]:
    return tuple(pair[0].effect.name for pair in walking()._rivals(chosen, tried))


def test_rivals_explain_both_kinds_of_runs_alike_whatever_their_group():
    best = (score("valve_lag", 800.0), stub(1.0, 26_333.0))
    near = (score("line_delay", 790.0), stub(1.1, 26_343.0))
    worse_ahead = (score("channel_skew", 780.0), stub(9.0, 26_340.0))
    worse_in_training = (score("gravity", 770.0), stub(1.1, 27_500.0))
    tried = [best, near, worse_ahead, worse_in_training]
    assert rivals(best, tried) == ("line_delay",)


def test_beside_an_effect_that_leaves_noise_alone_a_rival_must_leave_noise_alone():
    tried = [(score("valve_lag", 800.0), stub(1.02, 26_333.0)), (score("channel_skew", 790.0), stub(1.4, 26_343.0))]
    assert rivals(tried[0], tried) == ()
    # where the best one leaves more than noise, a lead of that size is an accident
    tried = [(score("valve_lag", 800.0), stub(4.0, 26_333.0)), (score("channel_skew", 790.0), stub(4.4, 26_343.0))]
    assert rivals(tried[0], tried) == ("channel_skew",)


@pytest.mark.parametrize(
    ("error", "cost", "open_", "beside"),
    [
        (1.3, 26_100.0, True, ("gravity",)),
        (9.0, 26_100.0, True, ("gravity",)),  # by more than 3 % of the gain
        (1.3, 26_100.0, False, ()),
        (9.0, 26_100.0, False, ()),
        (1.3, 26_343.0, True, ()),
    ],
)
def test_a_rival_that_costs_less_may_leave_what_the_training_runs_leave_open(error, cost, open_, beside):
    """A constant force on a bench: right, cheaper, and off by what the training runs leave open of viscous friction."""
    judge = SimpleNamespace(**vars(JUDGE) | {"explains": lambda _: open_})
    tried = [(score("friction_direction", 800.0), stub(1.09, 26_333.0)), (score("gravity", 790.0), stub(error, cost))]
    assert tuple(pair[0].effect.name for pair in walking(judge)._rivals(tried[0], tried)) == beside


@pytest.mark.parametrize(
    ("cost", "open_", "named"), [(26_332.0, True, "gravity"), (26_332.0, False, "load_spring"), (26_400.0, True, "load_spring")]
)
def test_what_a_spring_is_in_a_limit_is_named_though_it_leaves_what_stays_open(cost, open_, named):
    judge = SimpleNamespace(**vars(JUDGE) | {"explains": lambda _: open_})
    tried = [(score("load_spring", 800.0), stub(1.09, 26_333.0)), (score("gravity", 790.0), stub(1.3, cost))]
    for parameters, (_, trial) in zip((8, 7), tried, strict=True):
        trial.fit.plant = SimpleNamespace(parameters=[None] * parameters)
    assert walking(judge)._plainest(tried[0], tried)[0].effect.name == named


@pytest.mark.parametrize(("dahl", "named"), [(1.02, "law:dahl"), (3.0, "law:lugre")])
def test_of_friction_laws_that_explain_as_much_the_plainest_is_named(dahl, named):
    tried = []
    for name, parameters, error in (("law:lugre", 6, 1.0), ("law:dahl", 3, dahl), ("friction_presliding_memory", 5, 1.01)):
        effect = LAW_STEPS.get(name) or CATALOGUE[name]
        trial = stub(error, 26_333.0, name)
        trial.fit.plant = SimpleNamespace(parameters=[None] * parameters)
        tried.append((Score(effect, 900.0, 0.03, 1, {}, ()), trial))
    chosen = walking()._plainest(tried[0], tried)
    assert chosen[0].effect.name == named
    # an effect that is no law stays a rival, a law that contains the named one does not
    assert rivals(chosen, tried) == ("friction_presliding_memory",)


@pytest.mark.parametrize(("spring", "others"), [(26_330.0, ("gravity",)), (26_300.0, ("gravity", "load_spring"))])
def test_a_rival_that_is_another_one_in_a_limit_is_named_once(spring, others):
    """Beside friction by direction a constant force, and a spring that pulls from three metres away."""
    costs = {"friction_direction": 26_333.0, "gravity": 26_331.0, "load_spring": spring}
    tried = [(score(name, 900.0), stub(1.0, cost)) for name, cost in costs.items()]
    assert rivals(tried[0], tried) == others


@pytest.mark.parametrize(("constant", "named", "beside"), [(26_334.0, "gravity", ()), (26_600.0, "load_spring", ("gravity",))])
def test_a_spring_that_is_no_better_than_a_constant_force_is_one(constant, named, beside):
    tried = [(score("load_spring", 900.0), stub(1.0, 26_333.0)), (score("gravity", 890.0), stub(1.01, constant))]
    for parameters, (_, trial) in zip((8, 7), tried, strict=True):
        trial.fit.plant = SimpleNamespace(parameters=[None] * parameters)
    chosen = walking()._plainest(tried[0], tried)
    assert chosen[0].effect.name == named
    assert rivals(chosen, tried) == beside


@pytest.mark.parametrize(
    ("error", "verdict", "rest"), [(1.1, "ambiguous", False), (30.0, "ambiguous", True), (120.0, "unknown", True)]
)
def test_effects_that_cannot_be_told_apart_and_explain_little_stand_beside_something_larger(error, verdict, rest, monkeypatch):
    monkeypatch.setattr("pneuid.criticism.decision.verdict._rest", lambda _: Unknown("flow_1", ("p1",), 1.0, "kg/s"))
    at_end = walking(current=stub(error, 40_000.0))
    at_end.named, at_end.ambiguous = ["valve_asymmetry"], {"valve_asymmetry": ("heat_transfer",)}
    found = _verdict(at_end)
    assert found.verdict == verdict and (found.unknown is not None) == rest
    assert found.effects == (("valve_asymmetry", "heat_transfer") if verdict == "ambiguous" else ("valve_asymmetry",))


def test_a_candidate_that_made_things_worse_stays_where_screening_put_it():
    known = {"friction_pressure": (0.19, 0.1, 0.99), "load_mass": (0.039, None, None), "friction_position": (0.044, 1.56, -1.4)}
    ranking = {name: Candidate(name, "friction", gain, ratio, part) for name, (gain, ratio, part) in known.items()}
    at_end = walking(current=stub(1.0, 25_000.0))
    at_end.named, at_end.ranking = ["friction_pressure"], ranking
    found = _verdict(at_end)
    assert [item.effect for item in found.ranking] == ["friction_pressure", "friction_position", "load_mass"]
    lines = verdict_lines(found)
    assert any(line.startswith("  friction_position") and line.endswith("held-out error times 1.56") for line in lines)
    assert any(line.startswith("  load_mass") and line.endswith("screened only") for line in lines)


@pytest.mark.parametrize(
    ("error", "cost", "training", "better"),
    [
        (20.0, 26_500.0, 1.0, True),  # the effect had led out of a local optimum
        (145.0, 43_000.0, 1.0, False),  # back where it came from: the fall is the effect's
        (150.0, 26_500.0, 1.0, False),
        (20.0, 42_990.0, 1.0, False),
        (20.0, 45_000.0, 0.6, True),  # out of a wrong break-away, of which the relaxed cost tells little
        (20.0, 45_000.0, 0.9, False),
        (150.0, 45_000.0, 0.6, False),
        (20.0, 48_000.0, 0.6, False),
    ],
)
def test_the_model_without_an_accepted_effect_may_be_better_than_it_was(error, cost, training, better):
    with_effect = stub(18.0, 26_400.0, "load_mass")
    with_effect.fit.plant = SimpleNamespace(effects=[CATALOGUE["load_mass"]])
    smaller = stub(error, cost)
    predicted = {id(smaller): training}
    judge = SimpleNamespace(
        trial=lambda fit, _added: fit, usually_fits=lambda trial: predicted.get(id(trial), 1.0), fits=lambda _: 1.0
    )
    refitter = SimpleNamespace(late=lambda: False, without=lambda _fit, name: {"load_mass": smaller}[name])
    found = better_without((score("load_mass", 100.0), with_effect), FIRST, judge, refitter)
    assert (found is smaller) if better else (found is None)


@pytest.mark.parametrize(("far", "tight", "better"), [(400.0, 20.0, True), (400.0, 150.0, False), (4.0, 20.0, False)])
def test_where_loose_jumps_lead_back_and_the_model_is_far_off_it_is_fitted_tightly_from_there(far, tight, better):
    """Beside a play of 0.3 mm a refit without the effect went back to 41 floors."""
    with_effect = stub(18.0, 42_000.0, "load_mass")
    with_effect.fit.plant = SimpleNamespace(effects=[CATALOGUE["load_mass"]])
    back, there = stub(145.0, 43_000.0), stub(tight, 44_500.0)
    judge = SimpleNamespace(
        trial=lambda fit, _added: fit, fits=lambda _: far, usually_fits=lambda trial: 0.6 if trial is there else 1.0
    )
    refitter = SimpleNamespace(without=lambda *_: back, moved=lambda base, led: there if led is with_effect.fit else base)
    found = better_without((score("load_mass", 100.0), with_effect), FIRST, judge, refitter)
    assert (found is there) if better else (found is None)


@pytest.mark.parametrize(("error", "better"), [(20.0, True), (150.0, False)])
def test_a_model_that_reaches_an_exact_fit_from_where_an_effect_led_needs_no_effect(error, better):
    """The effect led it out of a wrong break-away, of which the relaxed cost tells nothing."""
    with_effect, smaller, exact = stub(18.0, 42_000.0, "load_mass"), stub(140.0, 43_001.0), stub(error, 43_001.0)
    with_effect.fit.plant = SimpleNamespace(effects=[CATALOGUE["load_mass"]])
    with_effect.fit.exact = exact.fit.exact = "an exact fit"
    one = {"usually_fits": lambda _: 1.0, "fits": lambda _: 1.0}
    judge = SimpleNamespace(trial=lambda fit, _added: exact if fit is exact.fit else smaller, **one)
    refitter = SimpleNamespace(late=lambda: False, without=lambda *_: smaller.fit, completed=lambda _: exact.fit)
    found = better_without((score("load_mass", 100.0), with_effect), FIRST, judge, refitter)
    assert (found is exact) if better else (found is None)


def test_what_fits_the_training_runs_alike_is_followed_to_its_exact_fit_and_nothing_else(monkeypatch):
    asked = []
    monkeypatch.setattr(walk, "followed", lambda trial, *_: asked.append(trial.added) or trial)
    monkeypatch.setattr(ascent, "same_floor", lambda judge, current, first, found: (judge, current, first, found))
    ends = {"valve_lag": 26_333.0, "line_delay": 26_700.0, "gravity": 30_000.0}
    tried = [(score(name, 800.0), stub(9.0, cost, name)) for name, cost in ends.items()]
    assert walking()._followed(tried) == tried and asked == ["valve_lag", "line_delay"]


@pytest.mark.parametrize(("explains", "asked"), [(True, ["line_delay"]), (False, ["line_delay", "valve_lag"])])
def test_the_best_predictor_of_the_training_runs_is_followed_first_and_the_last_that_explains_all(explains, asked, monkeypatch):
    seen = []
    monkeypatch.setattr(walk, "followed", lambda trial, *_: seen.append(trial.added) or trial)
    monkeypatch.setattr(ascent, "same_floor", lambda judge, current, first, found: (judge, current, first, found))
    ends = {"valve_lag": (26_333.0, 9.0, 3.0), "line_delay": (26_400.0, 1.1 if explains else 20.0, 2.0)}
    tried = [
        (score(name, 800.0), replace(stub(error, cost, name), usual_train={"x": training}))
        for name, (cost, error, training) in ends.items()
    ]
    judge = SimpleNamespace(**vars(JUDGE) | {"usually_fits": lambda trial: trial.usual_train["x"]})
    assert walking(judge)._followed(tried) == tried and seen == asked


TOLD = {"gravity": (1.2, 42_000.0, True), "load_spring": (1.1, 42_500.0, True)}
"""Held-out error, training cost, and whether noise alone is left of the training runs."""


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({}, ["gravity"]),
        ({"gravity": (2.2, 42_000.0, True)}, ["load_spring"]),  # held-out runs speak against the one that shows more
        ({"gravity": (1.2, 42_000.0, False)}, ["load_spring"]),  # more than noise is left
        ({"gravity": (1.2, 42_990.0, True), "load_spring": (1.1, 42_990.0, True)}, []),  # chance
    ],
)
def test_training_runs_name_an_effect_where_held_out_runs_cannot_judge(changes, named, monkeypatch):
    told = TOLD | changes
    tried = [(score(name, 900.0), stub(error, cost, name)) for name, (error, cost, _) in told.items()]
    monkeypatch.setattr(walk, "refitted", lambda *_: tried)
    monkeypatch.setattr(ascent, "screen", lambda *_: [one for one, _ in tried])
    monkeypatch.setattr(ascent, "same_floor", lambda judge, current, first, found: (judge, current, first, found))
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    monkeypatch.setattr(Walk, "rung", lambda _self, trial, accepted: (trial, accepted))
    current = stub(1.3, 43_000.0)
    current.fit.plant = SimpleNamespace(servo=True)
    for _, trial in tried:
        trial.fit.plant = SimpleNamespace(parameters=[])
    judge = SimpleNamespace(**vars(JUDGE) | {"learned": lambda trial: trial.added is not None and told[trial.added][2]})
    going = walking(judge, current=current)
    assert going._by_training_runs() is bool(named) and going.named == named
    assert [name in line for name, line in zip(named, going.moved, strict=True)] == [True] * len(named)


def test_training_runs_of_a_bench_or_without_a_rest_name_nothing():
    bench, quiet = stub(1.3, 43_000.0), stub(1.3, 43_000.0)
    bench.fit.plant, quiet.fit.plant = SimpleNamespace(servo=False), SimpleNamespace(servo=True)
    unlearned = SimpleNamespace(**vars(JUDGE) | {"learned": lambda _: False})
    assert not walking(unlearned, current=bench)._by_training_runs()
    assert not walking(SimpleNamespace(**vars(JUDGE) | {"learned": lambda _: True}), current=quiet)._by_training_runs()


@pytest.mark.parametrize(("exact", "training", "judges"), [(None, 70.0, True), (None, 8.0, False), ("exact", 70.0, False)])
def test_what_is_open_is_no_reason_not_to_look_where_a_relaxed_fit_is_far_off_on_the_training_runs_too(
    exact, training, judges, monkeypatch
):
    monkeypatch.setattr(leftover, "loudest", lambda _: 1.0)
    current = stub(1.1, 26_000.0)
    current.fit.exact = exact
    going = walking(SimpleNamespace(**vars(JUDGE) | {"fits": lambda _: training}), current=current)
    assert going._cannot_judge() is not judges


def test_a_richer_friction_law_cannot_be_taken_out():
    richer = stub(18.0, 26_400.0, "law:lugre")
    richer.fit.plant = SimpleNamespace(effects=[])
    assert better_without((score("load_mass", 100.0), richer), FIRST, SimpleNamespace(), SimpleNamespace()) is None


def test_a_pair_that_leaves_next_to_nothing_spares_the_second_looks_and_another_one_is_asked_after_them(monkeypatch):
    asked = []

    def two(at, _tried, _chosen, most=np.inf):
        asked.append(most)
        return most < 1.0 and at.first is FIRST

    monkeypatch.setattr(ascent, "screen", lambda *_: [])
    for name, stand_in in {"_first_looks": lambda *_: [], "_take_two": two, "_round": lambda *_: ([], None)}.items():
        monkeypatch.setattr(Walk, name, stand_in)
    monkeypatch.setattr(Walk, "_take", lambda *_: True)
    assert walking().step() and asked == [NEXT_TO_NOTHING]
    other = walking()
    other.first = stub(145.0, 43_000.0)
    assert other.step() and asked == [NEXT_TO_NOTHING, NEXT_TO_NOTHING, np.inf]


@pytest.mark.parametrize(("error", "named"), [(19.0, []), (2.0, ["load_mass"])])
def test_a_better_base_takes_the_place_of_the_first_and_the_effect_must_beat_it(error, named, monkeypatch):
    """The effect leaves 19 or 2 where the base of 145 leaves 20 from where the effect led."""
    lead, smaller, chosen = score("load_mass", 900.0), stub(20.0, 26_500.0), stub(error, 25_000.0, "load_mass")
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda _: FIRST, held=())
    base, turns = SimpleNamespace(plant=None, noise=None), []

    def turn(self, *_):
        turns.append(self.current)
        tried = [(lead, chosen)] if len(turns) == 1 else []
        return tried, (tried[0] if tried else None)

    replaced = {
        "_first_looks": lambda *_: [], "_round": turn, "rung": lambda _self, trial, accepted: (trial, accepted),
        "backward": lambda _self: False, "_by_all_runs": lambda *_: False, "_beyond_catalogue": lambda *_: False,
    }
    for name, stand_in in replaced.items():
        monkeypatch.setattr(Walk, name, stand_in)
    monkeypatch.setattr(ascent, "screen", lambda *_: [lead])
    monkeypatch.setattr(ascent, "better_without", lambda *_: smaller)
    monkeypatch.setattr(walk, "joined", lambda *_: None)
    monkeypatch.setattr(verdict, "judge_of", lambda *_: judge)
    monkeypatch.setattr(verdict, "too_slow", lambda _: None)
    monkeypatch.setattr(verdict, "uncovered", lambda *_: [])
    monkeypatch.setattr(verdict, "_verdict", lambda ended, _: Diagnosis("effect", tuple(ended.named), ()))
    found = verdict.diagnose(base, [], CATALOGUE, refitter=SimpleNamespace(late=lambda: False))
    assert turns[1] is (chosen if named else smaller)
    assert found.base is smaller.fit
    assert found.diagnosis.effects == tuple(named)
    assert found.rungs == [(smaller, True), (chosen, bool(named))]
    assert "fits better from another start (12.04 -> 4.47 floors)" in found.diagnosis.sentences[-1]


@pytest.mark.parametrize(
    ("zone", "leak", "named"),
    [
        ((4.5, 26_300.0), (3.2, 27_400.0), ["valve_null_leakage", "valve_dead_zone"]),
        ((4.5, 27_400.0), (3.2, 26_300.0), ["valve_dead_zone", "valve_null_leakage"]),
        ((1.61, 26_100.0), (3.2, 26_300.0), ["valve_null_leakage"]),
        ((1.61, 27_400.0), (3.2, 26_300.0), ["valve_dead_zone", "valve_null_leakage"]),
        ((2.2, 26_100.0), (3.2, 26_300.0), ["valve_null_leakage", "valve_dead_zone"]),
    ],
)
def test_what_is_named_stands_in_order_of_weight_and_what_is_not_missed_is_dropped(zone, leak, named, monkeypatch):
    """The dead zone was found first, by break-away; without the leak, a twentieth of the training runs' cost is lost."""
    ends = {"valve_dead_zone": stub(*zone), "valve_null_leakage": stub(*leak)}
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda fit: fit)
    both = stub(1.6, 26_000.0, "valve_null_leakage")
    both.fit.plant = SimpleNamespace(effects=[CATALOGUE[name] for name in ends])
    monkeypatch.setattr(revision, "exchanged", lambda *_: Exchange())
    going = walking(judge, SimpleNamespace(late=lambda: False, without=lambda _fit, name: ends[name]), both)
    going.first, going.named = stub(9.3, 28_000.0), list(ends)
    for end in ends.values():
        end.fit.plant = SimpleNamespace(effects=[CATALOGUE["valve_null_leakage"]])
    assert going.backward() == (len(named) == 1)
    assert going.named == named


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_richer_friction_law_keeps_the_place_in_which_it_was_found(place, monkeypatch):
    """Without it the model is another, whose cost says nothing: a bristle's jumps excuse what friction alone must miss."""
    ends = {"valve_dead_zone": stub(4.5, 26_300.0), "valve_null_leakage": stub(3.2, 27_400.0)}
    both = stub(1.6, 26_000.0, "law:lugre")
    both.fit.plant = SimpleNamespace(effects=[CATALOGUE[name] for name in ends])
    monkeypatch.setattr(revision, "exchanged", lambda *_: Exchange())
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda fit: fit)
    going = walking(judge, SimpleNamespace(late=lambda: False, without=lambda _fit, name: ends[name]), both)
    for end in ends.values():
        end.fit.plant = SimpleNamespace(effects=[CATALOGUE["valve_null_leakage"]])
    monkeypatch.setattr(walk.Walk, "_not_missed", lambda *_: False)
    going.named = list(ends)
    going.named.insert(place, "law:lugre")
    assert not going.backward()
    assert going.named.index("law:lugre") == place and [n for n in going.named if n in ends] == [*ends][::-1]


@pytest.mark.parametrize(("relaxation", "named"), [(1.0, ["line_delay", "dead_volume"]), (0.1, ["dead_volume", "line_delay"])])
def test_weights_are_told_by_defects_that_all_smaller_models_have(relaxation, named, monkeypatch):
    """Without a tube only loose defects carry the model; tight ones show more of what the dead volume beside it takes."""
    ends = {"dead_volume": stub(149.0, 37_100.0), "line_delay": stub(2300.0, 32_600.0, relaxation=relaxation)}
    ends["dead_volume"].fit.loose_cost = 26_600.0
    both = stub(10.4, 29_800.0, "dead_volume")
    both.fit.plant = SimpleNamespace(effects=[CATALOGUE[name] for name in ends])
    for end in ends.values():
        end.fit.plant = both.fit.plant
    monkeypatch.setattr(revision, "exchanged", lambda *_: Exchange())
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda fit: fit)
    going = walking(judge, SimpleNamespace(late=lambda: False, without=lambda _fit, name: ends[name]), both)
    going.first, going.named = stub(2340.0, 33_000.0), ["dead_volume", "line_delay"]
    monkeypatch.setattr(walk.Walk, "_not_missed", lambda *_: False)
    assert not going.backward() and going.named == named


@pytest.mark.parametrize(("lacking", "least"), [(True, 3.0), (False, 15.0)])
def test_a_model_that_no_parameters_make_follow_is_refitted_with_what_promises_little(lacking, least, monkeypatch):
    seen, current = [], stub(145.0, 43_000.0)
    current.fit.lacking = lacking
    walk_ = walking(current=current)
    monkeypatch.setattr(walk_, "_cannot_judge", lambda: False)
    monkeypatch.setattr(walk_, "_screened", lambda _: [])
    monkeypatch.setattr(walk_, "_first_looks", lambda _scores, drop: seen.append(drop) or [])
    monkeypatch.setattr(walk_, "_round", lambda *_: ([], ([], current)))
    monkeypatch.setattr(walk_, "_take", lambda *_: True)
    monkeypatch.setattr(walk, "leaves_much", lambda *_: False)
    assert walk_.step() and seen == [least]


@pytest.mark.parametrize(("slow", "cost", "named"), [(True, 42_000.0, False), (True, 40_000.0, True), (False, 42_000.0, True)])
def test_recordings_that_do_not_show_break_away_name_what_explains_half_or_shows_in_training(slow, cost, named):
    tried = [(score("inlet_mixing", 900.0), stub(100.0, cost, "inlet_mixing"))]
    walked = walking()
    walked.slow = slow
    assert (walked._best(tried) is not None) is named
