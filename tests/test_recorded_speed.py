"""A bench that records its speed: how position and speed together give the motion."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import cho_solve_banded

from pneuid.api import plant_of
from pneuid.criticism.prediction import noise_floor
from pneuid.estimation import motion
from pneuid.estimation.fit import fit
from pneuid.estimation.motion import Speed, refined_motion
from pneuid.estimation.preparation import noise_of, prepare
from pneuid.estimation.whittaker import differences
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import TruthBench, record_bench
from pneuid.virtual_rig.motion import Motion, reciprocation, strokes

RIG = Rig.from_dict(
    {
        "kind": "bench",
        "friction": "lugre",
        "conventions": {"pressure": "abs"},
        "cylinder": {"bore": "32 mm", "rod": "12 mm", "stroke": "500 mm"},
        "load": {"mass": "1 kg"},
    }
)
FINE, COARSE, TACHO = 40e-9, 20e-6, 20e-6
"""Noise of two positions (m) and of a speed (m/s)."""

MOVED = strokes((1e-3, 5e-3, 60e-3), start=0.15, travel=0.02, longest=1.0, rate=1000.0)
LIVELY = strokes((20e-3, 60e-3, 150e-3), start=0.1, travel=0.05, longest=1.0, rate=250.0, acceleration=10.0)


def measured(motion: Motion, noise: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Position (m) with ``noise`` and speed (m/s) with that of a tachometer."""
    drawn = np.random.default_rng(seed).standard_normal((2, motion.t.size))
    return motion.x + noise * drawn[0], motion.v + TACHO * drawn[1]


def wrong(v: np.ndarray, motion: Motion = MOVED) -> float:
    """RMS error of a speed, m/s."""
    return float(np.sqrt(np.mean((v - motion.v) ** 2)))


@pytest.mark.parametrize("noise", [FINE, 1e-6, COARSE])
def test_both_sensors_tell_more_than_either(noise):
    x, v = measured(MOVED, noise)
    alone, both = (refined_motion(MOVED.t, x, noise, speed) for speed in (None, Speed(v, TACHO)))
    assert wrong(both.v) < 0.7 * min(wrong(alone.v), TACHO)
    assert both.speed_noise == pytest.approx(TACHO)
    assert alone.speed_noise is None


@pytest.mark.parametrize("motion", [MOVED, LIVELY], ids=["1 kHz", "250 Hz"])
def test_a_speed_without_noise_stays_as_it_is(motion):
    x, _ = measured(motion, 1e-6)
    found = refined_motion(motion.t, x, 1e-6, Speed(motion.v, 1e-9))
    assert wrong(found.v, motion) < 1e-8
    assert wrong(refined_motion(motion.t, x, 1e-6).v, motion) > 3e-6


def test_where_the_motion_is_lively_for_its_sampling_differences_of_the_position_do_not_overrule_the_speed():
    x, v = measured(LIVELY, 1e-6)
    found = refined_motion(LIVELY.t, x, 1e-6, Speed(v, TACHO))
    assert wrong(found.v, LIVELY) < 0.7 * TACHO
    assert wrong(refined_motion(LIVELY.t, x, 1e-6).v, LIVELY) > 5.0 * TACHO
    assert found.speed_noise == pytest.approx(TACHO)


def test_uneven_time():
    kept = np.sort(np.random.default_rng(4).permutation(MOVED.t.size)[: MOVED.t.size * 4 // 5])
    x, v = measured(MOVED, 1e-6)
    found = refined_motion(MOVED.t[kept], x[kept], 1e-6, Speed(v[kept], TACHO))
    assert np.sqrt(np.mean((found.v - MOVED.v[kept]) ** 2)) < 0.7 * TACHO


def test_rest_is_rest_and_a_creep_below_the_noise_of_the_position_is_none():
    motion = reciprocation(amplitude=20e-6, cycles=2)
    x, v = measured(motion, COARSE)
    found = refined_motion(motion.t, x, COARSE, Speed(v, TACHO))
    still = motion.t < 0.03
    assert np.mean(found.v[still] == 0.0) > 0.8
    moving = np.abs(motion.v) > 0.0
    assert np.mean(found.v[moving] == 0.0) < 0.02
    assert wrong(found.v, motion) < TACHO


@pytest.mark.parametrize("own", [lambda v: 1.02 * v, lambda v: v + 0.5e-3], ids=["gain", "offset"])
def test_a_speed_that_leads_away_from_the_position_counts_less_and_is_told(own):
    x, v = measured(MOVED, 1e-6)
    run = Recording.from_arrays("run.csv", RIG, t=MOVED.t, x=x, v=own(v), F=np.sign(MOVED.v))
    prepared = prepare(run, plant_of(RIG), noise_of(RIG, [run]))
    assert prepared.motion.speed_noise > 3.0 * TACHO
    assert wrong(prepared.motion.v) < 1.3 * wrong(refined_motion(MOVED.t, x, 1e-6).v)
    assert any("recorded v does not follow x" in note and "mm/s" in note for note in prepared.notes)


@pytest.mark.parametrize("place", [0.5, 0.3, 0.0])
def test_a_rest_at_the_edge_of_a_code_is_rest_and_a_creep_of_codes_is_none(place):
    """Where an encoder toggles it shows half a step, and codes on average no more than 0.29 of one."""
    code, t = 0.1e-6, np.arange(3000) * 1e-3
    moved = 0.02 * np.clip(t - 1.5, 0.0, 0.5)
    jitter = 0.1 * code * np.random.default_rng(8).standard_normal(t.size)
    still, creeping = (code * np.round((x + place * code + jitter) / code) for x in (moved, moved + 10e-6 * t))
    noise, rest = 0.33 * code, (t > 0.1) & (t < 1.4)
    assert np.mean(refined_motion(t, still, noise).v[rest] == 0.0) > 0.95
    assert np.mean(refined_motion(t, creeping, noise).v[rest] == 0.0) < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_a_bristle_that_unloads_below_the_noise_of_a_window_does_not_rest(seed):
    """By 40 um in 0.15 s: half the noise of the position in ten samples, and with 0.9 N/um 36 N of force."""
    t, noise = np.arange(4000) * 1e-3, 4.5e-6
    speed = -40e-6 / 0.15
    x = 0.1 + speed * np.clip(t - 2.0, 0.0, 0.15) + noise * np.random.default_rng(seed).standard_normal(t.size)
    found = refined_motion(t, x, noise)
    unloading, rest = (t > 2.02) & (t < 2.13), (t < 1.9) | (t > 2.25)
    assert np.sum(found.v[unloading]) * 1e-3 == pytest.approx(speed * 0.11, rel=0.25)
    assert np.mean(found.v[rest] == 0.0) > 0.9


def test_draws_have_the_covariance_of_the_smoothed_motion():
    s = np.cumsum(np.random.default_rng(2).uniform(0.8, 1.2, 30))
    D, variance = differences(s, motion.ORDER), np.full(27, 0.5)
    rate = motion._Rate(motion._rates(s), np.zeros(30), 0.4)
    rng = np.random.default_rng(3)
    factor = motion._factor(D, variance, rate)
    smoothed = np.array([cho_solve_banded(factor, motion._drawn(D, variance, rate, rng)) for _ in range(4000)])
    np.testing.assert_allclose(smoothed.var(axis=0), np.diag(cho_solve_banded(factor, np.eye(30))), rtol=0.15)


def test_the_speed_counts_only_where_all_runs_have_it():
    x, v = measured(MOVED, 1e-6)
    force = np.sign(MOVED.v)
    with_it = Recording.from_arrays("with.csv", RIG, t=MOVED.t, x=x, v=v, F=force)
    without = Recording.from_arrays("without.csv", RIG, t=MOVED.t, x=x, F=force)
    assert noise_of(RIG, [with_it])["v"] == pytest.approx(TACHO, rel=0.05)
    noise = noise_of(RIG, [with_it, without])
    assert "v" not in noise
    assert prepare(with_it, plant_of(RIG), noise).motion.speed_noise is None
    # a held-out run without it is smoothed by its position
    assert prepare(without, plant_of(RIG), noise_of(RIG, [with_it])).motion.speed_noise is None


def test_the_noise_floor_is_drawn_with_the_noise_of_both_sensors(monkeypatch):
    x, v = measured(MOVED, 1e-6)
    run = Recording.from_arrays("run.csv", RIG, t=MOVED.t, x=x, v=v, F=np.sign(MOVED.v))
    prepared = prepare(run, plant_of(RIG), noise_of(RIG, [run]))
    drawn = []

    def smoothed(_t, _x, _noise, speed):
        drawn.append(speed)
        return prepared.motion

    monkeypatch.setattr(noise_floor, "refined_motion", smoothed)
    monkeypatch.setattr(noise_floor, "free_run", lambda *given: [SimpleNamespace(predicted=given[-1][-2:-1])])
    model = SimpleNamespace(plant=plant_of(RIG), noise=noise_of(RIG, [run]))
    noise_floor._drawn_bench(model, None, prepared)(np.random.default_rng(3))
    (speed,) = drawn
    assert speed.noise == pytest.approx(prepared.motion.speed_noise)
    assert np.std(speed.v - prepared.motion.v) == pytest.approx(TACHO, rel=0.1)


def test_a_noisy_speed_is_no_missing_effect():
    """The bristle relaxes with |v|: taken as it is, such a speed leaves 1.26 times the noise and a sigma1 of 301."""
    made = record_bench(TruthBench(), 3e5, 2e5, MOVED, seed=7, with_truth=True)
    noisy = made["true_v"] + 5.0 * TACHO * np.random.default_rng(8).standard_normal(MOVED.t.size)
    run = Recording.from_arrays("run.csv", RIG, v=noisy, **{name: made[name] for name in ("t", "x", "p1", "p2", "F")})
    found = fit(plant_of(RIG), [run])
    assert found.exact is not None
    assert 2.0 * found.exact.cost / run.n < 1.1
