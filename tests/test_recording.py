"""Contract of a run: conversion to SI and absolute pressure, what is said, and everything that is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from pneuid.errors import UserError
from pneuid.recording import Recording
from pneuid.rig import Rig

SERVO: dict[str, Any] = {
    "kind": "servo",
    "conventions": {"pressure": "gauge"},
    "cylinder": {
        "bore": "32 mm",
        "rod": "12 mm",
        "stroke": "500 mm",
        "dead_volume_1": "12 cm^3",
        "dead_volume_2": "14 cm^3",
    },
    "load": {"mass": "2.4 kg"},
    "valve": {"conductance": "1.2e-8 m^3/(s*Pa)", "critical_ratio": 0.3, "full_scale": "10 V"},
    "supply": {"pressure": "600 kPa"},
    "runs": {"low.csv": {"supply": "300 kPa"}},
}
BENCH: dict[str, Any] = {"kind": "bench", "load": {"mass": "1 kg"}}
PATM = 101325.0
N = 30


def rows() -> list[list[str]]:
    """Cells of a good servo run: t [s], u [V], x [mm], p1 [kPa], p2 [bar], note []."""
    return [[f"{5 + 0.01 * k:.2f}", "1.5", f"{100 + k}", "200", "3", "7"] for k in range(N)]


HEADER = ["t [s]", "u [V]", "x [mm]", "p1 [kPa]", "p2 [bar]", "oil temperature [degC]"]


def write(folder: Path, cells: list[list[str]], header: list[str] | None = None, name: str = "run.csv") -> Path:
    path = folder / name
    lines = [",".join(row) for row in [header or HEADER, *cells]]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_units_reference_extra_columns_and_start_of_time(tmp_path: Path) -> None:
    path = write(tmp_path, rows())
    run = Recording.read(path, Rig.from_dict(SERVO))
    assert (run.name, run.file, run.n, len(run.sha256)) == ("run.csv", str(path), N, 64)
    assert run.t[0] == 0.0
    assert run.duration == pytest.approx(0.29)
    assert run.rate == pytest.approx(100.0)
    assert run.uniform
    np.testing.assert_allclose(run.signals["x"], 0.1 + 1e-3 * np.arange(N), rtol=1e-12)
    np.testing.assert_allclose(run.signals["p1"], 200e3 + PATM, rtol=1e-12)
    np.testing.assert_allclose(run.signals["p2"], 300e3 + PATM, rtol=1e-12)
    np.testing.assert_allclose(run.signals["psup"], 600e3 + PATM, rtol=1e-12)
    assert run.recorded == ("u", "x", "p1", "p2")
    assert run.extra == ("oil temperature",)
    assert "psup is not recorded: taken as 600 kPa gauge from the rig" in run.notes
    assert set(run.weights) == set(run.signals)
    assert all((weight == 1.0).all() for weight in run.weights.values())


def test_absolute_pressures_stay_and_order_of_columns_is_free(tmp_path: Path) -> None:
    raw = SERVO | {"conventions": {"pressure": "abs"}}
    path = write(tmp_path, [row[::-1] for row in rows()], HEADER[::-1])
    run = Recording.read(path, Rig.from_dict(raw))
    np.testing.assert_allclose(run.signals["p1"], 200e3)
    np.testing.assert_allclose(run.signals["psup"], 600e3)


def test_supply_of_one_run_and_a_recorded_supply(tmp_path: Path) -> None:
    rig = Rig.from_dict(SERVO)
    low = Recording.read(write(tmp_path, rows(), name="low.csv"), rig)
    np.testing.assert_allclose(low.signals["psup"], 300e3 + PATM)
    header = [*HEADER[:5], "psup [bar]"]
    measured = Recording.read(write(tmp_path, rows(), header), rig)
    np.testing.assert_allclose(measured.signals["psup"], 700e3 + PATM)
    assert "psup" in measured.recorded
    assert measured.notes == ()


def test_arrays_are_read_only_and_copies() -> None:
    x = np.linspace(0.0, 0.1, N)
    run = Recording.from_arrays("a", Rig.from_dict(BENCH), t=np.arange(N) * 0.1, x=x, F=np.ones(N))
    x[0] = 9.0
    assert run.signals["x"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        run.signals["x"][0] = 1.0
    with pytest.raises(AttributeError):
        run.name = "b"  # type: ignore[misc]


def test_bench_without_pressures_is_at_ambient(tmp_path: Path) -> None:
    cells = [[f"{10 * k}", f"{k}", "5"] for k in range(N)]
    run = Recording.read(write(tmp_path, cells, ["t [ms]", "x [um]", "F [kgf]"]), Rig.from_dict(BENCH))
    np.testing.assert_array_equal(run.signals["p1"], PATM)
    np.testing.assert_array_equal(run.signals["p2"], PATM)
    np.testing.assert_allclose(run.signals["F"], 5 * 9.80665)
    assert run.recorded == ("x", "F")
    assert "psup" not in run.signals


def test_whitespace_file_by_column_number(tmp_path: Path) -> None:
    raw = BENCH | {
        "files": {"delimiter": "whitespace", "header": False, "skip_rows": 2},
        "columns": {
            "t": {"column": 1, "unit": "ms"},
            "x": {"column": 3, "unit": "mm", "gain": "-1", "offset": "2 mm"},
            "F": {"column": 4, "unit": "V", "gain": "35 N/V"},
        },
    }
    path = tmp_path / "log.txt"
    path.write_text("logger\r\n0 0 0 0\r\n" + "".join(f"{10.0 * k:8.1f}\t9 {k} -1\r\n" for k in range(N)))
    run = Recording.read(path, Rig.from_dict(raw))
    np.testing.assert_allclose(run.signals["x"], 2e-3 - 1e-3 * np.arange(N), atol=1e-15)
    np.testing.assert_allclose(run.signals["F"], -35.0)
    assert run.extra == ("2",)


def test_matlab_file_with_names_of_its_own(tmp_path: Path) -> None:
    raw = BENCH | {
        "columns": {
            "t": {"column": "time", "unit": "s"},
            "x": {"column": "qm", "unit": "m"},
            "F": {"column": "vir", "unit": "V", "gain": "2 N/V"},
        }
    }
    path = tmp_path / "axis.mat"
    k = np.arange(N)[:, None]
    scipy.io.savemat(path, {"time": 1e-3 * k, "qm": 1e-4 * k, "vir": 3.0 + 0 * k, "kp": 160.0, "qg": k})
    run = Recording.read(path, Rig.from_dict(raw))
    np.testing.assert_allclose(run.signals["F"], 6.0)
    assert run.extra == ("qg",)
    assert any("kp" in note and "scalar" in note for note in run.notes)


def test_a_mapped_column_may_be_the_header_cell_as_it_stands(tmp_path: Path) -> None:
    for wanted in ("pos", "pos [mm]"):
        raw = BENCH | {"columns": {"x": {"column": wanted}}}
        cells = [[f"{k}", f"{k}", "5"] for k in range(N)]
        run = Recording.read(write(tmp_path, cells, ["t [s]", "pos [mm]", "F [N]"]), Rig.from_dict(raw))
        np.testing.assert_allclose(run.signals["x"], 1e-3 * np.arange(N))


def test_a_column_mapped_to_one_signal_is_not_read_as_another(tmp_path: Path) -> None:
    raw = BENCH | {"columns": {"x": {"column": "v", "unit": "mm"}}}
    cells = [[f"{k}", f"{k}", "5"] for k in range(N)]
    run = Recording.read(write(tmp_path, cells, ["t [s]", "v", "F [N]"]), Rig.from_dict(raw))
    assert run.recorded == ("x", "F")


def test_gaps_have_no_weight_and_are_said(tmp_path: Path) -> None:
    cells = rows()
    cells[3][3] = ""
    cells[4][3] = "NaN"
    cells[5][3] = "500"
    cells[0][2] = "nan"
    run = Recording.read(write(tmp_path, cells), Rig.from_dict(SERVO | {"files": {"gaps": True}}))
    np.testing.assert_array_equal(np.flatnonzero(run.weights["p1"] == 0.0), [3, 4])
    np.testing.assert_allclose(run.signals["p1"][2:6], [301325, 401325, 501325, 601325])
    assert run.weights["x"][0] == 0.0
    assert run.signals["x"][0] == run.signals["x"][1]
    assert any("p1: 2 missing samples" in note for note in run.notes)
    assert any("x: 1 missing sample" in note for note in run.notes)


def test_jittered_time_and_a_pause(tmp_path: Path) -> None:
    cells = rows()
    cells[7][0] = "5.073"
    run = Recording.read(write(tmp_path, cells), Rig.from_dict(SERVO))
    assert not run.uniform
    assert run.rate == pytest.approx(100.0)
    for row in cells[10:]:
        row[0] = f"{float(row[0]) + 0.3:.3f}"
    assert any(
        "longest time step" in note for note in Recording.read(write(tmp_path, cells), Rig.from_dict(SERVO)).notes
    )


def test_the_fingerprint_follows_the_content(tmp_path: Path) -> None:
    rig = Rig.from_dict(BENCH)
    t, x = np.arange(N) * 0.1, np.linspace(0, 1, N)
    first = Recording.from_arrays("a", rig, t=t, x=x, F=x)
    assert Recording.from_arrays("b", rig, F=x, x=x, t=t).sha256 == first.sha256
    assert Recording.from_arrays("a", rig, t=t, x=x, F=2 * x).sha256 != first.sha256


def test_presliding_runs_of_a_bench_are_motion() -> None:
    t, x = np.arange(N) * 0.1, np.linspace(0, 20e-6, N)
    assert Recording.from_arrays("a", Rig.from_dict(BENCH), t=t, x=x, F=x).n == N


@settings(max_examples=50, deadline=None)
@given(
    value=st.floats(-0.9, 50.0),
    unit=st.sampled_from([("bar", 1e5), ("kPa", 1e3), ("Pa", 1.0), ("psi", 6894.757293168361)]),
    convention=st.sampled_from(["gauge", "abs"]),
)
def test_pressure_from_any_unit_and_reference(
    tmp_path_factory: pytest.TempPathFactory, value: float, unit: tuple[str, float], convention: str
) -> None:
    name, factor = unit
    absolute = value * factor + (PATM if convention == "gauge" else 0.0)
    if absolute < 0.0:
        return
    cells = [[*row[:3], repr(value), "3"] for row in rows()]
    path = write(tmp_path_factory.getbasetemp(), cells, [*HEADER[:3], f"p1 [{name}]", "p2 [bar]"])
    run = Recording.read(path, Rig.from_dict(SERVO | {"conventions": {"pressure": convention}}))
    np.testing.assert_allclose(run.signals["p1"], absolute, rtol=1e-12, atol=1e-6)


def cell(row: int, column: int, text: str) -> Callable[[list[str], list[list[str]]], None]:
    """Put ``text`` into one cell; ``row`` is the line of the file."""

    def change(_header: list[str], cells: list[list[str]]) -> None:
        cells[row - 2][column] = text

    return change


def title(column: int, text: str) -> Callable[[list[str], list[list[str]]], None]:
    """Change one cell of the header."""

    def change(header: list[str], _cells: list[list[str]]) -> None:
        header[column] = text

    return change


def column_of(column: int, text: str) -> Callable[[list[str], list[list[str]]], None]:
    """Put ``text`` into a whole column."""

    def change(_header: list[str], cells: list[list[str]]) -> None:
        for row in cells:
            row[column] = text

    return change


def shorten(_header: list[str], cells: list[list[str]]) -> None:
    del cells[5:]


def short_row(_header: list[str], cells: list[list[str]]) -> None:
    del cells[8][4:]


NONSENSE = [
    ("text", cell(10, 3, "high"), {}, ["row 10", "'p1'", "'high'"]),
    ("nan", cell(10, 2, "NaN"), {}, ["row 10", "'x'", "NaN", "gaps = true"]),
    ("empty", cell(11, 4, ""), {}, ["row 11", "'p2'", "empty", "gaps = true"]),
    ("infinite", cell(11, 4, "inf"), {}, ["row 11", "'p2'", "inf"]),
    ("missing time", cell(9, 0, ""), {"files": {"gaps": True}}, ["row 9", "'t'", "NaN"]),
    ("time back", cell(12, 0, "5.01"), {}, ["row 12", "'t'", "runs back", "5.01 after 5.09"]),
    ("time repeats", cell(12, 0, "5.09"), {}, ["row 12", "'t'", "repeats", "5.09 after 5.09"]),
    ("outside stroke", cell(15, 2, "502"), {}, ["row 15", "'x'", "502", "0 to 500 mm"]),
    ("before stroke", cell(15, 2, "-2"), {}, ["row 15", "'x'", "-2"]),
    ("vacuum", cell(20, 3, "-102"), {}, ["row 20", "'p1'", "-102", "below vacuum"]),
    ("vacuum abs", cell(20, 4, "-0.01"), {"conventions": {"pressure": "abs"}}, ["row 20", "'p2'", "-0.01", "vacuum"]),
    ("no motion", column_of(2, "100"), {}, ["'x'", "no motion", "50 um"]),
    ("few samples", shorten, {}, ["5 samples"]),
    ("short row", short_row, {}, ["row 10", "short", "4 cells"]),
    ("all gaps", column_of(1, ""), {"files": {"gaps": True}}, ["'u'", "every cell"]),
    ("no unit", title(2, "x"), {}, ["'x'", "no unit", "x [mm]"]),
    ("empty unit", title(2, "x []"), {}, ["'x'", "no unit"]),
    ("unknown unit", title(2, "x [mmm]"), {}, ["'x'", "'mmm'"]),
    ("wrong dimension", title(3, "p1 [mm]"), {}, ["'p1'", "'mm'", "Pa"]),
    ("a unit with its reference", title(3, "p1 [barg]"), {}, ["'p1'", "'barg'", "write bar", "conventions"]),
    ("volts for pressure", title(3, "p1 [V]"), {}, ["'p1'", "'V'", "Pa"]),
    ("no u", title(1, "cmd [V]"), {}, ["column u is missing", "cmd", "[columns]"]),
    ("no p2", title(4, "p3 [bar]"), {}, ["column p2 is missing", "p3"]),
    ("capital", title(3, "P1 [kPa]"), {}, ["'P1'", "p1", "[columns]"]),
    ("mapped away", title(1, "y [V]"), {"columns": {"u": {"column": "cmd"}}}, ["'cmd'", "u", "missing", "y"]),
    ("number too high", title(1, "y [V]"), {"columns": {"u": {"column": 9}}}, ["column 9", "6 columns"]),
    ("two units", title(1, "y [mV]"), {"columns": {"u": {"column": "y", "unit": "V"}}}, ["'y'", "[mV]", "'V'"]),
    ("mapped twice", title(1, "y [V]"), {"columns": {"u": {"column": "y"}, "x": {"column": 2}}}, ["'y'", "u", "x"]),
    ("mapped, no unit", title(1, "y"), {"columns": {"u": {"column": "y"}}}, ["'y'", "no unit"]),
    ("gain", title(1, "y [A]"), {"columns": {"u": {"column": "y", "gain": "2 V/N"}}}, ["'y'", "2 V/N", "u in V"]),
]


@pytest.mark.parametrize(("change", "rig", "said"), [case[1:] for case in NONSENSE], ids=[case[0] for case in NONSENSE])
def test_nonsense_is_refused_in_one_line_with_file_row_and_column(
    change: Callable[[list[str], list[list[str]]], None], rig: dict[str, Any], said: list[str], tmp_path: Path
) -> None:
    header, cells = list(HEADER), rows()
    change(header, cells)
    path = write(tmp_path, cells, header)
    with pytest.raises(UserError) as caught:
        Recording.read(path, Rig.from_dict(SERVO | rig))
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{path}: ")
    for words in said:
        assert words in line


def test_pressures_without_an_area_are_refused(tmp_path: Path) -> None:
    raw = BENCH | {"conventions": {"pressure": "gauge"}}
    cells = [[f"{k}", f"{k}", "5", "2"] for k in range(N)]
    with pytest.raises(UserError, match=r"p1 is there, but .* no cylinder.bore"):
        Recording.read(write(tmp_path, cells, ["t [s]", "x [mm]", "F [N]", "p1 [bar]"]), Rig.from_dict(raw))
    with pytest.raises(UserError, match=r"p2 is there, but .* no cylinder.rod"):
        Recording.read(
            write(tmp_path, cells, ["t [s]", "x [mm]", "F [N]", "p2 [bar]"]),
            Rig.from_dict(raw | {"cylinder": {"bore": "32 mm"}}),
        )


def test_a_vector_of_another_length_is_named(tmp_path: Path) -> None:
    raw = BENCH | {"columns": {"x": {"column": "x", "unit": "m"}, "t": {"column": "t", "unit": "s"}}}
    k = np.arange(N, dtype=float)
    scipy.io.savemat(tmp_path / "a.mat", {"t": k, "x": k[:-3], "F": k})
    with pytest.raises(UserError, match=r"'x' for x is missing; it cannot be used: 27 values where"):
        Recording.read(tmp_path / "a.mat", Rig.from_dict(raw))
    scipy.io.savemat(tmp_path / "b.mat", {"t": k, "x": k, "F": k})
    with pytest.raises(UserError, match="column 'F' has no unit"):
        Recording.read(tmp_path / "b.mat", Rig.from_dict(raw))
    scipy.io.savemat(tmp_path / "c.mat", {"t": k[::-1], "x": k, "F": k})
    with pytest.raises(UserError, match="sample 2, column 't': time runs back"):
        Recording.read(tmp_path / "c.mat", Rig.from_dict(raw | {"columns": {
            name: {"column": name, "unit": unit} for name, unit in (("t", "s"), ("x", "m"), ("F", "N"))}}))  # fmt: skip


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        ({"x": np.zeros(N)}, "column F is missing"),
        ({"x": np.zeros(N), "F": np.zeros(N)}, "no motion"),
        ({"x": np.zeros(N - 1), "F": np.zeros(N)}, "column x has shape"),
        ({"x": np.full(N, math.nan), "F": np.zeros(N)}, "sample 1, column x: nan"),
        ({"x": np.zeros(N), "F": np.zeros(N), "u": np.zeros(N)}, "'u' is no signal of a bench"),
    ],
)
def test_arrays_that_are_refused(signals: dict[str, np.ndarray], said: str) -> None:
    with pytest.raises(UserError) as caught:
        Recording.from_arrays("virtual", Rig.from_dict(BENCH), t=np.arange(N) * 1.0, **signals)
    assert str(caught.value).startswith("virtual: ")
    assert said in str(caught.value)
