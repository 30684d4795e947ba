"""What shows at break-away alone: named where all windows bear it out, on held-out and training runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from trials import JUDGE, score, stub, walking

from pneuid.criticism.decision import ascent, walk
from pneuid.criticism.decision.break_away import leading_friction, shown_at_break_away
from pneuid.criticism.refitting.trial import Trial

DWELL = "friction_dwell"


def trial(error: float, whole: float, training: float, added: str | None = None, servo: bool = True) -> Trial:
    """A trial with squared errors of the usual held-out windows, of all of them, and of the training runs."""
    made = replace(stub(error, 26_000.0, added), whole=whole, train={"x": training})
    made.fit.plant = SimpleNamespace(servo=servo, effects=[])  # type: ignore[attr-defined]
    return made


BASE = trial(2.0, 8.2, 300.0)
JUDGED = SimpleNamespace(**vars(JUDGE) | {"fits": lambda one: one.train["x"]})


@pytest.mark.parametrize(
    ("error", "whole", "training", "named"),
    [
        (1.4, 2.0, 86.0, True), (1.4, 5.0, 86.0, False), (2.1, 2.0, 86.0, False), (2.01, 2.0, 86.0, True),
        # nearly all of the usual excess stands for the training runs, which then must not get worse
        (1.15, 4.0, 280.0, True), (1.15, 4.0, 310.0, False), (1.3, 4.0, 280.0, False),
    ],
)  # fmt: skip
def test_half_of_all_windows_and_of_the_training_runs_or_nearly_all_of_the_usual_excess(error, whole, training, named):
    assert shown_at_break_away(trial(error, whole, training, DWELL), BASE, JUDGED) is named


@pytest.mark.parametrize(
    ("standing", "found"),
    [(BASE, DWELL), (trial(2.0, 1.9, 300.0), None), (trial(2.0, 8.2, 300.0, servo=False), None)],
)
def test_the_friction_that_promises_most_is_looked_at_where_much_is_left_on_a_servo_rig(standing, found):
    tried = [(score(name, drop), stub(2.0, 26_000.0, name)) for name, drop in
             (("load_mass", 90.0), ("friction_position", 20.0), (DWELL, 30.0))]  # fmt: skip
    pair = leading_friction(tried, standing, JUDGED)
    assert (None if pair is None else pair[0].effect.name) == found
    assert leading_friction(tried[:1], BASE, JUDGED) is None


def test_where_screening_sees_chance_the_friction_that_predicts_the_training_runs_best_is_looked_at():
    pressure, dwell = (score("friction_pressure", 3.8), trial(1.4, 3.2, 46.0)), (score(DWELL, 2.0), trial(1.6, 2.0, 5.0))
    assert leading_friction([pressure, dwell], BASE, JUDGED) is dwell
    assert leading_friction([(score("friction_pressure", 38.0), pressure[1]), dwell], BASE, JUDGED)[1] is pressure[1]


@pytest.mark.parametrize(("loud", "named"), [(1.1, [DWELL]), (1.9, [])])
def test_it_is_named_where_no_balance_leaves_a_defect(loud, named, monkeypatch):
    """The refit that nothing was accepted for is settled, and stands once on the ladder."""
    here, first = walking(JUDGED, current=BASE), (score(DWELL, 30.0), trial(1.95, 7.0, 290.0, DWELL))
    monkeypatch.setattr(walk, "loudest", lambda _: loud)
    monkeypatch.setattr(walk, "settled", lambda *_: trial(1.4, 2.0, 86.0, DWELL))
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    monkeypatch.setattr(walk, "leaves_much", lambda *_: False)
    for name, made in {
        "_cannot_judge": False, "_screened": [], "_round": ([first], None), "_record": None, "_by_all_runs": False
    }.items():  # fmt: skip
        monkeypatch.setattr(walk.Walk, name, lambda *_, made=made, **__: made)
    monkeypatch.setattr(walk.Walk, "rung", lambda _, one, accepted: (one.added, accepted))
    assert here.step() is bool(named)
    assert here.named == named and here.rungs == [(DWELL, bool(named))]
    assert any("from 2.86 to 1.41 floors" in words for words in here.moved) is bool(named)


def test_what_does_not_show_at_break_away_is_no_rival_of_what_does(monkeypatch):
    """Without the windows of break-away all that were tried predict alike."""
    here, dwell = walking(JUDGED, current=trial(1.25, 4.6, 70.0)), (score(DWELL, 30.0), trial(1.25, 1.7, 5.0, DWELL))
    other = (score("friction_position", 3.0), trial(1.24, 3.9, 60.0, "friction_position"))
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    for name, made in {"loudest": 1.1, "settled": dwell[1], "leaves_much": False}.items():
        monkeypatch.setattr(walk, name, lambda *_, made=made: made)
    for name, made in {"_cannot_judge": False, "_screened": [], "_round": ([dwell, other], None), "_record": None}.items():
        monkeypatch.setattr(walk.Walk, name, lambda *_, made=made, **__: made)
    monkeypatch.setattr(walk.Walk, "rung", lambda _, one, accepted: (one.added, accepted))
    assert here.step() and here.ambiguous == {DWELL: ()}


@pytest.mark.parametrize(
    ("ahead", "loud", "named"), [(9.0, 1.9, ["valve_lag", DWELL]), (4.0, 1.9, ["valve_lag"]), (4.0, 1.1, ["valve_lag"])]
)
def test_beside_another_effect_what_stands_out_is_looked_at_however_loud_the_balances(ahead, loud, named, monkeypatch):
    here, first = walking(JUDGED, current=BASE), (score(DWELL, 30.0, ahead=ahead), trial(1.95, 7.0, 290.0, DWELL))
    here.named = ["valve_lag"]
    for name, made in {"loudest": loud, "settled": trial(1.4, 2.0, 86.0, DWELL), "leaves_much": False}.items():
        monkeypatch.setattr(walk, name, lambda *_, made=made: made)
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    for name, made in {"_cannot_judge": False, "_screened": [], "_round": ([first], None), "_record": None}.items():
        monkeypatch.setattr(walk.Walk, name, lambda *_, made=made, **__: made)
    monkeypatch.setattr(walk.Walk, "rung", lambda _, one, accepted: (one.added, accepted))
    here.step()
    assert here.named == named
    said = [words for words in here.moved if "screening expects far more of it" in words and "2.86 to 1.41 floors" in words]
    assert bool(said) is (DWELL in named)
