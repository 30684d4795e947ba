"""What the verdict says of the place where a walk ended."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from trials import JUDGE, stub

from pneuid.criticism.decision import verdict
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown

REST = Unknown("force", ("x",), 1.0, "N")


@pytest.fixture(autouse=True)
def _ends(monkeypatch):
    monkeypatch.setattr(verdict, "explained_away", lambda trial, judge: judge.explains(trial))
    monkeypatch.setattr(verdict, "_rest", lambda _: REST)


def said_of(before: float, after: float, judge: SimpleNamespace = JUDGE, by_all_runs: bool = False, partly: bool = False):
    """Of a walk from ``before`` to ``after`` squared floors by one effect."""
    walk = SimpleNamespace(
        named=["gravity"], first=stub(before, 1e4), current=stub(after, 1e3, "gravity"), judge=judge, ranking={},
        by_all_runs=by_all_runs, partly=partly, ambiguous={}, lacking=None, beyond=False,
    )  # fmt: skip
    return verdict._verdict(walk)


@pytest.mark.parametrize(
    ("before", "after", "said", "rest"),
    [(400.0, 1.1, "effect", False), (400.0, 2.2, "effect", False), (400.0, 2.3, "effect", True), (20.0, 2.2, "effect", False),
     (10.0, 2.2, "effect", True), (30.0, 20.0, "unknown", True)],
)  # fmt: skip
def test_a_rest_is_reported_where_a_tenth_of_the_excess_is_left_or_one_and_a_half_floors(before, after, said, rest):
    found = said_of(before, after)
    assert (found.verdict, found.unknown is REST) == (said, rest)
    assert ("a part of the error remains" in " ".join(found.sentences)) == rest


@pytest.mark.parametrize(
    ("before", "after", "excused", "by_all_runs", "said"),
    [
        (700.0, 37.0, False, False, "unknown"),  # six floors and a twentieth of the excess
        (700.0, 35.0, False, False, "effect"),
        (800.0, 37.0, False, False, "effect"),
        (700.0, 37.0, True, False, "unknown"),  # open parameters do not excuse as much
        (700.0, 37.0, False, True, "effect"),
    ],
)
def test_what_leaves_six_floors_and_a_twentieth_stands_beside_something_larger(before, after, excused, by_all_runs, said):
    """A sensor whose gain drifts passed for its offset: 81 % explained, and 13 floors left."""
    judge = SimpleNamespace(**vars(JUDGE) | {"explains": lambda _: excused})
    found = said_of(before, after, judge, by_all_runs)
    assert (found.verdict, found.effects) == (said, ("gravity",))


@pytest.mark.parametrize(
    ("excused", "learned", "said"), [(True, True, "effect"), (False, True, "unknown"), (True, False, "unknown")]
)
def test_runs_of_which_noise_is_left_and_that_say_little_of_the_others_show_nothing_larger(excused, learned, said):
    """Friction by pressure left noise of the training runs, and nine floors of held-out runs at other pressures."""
    judge = SimpleNamespace(**vars(JUDGE) | {"explains": lambda _: excused, "learned": lambda _: learned})
    assert said_of(370.0, 81.0, judge).verdict == said


@pytest.mark.parametrize(
    ("before", "after", "by_all_runs", "said"),
    [
        (20.0, 9.0, False, "unknown"),  # 58 % of the excess, three floors
        (15.0, 6.3, False, "unknown"),
        (15.0, 6.2, False, "effect"),  # less than 2.5 floors
        (20.0, 7.2, False, "effect"),  # two thirds of the excess
        (20.0, 9.0, True, "effect"),
    ],
)
def test_what_leaves_a_third_and_some_floors_stands_beside_something_larger(before, after, by_all_runs, said):
    """Heat at the walls in place of a supply that warms up: 53 % explained, and 3.1 floors left."""
    assert said_of(before, after, by_all_runs=by_all_runs).verdict == said


@pytest.mark.parametrize(
    ("before", "after", "by_all_runs", "said", "rest"),
    [(45.0, 34.0, False, "unknown", True), (45.0, 34.0, True, "effect", False), (25.0, 8.9, False, "effect", False),
     # the effect stands, but a function may explain more than it does
     (110.0, 34.0, False, "effect", True), (500.0, 34.0, False, "effect", False)],
)  # fmt: skip
def test_open_parameters_do_not_excuse_an_effect_that_explains_little_and_leaves_much(before, after, by_all_runs, said, rest):
    """Beside a magnet friction by place took a quarter, and the training runs left open what stayed."""
    excusing = SimpleNamespace(**vars(JUDGE) | {"explains": lambda _: True})
    found = said_of(before, after, excusing, by_all_runs)
    assert (found.verdict, found.effects, found.unknown is REST) == (said, ("gravity",), rest)


@pytest.mark.parametrize(("partly", "said"), [(True, "unknown"), (False, "effect")])
def test_what_all_runs_show_and_hardly_predicts_stands_beside_something_else(partly, said):
    found = said_of(4.3, 3.5, by_all_runs=True, partly=partly)
    assert (found.verdict, found.effects, found.unknown is REST) == (said, ("gravity",), partly)


@pytest.mark.parametrize(
    ("exact", "after", "said"), [(None, 9.1, "unknown"), (None, 8.9, "adequate"), (SimpleNamespace(), 9.1, "adequate")]
)
def test_a_model_far_off_at_break_away_that_has_no_exact_fit_is_not_adequate(exact, after, said, monkeypatch):
    monkeypatch.setattr(verdict, "loudest", lambda _: 1.2)
    current = stub(after, 1e4)
    current.fit.exact = exact
    walk = SimpleNamespace(current=current, judge=JUDGE, lacking=None, beyond=False)
    found = verdict._nothing_named(walk, ["so far"], (), slow=False, adequate=False)
    assert found.verdict == said and found.sentences[0] == "so far"
    assert (verdict.AT_BREAK_AWAY in found.sentences) == (said == "unknown")


@pytest.mark.parametrize(
    ("whole", "fits", "exact", "said"),
    [(236.0, 309.0, None, "unknown"), (8.9, 309.0, None, "adequate"), (236.0, 8.9, None, "adequate"),
     (236.0, 309.0, SimpleNamespace(), "adequate")],
)  # fmt: skip
def test_usual_windows_at_noise_do_not_clear_a_model_far_off_in_the_others_of_both_kinds_of_runs(whole, fits, exact, said):
    """Static friction three times too high: 1.06 floors in the usual windows, 15 in all, 17 of the training runs."""
    current = replace(stub(1.12, 1e4), whole=whole)
    current.fit.exact = exact
    judge = SimpleNamespace(**{**vars(JUDGE), "fits": lambda _: fits})
    walk = SimpleNamespace(current=current, judge=judge, lacking=None, beyond=False)
    found = verdict._nothing_named(walk, ["so far"], (), slow=False, adequate=True)
    assert found.verdict == said and (verdict.AT_BREAK_AWAY in found.sentences) == (said == "unknown")
    assert verdict._nothing_named(walk, ["so far"], (), slow=True, adequate=True).verdict == "adequate"


@pytest.mark.parametrize(("after", "said"), [(9.0, "unknown"), (2.3, "unknown"), (2.2, "adequate"), (1.01, "adequate")])
def test_a_model_that_cannot_follow_its_training_runs_is_not_adequate(after, said, monkeypatch):
    monkeypatch.setattr(verdict, "loudest", lambda _: 1.2)
    current = stub(after, 1e4)
    current.fit.exact, current.fit.lacking = SimpleNamespace(), True
    walk = SimpleNamespace(current=current, judge=JUDGE, lacking=None, beyond=False)
    found = verdict._nothing_named(walk, ["so far"], (), slow=False, adequate=True)
    assert found.verdict == said and (verdict.CANNOT_FOLLOW in found.sentences) == (said == "unknown")


@pytest.mark.parametrize(
    ("steps", "drops", "calls"),
    [
        ([True, False], [False], "ssb"),
        ([True, False, True, False], [True, False], "ssbssb"),  # dropped: the smaller model is asked again
        ([True] * 4, [False], "ssssb"),
        ([False], [False], "sb"),
        ([False] * 4, [True] * 5, "sbsbsbsbb"),
    ],
)
def test_what_is_dropped_from_a_walk_is_followed_by_another_round(steps, drops, calls):
    made, steps, drops = [], iter(steps), iter(drops)
    walk = SimpleNamespace(
        step=lambda: (made.append("s"), next(steps))[1], backward=lambda: (made.append("b"), next(drops))[1],
        refitter=SimpleNamespace(late=lambda: False),
    )  # fmt: skip
    verdict.climb(walk)  # type: ignore[arg-type]
    assert "".join(made) == calls


@pytest.mark.parametrize("late", [True, False])
def test_a_diagnosis_whose_time_was_over_says_so(late, monkeypatch):
    replaced = {
        "judge_of": lambda *_: SimpleNamespace(**vars(JUDGE), trial=lambda _: stub(9.0, 1e4), held=()),
        "too_slow": lambda _: None, "uncovered": lambda *_: [], "climb": lambda _: None,
        "_verdict": lambda *_: Diagnosis("unknown", (), ()),
    }  # fmt: skip
    for name, stand_in in replaced.items():
        monkeypatch.setattr(verdict, name, stand_in)
    monkeypatch.setattr(verdict.Walk, "rung", lambda *_: None)
    base, refitter = SimpleNamespace(plant=None, noise=None), SimpleNamespace(late=lambda: late)
    found = verdict.diagnose(base, [], {}, refitter=refitter)
    assert (verdict.OUT_OF_TIME in found.diagnosis.sentences) == late


def test_no_round_begins_once_the_time_is_over():
    made, times = [], iter([False, True, True])
    walk = SimpleNamespace(
        step=lambda: made.append("s") or True, backward=lambda: bool(made.append("b")),
        refitter=SimpleNamespace(late=lambda: next(times)),
    )  # fmt: skip
    verdict.climb(walk)  # type: ignore[arg-type]
    assert "".join(made) == "sb"


@pytest.mark.parametrize(
    ("equation", "part", "told"), [("flow_1", 0.018, True), ("flow_1", 0.06, False), ("friction", 0.018, False)]
)
def test_a_later_effect_of_little_weight_on_the_same_balance_may_mend_the_first_ones_form(equation, part, told):
    """Beside a dead zone with rounded laps a critical ratio took 1.8 % of the excess; nothing else was hidden."""
    ranking = {
        "valve_dead_zone": Candidate("valve_dead_zone", "valve", 0.17, excess_explained=0.967),
        "other": Candidate("other", equation, 0.014, excess_explained=part),
    }
    walk = SimpleNamespace(
        named=["valve_dead_zone", "other"], first=stub(142.0, 1e4), current=stub(3.0, 1e3, "other"), judge=JUDGE,
        ranking=ranking, by_all_runs=False, partly=False, ambiguous={}, lacking=None, beyond=False,
    )  # fmt: skip
    found = verdict._verdict(walk)
    assert found.effects == ("valve_dead_zone", "other")
    said = [words for words in found.sentences if "may only make up" in words]
    assert bool(said) == told
    assert not told or ("other brings 1.8 % of it" in said[0] and "as valve_dead_zone" in said[0])


@pytest.mark.parametrize(
    ("rivals", "said", "effects", "beside"),
    [
        ({"load_mass": ("backlash",)}, "ambiguous", ("gravity", "load_mass", "backlash"), ("gravity",)),
        ({"gravity": ("load_spring",)}, "ambiguous", ("gravity", "load_spring", "load_mass"), ("load_mass",)),
        ({"gravity": ("load_spring",), "load_mass": ("backlash",)}, "ambiguous",
         ("gravity", "load_spring", "load_mass", "backlash"), ()),
        ({"load_mass": ("gravity",)}, "effect", ("gravity", "load_mass"), ()),
    ],
)  # fmt: skip
def test_a_later_effect_that_others_cannot_be_told_from_is_ambiguous_too(rivals, said, effects, beside):
    walk = SimpleNamespace(
        named=["gravity", "load_mass"], first=stub(400.0, 1e4), current=stub(1.1, 1e3, "load_mass"), judge=JUDGE,
        ranking={}, by_all_runs=False, partly=False, ambiguous=rivals, lacking=None, beyond=False,
    )  # fmt: skip
    found = verdict._verdict(walk)
    assert (found.verdict, found.effects, found.beside) == (said, effects, beside)
    groups = tuple((name, *others) for name, others in rivals.items()) if said == "ambiguous" else ()
    assert found.choices == groups, "the weightiest doubt first"
