"""A recorded supply pressure: its noise goes, what moves stays, and a rig that lacks nothing leaves noise alone."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import rig
from hypothesis import given, settings
from hypothesis import strategies as st

from pneuid.api import plant_of
from pneuid.estimation.preparation import noise_of, prepare
from pneuid.estimation.supply import smoothed_supply
from pneuid.recording import Recording
from pneuid.virtual_rig import NOTHING, TruthServo, record_servo

NOISE = 470.0
T = np.arange(4000) * 1e-3
EVERY = np.ones(T.size)
STEADY = np.full(T.size, 8e5)
DROOPING = 8e5 - 3e4 * np.abs(np.sin(2.0 * T)) ** 3
OPENED = 8e5 - 2e4 * (T % 1.0 < 0.3) * np.exp(-(T % 1.0) / 0.1)


def smoothed(pressure, seed=1, noise=NOISE, recorded=EVERY):
    measured = pressure + noise * np.random.default_rng(seed).standard_normal(pressure.size)
    return smoothed_supply(T, measured, noise, recorded), measured


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("seed", range(5))
def test_of_a_steady_supply_next_to_nothing_of_the_noise_is_left(seed):
    assert rms(smoothed(STEADY, seed)[0].pressure - STEADY) < 0.08 * NOISE
    assert rms(smoothed(8e5 - 1e3 * T, seed)[0].pressure - (8e5 - 1e3 * T)) < 0.08 * NOISE


@pytest.mark.parametrize("seed", range(5))
def test_a_droop_is_followed_to_a_fraction_of_the_noise(seed):
    found, _ = smoothed(DROOPING, seed)
    assert rms(found.pressure - DROOPING) < 0.2 * NOISE
    assert 3.0 < found.bandwidth < 30.0


def test_what_moves_faster_than_the_noise_can_hide_stays_about_as_it_was_recorded():
    found, measured = smoothed(OPENED)
    assert rms(found.pressure - OPENED) < 1.0 * rms(measured - OPENED)
    assert found.bandwidth > 50.0


def test_missing_samples_are_bridged_and_their_fillings_do_not_count():
    recorded = EVERY.copy()
    recorded[1000:1100] = 0.0
    wrong = DROOPING.copy()
    wrong[1000:1100] = 0.0
    found = smoothed_supply(T, wrong + NOISE * np.random.default_rng(3).standard_normal(T.size), NOISE, recorded).pressure
    assert np.abs(found - DROOPING)[1000:1100].max() < 3.0 * NOISE


def test_a_record_without_noise_and_a_short_one_stay_as_they_are():
    assert smoothed_supply(T, OPENED, 0.0, EVERY).pressure is OPENED
    assert smoothed_supply(T[:4], OPENED[:4], NOISE, EVERY[:4]).pressure.tolist() == OPENED[:4].tolist()


@settings(max_examples=25, deadline=None)
@given(
    level=st.floats(2e5, 1e6), size=st.floats(0.0, 1e5), rate=st.floats(0.1, 5.0), noise=st.floats(1.0, 2e3),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_smoothing_never_makes_a_smooth_pressure_worse(level, size, rate, noise, seed):
    pressure = level + size * np.sin(2.0 * np.pi * rate * T)
    found, measured = smoothed(pressure, seed, noise)
    assert np.isfinite(found.pressure).all()
    assert rms(found.pressure - pressure) < rms(measured - pressure)


def test_uneven_sampling_and_units_of_time_do_not_matter():
    kept = np.sort(np.random.default_rng(4).choice(T.size, 2500, replace=False))
    _, measured = smoothed(DROOPING)
    whole = smoothed_supply(T[kept], measured[kept], NOISE, EVERY[kept])
    slower = smoothed_supply(10.0 * T[kept], measured[kept], NOISE, EVERY[kept])
    assert rms(whole.pressure - DROOPING[kept]) < 0.25 * NOISE
    np.testing.assert_allclose(slower.pressure, whole.pressure, atol=0.05 * NOISE)
    assert slower.bandwidth == pytest.approx(0.1 * whole.bandwidth, rel=0.2)


def test_a_prepared_run_has_the_smoothed_supply_and_says_so():
    run = record_servo(TruthServo(), NOTHING, "multisine", 2.0, 5)
    noisy = 7e5 + NOISE * np.random.default_rng(6).standard_normal(run["t"].size)
    stand = rig()
    plain, recorded = (Recording.from_arrays("a.csv", stand, **(run | more)) for more in ({}, {"psup": noisy}))
    plant = plant_of(stand)
    prepared = prepare(recorded, plant, noise_of(stand, [recorded]))
    assert rms(prepared.input("psup") - 7e5) < 0.1 * NOISE
    assert rms(prepared.data[1 + 2 + prepared.inputs.index("psup")]) < 1e-2 * NOISE / 1e-3, "its slope is no noise either"
    assert any("psup smoothed by its noise" in note for note in prepared.notes)
    stated = prepare(plain, plant, noise_of(stand, [plain]))
    assert np.ptp(stated.input("psup")) == 0.0 and not any("psup" in note for note in stated.notes)
