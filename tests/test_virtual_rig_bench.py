"""The virtual bench and the files the virtual rig writes."""

import csv

import numpy as np
import pytest

from pneuid.virtual_rig import (
    ATMOSPHERE,
    IDEAL_SENSORS,
    MOTIONS,
    Hidden,
    TruthBench,
    TruthServo,
    reciprocation,
    record_bench,
    record_servo,
    steady_friction,
    strokes,
    write_csv,
)

BENCH = TruthBench()
P1, P2 = ATMOSPHERE + 3e5, ATMOSPHERE + 4e5


@pytest.mark.parametrize("name", sorted(MOTIONS))
def test_motions_are_consistent_and_within_the_stroke(name):
    motion = MOTIONS[name]()
    dt = motion.t[1]
    speed = np.diff(motion.x) / dt
    assert np.max(np.abs(speed - 0.5 * (motion.v[1:] + motion.v[:-1]))) < 5e-3 * np.max(np.abs(motion.v))
    gain = np.diff(motion.v)
    assert np.max(np.abs(gain - 0.5 * dt * (motion.a[1:] + motion.a[:-1]))) < 0.02 * np.max(np.abs(gain)) + 1e-12
    assert np.min(motion.x) > 0.0
    assert np.max(motion.x) < BENCH.stroke


def test_laws_of_2011_hold_on_the_plateaus():
    motion = strokes(speeds=(0.001, 0.01, 0.1))
    run = record_bench(BENCH, P1, P2, motion, sensors=IDEAL_SENSORS, with_truth=True)
    # contract, gauge bar: ps = 3, dp = -1
    fc, fs = 2.856 + 0.772 * 3 + 0.5843, 3.904 + 7.152 * 3 + 4.0386
    vs, viscous = (2.3892 - 0.3782 * 3 - 0.1134) * 1e-3, (0.0185 + 0.1032 * 3 + 0.0627) * 1e3
    for speed in (0.001, 0.01, 0.1, -0.001, -0.01, -0.1):
        plateau = np.flatnonzero(np.isclose(motion.v, speed, rtol=1e-9))
        last = plateau[-5]
        expected = np.sign(speed) * (fc + (fs - fc) * np.exp(-((speed / vs) ** 2))) + viscous * speed
        assert steady_friction(BENCH, np.array([speed]), P1, P2)[0] == pytest.approx(expected, rel=1e-9)
        # the regulators give way by 5 kPa s/m, which is worth up to 0.1 N at 0.1 m/s
        assert run["true_friction"][last] == pytest.approx(expected, abs=0.02 + 1.2 * abs(speed))


def test_force_balance_has_the_contracts_signs():
    run = record_bench(BENCH, P1, P2, "sine", sensors=IDEAL_SENSORS, with_truth=True)
    servo = BENCH.as_servo()
    pressure = (run["p1"] - BENCH.patm) * servo.area_1 - (run["p2"] - BENCH.patm) * servo.area_2
    assert np.allclose(run["F"], BENCH.mass * run["true_a"] + run["true_friction"] - pressure, atol=1e-9)
    loaded = record_bench(BENCH, P1, P2, "sine", Hidden(gravity=10.0), sensors=IDEAL_SENSORS)
    assert np.mean(loaded["F"] - run["F"]) == pytest.approx(10.0, rel=0.01)
    assert np.ptp(loaded["F"] - run["F"]) < 0.4  # the spring balancer


def test_presliding_slope_is_the_bristles_stiffness():
    run = record_bench(BENCH, P1, P2, reciprocation(), sensors=IDEAL_SENSORS, with_truth=True)
    turn = np.flatnonzero(np.diff(np.sign(run["true_v"])) < 0)[0]
    window = slice(turn + 12, turn + 20)  # just after the reversal, within a few micrometres
    slope = np.polyfit(run["true_x"][window], run["true_friction"][window], 1)[0]
    assert 0.7 * 4.48e5 < slope / 2.0 < 1.3 * 4.48e5  # both g and z change: twice sigma0 at a reversal from sliding


def test_bench_halving_the_step():
    coarse, fine = (
        record_bench(BENCH, P1, P2, "sine", sensors=IDEAL_SENSORS, step=step)["F"] for step in (20e-6, 5e-6)
    )
    assert np.max(np.abs(coarse - fine)) < 1e-4  # N, against 0.2 N of noise


def test_bench_noise_seed_and_offset():
    one, again, other = (record_bench(BENCH, P1, P2, "sine", seed=seed) for seed in (1, 1, 2))
    assert all(np.array_equal(one[name], again[name]) for name in one)
    assert np.std(one["F"] - other["F"]) == pytest.approx(0.2 * np.sqrt(2), rel=0.1)
    shifted = record_bench(BENCH, P1, P2, "sine", Hidden(sensor_offset_F=3.0), seed=1)
    assert np.mean(shifted["F"] - one["F"]) == pytest.approx(3.0, abs=1e-6)
    assert list(one) == ["t", "x", "p1", "p2", "F"]


def test_bench_refuses():
    with pytest.raises(KeyError, match="strokes"):
        record_bench(BENCH, P1, P2, "jump")
    with pytest.raises(ValueError, match="stroke"):
        record_bench(BENCH, P1, P2, strokes(start=0.4))
    with pytest.raises(ValueError, match="absolute"):
        record_bench(BENCH, -1.0, P2)


def test_csv_is_the_contracts_file(tmp_path):
    record = record_servo(TruthServo(), duration=0.05, with_truth=True)
    path = tmp_path / "run.csv"
    write_csv(path, record)
    with path.open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t [s]", "u [V]", "x [mm]", "p1 [kPa]", "p2 [kPa]"]
    table = np.array(rows[1:], dtype=float)
    assert np.max(np.abs(table[:, 1] - record["u"])) < 1e-9  # the command's grid is coarser than the file's
    assert np.max(np.abs(table[:, 2] * 1e-3 - record["x"])) < 1e-9
    assert np.max(np.abs(table[:, 3] * 1e3 + ATMOSPHERE - record["p1"])) < 5.01
    write_csv(path, record, gauge=False)
    absolute = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.max(np.abs(absolute[:, 3] * 1e3 - record["p1"])) < 5.01
