"""Where the error is: a planted region is named, an even error is not, whatever the noise."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from pneuid.criticism.comparison.regions import find_regions
from pneuid.criticism.prediction.horizons import Prediction
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig

SERVO = {
    "kind": "servo", "friction": "lugre", "conventions": {"pressure": "gauge"},
    "cylinder": {
        "bore": "32 mm", "rod": "12 mm", "stroke": "500 mm", "dead_volume_1": "12 cm^3", "dead_volume_2": "14 cm^3",
    },
    "load": {"mass": "2.4 kg"},
    "valve": {"conductance": "1.2e-8 m^3/(s*Pa)", "critical_ratio": 0.3, "full_scale": "5 V", "null": "5 V"},
    "supply": {"pressure": "600 kPa"}, "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
}  # fmt: skip
BENCH = {
    "kind": "bench", "friction": "lugre", "conventions": {"pressure": "gauge"},
    "cylinder": {"bore": "32 mm", "rod": "12 mm"}, "load": {"mass": "2.4 kg"},
    "sensors": {"x": "1 um", "p1": "0.5 kPa", "p2": "0.5 kPa", "F": "0.2 N"},
}  # fmt: skip
PATM = 101_325.0


def servo_signals(run: int, n: int = 4000) -> dict[str, np.ndarray]:
    """A plausible run (SI): strokes of several speeds, pressures that are not a function of the speed alone."""
    t = np.arange(n) * 1e-3
    slow = 2 * np.pi * (0.45 + 0.1 * run)
    x = 0.25 + 0.12 * np.sin(slow * t) + 0.05 * np.sin(3.1 * slow * t + run)
    p1 = PATM + 3.2e5 + 1.4e5 * np.sin(1.37 * slow * t + 0.5) + 0.6e5 * np.sin(5.3 * t + run)
    p2 = PATM + 3.4e5 + 1.5e5 * np.sin(1.91 * slow * t + 1.0 + run) + 0.5e5 * np.sin(4.1 * t)
    return {"t": t, "u": 5.0 + 3.0 * np.sin(2.3 * slow * t + run), "x": x, "p1": p1, "p2": p2}


@pytest.fixture(scope="module")
def servo() -> tuple[Plant, list[Prediction]]:
    """Predictions without any error: planting one is adding it to ``predicted``."""
    rig = Rig.from_dict(SERVO)
    plant = Plant(rig, "lugre")
    noise = {"x": 2e-5, "p1": 500.0, "p2": 500.0}
    made = []
    for k, name in enumerate(("a.csv", "b.csv", "c.csv")):
        run = prepare(Recording.from_arrays(name, rig, **servo_signals(k)), plant, noise)
        index = np.arange(100, run.n)
        measured = np.vstack([run.measured(signal)[index] for signal in plant.outputs])
        made.append(Prediction(run, index, measured.copy(), measured, np.ones_like(measured, dtype=bool)))
    return plant, made


def planted(items, seed, size, signal=2, factor=8.0):
    """White errors, ``factor`` times as large where ``size(run, index)`` holds, in one signal only."""
    rng = np.random.default_rng(seed)
    made = []
    for item in items:
        error = rng.standard_normal(item.measured.shape)
        inside = size(item.run, item.index)
        error[signal] *= np.where(inside, factor, 1.0)
        made.append(dataclasses.replace(item, predicted=item.measured - error))
    return made


def share_inside(items, size, signal=2):
    energy = np.concatenate([item.error[signal] ** 2 for item in items])
    inside = np.concatenate([size(item.run, item.index) for item in items])
    return energy[inside].sum() / energy.sum(), inside.mean()


REGIONS = {
    "v < 0 and p2 > 400 kPa gauge": lambda run, at: (run.motion.v[at] < 0) & (run.measured("p2")[at] > PATM + 4e5),
    "p1 < 200 kPa gauge": lambda run, at: run.measured("p1")[at] < PATM + 2e5,
    "u > 5 V and x < 200 mm": lambda run, at: (run.input("u")[at] > 5.0) & (run.motion.x[at] < 0.2),
    "run b.csv": lambda run, at: np.full(at.size, run.name == "b.csv"),
}


@pytest.mark.parametrize("words", REGIONS)
def test_a_planted_region_is_named_with_its_share_under_any_noise(servo, words):
    plant, items = servo
    for seed in range(4):
        made = planted(items, seed, REGIONS[words])
        found = find_regions(made, plant)
        share, samples = share_inside(made, REGIONS[words])
        assert [item.region for item in found] == [words]
        assert found[0].signal == "p2"
        assert found[0].share == pytest.approx(share, abs=0.02)
        assert found[0].samples == pytest.approx(samples, abs=0.01)
        assert found[0].lift == pytest.approx(share / samples, rel=0.1)


def test_a_band_of_pressure_is_one_condition_in_words(servo):
    plant, items = servo
    made = planted(items, 1, lambda run, at: np.abs(run.measured("p1")[at] - PATM - 2.5e5) < 0.5e5)
    assert [item.region for item in find_regions(made, plant)] == ["p1 = 200 to 300 kPa gauge"]


def test_rest_is_told_from_motion(servo):
    plant, items = servo
    found = find_regions(planted(items, 0, lambda run, at: np.abs(run.motion.v[at]) < 0.05), plant)
    assert found[0].region == "|v| < 50 mm/s"


def test_two_regions_of_one_signal_are_both_found(servo):
    plant, items = servo

    def corners(run, at):
        return (run.motion.x[at] < 0.15) | (run.measured("p2")[at] > PATM + 5e5)

    found = {item.region for item in find_regions(planted(items, 0, corners, factor=12.0), plant)}
    assert found == {"x < 150 mm", "p2 > 500 kPa gauge"}


def walk(rng, count):
    """Errors that grow over windows of 200 ms, as predictions do."""
    return np.cumsum(rng.standard_normal((3, -(-count // 200), 200)), axis=2).reshape(3, -1)[:, :count]


@pytest.mark.parametrize(("noise", "allowed"), [(lambda rng, count: rng.standard_normal((3, count)), 0), (walk, 1)])
def test_an_even_error_names_no_region(servo, noise, allowed):
    plant, items = servo
    false = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        made = [dataclasses.replace(item, predicted=item.measured - noise(rng, item.index.size)) for item in items]
        false += len(find_regions(made, plant))
    assert false <= allowed  # of 24 signals


def test_one_short_burst_is_no_region(servo):
    plant, items = servo
    made = planted(items, 0, lambda run, at: (run.name == "a.csv") & (np.abs(run.t[at] - 2.0) < 0.05), factor=50.0)
    assert find_regions(made, plant) == []


def test_a_signal_at_its_noise_floor_is_passed_over(servo):
    plant, items = servo
    made = planted(items, 0, REGIONS["p1 < 200 kPa gauge"])
    rms = float(np.sqrt(np.mean(np.concatenate([item.error[2] for item in made]) ** 2)))
    assert find_regions(made, plant, {"x": 1.0, "p1": 1.0, "p2": rms}) == []
    assert len(find_regions(made, plant, {"x": 1.0, "p1": 1.0, "p2": 0.5 * rms})) == 1


def test_masked_and_diverged_samples_do_not_count(servo):
    plant, items = servo
    made = planted(items, 0, REGIONS["p1 < 200 kPa gauge"])
    broken = []
    for item in made:
        used, predicted = item.used.copy(), item.predicted.copy()
        used[:, item.index > 3500] = False
        predicted[:, item.index > 3500] = 1e9
        predicted[:, :200] = np.nan
        broken.append(dataclasses.replace(item, used=used, predicted=predicted))
    assert [item.region for item in find_regions(broken, plant)] == ["p1 < 200 kPa gauge"]


def test_nothing_to_look_at(servo):
    plant, items = servo
    nothing = np.zeros((3, 0))
    empty = Prediction(items[0].run, np.zeros(0, dtype=int), nothing, nothing, nothing.astype(bool))
    assert find_regions([], plant) == [] and find_regions([empty], plant) == []
    assert find_regions(items, plant) == []  # no error at all


def test_at_most_five_regions_largest_share_first(servo):
    plant, items = servo
    made = []
    for item in items:
        rng = np.random.default_rng(3)
        error = rng.standard_normal(item.measured.shape)
        x, p2 = item.run.motion.x[item.index], item.run.measured("p2")[item.index]
        error *= np.where((x < 0.15) | (p2 > PATM + 5e5), 12.0, 1.0)
        made.append(dataclasses.replace(item, predicted=item.measured - error))
    shares = [item.share for item in find_regions(made, plant)]
    assert len(shares) == 5
    assert shares == sorted(shares, reverse=True)


def test_bench_force_at_high_pressure():
    rig = Rig.from_dict(BENCH)
    plant = Plant(rig, "lugre")
    items = []
    for k, gauge in enumerate((0.0, 2e5, 5e5)):
        n = 3000
        t = np.arange(n) * 1e-3
        x = 0.2 + 0.05 * np.sin(2 * np.pi * t + k)
        p1 = PATM + gauge + 3e3 * np.sin(9 * t)
        run = prepare(
            Recording.from_arrays(f"{k}.csv", rig, t=t, x=x, p1=p1, F=20 * np.sign(np.cos(2 * np.pi * t + k))),
            plant, {"x": 1e-6, "F": 0.2},
        )  # fmt: skip
        index = np.arange(n)
        measured = run.measured("F")[None]
        items.append(Prediction(run, index, measured.copy(), measured, np.ones_like(measured, dtype=bool)))

    def high(run, at):
        return (run.recording.signals["p1"][at] > PATM + 3e5) & (run.motion.v[at] > 0)

    for seed in range(3):
        found = find_regions(planted(items, seed, high, signal=0), plant)
        assert [(item.signal, item.region) for item in found] == [("F", "v > 0 and p1 > 300 kPa gauge")]


def test_many_samples_take_no_time(servo):
    plant, items = servo
    many = [items[k % 3] for k in range(6)]  # 23 400 samples
    made = planted(many, 0, REGIONS["v < 0 and p2 > 400 kPa gauge"])
    began = time.perf_counter()
    find_regions(made, plant)
    # about 0.1 s; the margin is for a busy machine
    assert time.perf_counter() - began < 2.0
