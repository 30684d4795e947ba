"""One round of a walk: what starts again with the chosen effect, what from where that one led, and what second looks find."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import FIRST, JUDGE, one_round, score, stub, walking

from pneuid.criticism.decision import ascent, walk
from pneuid.effects import CATALOGUE

pytestmark = pytest.mark.usefixtures("amplitudes_inside")


def _at_first(monkeypatch, tried, settled):
    """Have a round try just these at first, by one floor, with ``settled`` for other starts; a second look finds no more."""
    monkeypatch.setattr(walk, "refitted", lambda *_: tried)
    monkeypatch.setattr(walk, "overtaking", lambda _current, _first, _scores, found, *_: found)
    monkeypatch.setattr(ascent, "same_floor", lambda judge, current, first, found: (judge, current, first, found))
    monkeypatch.setattr(walk, "loudest", lambda _: 1.0)
    monkeypatch.setattr(walk, "second_looks", lambda _current, _scores, found, *_: found)
    monkeypatch.setattr(walk, "settled", settled)
    monkeypatch.setattr(walk, "led", lambda _, found, *__: found)


@pytest.mark.parametrize(("read_anew", "named"), [(90.0, "backlash"), (70.0, "load_mass"), (160.0, "backlash")])
def test_what_reading_break_away_anew_makes_worse_is_the_best_no_longer(read_anew, named, monkeypatch):
    """load_mass leaves 60 and backlash 80 of 145, load_mass with its break-away read anew 90, 70 or 160."""
    tried = [(score(name, 900.0), stub(error, 25_000.0, name)) for name, error in (("load_mass", 60.0), ("backlash", 80.0))]
    ends = {"load_mass": stub(read_anew, 24_900.0, "load_mass"), "backlash": tried[1][1]}
    _at_first(monkeypatch, tried, lambda _, trial, *__: ends[trial.added])
    after, chosen = one_round(walking(), [])
    assert chosen is not None and chosen[0].effect.name == named and chosen[1] is ends[named]
    assert after[0][1] is ends["load_mass"], "what was tried is told as it ended"


@pytest.mark.parametrize(("per_sample", "looked_at"), [(1.05, ["backlash"]), (1.4, ["backlash", "load_mass"])])
def test_where_the_chosen_effect_follows_whole_runs_nothing_alike_starts_again(per_sample, looked_at, monkeypatch):
    tried = [(score(name, 900.0), stub(error, 25_000.0, name)) for name, error in (("load_mass", 80.0), ("backlash", 60.0))]
    seen = []

    def ended(_, trial, *__):
        seen.append(trial.added)
        end = stub(trial.error, 25_000.0, trial.added)
        end.fit.exact, end.fit.cost_per_sample = "an exact fit", per_sample
        return end

    _at_first(monkeypatch, tried, ended)
    chosen = one_round(walking(), [])[1]
    assert chosen is not None and chosen[0].effect.name == "backlash" and seen == looked_at


@pytest.mark.parametrize(
    ("late", "settled", "more"), [(False, ["backlash", "load_mass"], ["second looks", "led"]), (True, ["backlash"], [])]
)
def test_once_the_time_is_over_only_the_chosen_effect_starts_again_and_nothing_else_is_looked_at(
    late, settled, more, monkeypatch
):
    tried = [(score(name, 900.0), stub(error, 25_000.0, name)) for name, error in (("load_mass", 80.0), ("backlash", 60.0))]
    seen, asked = [], []
    _at_first(monkeypatch, tried, lambda _, trial, *__: seen.append(trial.added) or trial)
    monkeypatch.setattr(walk, "open_to_second_looks", lambda *_: [tried[0][0]])
    monkeypatch.setattr(walk, "second_looks", lambda _current, _scores, found, *_: asked.append("second looks") or found)
    monkeypatch.setattr(walk, "led", lambda _, found, *__: asked.append("led") or found)
    refitter = SimpleNamespace(late=lambda: late, completed=lambda fit: fit)
    chosen = one_round(walking(refitter=refitter), [])[1]
    assert chosen is not None and chosen[0].effect.name == "backlash" and seen == settled and asked == more


def test_three_of_what_promises_as_much_start_again_with_the_chosen_effect(monkeypatch):
    names = ("backlash", "load_mass", "gravity", "friction_lag", "load_spring")
    tried = [(score(name, 900.0), stub(60.0 + i, 25_000.0, name)) for i, name in enumerate(names)]
    seen = []
    _at_first(monkeypatch, tried, lambda _, trial, *__: seen.append(trial.added) or trial)
    one_round(walking(), [])
    assert seen == list(names[:4])


@pytest.mark.parametrize(
    ("left", "seen"), [(8.0, ["load_spring", "gravity"]), (20.0, ["load_spring", "gravity", "friction_lag"])]
)
def test_beside_what_leaves_next_to_nothing_only_what_is_not_far_behind_starts_again(left, seen, monkeypatch):
    errors = (("load_spring", left), ("gravity", left + 2.0), ("friction_lag", 90.0))
    tried = [(score(name, 900.0), stub(error, 25_000.0, name)) for name, error in errors]
    found = []
    _at_first(monkeypatch, tried, lambda _, trial, *__: found.append(trial.added) or trial)
    one_round(walking(), [])
    assert found == seen


@pytest.mark.parametrize(("led_to", "named"), [(1.02, "gravity"), (4.0, "load_spring")])
def test_what_is_led_to_a_better_end_than_the_chosen_effect_takes_its_place(led_to, named, monkeypatch):
    names = (("load_spring", 1.1), ("gravity", 130.0))
    tried = [(score(name, 900.0), stub(error, 25_000.0, name)) for name, error in names]
    end = stub(led_to, 25_000.0, "gravity")
    _at_first(monkeypatch, tried, lambda _, trial, *__: trial)
    monkeypatch.setattr(walk, "led", lambda _, found, *__: [found[0], (found[1][0], end)])
    assert one_round(walking(), [])[1][0].effect.name == named


def test_an_effect_that_does_not_bear_reading_break_away_anew_is_not_accepted(monkeypatch):
    tried = [(score("backlash", 900.0), stub(120.0, 42_900.0, "backlash"))]
    _at_first(monkeypatch, tried, lambda *_: stub(180.0, 42_800.0, "backlash"))
    assert one_round(walking(), [])[1] is None


def test_where_the_leading_effect_does_not_bear_other_starts_a_second_look_finds_what_it_hid(monkeypatch):
    """It explained most, so that nothing else was looked at: a silencer stayed `unknown` behind heat at the walls."""
    heat, silencer = score("heat_transfer", 900.0), score("exhaust_restriction", 20.0)
    looks, ends = [], {"heat_transfer": stub(180.0, 29_000.0, "heat_transfer")}

    def looked(_current, _scores, tried, *_):
        looks.append(tried)
        return [*tried, (silencer, stub(2.0, 26_000.0, "exhaust_restriction"))]

    tried = [(heat, stub(8.0, 30_000.0, "heat_transfer"))]
    _at_first(monkeypatch, tried, lambda _, trial, *__: ends.get(trial.added, trial))
    monkeypatch.setattr(walk, "second_looks", looked)
    _, chosen = one_round(walking(), [heat])
    assert chosen is not None and chosen[0] is silencer
    assert len(looks) == 1 and looks[0][0][1].error == 180.0, "once, and with the end that the other start led to"


@pytest.mark.parametrize(
    ("left", "known_well"),
    [
        ([125.0, 112.0, 95.0], [set(), {"load_mass"}, {"load_mass", "backlash"}, {"backlash", "gravity"}]),
        ([100.0], [set(), set()]),  # three tenths of 145 went
    ],
)
def test_second_looks_are_not_taken_again_where_little_was_gained_since(left, known_well, monkeypatch):
    """A machine that shakes: of 105 floors a soft mounting left 98, a friction like another's 92, and nothing else helped."""
    seen, known = [], [score("load_mass", 900.0), score("backlash", 800.0), score("gravity", 700.0)]

    def looked(_current, _scores, tried, *given):
        seen.append(given[-1])
        return [(one, stub(300.0, 43_000.0, one.effect.name)) for one in known[: len(seen)]]

    _at_first(monkeypatch, [], None)
    monkeypatch.setattr(walk, "second_looks", looked)
    monkeypatch.setattr(walk, "open_to_second_looks", lambda scores, *_: scores)
    here = walking()
    one_round(here, known)
    for error in left:
        here.current = stub(error, 43_000.0, "mounting_compliance")
        one_round(here, known)
    assert seen == known_well


@pytest.mark.parametrize("current", [FIRST, stub(9.0, 26e3, "gravity")])
def test_steps_are_looked_at_in_every_round_by_held_out_runs(current, monkeypatch):
    seen = []
    _at_first(monkeypatch, [], None)
    monkeypatch.setattr(walk, "overtaking", lambda *given: seen.append(given) or [])
    assert one_round(walking(current=current), []) == ([], None) and len(seen) == 1


@pytest.mark.parametrize(
    ("standing", "cost", "usual", "whole", "seen"),
    [
        ("line_delay", 28_000.0, 0.34, 0.5, ["friction_pressure"]),
        ("line_delay", 28_000.0, 0.9, 0.7, ["friction_pressure"]),  # a cushion beside a leak: an eighth of cost and usual error
        ("line_delay", 28_000.0, 1.1, 0.5, []),  # worse on the training runs
        ("line_delay", 28_000.0, 0.34, 1.1, []),  # in some windows of these
        ("line_delay", 32_500.0, 0.34, 0.5, []),  # three per cent of their cost
        (None, 28_000.0, 0.34, 0.5, []),  # beside no effect a second look has other starts
        ("friction_warmup", 28_000.0, 0.34, 0.5, []),  # easily confused with it: it takes up what that one's form leaves
    ],
)
def test_beside_an_effect_what_the_training_runs_show_gets_other_starts_where_the_held_out_ones_deny_it(
    standing, cost, usual, whole, seen, monkeypatch
):
    """Behind a tube friction by pressure took 16 % of the cost and two thirds of the usual error, and held out none."""
    tried = [(score("friction_pressure", 900.0), stub(312.0, cost, "friction_pressure"))]
    found = []
    _at_first(monkeypatch, tried, lambda _, trial, *__: found.append(trial.added) or stub(198.0, cost, trial.added))
    by = {"fits": {"friction_pressure": whole}, "usually_fits": {"friction_pressure": usual}}
    errors = {name: lambda trial, found=found: found.get(trial.added, 1.0) for name, found in by.items()}
    judge = SimpleNamespace(**{**vars(JUDGE), **errors})
    here = walking(judge, current=stub(308.0, 33_469.0, standing))
    here.first = stub(2085.0, 37_831.0)
    here.current.fit.plant.effects = tuple(CATALOGUE[name] for name in [standing] if name)
    chosen = one_round(here, [])[1]
    assert found == seen
    assert (chosen is not None) == bool(seen), "its other end is accepted"
