"""What a round accepts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from trials import ALONE, FIRST, JUDGE, score, stub

from pneuid.criticism.decision import acceptance
from pneuid.criticism.refitting.trial import Trial
from pneuid.effects import CATALOGUE

INSIDE = acceptance.inside_bounds


@pytest.fixture(autouse=True)
def _amplitudes_are_inside(monkeypatch):
    monkeypatch.setattr(acceptance, "inside_bounds", lambda *_: True)
    monkeypatch.setattr(acceptance, "unresolved", lambda *_: False)


def _foretold(monkeypatch, fits: tuple[float, float], usual: tuple[float, float]) -> None:
    """Squared errors on the training runs, of all windows and of the usual ones, before and with what is tried."""
    monkeypatch.setattr(JUDGE, "fits", lambda trial: fits[trial.added is not None])
    monkeypatch.setattr(JUDGE, "usually_fits", lambda trial: usual[trial.added is not None])


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
    found = acceptance.accepted(tried, current, FIRST, JUDGE)
    assert (found is not None) == taken


@pytest.mark.parametrize(
    ("error", "fits", "usual", "cost", "taken"),
    [
        (1.3, 50.0, 1.0, 26_300.0, True),  # 20.8 to 7 floors on the training runs, 95 % of the excess; the cost rose
        (1.3, 150.0, 1.0, 26_300.0, False),  # the training runs are predicted hardly better
        (1.3, 450.0, 0.2, 26_300.0, True),  # they are but for the worst windows
        (1.3, 450.0, 0.3, 26_300.0, False),
        (3.0, 50.0, 0.2, 26_300.0, False),  # two thirds of the excess
        (3.0, 50.0, 1.0, 26_000.0, True),  # which is enough where the cost falls
        (1.3, 150.0, 1.0, 26_000.0, True),
    ],
)
def test_where_break_away_is_at_stake_predictions_of_both_kinds_of_runs_take_the_place_of_the_cost(
    error, fits, usual, cost, taken, monkeypatch
):
    """A rest's effect at its right size: the relaxed cost was higher than without it, whose zigzag had stopped elsewhere."""
    current = stub(7.2, 26_150.0)
    tried = [(score("friction_dwell", 10.0), stub(error, cost, "friction_dwell"))]
    _foretold(monkeypatch, (432.0, fits), (1.0, usual))
    assert (acceptance.accepted(tried, current, current, JUDGE) is not None) == taken


@pytest.mark.parametrize(
    ("error", "fits", "usual", "cost", "taken"),
    [
        (30.0, 70.0, 35.0, 31_300.0, True),  # a leak past the spool beside a soft mounting, 5.5 floors left of 14
        (30.0, 70.0, 110.0, 31_300.0, False),  # another cause, mostly a base model at a wrong optimum
        (30.0, 240.0, 35.0, 31_300.0, False),
        (30.0, 70.0, 35.0, 33_000.0, False),  # a tenth dearer
        (45.0, 70.0, 35.0, 31_300.0, False),  # 77 % of the excess
    ],
)
def test_far_off_both_errors_of_the_training_runs_have_to_fall_where_the_cost_does_not(
    error, fits, usual, cost, taken, monkeypatch
):
    current = stub(197.0, 29_800.0)
    tried = [(score("valve_null_leakage", 1400.0), stub(error, cost, "valve_null_leakage"))]
    _foretold(monkeypatch, (920.0, fits), (425.0, usual))
    assert (acceptance.accepted(tried, current, current, JUDGE) is not None) == taken


@pytest.mark.parametrize(
    ("ahead", "error", "fits", "usual", "cost", "taken"),
    [
        (20.0, 2.6, 12.6, 4.8, 28_200.0, True),
        (4.0, 2.6, 12.6, 4.8, 28_200.0, False),  # as much is expected of others
        (20.0, 3.6, 12.6, 4.8, 28_200.0, False),  # less than half of the excess
        (20.0, 2.6, 300.0, 4.8, 28_200.0, False),  # the training runs are foretold hardly better
        (20.0, 2.6, 12.6, 80.0, 28_200.0, False),
        (20.0, 2.6, 12.6, 4.8, 30_100.0, False),  # a tenth dearer
    ],
)
def test_what_is_expected_of_nothing_else_and_foretold_by_both_kinds_of_runs_may_cost_more(
    ahead, error, fits, usual, cost, taken, monkeypatch
):
    current = stub(6.0, 27_300.0)
    tried = [(score("friction_presliding_memory", 600.0, ahead=ahead), stub(error, cost, "friction_presliding_memory"))]
    _foretold(monkeypatch, (542.0, fits), (109.0, usual))
    assert (acceptance.accepted(tried, current, current, JUDGE) is not None) == taken


@pytest.mark.parametrize(
    ("error", "cost", "taken"), [(6.0, 26_000.0, True), (12.0, 26_000.0, False), (6.0, 26_500.0, False)]
)
def test_beside_a_strong_first_effect_a_second_one_must_explain_nearly_all_that_is_left(error, cost, taken):
    """The first brought 402 400, more than any second one can: here 83 or 63 % of what is left, 6 or 4 % of its cost."""
    tried = [(score("valve_dead_zone", 500.0), stub(error, cost, "valve_dead_zone"))]
    found = acceptance.accepted(tried, ALONE, stub(14_500.0, 430_000.0), JUDGE)
    assert (found is not None) == taken


@pytest.mark.parametrize(
    ("name", "ahead", "error", "usual", "cost", "taken"),
    [
        ("friction_presliding_memory", 9.0, 4.0, 0.5, 27_500.0, True),  # 0.4 % of the cost, nine tenths of what is left
        ("friction_presliding_memory", 4.0, 4.0, 0.5, 27_500.0, False),  # screening expects as much of others
        ("friction_presliding_memory", 9.0, 4.0, 0.5, 27_590.0, False),  # chance
        ("friction_presliding_memory", 9.0, 20.0, 0.6, 27_500.0, True),  # a third of it, foretold by the training runs
        ("friction_presliding_memory", 9.0, 20.0, 0.7, 27_500.0, False),
        ("friction_presliding_memory", 9.0, 26.0, 0.4, 27_500.0, True),  # a sixth, and half of the training runs' errors
        ("friction_presliding_memory", 9.0, 26.0, 0.6, 27_500.0, False),
        ("friction_presliding_memory", 9.0, 28.5, 0.4, 27_500.0, False),  # less than a tenth
        ("valve_dead_zone", 9.0, 26.0, 0.4, 27_500.0, False),  # on the balance whose own form may leave it
        ("valve_dead_zone", 9.0, 4.0, 0.4, 27_500.0, False),  # and easily confused with what stands
    ],
)
def test_what_stands_out_beside_another_effect_need_not_take_a_part_of_the_cost(
    name, ahead, error, usual, cost, taken, monkeypatch
):
    standing = stub(30.8, 27_600.0, "valve_null_leakage")
    standing.fit.plant.effects = (CATALOGUE["valve_null_leakage"],)
    first, trial = stub(14_500.0, 430_000.0), stub(error, cost, name)
    monkeypatch.setattr(JUDGE, "fits", lambda trial: min(usual, 0.45) if trial is not standing else 1.0)
    monkeypatch.setattr(JUDGE, "usually_fits", lambda trial: usual if trial is not standing else 1.0)
    found = acceptance.accepted([(score(name, 60.0, ahead=ahead), trial)], standing, first, JUDGE)
    assert (found is not None) == taken
    by_chance = [(score(name, 14.0, ahead=ahead), trial)]
    assert acceptance.accepted(by_chance, standing, first, JUDGE) is None, "chance stands out of nothing"


@pytest.mark.parametrize(
    ("left", "error", "usual", "taken"),
    [
        (535.0, 34.8, 0.18, True),  # 23 floors and 5.9
        (535.0, 130.0, 0.18, False),  # three quarters of what is left
        (535.0, 34.8, 0.6, False),  # but not half of that on the training runs
        (95.0, 6.0, 0.18, False),  # a form may leave nine floors
    ],
)
def test_far_off_a_lag_s_form_is_not_what_hysteresis_beside_it_mends(left, error, usual, taken, monkeypatch):
    standing = stub(left, 47_348.0, "valve_lag")
    standing.fit.plant.effects = (CATALOGUE["valve_lag"],)
    first, trial = stub(14_148.0, 143_754.0), stub(error, 44_002.0, "valve_hysteresis")
    for name in ("fits", "usually_fits"):
        monkeypatch.setattr(JUDGE, name, lambda trial: usual if trial is not standing else 1.0)
    found = acceptance.accepted([(score("valve_hysteresis", 3000.0), trial)], standing, first, JUDGE)
    assert (found is not None) == taken


@pytest.mark.parametrize(
    ("name", "error", "usual", "whole", "cost", "taken"),
    [
        ("load_spring", 12.0, 22.0, 30.0, 27_000.0, True),  # 63 % of what is left, half of it on the training runs
        ("load_spring", 12.0, 27.0, 30.0, 27_000.0, False),  # but not of the usual windows there
        ("load_spring", 12.0, 22.0, 40.0, 27_000.0, False),  # nor of all
        ("load_spring", 17.0, 22.0, 30.0, 27_000.0, False),  # less than half held out
        ("load_spring", 12.0, 22.0, 30.0, 27_590.0, False),  # no more of the cost than chance
        ("valve_dead_zone", 12.0, 22.0, 30.0, 27_000.0, False),  # what is confused with the leak that stands may be its form
    ],
)
def test_what_halves_what_is_left_of_both_kinds_of_runs_need_not_take_what_a_form_does(
    name, error, usual, whole, cost, taken
):
    """A spring beside friction by pressure took 4.7 % of what that had brought, and 78 % of what was left of either."""
    standing = stub(30.8, 27_600.0, "valve_null_leakage")
    standing.fit.plant = SimpleNamespace(servo=False, effects=(CATALOGUE["valve_null_leakage"],))
    judge = SimpleNamespace(**{
        **vars(JUDGE), "usually_fits": lambda trial: 50.0 if trial is standing else usual,
        "fits": lambda trial: 70.0 if trial is standing else whole,
    })  # fmt: skip
    found = acceptance.accepted([(score(name, 500.0), stub(error, cost, name))], standing, FIRST, judge)
    assert (found is not None) == taken


def test_costs_are_compared_with_loose_defects_where_one_has_no_others():
    """A base model too wrong for tight ones: what a later effect brings with tight ones says nothing beside it."""

    def mixed(error: float, loose: float, tight: float) -> Trial:
        found = stub(error, tight, "leakage_internal")
        found.fit.loose_cost = loose
        return found

    first = stub(15_000.0, 67_100.0, relaxation=1.0)
    current, offset = mixed(63.0, 26_300.0, 35_700.0), mixed(40.0, 25_600.0, 30_300.0)
    assert acceptance.costs(first, current, offset) == [67_100.0, 26_300.0, 25_600.0]
    assert acceptance.costs(current, offset) == [35_700.0, 30_300.0]
    assert acceptance.accepted([(score("valve_offset", 5e3), offset)], current, first, JUDGE) is None
    # what takes nearly all that is left, and shows with tight defects, stands although loose ones absorb it
    gravity = mixed(6.0, 26_100.0, 27_000.0)
    assert acceptance.accepted([(score("gravity", 5e3), gravity)], current, first, JUDGE) is not None
    # a quarter of it is enough where the training runs are predicted far better too
    bends = [(score("friction_viscous_nonlinear", 5e3), mixed(47.0, 26_100.0, 29_800.0))]
    assert acceptance.accepted(bends, current, first, JUDGE) is None
    for usual, taken in ((0.6, True), (0.7, False)):
        by = {id(current): 1.0, id(bends[0][1]): usual}
        judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial, by=by: by[id(trial)]})
        assert (acceptance.accepted(bends, current, first, judge) is not None) is taken
    # but on the balance of what stands, whose own form may leave that; a sensor reads what every balance leaves
    for standing, taken in (("valve_dead_zone", True), ("friction_direction", False), ("sensor_lag_p1", False)):
        current.fit.plant.effects = (CATALOGUE[standing],)
        judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial: 0.6 if trial is bends[0][1] else 1.0})
        assert (acceptance.accepted(bends, current, first, judge) is not None) is taken
    # nor there where it stands out, takes a fifth of the cost with tight defects, and leaves half of what was left
    current.fit.plant.effects = (CATALOGUE["valve_hysteresis"],)
    for ahead, tight, error, taken in (
        (41.5, 28_000.0, 31.0, True), (4.0, 28_000.0, 31.0, False),
        (41.5, 29_000.0, 31.0, False), (41.5, 28_000.0, 33.0, False),
    ):  # fmt: skip
        volume = mixed(error, 25_600.0, tight)
        judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial, own=volume: 0.6 if trial is own else 1.0})
        found = acceptance.accepted([(score("dead_volume", 8e3, ahead=ahead), volume)], current, first, judge)
        assert (found is not None) is taken
    current.fit.plant.effects = ()
    unseen = mixed(6.0, 26_100.0, 35_000.0)
    assert acceptance.accepted([(score("gravity", 5e3), unseen)], current, first, JUDGE) is None


@pytest.mark.parametrize(
    ("name", "cost", "taken"),
    [
        ("channel_skew", 26_500.0, False),
        ("channel_skew", 26_300.0, True),
        ("gravity", 26_500.0, True),
        ("channel_skew", 26_900.0, False),
    ],
)
def test_what_is_easily_confused_with_an_accepted_effect_must_bring_a_part_of_what_that_brought(name, cost, taken):
    """A sensor that averages left nine tenths of its rest to a skew of all channels: 2.4 % of what the lag had brought."""
    current = stub(6.8, 28_000.0, "sensor_lag_p2")
    current.fit.plant.effects = (CATALOGUE["sensor_lag_p2"],)
    judge = SimpleNamespace(**{**vars(JUDGE), "fits": lambda trial: 1.0 if trial.added == name else 10.0})
    other = [(score(name, 1800.0), stub(1.4, cost, name))]
    found = acceptance.accepted(other, current, stub(340.0, 60_000.0), judge)
    assert (found is not None) is taken


@pytest.mark.parametrize(
    ("left", "cost", "alone"), [(22.6, 6579.0, True), (12.0, 6579.0, False), (22.6, 6200.0, False), (14.0, 6579.0, True)]
)
def test_what_takes_a_part_of_the_errors_at_break_away_and_nothing_of_the_cost_only_moves_it(left, cost, alone):
    """Of 25.9 squared floors on a rig that was sampled 2.2 times a swing, each of five effects took 3, and 15 of 6594."""
    assert acceptance.moves_break_away_alone(stub(left, cost, "inlet_mixing"), stub(25.9, 6594.0)) is alone


@pytest.mark.parametrize(("standing", "unseen", "taken"), [(20.0, 4.0, True), (20.0, 13.0, False), (30.0, 13.0, True)])
def test_a_gain_read_off_the_judged_runs_themselves_does_not_count(standing, unseen, taken):
    """A warmth that starts anew in each run is a free level of friction: without it 4 or 13 of 20 squared floors are left.

    Where a warmth stands already, it does without that level as well, and leaves 30 then.
    """
    current, warm = stub(20.0, 30_000.0), stub(2.0, 25_000.0, "friction_warmup")
    judge = SimpleNamespace(**{**vars(JUDGE), "unseen": lambda trial: standing if trial is current else unseen})
    found = acceptance.accepted([(score("friction_warmup", 5e3), warm)], current, current, judge)
    assert (found is not None) is taken


def test_the_best_on_held_out_runs_is_accepted_not_the_best_on_training_runs():
    tried = [(score("gravity", 900.0), stub(20.0, 26_000.0)), (score("load_mass", 800.0), stub(10.0, 27_000.0))]
    found = acceptance.accepted(tried, FIRST, FIRST, JUDGE)
    assert found is not None and found[0].effect.name == "load_mass"


@pytest.mark.parametrize(
    ("error", "usual", "cost", "taken"),
    [
        (3.33, 3.8, 19_619.0, "friction_dwell"),
        (3.33, 12.0, 19_619.0, "friction_direction"),  # the training runs hardly tell them either
        (3.33, 3.8, 19_632.0, "friction_direction"),  # it costs more
        (3.43, 3.8, 19_619.0, "friction_direction"),  # noise tells them held out
    ],
)
def test_what_noise_does_not_tell_apart_held_out_the_training_runs_tell(error, usual, cost, taken):
    """Friction by direction stood in for a static friction that grows at rest: 14 squared floors of training, not 4."""
    current, direction = stub(4.04, 19_700.0), stub(3.21, 19_631.0, "friction_direction")
    dwell, by = stub(error, cost, "friction_dwell"), {None: 10.6, "friction_direction": 14.4, "friction_dwell": usual}
    judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial: by[trial.added]})
    tried = [(score("friction_direction", 70.0), direction), (score("friction_dwell", 80.0), dwell)]
    found = acceptance.accepted(tried, current, current, judge)
    assert found is not None and found[0].effect.name == taken


@pytest.mark.parametrize(
    ("error", "usual", "cost", "taken"),
    [
        (32.6, 23.4, 53_587.0, "backlash"),
        (45.0, 23.4, 53_587.0, "mounting_compliance"),  # not far better held out
        (32.6, 45.0, 53_587.0, "mounting_compliance"),  # nor on the training runs
        (32.6, 23.4, 57_000.0, "mounting_compliance"),  # has not converged
    ],
)
def test_far_off_what_predicts_all_runs_far_better_is_accepted_in_place_of_what_is_cheaper(error, usual, cost, taken):
    """Of two relaxed fits whose jumps leave noise the cheaper one predicted by 8.9 floors, the right one by 5.7."""
    current, mounting = stub(164.4, 52_585.0), stub(79.2, 51_661.0, "mounting_compliance")
    by = {None: 99.5, "mounting_compliance": 50.1, "backlash": usual}
    judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial: by[trial.added]})
    play = (score("backlash", 4.0), stub(error, cost, "backlash"))
    assert acceptance.accepted([play], current, current, judge) is None, "alone its cost says nothing for it"
    both = [(score("mounting_compliance", 13.0), mounting), play]
    found = acceptance.accepted(both, current, current, judge)
    assert found is not None and found[0].effect.name == taken
    by |= {"backlash": max(usual, 30.0)}
    near = [(both[0][0], stub(8.0, 51_661.0, "mounting_compliance")), (play[0], stub(2.0, cost, "backlash"))]
    found = acceptance.accepted(near, stub(20.0, 52_585.0), stub(20.0, 52_585.0), judge)
    assert found is not None and found[0].effect.name == "mounting_compliance", "within three floors the cost counts"
    by |= {"backlash": usual}
    # its gain read off the judged runs, it is not accepted by this way either; nor beside what it is confused with
    judge.unseen = lambda trial: 150.0 if trial.added == "backlash" else trial.error
    found = acceptance.accepted(both, current, current, judge)
    assert found is not None and found[0].effect.name == "mounting_compliance"
    judge.unseen, current.fit.plant.effects = JUDGE.unseen, (CATALOGUE[CATALOGUE["backlash"].confused_with[0]],)
    found = acceptance.accepted(both, current, current, judge)
    assert found is None or found[0].effect.name == "mounting_compliance"


@pytest.mark.parametrize(
    ("error", "cost", "usual", "best", "taken"),
    [
        (47.1, 39_000.0, 20.0, 39.6, "friction_pressure"),
        (50.0, 39_000.0, 20.0, 39.6, "friction_position"),  # a quarter more of the held-out excess
        (47.1, 53_000.0, 20.0, 39.6, "friction_position"),  # less than three times as much of the training cost
        (47.1, 39_000.0, 70.0, 39.6, "friction_position"),  # the training runs are predicted worse
        (9.5, 39_000.0, 20.0, 8.9, "friction_position"),  # within three floors the held-out runs decide
    ],
)
def test_far_off_the_training_runs_choose_between_what_explains_as_little(error, cost, usual, best, taken):
    """Friction by the pressure across a seal, which no affine law holds: 6.9 floors with one, 6.3 with friction over x."""
    current = stub(132.0, 100_000.0)
    tried = [
        (score("friction_position", 16_000.0), stub(best, 84_000.0, "friction_position")),
        (score("friction_pressure", 61_000.0), stub(error, cost, "friction_pressure")),
    ]
    by = {None: 100.0, "friction_position": 60.0, "friction_pressure": usual}
    judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial: by[trial.added]})
    found = acceptance.accepted(tried, current, current, judge)
    assert found is not None and found[0].effect.name == taken


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


@pytest.mark.parametrize(
    ("lacking", "before", "drop", "taken"),
    [(True, 2.27, 13.8, True), (False, 2.27, 13.8, False), (True, 1.45, 13.8, False), (True, 2.27, 2.0, False)],
)
def test_where_no_parameters_follow_the_runs_a_small_fall_of_the_cost_is_enough(lacking, before, drop, taken):
    """Loose jumps hide all but a little of a friction that bends with speed; held-out 2.27 -> 1.60 floors."""
    current = stub(before**2, 50_577.0)
    current.fit.lacking = lacking
    tried = [(score("friction_viscous_nonlinear", 13.0), stub(1.0 + 0.4 * (before**2 - 1.0), 50_577.0 - drop))]
    found = acceptance.accepted(tried, current, current, JUDGE)
    assert (found is not None) == taken
