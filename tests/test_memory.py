"""Slow states of effects, carried from window to window."""

from __future__ import annotations

import numpy as np

from pneuid.criticism.memory import CERTAIN, carried

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
