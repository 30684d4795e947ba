"""A zero reading: what is read, and what is refused with one clear line."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import rig

from pneuid import ZeroReading
from pneuid.errors import UserError
from pneuid.virtual_rig import BENCH_SENSORS, Hidden, record_zero
from pneuid.zero_reading import BLOCKS, FEWEST, shown_with

PATM = 101325.0


def _written(path, header, columns):
    rows = (",".join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([header, *rows, ""]))
    return path


def _noisy(value, noise, seed=0, count=1000):
    return value + noise * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("seed", range(3))
def test_the_means_are_read_in_si_and_known_to_a_tenth_of_the_noise_of_a_sample(seed, tmp_path):
    columns = _noisy(7.5, 0.5, seed), _noisy(0.0, 0.5, seed + 10), _noisy(-2.6, 0.2, seed + 20)
    found = ZeroReading.read(_written(tmp_path / "zero.csv", "p1 [kPa],p2 [kPa],F [N]", columns), rig("bench"))
    expected = {"p1": (7500.0, 50.0), "p2": (0.0, 50.0), "F": (-2.6, 0.02)}
    assert set(found.zeros) == set(expected)
    for signal, (value, std) in expected.items():
        zero = found.zeros[signal]
        assert abs(zero.value - value) < 4 * zero.std and zero.std == pytest.approx(std, rel=0.5)


def test_columns_go_by_what_the_rig_says_and_the_rest_is_not_looked_at(tmp_path):
    columns = np.arange(200.0), _noisy(1.0, 0.01, count=200), np.full(200, 77.0)
    path = _written(tmp_path / "zero.csv", "stamp [ms],force [V],x [mm]", columns)
    own = rig("bench", columns={"F": {"column": "force", "gain": "10 N/V", "offset": "-4 N"}})
    found = ZeroReading.read(path, own)
    assert list(found.zeros) == ["F"] and found.zeros["F"].value == pytest.approx(6.0, abs=0.05)


def test_a_servo_rig_reads_its_pressures_alone(tmp_path):
    path = _written(tmp_path / "zero.csv", "p1 [kPa],p2 [kPa],F [N]", [_noisy(0.0, 0.1, seed) for seed in range(3)])
    assert list(ZeroReading.read(path, rig("servo")).zeros) == ["p1", "p2"]


def test_absolute_pressures_need_the_barometer(tmp_path):
    path = _written(tmp_path / "zero.csv", "p1 [kPa]", [_noisy(99.0, 0.1)])
    conventions = {"pressure": "abs"}
    with pytest.raises(UserError, match=r"zero\.csv: p1 is absolute.*barometer.*\[ambient\] pressure"):
        ZeroReading.read(path, rig("bench", conventions=conventions))
    found = ZeroReading.read(path, rig("bench", conventions=conventions, ambient={"pressure": "99 kPa"}))
    assert found.zeros["p1"].value == pytest.approx(0.0, abs=20.0)


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("t [s],x [mm]", [np.arange(200.0), np.zeros(200)], r"needs a column p1 or p2 or F; columns there: t, x"),
        ("F [N]", [np.zeros(FEWEST - 1)], r"column F: 99 samples; a zero reading needs at least 100"),
        ("p1 [kPa]", [_noisy(0.0, 0.1) + 40.0 * np.exp(-np.arange(1000) / 200.0)], r"column p1 moves by \d+.* kPa while"),
        ("p2 [bar]", [_noisy(3.0, 0.001)], r"column p2 is 300 kPa from ambient pressure; .* with both chambers vented"),
        ("p1", [np.zeros(200)], r"column 'p1' has no unit"),
    ],
    ids=["no_signal", "short", "still_venting", "under_pressure", "no_unit"],
)  # fmt: skip
def test_what_is_no_zero_reading_is_refused(header, columns, said, tmp_path):
    with pytest.raises(UserError, match=said):
        ZeroReading.read(_written(tmp_path / "zero.csv", header, columns), rig("bench"))


def test_a_reading_without_any_noise_stands_still():
    found = ZeroReading.from_arrays("zero", rig("bench"), F=np.full(200, 2.65))
    assert found.zeros["F"].value == pytest.approx(2.65) and found.zeros["F"].std == pytest.approx(0.0, abs=1e-9)


def test_arrays_of_other_signals_are_refused():
    with pytest.raises(UserError, match="x has no zero on this rig; give p1 or p2 or F"):
        ZeroReading.from_arrays("zero", rig("bench"), x=np.zeros(200))


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(wrong):
    values = np.zeros(200)
    values[7] = wrong
    with pytest.raises(UserError, match="column F: not every sample is a finite number"):
        ZeroReading.from_arrays("zero", rig("bench"), F=values)


def test_a_reading_of_nothing_is_refused():
    with pytest.raises(UserError, match="zero: a zero reading needs a column p1 or p2 or F"):
        ZeroReading.from_arrays("zero", rig("bench"))


def test_a_column_that_the_rig_gives_to_another_signal_is_not_read(tmp_path):
    """In its recordings the column p1 is the position, as the rig says; so it is here."""
    own = rig("bench", columns={"x": {"column": "p1", "unit": "mm"}})
    path = _written(tmp_path / "zero.csv", "p1 [kPa],F [N]", [_noisy(0.0, 0.1), _noisy(0.0, 0.1)])
    assert list(ZeroReading.read(path, own).zeros) == ["F"]


def test_a_slow_drift_within_the_reading_widens_what_is_known():
    drift = 3.0 * 0.2 * np.linspace(-0.5, 0.5, 1000)
    still = ZeroReading.from_arrays("zero", rig("bench"), F=_noisy(0.0, 0.2)).zeros["F"]
    moving = ZeroReading.from_arrays("zero", rig("bench"), F=_noisy(0.0, 0.2) + drift).zeros["F"]
    assert moving.std > 3.0 * still.std
    assert moving.std == pytest.approx(float(np.std(np.linspace(-0.27, 0.27, BLOCKS))), rel=0.3)


def test_the_virtual_rig_shows_its_shifts_and_nothing_else():
    hidden = Hidden(gravity=12.0, sensor_offset_p2=3e3)
    shown = record_zero(hidden, PATM, BENCH_SENSORS, seed=1)
    assert shown["F"].mean() == pytest.approx(0.0, abs=0.02)
    assert shown["p1"].mean() == pytest.approx(PATM, abs=50.0) and shown["p2"].mean() == pytest.approx(PATM + 3e3, abs=50.0)


@pytest.mark.parametrize(
    ("signal", "value", "std", "said"),
    [
        ("F", -0.00774, 0.019, "-0.008 ± 0.019 N"), ("p1", -13243.0, 521.0, "-13.24 ± 0.52 kPa"),
        ("F", 2653.0, 12.0, "2653 ± 12 N"), ("p2", -10178.0, 0.0, "-10.2 kPa"),
    ],
)  # fmt: skip
def test_a_zero_is_said_to_the_places_that_are_known(signal, value, std, said):
    assert shown_with(signal, value, std) == said
