"""Other starts of a model with an effect: which are made, and which is kept."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import rig
from trials import FIRST, score, stub

from pneuid.criticism.refitting import refits, restarts
from pneuid.criticism.refitting.refits import Asked, Standing
from pneuid.criticism.screening.scores import Score
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.estimation.shooting import TIGHT
from pneuid.plant import Plant


@pytest.mark.parametrize(("training", "taken"), [(4.0, True), (400.0, False)])
def test_break_away_is_read_anew_where_the_training_runs_fit_better_for_it(training, taken):
    accepted = replace(stub(2.0, 27_000.0, "gravity"), train={"x": 100.0})
    other = replace(stub(1.5, 26_900.0, "gravity"), train={"x": training})
    judge = SimpleNamespace(
        small=0.15, trial=lambda *_: other, fits=lambda _: 1.0, usually_fits=lambda trial: trial.train["x"]
    )
    refitter = SimpleNamespace(sharper=lambda _: other.fit, by_sliding=lambda _: [])
    assert restarts.read_anew(accepted, judge, refitter, lambda _: None) is (other if taken else accepted)


@pytest.mark.parametrize(("training", "taken"), [(2.0, True), (400.0, False)])
def test_a_relaxed_fit_is_judged_by_the_exact_one_it_leads_to_where_that_predicts_the_training_runs_better(
    training, taken
):
    relaxed = replace(stub(20.0, 27_000.0, "friction_lag"), train={"x": 100.0})
    exact = replace(stub(1.1, 27_000.0, "friction_lag"), train={"x": training})
    judge = SimpleNamespace(
        small=0.15, trial=lambda *_: exact, fits=lambda _: 1.0, usually_fits=lambda trial: trial.train["x"]
    )
    refitter = SimpleNamespace(completed=lambda _: exact.fit)
    assert restarts.followed(relaxed, FIRST, judge, refitter, lambda _: None) is (exact if taken else relaxed)


@pytest.mark.parametrize("whole", [1.1, 1.0 + 0.04 * 144.0])
def test_what_leaves_next_to_nothing_or_has_an_exact_fit_is_followed_no_further(whole):
    judge, refitter = SimpleNamespace(small=0.15), SimpleNamespace()
    small, exact = stub(whole, 27_000.0, "friction_lag"), stub(90.0, 27_000.0, "friction_lag")
    exact.fit.exact = "an exact fit"
    for trial in (small, exact):
        assert restarts.followed(trial, FIRST, judge, refitter, lambda _: None) is trial


def test_a_fit_that_leads_to_no_exact_one_stays():
    trial, judge = stub(90.0, 27_000.0, "friction_lag"), SimpleNamespace(small=0.15)
    refitter = SimpleNamespace(completed=lambda fit: fit)
    assert restarts.followed(trial, FIRST, judge, refitter, lambda _: None) is trial


def test_an_accepted_effect_that_leaves_noise_alone_is_left_alone():
    judge, refitter = SimpleNamespace(small=0.15), SimpleNamespace()
    accepted = stub(1.1, 27_000.0, "gravity")
    assert restarts.read_anew(accepted, judge, refitter, lambda _: None) is accepted


def test_an_amplitude_of_a_second_look_is_at_least_typical():
    plant = SimpleNamespace(rig=SimpleNamespace(mass=1.0, A1=8e-4, A2=7e-4, patm=1e5), law=None)
    current = SimpleNamespace(fit=SimpleNamespace(plant=plant))
    started = restarts.typical_start(current, Score(CATALOGUE["backlash"], 5.0, 1e-4, 1, {"b_play": 1e-9}, ()))
    assert started == {"b_play": pytest.approx(3e-4)}


@pytest.mark.parametrize(("per_sample", "taken"), [(1.1, True), (1.3, False)])
def test_what_follows_whole_runs_to_their_noise_is_kept_whatever_single_windows_say(per_sample, taken):
    """Windows of the training runs in which the piston may break away, or not, outweigh all others."""
    relaxed = replace(stub(20.0, 27_000.0, "mounting_compliance"), train={"x": 30.0})
    exact = replace(stub(1.1, 27_000.0, "mounting_compliance"), train={"x": 40.0})
    exact.fit.exact, exact.fit.cost_per_sample = "an exact fit", per_sample
    judge = SimpleNamespace(
        small=0.15, trial=lambda *_: exact, fits=lambda _: 1.0, usually_fits=lambda trial: trial.train["x"]
    )
    refitter = SimpleNamespace(completed=lambda _: exact.fit)
    assert restarts.followed(relaxed, FIRST, judge, refitter, lambda _: None) is (exact if taken else relaxed)


def way_of(asked: Asked) -> str:
    return "cold" if asked.cold else "anew" if asked.anew else "own"


class _Starts:
    """Refits that end as scripted, by the size of the lag and the way they start; keeps what was asked for.

    An end is the squared error on the training runs, and the cost where it is another one than usual.
    """

    def __init__(self, ends, late=False):
        self.ends, self.asked, self.late = ends, [], lambda: late

    def each(self, _, asked):
        self.asked += asked
        return [(one, lambda one=one: self.ends[round(one.start["tau_L"], 3), way_of(one)]) for one in asked]

    def afresh(self, fit):
        return fit

    def completed(self, fit):
        return fit


NEXT_TO_NOTHING = 1.0 + 0.04 * (FIRST.whole - 1.0)

ENDS = {
    (0.02, "own"): 95.0, (0.02, "anew"): 90.0, (0.02, "cold"): 70.0, (0.08, "own"): 40.0, (0.08, "anew"): 60.0,
    (0.08, "cold"): 500.0,
}  # fmt: skip
"""Squared error on the training runs where lags of 4 and 16 scales lead: from what stood before, with its break-away or with
that of the data, and from the data alone."""


def _settled(monkeypatch, name="friction_lag", servo=True, left=90.0, training=80.0, cheap=27_000.0, late=False):
    """``cheap`` is what the end costs that predicts the training runs worst: its break-away read anew mends that."""
    plant = SimpleNamespace(servo=servo, rig=SimpleNamespace(mass=1.0, A1=8e-4, A2=7e-4, patm=1e5), law=None)
    current = replace(FIRST, fit=SimpleNamespace(plant=plant))
    trial = replace(stub(left, 27_000.0, name), train={"x": training})

    def ended(made, name):
        return replace(stub(made, cheap if made == 500.0 else 27_000.0, name), train={"x": made})

    judge = SimpleNamespace(small=0.15, fits=lambda _: 1.0, usually_fits=lambda one: one.train["x"], trial=ended)
    mended = lambda one, *_: replace(one, train={"x": 10.0}) if one.train["x"] == 500.0 else one  # noqa: E731
    monkeypatch.setattr(restarts, "read_anew", mended)
    refitter = _Starts(ENDS, late)
    return refitter, restarts.settled(score(name, 5.0), trial, current, judge, refitter, lambda _: None)


@pytest.mark.parametrize(("training", "kept"), [(80.0, 40.0), (30.0, 30.0)])
def test_a_state_of_its_own_starts_from_several_sizes_and_the_best_on_the_training_runs_is_kept(
    training, kept, monkeypatch
):
    refitter, found = _settled(monkeypatch, training=training)
    assert [(round(one.start["tau_L"], 3), way_of(one)) for one in refitter.asked] == list(ENDS)
    assert all(one.way == 1.0 for one in refitter.asked)
    assert found.train["x"] == kept


def test_other_sizes_are_left_once_the_time_is_over(monkeypatch):
    refitter, found = _settled(monkeypatch, late=True)
    assert not refitter.asked and found.train["x"] == 80.0


@pytest.mark.parametrize(("cheap", "kept"), [(26_500.0, 10.0), (26_900.0, 40.0)])
def test_a_clearly_cheaper_end_is_followed_though_it_predicts_worse(cheap, kept, monkeypatch):
    _, found = _settled(monkeypatch, cheap=cheap)
    assert found.train["x"] == kept


@pytest.mark.parametrize(
    ("name", "servo", "left"),
    [
        ("gravity", True, 90.0),
        ("friction_lag", False, 90.0),
        *(("friction_lag", True, one) for one in (1.1, NEXT_TO_NOTHING)),
    ],
)
def test_an_effect_without_a_state_a_bench_and_one_that_leaves_next_to_nothing_are_spared_other_sizes(
    name, servo, left, monkeypatch
):
    refitter, found = _settled(monkeypatch, name, servo, left)
    assert not refitter.asked and found.error == left


def test_a_cold_refit_takes_the_effects_values_alone_from_what_it_is_given(monkeypatch):
    base = Plant(rig(), "lugre", effects_by_name(["gravity"]))
    standing = Standing(base, (), dict.fromkeys(base.parameter_names, 2.0), {}, {}, 1.0, True)
    monkeypatch.setattr(refits, "fit", lambda _plant, _runs, start, *_, again, **__: start if again else None)
    asked = Asked(CATALOGUE["friction_lag"], {"tau_L": 0.02}, cold=True)
    assert refits.refit(standing, asked, list(CATALOGUE)) == {"F_g": 2.0, "tau_L": 0.02}


def _refits(monkeypatch, ends, tight=True, kind="servo", law="lugre", warm=TIGHT, **asked):
    """Cost of the refit that is kept, and how fits began: tight or warm with the lag in s, or cold.

    ``warm`` is the relaxation in which a warm one ends.

    ``ends`` are their relaxed costs in turn; the base of cost 100 has defects as ``tight`` says; 10 % are promised.
    """
    base, began, coming = Plant(rig(kind), law), [], list(ends)
    standing = Standing(base, (), dict.fromkeys(base.parameter_names, 2.0), {}, {}, 100.0, tight)

    def made(how, relaxation):
        def fitted(_base, _plant, values, _monitor):
            began.append((how, values.get("tau_L")) if how != "cold" else (how,))
            cost = coming.pop(0)
            return SimpleNamespace(relaxed_cost=cost, loose_cost=cost, problem=SimpleNamespace(relaxation=relaxation))

        return fitted

    monkeypatch.setattr(refits, "_at_once", made("tight", TIGHT))
    monkeypatch.setattr(refits, "_warm", made("warm", warm))
    monkeypatch.setattr(refits, "_fitted", made("cold", TIGHT))
    monkeypatch.setattr(refits, "_break_away", lambda _: {})
    monkeypatch.setattr(refits, "_force_error", lambda end: end.relaxed_cost)
    given = {"gain": 0.1, "thorough": False, **asked}
    kept = refits.refit(standing, Asked(CATALOGUE["friction_lag"], {"tau_L": 0.02}, **given), list(CATALOGUE))
    assert not coming, "every end is needed"
    return kept.relaxed_cost, [(how, *(pytest.approx(lag) for lag in lags)) for how, *lags in began]


HALF_WAY, NEXT_TO_OFF, COLD = ("tight", 0.01), ("tight", 0.0004), ("cold",)


@pytest.mark.parametrize(
    ("ends", "kept", "began"),
    [((91.0,), 91.0, [HALF_WAY]), ((99.0,), 99.0, [HALF_WAY]), ((400.0, 95.0), 95.0, [HALF_WAY, NEXT_TO_OFF]),
     ((120.0, np.inf), 120.0, [HALF_WAY, NEXT_TO_OFF])],
)  # fmt: skip
def test_a_refit_has_tight_defects_at_once_and_begins_again_next_to_off_where_it_ends_dearer(
    ends, kept, began, monkeypatch
):
    assert _refits(monkeypatch, ends) == (kept, began)


def test_beside_a_base_that_only_loose_defects_carry_a_refit_that_falls_short_has_them_too(monkeypatch):
    assert _refits(monkeypatch, (91.0,), tight=False) == (91.0, [HALF_WAY])
    assert _refits(monkeypatch, (97.0, 91.0), tight=False) == (91.0, [HALF_WAY, ("warm", 0.01)])
    began = [HALF_WAY, ("warm", 0.01), ("warm", 0.0004)]
    assert _refits(monkeypatch, (140.0, 120.0, 99.0), tight=False) == (99.0, began)


def test_with_break_away_read_anew_a_refit_starts_once_whatever_it_costs(monkeypatch):
    assert _refits(monkeypatch, (400.0,), thorough=True, anew=True, way=1.0) == (400.0, [("tight", 0.02)])


def test_static_friction_has_no_break_away_that_loose_defects_could_lose(monkeypatch):
    assert _refits(monkeypatch, (91.0,), law="stribeck", thorough=True) == (91.0, [("warm", 0.01)])
    assert _refits(monkeypatch, (140.0, 99.0), law="stribeck") == (99.0, [("warm", 0.01), ("warm", 0.0004)])


def test_on_a_bench_a_thorough_refit_always_starts_twice(monkeypatch):
    assert _refits(monkeypatch, (91.0,), kind="bench") == (91.0, [("warm", 0.01)])
    assert _refits(monkeypatch, (91.0, 90.0), kind="bench", thorough=True) == (90.0, [("warm", 0.01), COLD])
    assert _refits(monkeypatch, (95.0, 97.0), kind="bench") == (95.0, [("warm", 0.01), COLD])


def test_what_loose_defects_alone_carry_is_dearer_than_a_base_that_has_tight_ones(monkeypatch):
    began = [("warm", 0.01), ("warm", 0.0004), COLD]
    assert _refits(monkeypatch, (91.0, 93.0, 95.0), kind="bench", warm=1.0) == (91.0, began)


def test_from_the_laws_of_sliding_friction_alone_starts_anew(monkeypatch):
    plant = Plant(rig(), "lugre", effects_by_name(["friction_pressure", "gravity"]))
    values, started = dict.fromkeys(plant.parameter_names, 1.0), dict.fromkeys(plant.parameter_names, 2.0)
    monkeypatch.setattr(refits, "sliding_starts", lambda *_: [started])
    monkeypatch.setattr(refits, "fit", lambda _plant, _runs, start, *_, **__: start)
    (start,) = refits.by_sliding(Standing(plant, (), values, {}, {}, 1.0, True))
    friction = {"Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2", *(f"k{i}" for i in range(1, 9))}
    assert {name for name, value in start.items() if value == 2.0} == friction


@pytest.mark.parametrize(
    ("training", "cost", "taken"), [(96.0, 45_000.0, False), (96.0, 28_000.0, True), (60.0, 45_000.0, True)]
)
def test_an_end_that_costs_much_more_must_predict_the_training_runs_clearly_better(training, cost, taken):
    cheap = replace(stub(375.0, 27_000.0, "friction_pressure"), train={"x": 100.0})
    dear = replace(stub(1136.0, cost, "friction_pressure"), train={"x": training})
    judge = SimpleNamespace(
        small=0.15, trial=lambda *_: dear, usually_fits=lambda trial: trial.train["x"], fits=lambda _: 150.0
    )
    refitter = SimpleNamespace(sharper=lambda fit: fit, by_sliding=lambda _: [dear.fit])
    assert restarts.read_anew(cheap, judge, refitter, lambda _: None) is (dear if taken else cheap)


@pytest.mark.parametrize(("usual", "every", "taken"), [(36.0, 38.0, False), (30.0, 38.0, True), (36.0, 30.0, True)])
def test_an_end_far_off_in_the_worst_windows_must_predict_the_others_clearly_better(usual, every, taken):
    """Of two ends of a silencer's restriction: 43 and 36 of the usual windows' squares, but 20 and 38 of all windows'."""
    one, other = (replace(stub(9.0, 26_000.0), train={"x": x, "all": y}) for x, y in ((43.0, 20.0), (usual, every)))
    judge = SimpleNamespace(usually_fits=lambda trial: trial.train["x"], fits=lambda trial: trial.train["all"])
    assert restarts.best_end([one, other], judge) is (other if taken else one)


def test_an_end_that_follows_whole_runs_is_the_best_whatever_it_costs():
    exact = replace(stub(1.1, 45_000.0, "friction_pressure"), train={"x": 100.0})
    exact.fit.exact, exact.fit.cost_per_sample = "an exact fit", 1.02
    cheap = replace(stub(375.0, 27_000.0, "friction_pressure"), train={"x": 99.0})
    judge = SimpleNamespace(fits=lambda _: 1.0, usually_fits=lambda trial: trial.train["x"])
    assert restarts.best_end([cheap, exact], judge) is exact


def test_what_is_led_starts_from_the_other_effects_end_and_its_own_amplitude(monkeypatch):
    plant = Plant(rig(), "lugre")
    standing = Standing(plant, (), dict.fromkeys(plant.parameter_names, 2.0), {}, {}, 100.0, True)
    monkeypatch.setattr(refits.Standing, "of", lambda _: standing)
    monkeypatch.setattr(
        refits, "near", lambda plant, runs, start, noise, **_: (plant.parameter_names, runs, start, noise)
    )
    base = SimpleNamespace(runs="the runs", noise="the noise")
    there = SimpleNamespace(values=dict.fromkeys(plant.parameter_names, 3.0) | {"k_spring": 9.0})
    asked = Asked(CATALOGUE["gravity"], {"F_g": 5.0})
    names, runs, start, noise = refits.led(base, there, asked, list(CATALOGUE))
    assert (runs, noise) == ("the runs", "the noise") and set(start) == set(names)
    assert start == {**dict.fromkeys(plant.parameter_names, 3.0), "F_g": 5.0}


@pytest.mark.parametrize(
    ("kind", "before", "refitted", "tight", "taken"),
    [("servo", 4.0, 2500.0, 1.6, True), ("servo", 4.0, 2500.0, 9000.0, False), ("servo", 4.0, 3.0, 1.6, False),
     ("bench", 4.0, 2500.0, 1.6, False)],
)  # fmt: skip
def test_a_refit_that_worsens_the_training_runs_is_made_with_tight_defects_from_what_stood_before(
    kind, before, refitted, tight, taken
):
    """A valve's hysteresis, refitted with loose defects, lost a break-away that was right."""

    def end(training):
        return replace(stub(600.0, 13_000.0, "valve_hysteresis"), train={"x": training})

    current, trial, other = end(before), end(refitted), end(tight)
    current.fit.plant = Plant(rig(kind), "lugre")
    asked = []
    judge = SimpleNamespace(trial=lambda *_: other, fits=lambda _: 1.0, usually_fits=lambda one: one.train["x"])
    refitter = SimpleNamespace(led=lambda base, there, one: asked.append((base, there, one.effect.name)))
    found = restarts.from_standing(score("valve_hysteresis", 390.0), trial, current, judge, refitter, lambda _: None)
    assert found is (other if taken else trial)
    worse = kind == "servo" and refitted > before
    assert asked == ([(current.fit, current.fit, "valve_hysteresis")] if worse else [])


@pytest.mark.parametrize(("per_sample", "again"), [(1.03, False), (1.05, True)])
def test_what_leaves_whole_runs_noise_alone_starts_no_more(per_sample, again, monkeypatch):
    """Of 20 000 numbers the mean square is 1 within 0.04, four standard deviations, though single windows may be far off."""
    exact = stub(90.0, 27_000.0, "friction_lag")
    exact.fit.exact, exact.fit.cost_per_sample = "an exact fit", per_sample
    seen = []
    monkeypatch.setattr(restarts, "read_anew", lambda trial, *_: seen.append(trial) or trial)
    monkeypatch.setattr(restarts, "large_starts", lambda *_: [])
    judge = SimpleNamespace(small=0.15)
    assert restarts.settled(score("friction_lag", 900.0), exact, FIRST, judge, None, lambda _: None) is exact
    assert bool(seen) == again


@pytest.mark.parametrize(("usual", "looked"), [(1.15, True), (1.25, False)])
def test_what_leaves_usual_windows_noise_alone_is_followed_to_its_exact_fit_before_it_starts_again(
    usual, looked, monkeypatch
):
    """The windows in which the piston breaks away are all that a relaxed fit may leave."""
    relaxed = replace(stub(usual, 27_000.0, "gravity"), whole=3.0, train={"x": 9.0})
    exact = replace(stub(1.02, 27_000.0, "gravity"), train={"x": 1.0})
    exact.fit.exact, exact.fit.cost_per_sample = "an exact fit", 1.01
    monkeypatch.setattr(restarts, "read_anew", lambda trial, *_: trial)
    judge = SimpleNamespace(
        small=0.15, trial=lambda *_: exact, fits=lambda _: 1.0, usually_fits=lambda one: one.train["x"]
    )
    refitter = SimpleNamespace(completed=lambda _: exact.fit)
    found = restarts.settled(score("gravity", 900.0), relaxed, FIRST, judge, refitter, lambda _: None)
    assert found is (exact if looked else relaxed)
