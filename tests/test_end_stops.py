"""A piston that strikes an end stop: what is masked, where the model starts anew, what predictions leave out."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import TRUTH, base_fit, rig, servo_run

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import predict_ahead
from pneuid.effects import effects_by_name
from pneuid.estimation.end_stops import stretches
from pneuid.estimation.first_guess import first_states
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import data_ranges, noise_of, prepare
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.thinning import section
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import ATMOSPHERE, NOTHING, TruthServo, run_open_loop

STROKE = 0.33
STAND = rig("servo", {"cylinder": {"stroke": f"{1e3 * STROKE} mm"}})


@cache
def struck(bar: int, seed: int) -> Recording:
    """3 s of a multisine made for a longer cylinder: the piston runs into the end and back."""
    u = servo_run("multisine", bar, seed).signals["u"]
    supply = bar * 1e5 + ATMOSPHERE
    out = run_open_loop(replace(TruthServo(), stroke=STROKE), NOTHING, u, 1e-3, x0=0.2, supply=supply)
    rng = np.random.default_rng(seed)
    noise = {"x": 20e-6, "p1": 500.0, "p2": 500.0}
    measured = {name: out[name] + sigma * rng.standard_normal(u.size) for name, sigma in noise.items()}
    return Recording.from_arrays(
        f"struck{bar}.csv", STAND, t=1e-3 * np.arange(u.size), u=u, psup=np.full(u.size, supply), **measured
    )


@cache
def struck_fit() -> Fit:
    return fit(Plant(STAND, "lugre"), [struck(5, 11), struck(7, 12)])


def problem_of(recording: Recording, *effects: str) -> Shooting:
    plant = Plant(STAND, "lugre", effects_by_name(effects))
    run = prepare(recording, plant, noise_of(STAND, [recording]))
    return Shooting(plant, [run], ["Fc"], plant.starts(), data_ranges([recording], plant), 1)


@pytest.mark.parametrize(
    ("touching", "first", "held"),
    [
        ("....|....|....", [0], "....|....|...."),
        ("....|..#.|....", [0, 2], "....|..--|...."),  # what follows in the interval is not concluded upon
        ("....|..##|#...|....", [0, 3], "....|..--|----|...."),
        ("....|..##|...#|....|....", [0, 2, 3], "....|..--|...-|....|...."),
        ("....|..##|.###|....", [0, 3], "....|..--|----|...."),  # a sample tells no speed
        ("####|....|....", [0, 1], "----|....|...."),
        ("....|####|####", [0], "....|----|----"),
    ],
)
def test_a_stretch_ends_at_a_contact_and_the_next_begins_clear_of_it(touching, first, held):
    samples = np.array([c == "#" for c in touching.replace("|", "")])
    starts, kept = stretches(samples, 4)
    assert starts.tolist() == first
    assert kept.tolist() == [c == "." for c in held.replace("|", "")]


def test_the_model_starts_anew_after_a_contact_and_nowhere_else():
    problem = problem_of(struck(5, 11))
    run, K = problem.runs[0], problem.samples
    starts, held = stretches(run.contact, K)
    assert starts.size > 1
    np.testing.assert_array_equal(problem.stretches, starts)
    assert set(range(problem.nint - 1)) - set(problem.linked) == set(starts[1:] - 1)
    priors = (problem.priors[0][problem.priors[0] >= problem.nq] - problem.nq) // problem.ns
    assert set(priors) == set(starts), "the bristle of every fresh start is held near rest"
    weights = problem.data[-3:, : run.n]
    np.testing.assert_array_equal(weights > 0, np.tile(held, (3, 1)))
    assert problem.weighted == 3 * held.sum()


def test_a_contact_sets_no_clock_back():
    problem = problem_of(struck(5, 11), "spline:force(t)")
    index, centre, _ = problem.priors
    clock = problem.plant.states.index("since_spline_force_t")
    at = index[(index >= problem.nq) & ((index - problem.nq) % problem.ns == clock)]
    times = centre[np.isin(index, at)] * problem.state_scale[clock]
    assert times.size > 1 and times[0] == 0.0
    np.testing.assert_allclose(times, problem.runs[0].t[problem.stretches * problem.samples], atol=1e-9)
    run = problem.runs[0]
    followed = first_states(problem.plant, run, run.motion, problem.values)[0][clock]
    np.testing.assert_allclose(followed, run.t, rtol=1e-3, atol=1e-6)
    later = section(run, 1000, 2000)
    followed = first_states(problem.plant, later, later.motion, problem.values)[0][clock]
    np.testing.assert_allclose(followed, later.t, rtol=1e-3, err_msg="a section goes on from its run")


def test_a_run_that_keeps_clear_of_the_ends_is_one_stretch():
    problem = base_fit().problem
    assert not any(run.contact.any() for run in problem.runs)
    np.testing.assert_array_equal(problem.stretches, problem.first[:-1])


def test_friction_is_recovered_from_runs_that_strike_the_end():
    found = struck_fit()
    assert found.stage == "exact"
    for name, within in (("Fc", 0.01), ("sigma2", 0.01), ("n", 0.005), ("C", 0.005), ("Fs", 0.1)):
        assert abs(found.values[name] / TRUTH[name] - 1.0) < within, (name, found.values[name])


def test_what_is_predicted_behind_a_contact_does_not_count():
    found = struck_fit()
    predicted = predict_ahead(Frozen.of(found), found.runs)[0]
    run = predicted.run
    behind = np.zeros(run.n, dtype=bool)
    before, window = 100, 300  # samples of a window's start, and of all of it
    for first in range(0, run.n - window + 1, window - before):
        touched = np.logical_or.accumulate(run.contact[first : first + window])
        behind[first + before : first + window] = touched[before:]
    assert behind[predicted.index].any() and not behind[predicted.index].all()
    np.testing.assert_array_equal(predicted.used[0], ~behind[predicted.index])
