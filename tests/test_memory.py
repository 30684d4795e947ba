"""Slow states of effects, carried from window to window."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import RANGES, base_fit, held_runs, rig, values_of

from pneuid.criticism.prediction import horizons, window_starts
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.memory import CERTAIN, carried
from pneuid.effects import effects_by_name
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant

W = 30
SPREAD = np.array([1.0])


def _case(time_constant: float, noise: float, seed: int = 0):
    """A state that began 0.9 above where it was taken to begin; windows every 0.2 s, two of them far off."""
    at = 0.2 * np.arange(W)[:, None]
    followed = 0.1 * at
    truth = followed + 0.9 * np.exp(-at / time_constant)
    found = truth + noise * np.random.default_rng(seed).standard_normal((W, 1))
    found[[9, 17]] -= 0.8
    return truth, followed, found, at / time_constant


def test_a_lasting_state_is_known_from_the_windows_before_and_outliers_do_not_count():
    truth, followed, found, forgotten = _case(90.0, 0.05)
    guess, sigma = carried(found, followed, forgotten, SPREAD)
    late = slice(5, None)
    assert np.max(np.abs(guess[late] - truth[late])) < 0.05
    assert np.max(np.abs(found[late] - truth[late])) > 0.7
    assert np.all(sigma[late] < 0.2) and np.all(sigma >= CERTAIN)


def test_nothing_is_carried_on_before_enough_is_known():
    _, followed, found, forgotten = _case(90.0, 0.05)
    guess, sigma = carried(found, followed, forgotten, SPREAD)
    np.testing.assert_array_equal(guess[:2], followed[:2])
    np.testing.assert_array_equal(sigma[:2], 1.0)


def test_a_window_is_told_nothing_by_those_after_it():
    _, followed, found, forgotten = _case(90.0, 0.05)
    before, _ = carried(found, followed, forgotten, SPREAD)
    found[20:] += 5.0
    after, _ = carried(found, followed, forgotten, SPREAD)
    np.testing.assert_array_equal(after[:20], before[:20])


def test_a_state_that_forgets_is_found_by_each_window_itself():
    _, followed, found, forgotten = _case(0.3, 0.05)
    guess, sigma = carried(found, followed, forgotten, SPREAD)
    np.testing.assert_array_equal(guess, followed)
    np.testing.assert_array_equal(sigma, 1.0)


@pytest.mark.parametrize(("name", "changes", "lasts"), [
    ("friction_warmup", {"w_warm": 0.3, "tau_warm": 60.0}, True), ("valve_lag", {"tau_valve": 4e-3}, False),
])  # fmt: skip
def test_a_prediction_carries_a_warmth_from_window_to_window_and_no_spool(name, changes, lasts, monkeypatch):
    plant = Plant(rig(), "lugre", effects_by_name([name]))
    base = base_fit()
    model = Frozen(plant, values_of(plant, changes), RANGES, base.noise, base.problem.substeps)
    run = prepare(held_runs()[0], plant, base.noise)
    made, estimate = [], window_starts.start_states
    monkeypatch.setattr(window_starts, "start_states", lambda *given: made.append(given[-1]) or estimate(*given))
    _, start = horizons.ahead_of(model, model.function([run]), run, run.data)
    spread = plant.effect_states[0].spread
    assert len(made) == (2 if lasts else 1)
    assert np.all(start.prior[0, -1] == spread)
    assert np.all(start.prior[5:, -1] < spread) if lasts else np.all(start.prior[:, -1] == spread)
