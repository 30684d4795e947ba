"""What the training runs leave open of the parameters is not taken for a missing effect, and a missing effect not for that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import rig

from pneuid.criticism.decision.all_runs import SHOWN_DROP
from pneuid.criticism.decision.verdict import diagnose
from pneuid.criticism.prediction.unsettled import unsettled
from pneuid.criticism.prediction.window_starts import Starts, stretched
from pneuid.criticism.refitting.trial import judge_of
from pneuid.criticism.screening.scores import Score, screen
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import BENCH_SENSORS, Friction, Hidden, TruthBench, record_bench, strokes
from pneuid.virtual_rig.hidden import NOTHING

CREEPING, SLOW, FAST = (1e-3, 2e-3, 4e-3), (1e-3, 3e-3, 0.012), (0.03, 0.25)
"""Stroke speeds, m/s: below the Stribeck velocity of 8 mm/s; with a viscous part of half a newton in 0.6 N of noise; fast."""

SENSORS = {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa", "F": "0.2 N"}}


def recorded(name: str, speeds: tuple[float, ...], seed: int, hidden: Hidden = NOTHING) -> Recording:
    """Strokes at ``speeds`` on the default bench."""
    motion = strokes(speeds, longest=0.8, dwell=0.4)
    stand = rig("bench", SENSORS)
    made = record_bench(TruthBench(friction=Friction()), 4e5, 3e5, motion, hidden, seed, sensors=BENCH_SENSORS)
    return Recording.from_arrays(name, stand, **made)


@cache
def fitted(hidden: Hidden = NOTHING, seed: int = 10, speeds: tuple[float, ...] = SLOW) -> Fit:
    runs = [recorded(f"slow_{i}.csv", speeds, 100 * seed + i, hidden) for i in (1, 2)]
    return fit(Plant(rig("bench", SENSORS), "lugre"), runs, exact=False)


@pytest.mark.parametrize("seed", [10, 12, 16])
def test_speeds_that_no_training_run_reached_are_no_missing_effect(seed):
    base, held = fitted(seed=seed, speeds=CREEPING), [recorded("fast.csv", FAST, 100 * seed + 3)]
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in held])
    trial = judge.trial(base)
    assert trial.error - 1.0 > 10 * judge.small, "creeping strokes must leave sliding friction open"
    assert judge.explains(trial)


@pytest.mark.parametrize("seed", [10, 12, 16])
def test_a_simulated_fit_to_slow_strokes_predicts_fast_ones(seed):
    """With jumps the viscous friction of half a newton was left open, and fast strokes were 1.6 floors off and more."""
    base, held = fitted(seed=seed), [recorded("fast.csv", FAST, 100 * seed + 3)]
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in held])
    jumping = judge.trial(replace(base, values=base.values | base.relaxed_values))
    assert judge.trial(base).error - 1.0 < judge.small < 0.1 * (jumping.error - 1.0)


def test_the_verdict_says_that_the_training_runs_leave_it_open():
    base, held = fitted(speeds=CREEPING), [recorded("fast.csv", FAST, 1003)]
    found = diagnose(base, held, CATALOGUE).diagnosis
    assert found.verdict == "adequate"
    assert any("train on runs that cover" in sentence for sentence in found.sentences)


def test_what_all_runs_show_is_named_although_the_held_out_runs_cannot_judge_it():
    hidden = Hidden(friction_direction=0.03)
    base, held = fitted(hidden), [recorded("fast.csv", FAST, 1003, hidden)]
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in held])
    trial = judge.trial(base)
    assert judge.explains(trial) and not judge.learned(trial)
    found = diagnose(base, held, CATALOGUE).diagnosis
    # what slow strokes say of the viscous friction in either direction predicts fast ones worse than the base model does
    assert found.verdict == "unknown" and found.effects == ("friction_direction",)
    assert any("all runs together show" in sentence for sentence in found.sentences)


def test_what_is_open_vanishes_on_runs_like_the_training_runs():
    base, held = fitted(), [recorded("slow.csv", SLOW, 3)]
    runs = [prepare(run, base.plant, base.noise) for run in held]
    judge = judge_of(base, runs)
    assert unsettled(base, runs, judge.usual) < 0.02
    assert judge.trial(base).error - 1.0 < judge.small


def test_a_missing_effect_is_not_taken_for_open_parameters():
    hidden = Hidden(load_spring=200.0)
    base, held = fitted(hidden), [recorded("slow.csv", SLOW, 3, hidden)]
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in held])
    trial = judge.trial(base)
    assert trial.error - 1.0 > judge.small
    assert not judge.explains(trial)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_bristle_of_a_bench_does_not_relax_at_rest(seed):
    """Wide kinks of ``|v|`` let it: jumps of 1.5 um in every 20 ms at rest, and a Fc that is 8 % off."""
    dwelling = recorded("dwells.csv", (2e-3, 0.012, 0.06), seed)
    found = fit(Plant(rig("bench", SENSORS), "lugre"), [dwelling], exact=False)
    problem, X = found.problem, found.relaxed.X
    end, _ = problem.evaluate_values(X)
    jumps = problem.defects(end, X)[:, 0] * problem.state_scale[0]
    speed = np.abs(found.runs[0].motion.v)
    at_rest = np.array([speed[k * problem.samples : (k + 1) * problem.samples].max() for k in problem.linked]) == 0.0
    assert at_rest.sum() > 50
    assert np.sqrt(np.mean(jumps[at_rest] ** 2)) < 0.6e-6
    assert found.values["Fc"] == pytest.approx(12.0, rel=0.03)


def test_a_spring_that_would_have_to_push_is_screened_from_the_other_side():
    """At its usual force-free position it promises nothing here; a metre away it pulls as the rig's does."""

    def spring(base: Fit) -> Score:
        (found,) = screen(base, [CATALOGUE["load_spring"]], list(CATALOGUE))
        return found

    there = spring(fitted(Hidden(load_spring=200.0)))
    assert there.shapes == {"x_free": 1.0} and there.drop > 1e4
    assert there.whole_start == {**there.start, "x_free": 1.0}
    absent = spring(fitted())
    assert not absent.shapes and absent.drop < 3.0


def test_what_only_the_held_out_runs_excite_is_named_by_all_of_them():
    """A mass that is wrong shows in strokes that turn fast, of which training has none."""
    hidden = Hidden(load_mass=0.5)
    base, held = fitted(hidden), [recorded("fast.csv", FAST, 1003, hidden)]
    trained = max(score.drop for score in screen(base, list(CATALOGUE.values()), list(CATALOGUE)))
    found = diagnose(base, held, CATALOGUE).diagnosis
    assert trained < SHOWN_DROP
    assert found.effects == ("load_mass",) and any("all runs together show" in sentence for sentence in found.sentences)


def test_a_stiffer_bristle_starts_with_the_same_force():
    states = np.array([[0.1, 0.0, 4e-5], [0.2, 0.0, -2e-5]])
    found = stretched(Starts(states, np.ones_like(states)), 2, 0.5)
    np.testing.assert_allclose(found.states, states * [1.0, 1.0, 0.5])
    np.testing.assert_allclose(stretched(states, 2, 0.5), states * [1.0, 1.0, 0.5])
    assert states[0, 2] == 4e-5, "the known starts stay as they are"
