"""What the numbers of a fit are worth: profile likelihood, outliers, quantities of one run, bounds."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers import TRUTH, rig, servo_run

from pneuid.errors import UserError
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.profile import LEVEL, profile
from pneuid.estimation.robust import FAR, HUBER, outliers, pseudo_values
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import NOTHING, Friction, random_servo, record_servo

SECONDS = 1.5


def run_of(bar: int, seed: int, stand=None, spikes: int = 0, stated: str | None = None) -> Recording:
    """A short run at ``bar``; ``spikes`` single samples far off in x and p1; ``stated`` is the name the rig knows it by."""
    whole = servo_run("multisine", bar, seed)
    count = int(SECONDS * 1000)
    signals = {name: whole.signals[name][:count].copy() for name in ("u", "x", "p1", "p2")}
    rng = np.random.default_rng(seed)
    for name, size in (("x", 2e-3), ("p1", 4e4)):
        at = rng.choice(np.arange(50, count - 50, 7), spikes, replace=False)
        signals[name][at] += size * rng.choice([-1.0, 1.0], spikes)
    return Recording.from_arrays(stated or whole.name, stand or rig(), t=whole.t[:count], **signals)


@cache
def short_fit(spikes: int = 0) -> Fit:
    return fit(Plant(rig(), "lugre"), [run_of(5, 11, spikes=spikes), run_of(7, 12, spikes=spikes)])


# --- profile likelihood ---


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Fc", "C"])
def test_where_the_cost_is_a_parabola_the_profile_is_the_standard_error(name):
    found = short_fit()
    item = profile(found, name)
    assert found.stage == "exact" and item.low is not None and item.high is not None
    assert np.all(np.diff(item.values) > 0) and item.rise.min() == pytest.approx(0.0, abs=0.05)
    assert item.low < item.estimate < item.high and max(item.rise[0], item.rise[-1]) > LEVEL
    j = found.plant.parameter_names.index(name)
    half = np.sqrt(LEVEL) * found.spread.std[j]
    assert item.high - item.estimate == pytest.approx(half, rel=0.1)
    assert item.estimate - item.low == pytest.approx(half, rel=0.1)


def test_a_profile_says_why_it_cannot_be_had():
    found = short_fit()
    with pytest.raises(UserError, match="is not fitted; did you mean 'Fc'"):
        profile(found, "Fcc")
    relaxed = fit(found.plant, [run.recording for run in found.runs], found.values, exact=False)
    with pytest.raises(UserError, match="the fit is relaxed"):
        profile(relaxed, "Fc")


# --- outliers ---


def test_single_samples_far_off_are_found_and_only_they():
    rng = np.random.default_rng(4)
    t = np.arange(3000) / 1000.0
    y = 0.1 * np.sin(2 * np.pi * 3.0 * t) + rng.normal(0.0, 2e-5, t.size)
    at = np.array([200, 901, 2500])
    y[at] += [1e-3, -6e-4, 5e-3]  # 30 noise levels and more; below 15 a sample may hide in the curvature
    found, _ = outliers(y, 2e-5)
    np.testing.assert_array_equal(np.flatnonzero(found), at)
    drawn, same = pseudo_values(y, 2e-5)
    np.testing.assert_array_equal(same, found)
    assert np.array_equal(drawn[~found], y[~found])
    assert np.all(np.abs(drawn[at] - 0.1 * np.sin(2 * np.pi * 3.0 * t[at])) < (HUBER + 5.0) * 2e-5)


@pytest.mark.parametrize("shape", ["step", "kink", "noise"])
def test_what_moves_its_neighbours_too_is_no_outlier(shape):
    rng = np.random.default_rng(5)
    y = rng.normal(0.0, 1.0, 4000)
    y += {"step": 50.0 * (np.arange(4000) > 2000), "kink": 5.0 * np.maximum(np.arange(4000) - 2000, 0), "noise": 0.0}[shape]
    assert FAR >= 6.0 and not outliers(y, 1.0)[0].any()


@pytest.mark.parametrize("seed", [10404, 10414])
def test_what_a_slow_logger_sees_of_a_quick_stroke_is_no_outlier(seed):
    # 150 Hz: a chamber that is compressed before an end rises by a third from sample to sample, and falls as fast
    drawn = random_servo(seed)
    assert drawn.rate < 200.0
    record = record_servo(drawn.truth, NOTHING, "travel", 10.0, seed, rate=drawn.rate, sensors=drawn.sensors)
    noises = {"x": drawn.sensors.x_noise, "p1": drawn.sensors.p_noise, "p2": drawn.sensors.p_noise}
    for name, noise in noises.items():
        assert not outliers(record[name], noise)[0].any(), name
        record[name][700] += 300.0 * noise
        assert list(np.flatnonzero(outliers(record[name], noise)[0])) == [700], name


@pytest.mark.slow
def test_spikes_neither_bias_the_fit_nor_pass_in_silence():
    clean, spiked = short_fit(), short_fit(20)
    assert spiked.stage == "exact"
    assert sum("20 samples of" in note and "Huber" in note for note in spiked.notes) == 4, spiked.notes
    for j, name in enumerate(clean.plant.parameter_names):
        assert abs(spiked.values[name] - clean.values[name]) < 3.0 * clean.spread.std[j], name


# --- quantities of one run ---


@pytest.mark.slow
def test_supply_and_mass_free_in_one_run_are_recovered():
    stand = rig(runs={
        "s5.csv": {"supply": "500 kPa"},
        "odd.csv": {"supply": "600 kPa", "mass": "3.5 kg", "free": ["supply", "mass"]},
    })  # fmt: skip
    found = fit(Plant(stand, "lugre"), [run_of(5, 11, stand), run_of(7, 12, stand, stated="odd.csv")])
    supply, mass = found.values["supply@odd.csv"], found.values["mass@odd.csv"]
    assert supply == pytest.approx(7e5 + 101325.0, rel=0.01)
    assert mass == pytest.approx(2.4, rel=0.05)
    assert found.values["C"] == pytest.approx(TRUTH["C"], rel=0.02)


# --- what the data do not hold ---


def test_without_a_static_surplus_the_stribeck_velocity_is_said_to_be_not_visible():
    found = fit(Plant(rig(), "lugre"), [run_of_dahl(5, 21), run_of_dahl(7, 22)])
    assert found.stage == "exact"
    assert found.values["Fs"] == pytest.approx(12.0, rel=0.01) and found.values["Fc"] == pytest.approx(12.0, rel=0.01)
    assert found.verdicts["vs"] == "not visible" and found.verdicts["Fc"] == "well determined"


def run_of_dahl(bar: int, seed: int) -> Recording:
    """A rig whose static friction is not above the sliding one."""
    whole = servo_run("multisine", bar, seed, friction=Friction(Fc=12.0, Fs=12.0))
    count = int(SECONDS * 1000)
    return Recording.from_arrays(
        whole.name, rig(), t=whole.t[:count], **{name: whole.signals[name][:count] for name in ("u", "x", "p1", "p2")}
    )
