"""Contract of the readers that need an extra: files written by the format's own library become the same table.

A test is skipped, and says so, where the library of its format is not installed.
"""

from __future__ import annotations

import datetime as dt
import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pneuid.errors import UserError
from pneuid.formats import READERS, FileLayout, RawTable, read_table
from pneuid.recording import Recording
from pneuid.rig import Rig

LIBRARIES = {
    ".h5": "h5py",
    ".hdf5": "h5py",
    ".parquet": "pyarrow",
    ".mf4": "asammdf",
    ".mdf": "asammdf",
    ".tdms": "nptdms",
}
BENCH: dict[str, Any] = {
    "kind": "bench",
    "load": {"mass": "1 kg"},
    "conventions": {"pressure": "gauge"},
    "cylinder": {"bore": "32 mm"},
}
N = 40
T = 0.01 * np.arange(N)
X = np.linspace(1.0, 9.0, N)
F = np.linspace(-2.0, 3.0, N)


def needs(library: str) -> pytest.MarkDecorator:
    absent = importlib.util.find_spec(library) is None
    return pytest.mark.skipif(
        absent, reason=f'{library} is not installed: pip install -c constraints.txt "pneuid[formats]"'
    )


needs_hdf5, needs_parquet, needs_mdf, needs_tdms = (needs(n) for n in ("h5py", "pyarrow", "asammdf", "nptdms"))
EVERY = [pytest.param(ending, marks=needs(library), id=ending[1:]) for ending, library in LIBRARIES.items()]


# --- files as the formats' own libraries write them ---


def hdf5(path: Path, datasets: dict[str, Any], units: dict[str, Any] | None = None, key: str = "unit") -> Path:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
        for name, unit in (units or {}).items():
            file[name].attrs[key] = unit
    return path


def parquet(path: Path, columns: dict[str, Any], units: dict[str, str] | None = None) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {name: values if isinstance(values, pa.Array) else pa.array(values) for name, values in columns.items()}
    metadata = {name: {"unit": unit} for name, unit in (units or {}).items()}
    fields = [pa.field(name, array.type, metadata=metadata.get(name)) for name, array in arrays.items()]
    pq.write_table(pa.table(list(arrays.values()), schema=pa.schema(fields)), path)
    return path


def mdf(path: Path, *groups: tuple[str, list[tuple[str, str, Any]], np.ndarray], **options: Any) -> Path:
    """Groups of (name, [(channel, unit, samples)], times); ``options`` are those of every channel."""
    import asammdf

    with asammdf.MDF(version="4.10" if path.suffix == ".mf4" else "3.30") as file:
        for place, channels, times in groups:
            signals = [asammdf.Signal(v, times, unit=unit, name=name, **options) for name, unit, v in channels]
            file.append(signals, acq_name=place)
        file.save(path, overwrite=True)
    return path


def tdms(path: Path, *channels: tuple[str, str, Any, dict[str, Any]]) -> Path:
    """Channels of (group, name, samples, properties)."""
    import nptdms

    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject(group, name, v, properties=p) for group, name, v, p in channels])
    return path


def wave(unit: str, step: float = 0.01, offset: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"unit_string": unit, "wf_increment": step, "wf_start_offset": offset, **more}


def measurement(path: Path) -> Path:
    """A run of a bench: t [s], x [mm], F [N], and p1 [bar] with its unit in the name only."""
    p1 = np.full(N, 2.0, dtype=np.float32)
    if path.suffix in (".h5", ".hdf5"):
        units = {"run/t": "s", "run/x": "mm", "run/F": "N"}
        return hdf5(path, {"run/t": T, "run/x": X[:, None], "run/F": F, "run/p1 [bar]": p1}, units)
    if path.suffix == ".parquet":
        return parquet(path, {"t [s]": T, "x": X, "F": F, "p1 [bar]": p1}, {"x": "mm", "F": "N"})
    if path.suffix == ".tdms":
        columns = [("x", X, wave("mm")), ("F", F, wave("N")), ("p1 [bar]", p1, wave(""))]
        return tdms(path, *[("run", name, values, properties) for name, values, properties in columns])
    return mdf(path, ("run", [("x", "mm", X), ("F", "N", F), ("p1 [bar]", "", p1)], T))


def read(path: Path) -> RawTable:
    return read_table(path, FileLayout())


def refused(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        read(path)
    return checked(path, caught.value)


def checked(path: Path, error: UserError) -> str:
    line = str(error)
    assert "\n" not in line and line.startswith(f"{path}: ")
    return line


def run_refused(path: Path, raw: dict[str, Any] | None = None) -> str:
    with pytest.raises(UserError) as caught:
        Recording.read(path, Rig.from_dict(BENCH | (raw or {})))
    return checked(path, caught.value)


# --- what holds for every format ---


@pytest.mark.parametrize("ending", EVERY)
def test_the_same_run_in_every_format(ending: str, tmp_path: Path) -> None:
    path = measurement(tmp_path / f"run{ending}")
    table = read(path)
    assert set(table.frame.columns) == {"t", "x", "F", "p1"}
    assert table.units == {"t": "s", "x": "mm", "F": "N", "p1": "bar"}
    assert list(table.frame.index) == list(range(1, N + 1))
    assert all(dtype == np.float64 for dtype in table.frame.dtypes)
    assert (table.ignored, table.apart) == ({}, {})
    run = Recording.read(path, Rig.from_dict(BENCH))
    np.testing.assert_allclose(run.t, T, atol=1e-12)
    np.testing.assert_allclose(run.signals["x"], 1e-3 * X, rtol=1e-12)
    np.testing.assert_allclose(run.signals["F"], F, rtol=1e-12)
    np.testing.assert_allclose(run.signals["p1"], 200e3 + 101325.0, rtol=1e-12)


@pytest.mark.parametrize("ending", EVERY)
@pytest.mark.parametrize("content", [b"", b"t [s],x [mm]\n0,1\n1,2\n", b"\x89HDF\r\n\x1a\n" + b"\xff" * 200])
def test_files_that_are_of_another_kind(ending: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"run{ending}"
    path.write_bytes(content)
    line = refused(path)
    assert "damaged" in line or "holds no channel" in line  # to TDMS an empty file is a file without channels


@pytest.mark.parametrize("ending", EVERY)
def test_a_file_that_is_cut_off_is_refused_and_nothing_else_is_said(
    ending: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = measurement(tmp_path / f"run{ending}").read_bytes()
    path = tmp_path / f"short{ending}"
    # between segments a TDMS file may end anywhere; elsewhere every cut shows
    for share in (0.2, 0.5, 0.7, 0.9, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        refused(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("ending", "library"), LIBRARIES.items())
def test_without_the_extra_one_line_says_what_to_install(
    ending: str, library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / f"run{ending}"
    path.write_bytes(b"anything")
    line = refused(path)
    assert f"needs {library}" in line and 'pip install "pneuid[formats]"' in line and ending in line


def test_every_ending_is_registered() -> None:
    assert set(LIBRARIES) <= set(READERS)


# --- HDF5 ---


@needs_hdf5
@pytest.mark.parametrize("unit", ["mm", b"mm", np.array(["mm"], dtype="S2"), np.array([b"mm"], dtype=object)])
@pytest.mark.parametrize("key", ["unit", "units"])
def test_hdf5_units_as_attributes_of_many_kinds(unit: Any, key: str, tmp_path: Path) -> None:
    table = read(hdf5(tmp_path / "a.h5", {"x": X, "values[3]": X}, {"x": unit, "values[3]": 7.0}, key))
    assert table.units == {"x": "mm"}
    assert set(table.frame.columns) == {"x", "values[3]"}


@needs_hdf5
def test_hdf5_groups_are_named_only_where_a_name_stands_twice(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "a.h5", {"a/x [mm]": X, "b/x [mm]": X + 1, "b/t [s]": T, "a/deep/F [N]": F})
    table = read(path)
    assert set(table.frame.columns) == {"a/x", "b/x", "t", "F"}
    assert "2 series bear this name (a/x, b/x)" in run_refused(path)
    run = Recording.read(path, Rig.from_dict(BENCH | {"columns": {"x": {"column": "b/x"}}}))
    np.testing.assert_allclose(run.signals["x"], 1e-3 * (X + 1))


@needs_hdf5
def test_hdf5_what_is_no_vector_is_reported_and_nothing_outside_is_followed(tmp_path: Path) -> None:
    import h5py

    other = hdf5(tmp_path / "other.h5", {"x": X})
    (tmp_path / "raw.bin").write_bytes(X.tobytes())
    path = hdf5(tmp_path / "a.h5", {"t": T, "x": X, "gain": 2.0, "grid": np.ones((3, 4)), "who": "me", "z": X * 1j})
    with h5py.File(path, "a") as file:
        file["pairs"] = np.zeros(N, dtype=[("t", "f8"), ("x", "f8")])
        file["none"] = h5py.Empty("f8")
        file["link"] = h5py.ExternalLink(other, "x")
        file["loop"] = h5py.SoftLink("/")
        file["self"] = file["/"]
        file.create_dataset("outside", (N,), "f8", external=[(str(tmp_path / "raw.bin"), 0, X.nbytes)])
        layout = h5py.VirtualLayout((N,), "f8")
        layout[:] = h5py.VirtualSource(other, "x", (N,))
        file.create_virtual_dataset("virtual", layout)
    table = read(path)
    assert set(table.frame.columns) == {"t", "x"}
    assert set(table.ignored) == {"gain", "grid", "who", "z", "pairs", "none", "outside", "virtual"}
    assert table.ignored["outside"] == table.ignored["virtual"] == "its values are in another file"


@needs_hdf5
def test_hdf5_a_signal_of_another_length_is_refused_and_another_series_is_noted(tmp_path: Path) -> None:
    signals = {"t [s]": T, "x [mm]": X, "F [N]": F}
    run = Recording.read(hdf5(tmp_path / "a.h5", signals | {"oil": T[:9]}), Rig.from_dict(BENCH))
    assert run.notes[0] == "oil is not used: 9 values where the others have 40; save all at one rate"
    line = run_refused(hdf5(tmp_path / "b.h5", signals | {"p1 [bar]": T[:9]}))
    assert "column 'p1' cannot be used: 9 values where the others have 40" in line


@needs_hdf5
def test_hdf5_name_and_attribute_must_agree_on_the_unit(tmp_path: Path) -> None:
    signals = {"t [s]": T, "x [mm]": X, "F [N]": F}
    assert read(hdf5(tmp_path / "a.h5", signals, {"x [mm]": "millimeter"})).units["x"] == "millimeter"
    line = run_refused(hdf5(tmp_path / "b.h5", signals, {"x [mm]": "m"}))
    assert "column 'x' cannot be used: its name says 'mm', the unit in the file 'm'" in line


@needs_hdf5
@pytest.mark.parametrize("shape", [(10**13,), (2**29,)])
def test_hdf5_a_file_that_claims_any_size_is_refused(shape: tuple[int], tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", shape, "f8", chunks=(1024,))
    assert "more than" in refused(tmp_path / "a.h5")


@needs_hdf5
def test_hdf5_without_a_vector_and_names_on_one_line(tmp_path: Path) -> None:
    assert "no vector" in refused(hdf5(tmp_path / "a.h5", {"gain": 1.0}))
    line = run_refused(hdf5(tmp_path / "b.h5", {"a\nb\x1b[2J": X, "c": X}))
    assert "a b" in line and "\x1b" not in line


# --- Parquet ---


@needs_parquet
def test_parquet_types_of_columns(tmp_path: Path) -> None:
    import pyarrow as pa

    start = dt.datetime(2026, 3, 1, 12, tzinfo=dt.UTC)
    stamps = [start + dt.timedelta(milliseconds=10 * k) for k in range(3)]
    columns = {
        "t": pa.array(stamps, pa.timestamp("ns", tz="UTC")),
        "since": pa.array([0, 5, None], pa.duration("ms")),
        "clock": pa.array([0, 1, 2], pa.time32("s")),
        "whole": pa.array([1, None, 2**60], pa.int64()),
        "exact": pa.array([1, 2, 3]).cast(pa.decimal128(19)),
        "flag": pa.array([True, None, False]),
        "coded": pa.array([1.5, 2.5, 1.5]).dictionary_encode(),
        "nothing": pa.nulls(3),
        "remark": pa.array(["a", None, "1.5"]),
        "list": pa.array([[1], [2], [3]]),
        "bytes": pa.array([b"1", b"2", b"3"]),
    }
    table = read(parquet(tmp_path / "a.parquet", columns))
    expected = {
        "t": [0, 0.01, 0.02],
        "since": [0, 0.005, np.nan],
        "clock": [0, 1, 2],
        "whole": [1, np.nan, 2**60],
        "exact": [1, 2, 3],
        "flag": [1, np.nan, 0],
        "coded": [1.5, 2.5, 1.5],
        "nothing": [np.nan] * 3,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(table.numbers(name, True, "f"), values, rtol=1e-12)
    assert table.units == {"t": "s", "since": "s", "clock": "s"}
    assert set(table.ignored) == {"list", "bytes"}
    with pytest.raises(UserError, match="f: row 1, column 'remark': 'a' is not a number"):
        table.numbers("remark", False, "f")
    with pytest.raises(UserError, match=r"f: row 2, column 'whole': the cell is NaN; .*gaps = true"):
        table.numbers("whole", False, "f")


@needs_parquet
def test_parquet_from_pandas_and_columns_that_stand_twice(tmp_path: Path) -> None:
    frame = pd.DataFrame({"x [mm]": X, "F [N]": F}, index=pd.Index(T, name="t [s]"))
    frame.to_parquet(tmp_path / "a.parquet")
    assert Recording.read(tmp_path / "a.parquet", Rig.from_dict(BENCH)).n == N
    line = run_refused(parquet(tmp_path / "b.parquet", {"t [s]": T, "x [mm]": X, "x [m]": X, "F [N]": F}))
    assert "column 'x' cannot be used: 2 series bear this name" in line


@needs_parquet
def test_parquet_without_rows_or_columns_of_numbers(tmp_path: Path) -> None:
    assert "no rows" in refused(parquet(tmp_path / "a.parquet", {"x": np.array([])}))
    assert "no column of numbers" in refused(parquet(tmp_path / "b.parquet", {"x": [[1.0]]}))


# --- MDF ---

BOTH_MDF = pytest.mark.parametrize("ending", [".mf4", ".mdf"])


@needs_mdf
@BOTH_MDF
def test_mdf_channels_of_two_rates_are_refused_with_both(ending: str, tmp_path: Path) -> None:
    fast = ("fast", [("x", "mm", X), ("F", "N", F)], T)
    slow = T[::10]
    path = mdf(tmp_path / f"a{ending}", fast, ("slow", [("p1", "bar", np.ones(4))], slow))
    line = run_refused(path)
    assert "column 'p1'" in line and "10 Hz (4 samples" in line and "100 Hz (40 samples" in line
    noted = mdf(tmp_path / f"b{ending}", fast, ("slow", [("oil", "degC", np.ones(4))], slow))
    run = Recording.read(noted, Rig.from_dict(BENCH))
    assert (run.recorded, run.notes[0].split(":")[0]) == (("x", "F"), "oil is not used")
    assert "it cannot be used: it is recorded at 10 Hz" in run_refused(noted, {"columns": {"p1": {"column": "oil"}}})


GAPS = {"files": {"gaps": True}}


def assert_slow_pressure(path: Path) -> None:
    """p1 stands at every tenth sample, where it was recorded, and weighs nothing between."""
    run = Recording.read(path, Rig.from_dict(BENCH | GAPS))
    assert run.n == N and set(run.recorded) == {"x", "F", "p1"}
    np.testing.assert_array_equal(np.flatnonzero(run.weights["p1"]), np.arange(0, N, 10))
    np.testing.assert_allclose(run.signals["p1"][::10], 1e5 * (1.0 + np.arange(4)) + 101325.0, rtol=1e-9)
    assert np.all(run.weights["x"] == 1.0)
    noted = " | ".join(run.notes)
    assert "p1: recorded at 10 Hz (4 samples" in noted and "p1: 36 missing samples filled linearly, weight 0" in noted


@needs_mdf
@BOTH_MDF
def test_mdf_channels_of_a_slower_rate_have_gaps_between_where_gaps_are_allowed(ending: str, tmp_path: Path) -> None:
    fast = ("fast", [("x", "mm", X), ("F", "N", F)], T)
    slow = ("slow", [("p1", "bar", 1.0 + np.arange(4))], T[::10] + 2e-3)
    assert_slow_pressure(mdf(tmp_path / f"a{ending}", fast, slow))
    # a faster channel of no signal does not become the time of the others, a faster one of a signal does
    rapid = ("rapid", [("noise", "V", np.zeros(10 * N))], 1e-3 * np.arange(10 * N))
    assert_slow_pressure(mdf(tmp_path / f"b{ending}", fast, slow, rapid))
    rapid = ("rapid", [("v", "mm/s", np.ones(10 * N))], 1e-3 * np.arange(10 * N))
    run = Recording.read(mdf(tmp_path / f"c{ending}", fast, slow, rapid), Rig.from_dict(BENCH | GAPS))
    assert run.n == 10 * N and np.count_nonzero(run.weights["x"]) == N
    # one that was recorded at another time has no sample to stand at
    later = ("slow", [("p1", "bar", np.ones(4))], T[::10] + 100.0)
    assert "column 'p1'" in run_refused(mdf(tmp_path / f"d{ending}", fast, later), GAPS)


@needs_tdms
def test_tdms_channels_of_a_slower_rate_have_gaps_between_where_gaps_are_allowed(tmp_path: Path) -> None:
    fast = [("a", "x", X, wave("mm")), ("a", "F", F, wave("N"))]
    slow = ("b", "p1", 1.0 + np.arange(4), wave("bar", 0.1, offset=0.002))
    assert_slow_pressure(tdms(tmp_path / "a.tdms", *fast, slow))


@needs_mdf
@BOTH_MDF
def test_mdf_groups_of_the_same_times_are_one_table(ending: str, tmp_path: Path) -> None:
    groups = [("a", [("x", "mm", X), ("y", "V", X)], T), ("b", [("F", "N", F), ("y", "V", X)], T + 1e-9)]
    table = read(mdf(tmp_path / f"a{ending}", *groups))
    places = ("a", "b") if ending == ".mf4" else ("group 0", "group 1")
    assert list(table.frame.columns) == ["t", "x", f"{places[0]}/y", "F", f"{places[1]}/y"]
    shifted = [groups[0], (*groups[1][:2], T + 2e-3)]
    assert "from 0.002 s" in run_refused(mdf(tmp_path / f"b{ending}", *shifted))


@needs_mdf
@BOTH_MDF
def test_mdf_a_channel_t_goes_before_the_master(ending: str, tmp_path: Path) -> None:
    table = read(mdf(tmp_path / f"a{ending}", ("run", [("x", "mm", X), ("t", "ms", 1e3 * T)], T)))
    assert table.units == {"x": "mm", "t": "ms"}


@needs_mdf
@BOTH_MDF
def test_mdf_conversions_are_applied_and_formulas_are_not_executed(ending: str, tmp_path: Path) -> None:
    whole = np.arange(N)
    linear = mdf(tmp_path / f"a{ending}", ("run", [("x", "mm", whole)], T), conversion={"a": 0.5, "b": 1.0})
    np.testing.assert_allclose(read(linear).numbers("x", False, "f"), 0.5 * whole + 1.0)
    formula = [("x", "mm", whole)]
    assert "no channel of numbers" in refused(
        mdf(tmp_path / f"b{ending}", ("run", formula, T), conversion={"formula": "X1 * 2"})
    )


@needs_mdf
@BOTH_MDF
def test_mdf_a_signal_by_formula_is_refused_not_evaluated(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import asammdf

    def fail(*_arguments: object, **_options: object) -> None:
        raise AssertionError("evaluated")

    for module in ("v2_v3_blocks", "v4_blocks"):
        monkeypatch.setattr(f"asammdf.blocks.{module}.evaluate", fail)
        monkeypatch.setattr(f"asammdf.blocks.{module}.lambdify", fail)
    path = tmp_path / f"a{ending}"
    signals = [asammdf.Signal(v, T, unit=unit, name=name) for name, unit, v in (("x", "mm", X), ("F", "N", F))]
    signals.append(asammdf.Signal(np.arange(N), T, unit="bar", name="p1", conversion={"formula": "X1 * 2"}))
    with asammdf.MDF(version="4.10" if ending == ".mf4" else "3.30") as file:
        file.append(signals)
        file.save(path)
    assert "column 'p1' cannot be used: its values are a formula in the file" in run_refused(path)
    assert set(read(path).frame.columns) == {"t", "x", "F"}


@needs_mdf
def test_mdf_invalid_samples_are_missing_text_is_reported_and_signals_of_no_length(tmp_path: Path) -> None:
    import asammdf

    invalid = np.zeros(N, dtype=bool)
    invalid[3] = True
    path = tmp_path / "a.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append(
            [
                asammdf.Signal(X, T, unit="mm", name="x", invalidation_bits=invalid),
                asammdf.Signal(np.array([b"ab"] * N), T, name="state", encoding="utf-8"),
            ]
        )
        file.append([asammdf.Signal(np.array([]), np.array([]), name="later")], acq_name="none")
        file.save(path)
    table = read(path)
    values = table.numbers("x", True, "f")
    assert np.flatnonzero(np.isnan(values)).tolist() == [3]
    np.testing.assert_array_equal(np.delete(values, 3), np.delete(X, 3))
    assert table.ignored == {"state": "not real numbers", "none/later": "empty"}
    with pytest.raises(UserError, match="sample 4, column 'x': the cell is NaN"):
        table.numbers("x", False, "f")


# --- TDMS ---


@needs_tdms
def test_tdms_channels_of_two_rates_are_refused_with_both(tmp_path: Path) -> None:
    fast = [("a", "x", X, wave("mm")), ("a", "F", F, wave("N"))]
    for number, other in enumerate((np.ones(4), np.ones(N))):
        path = tdms(tmp_path / f"{number}.tdms", *fast, ("b", "p1", other, wave("bar", 0.1)))
        line = run_refused(path)
        assert "column 'p1'" in line and f"10 Hz ({other.size} samples" in line and "100 Hz (40 samples" in line
    later = wave("bar", offset=0.003)
    assert "from 0.003 s" in run_refused(tdms(tmp_path / "later.tdms", *fast, ("b", "p1", X, later)))


@needs_tdms
def test_tdms_start_times_count_and_the_offset_is_the_start(tmp_path: Path) -> None:
    start = np.datetime64("2026-03-01T12:00:00.000000")
    late = start + np.timedelta64(4, "ms")
    first = wave("mm", offset=0.5, wf_start_time=start)
    same = [("a", "x", X, first), ("b", "F", F, wave("N", offset=0.5, wf_start_time=start))]
    table = read(tdms(tmp_path / "a.tdms", *same))
    np.testing.assert_allclose(table.frame["t"], 0.5 + T, rtol=1e-12)
    assert set(table.frame.columns) == {"t", "x", "F"}
    apart = ("b", "F", F, wave("N", offset=0.5, wf_start_time=late))
    assert "from 0.504 s" in run_refused(tdms(tmp_path / "b.tdms", same[0], apart))


@needs_tdms
def test_tdms_time_of_its_own_names_and_what_is_no_number(tmp_path: Path) -> None:
    stamps = np.datetime64("2026-03-01T12:00:00.000000") + (1e6 * T).astype("timedelta64[us]")
    path = tdms(
        tmp_path / "a.tdms",
        ("a", "t", stamps, {}),
        ("a", "x", X, {"unit_string": "mm"}),
        ("b", "x", X, {"unit_string": "m"}),
        ("a", "remark", ["text"] * N, {}),
        ("a", "z", X * 1j, {}),
    )
    table = read(path)
    assert set(table.frame.columns) == {"t", "a/x", "b/x"}
    assert table.units == {"t": "s", "a/x": "mm", "b/x": "m"}
    np.testing.assert_allclose(table.frame["t"], T, atol=1e-12)
    assert set(table.ignored) == {"a/remark", "a/z"}


@needs_tdms
def test_tdms_without_any_time_is_refused_and_a_channel_without_a_step_goes_by_its_length(tmp_path: Path) -> None:
    bare = [("a", "x", X, {"unit_string": "mm"}), ("a", "F", F, {"unit_string": "N"})]
    assert "column t is missing" in run_refused(tdms(tmp_path / "a.tdms", *bare))
    run = Recording.read(tdms(tmp_path / "b.tdms", bare[0], ("a", "F", F, wave("N"))), Rig.from_dict(BENCH))
    np.testing.assert_allclose(run.t, T, atol=1e-12)
    odd = tdms(tmp_path / "c.tdms", *bare, ("a", "t [s]", T, wave("", float("nan"))))
    np.testing.assert_allclose(Recording.read(odd, Rig.from_dict(BENCH)).t, T, atol=1e-12)
    assert "no channel of numbers" in refused(tdms(tmp_path / "d.tdms", ("a", "x", ["b"], {})))
