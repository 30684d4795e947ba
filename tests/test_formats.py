"""Contract of the readers: raw columns, units of the header, line numbers, and files that are no measurement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from pneuid.errors import UserError
from pneuid.formats import READERS, FileLayout, read_table

PLAIN = "t [s],x [mm],remark\n0.0,1.0,start\n0.1,2.0,\n0.2,3.0,end\n"


def write(folder: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refused(path: Path, layout: FileLayout | None = None) -> str:
    with pytest.raises(UserError) as caught:
        read_table(path, layout or FileLayout())
    line = str(caught.value)
    assert "\n" not in line and str(path) in line
    return line


def test_every_registered_extension_is_lower_case_and_callable() -> None:
    assert {".csv", ".txt", ".dat", ".mat"} <= set(READERS)
    assert all(ending == ending.lower() and ending.startswith(".") and callable(READERS[ending]) for ending in READERS)


def test_header_units_line_numbers_and_text_columns(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, PLAIN), FileLayout())
    assert list(table.frame.columns) == ["t", "x", "remark"]
    assert table.units == {"t": "s", "x": "mm"}
    assert list(table.frame.index) == [2, 3, 4]
    np.testing.assert_array_equal(table.numbers("x", False, "f"), [1.0, 2.0, 3.0])
    with pytest.raises(UserError, match="row 2, column 'remark': 'start' is not a number"):
        table.numbers("remark", False, "f")


@pytest.mark.parametrize(
    "content",
    [
        "t [s],x [mm]\r\n0,1\r\n1,2\r\n\r\n  \r\n",
        "\ufefft [s],x [mm]\n0,1\n1,2",
        '"t [s]", "x [mm]"\n"0","1"\n"1","2"\n',
        " t  [s] ,\tx [ mm ]\n 0 , 1\n1,2e0\n",
        "t [s],x [mm]\r0,1\r1,2\r",
    ],
    ids=["crlf and empty tail", "byte order mark", "quotes", "blanks", "cr only"],
)
def test_the_same_table_in_many_disguises(content: str, tmp_path: Path) -> None:
    table = read_table(write(tmp_path, content), FileLayout())
    assert list(table.frame.columns) == ["t", "x"]
    assert table.units == {"t": "s", "x": "mm"}
    np.testing.assert_array_equal(table.frame.to_numpy(float), [[0, 1], [1, 2]])


@pytest.mark.parametrize(
    ("layout", "content"),
    [
        (FileLayout(delimiter=";"), "t [s];x [mm]\n0;1\n1;2\n"),
        (FileLayout(delimiter="\t"), "t [s]\tx [mm]\n0\t1\n1\t2\n"),
        (FileLayout(delimiter="whitespace"), "t [s]   x [mm]\n 0  1 \n1\t2\n"),
        (FileLayout(skip_rows=2), "logger 3\n\nt [s],x [mm]\n0,1\n1,2\n"),
        (FileLayout(delimiter=";", decimal=","), "t [s];x [mm]\n0,0;1,\n10,0E-1;2\n"),
        (FileLayout(units=True, delimiter=";"), "t;x\n[s]; mm\n0;1\n1;2\n"),
        (FileLayout(encoding="cp1252"), "t [s],x [mm]\n0,1\n1,2\n"),
    ],
    ids=["semicolon", "tab", "whitespace", "skip_rows", "decimal comma", "units below", "encoding"],
)
def test_layouts(layout: FileLayout, content: str, tmp_path: Path) -> None:
    table = read_table(write(tmp_path, content, "run.TXT"), layout)
    assert list(table.frame.columns) == ["t", "x"]
    assert table.units == {"t": "s", "x": "mm"}
    np.testing.assert_array_equal(table.frame.to_numpy(float), [[0, 1], [1, 2]])
    assert table.frame.index[0] == layout.skip_rows + 2 + layout.units


def test_decimal_commas_beside_text_and_points(tmp_path: Path) -> None:
    """A column of dates does not hinder; a point where commas are decimals may mean thousands and is refused."""
    layout = FileLayout(delimiter=";", decimal=",")
    path = write(tmp_path, "t [s];day;x [mm]\n0,5;21.11.2026;1\n1,25;21.11.2026;1.234\n")
    table = read_table(path, layout)
    np.testing.assert_array_equal(table.numbers("t", False, "f"), [0.5, 1.25])
    with pytest.raises(UserError, match=r"f: row 3, column 'x': '1.234' is not a number; .*decimals are written with"):
        table.numbers("x", False, "f")
    numbers = read_table(write(tmp_path, "t [s];x [mm]\n0,5;1\n1,25;1.234\n"), layout)
    with pytest.raises(UserError, match=r"row 3, column 'x': '1.234' is not a number"):
        numbers.numbers("x", False, "f")
    with pytest.raises(UserError, match=r"row 3, column 'x': '1.234,5' is not a number"):
        read_table(write(tmp_path, "t [s];x [mm]\n0,5;1\n1,25;1.234,5\n"), layout).numbers("x", False, "f")
    gaps = read_table(write(tmp_path, "t [s];x [mm]\n0,5;1\n1,25;\n"), FileLayout(delimiter=";", decimal=",", gaps=True))
    np.testing.assert_array_equal(gaps.numbers("x", True, "f"), [1, np.nan])


def test_a_line_of_units_below_the_header(tmp_path: Path) -> None:
    path = write(tmp_path, "t,x,state\nms,mm,-\n0,1,0\n1,2,0\n")
    with pytest.raises(UserError, match=r"row 2, column 'x': 'mm' is not a number; for a line of units .* units = true"):
        read_table(path, FileLayout()).numbers("x", False, "f")
    table = read_table(path, FileLayout(units=True))
    assert table.units == {"t": "ms", "x": "mm"} and list(table.frame.index) == [3, 4]
    for content in ("t [s],x [mm]\n0,1\n1,2\n", "t,x\nms\n0,1\n"):
        assert "is no line of units" in refused(write(tmp_path, content), FileLayout(units=True))
    assert "no sample" in refused(write(tmp_path, "t,x\nms,mm\n"), FileLayout(units=True))


def test_a_logger_of_windows_writes_micrometres(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, b"t [s],x [\xb5m]\n0,1\n1,2\n"), FileLayout(encoding="cp1252"))
    assert table.units["x"] == "\u00b5m"


def test_without_a_header_columns_are_numbers(tmp_path: Path) -> None:
    layout = FileLayout(delimiter="whitespace", header=False, skip_rows=1)
    table = read_table(write(tmp_path, "junk\n0 1 2\n1 2 3\n", "run.dat"), layout)
    assert list(table.frame.columns) == [1, 2, 3]
    assert list(table.frame.index) == [2, 3]


def test_gaps_become_nan_only_when_allowed(tmp_path: Path) -> None:
    table = read_table(write(tmp_path, "t [s],x [mm]\n0,1\n1,\n2,NaN\n3,4\n"), FileLayout())
    np.testing.assert_array_equal(table.numbers("x", True, "f"), [1, np.nan, np.nan, 4])
    with pytest.raises(UserError, match=r"f: row 3, column 'x': the cell is empty; .*gaps = true"):
        table.numbers("x", False, "f")
    only_nan = read_table(write(tmp_path, "t [s],x [mm]\n0,1\n1,nan\n"), FileLayout())
    with pytest.raises(UserError, match="row 3, column 'x': the cell is NaN"):
        only_nan.numbers("x", False, "f")


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("abc", "'abc' is not a number"),
        ("1_000", "'1_000' is not a number"),
        ("0x10", "'0x10' is not a number"),
        ("n/a", "'n/a' is not a number"),
        ('"1,5"', "for decimal commas write decimal"),
        ("1e999", "inf is not finite"),
        ("inf", "inf"),
    ],
)
@pytest.mark.parametrize("gaps", [False, True])
def test_a_cell_that_is_no_number_is_named(cell: str, said: str, gaps: bool, tmp_path: Path) -> None:
    table = read_table(write(tmp_path, f"t [s],x [mm]\n0,1\n1,{cell}\n2,3\n"), FileLayout())
    with pytest.raises(UserError) as caught:
        table.numbers("x", gaps, "run.csv")
    assert str(caught.value).startswith("run.csv: row 3, column 'x': ") and said in str(caught.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "empty"),
        ("\n\n \n", "empty"),
        ("t [s],x [mm]\n", "no sample"),
        ("t [s],x [mm]\n0,1\n1\n", "row 3 is short: 1 cells where 2"),
        ("t [s],x [mm]\n0,1\n1,2,3\n", "row 3 is long: 3 cells where 2"),
        ("t [s],x [mm]\n0,1\n\n1,2\n", "row 3 is empty"),
        ("t [s],t [ms]\n0,1\n1,2\n", "row 1, column 2: 't' names two columns"),
        ("t [s],x [mm\n0,1\n1,2\n", "row 1, column 2: 'x [mm' is not of the form"),
        ("0,1\n1,2\n", "row 1: '0,1' is no header"),
        ("t [s];x [mm]\n0;1\n", 'the line holds \';\': write delimiter = ";" below [files] in rig.toml'),
        ("t [s];x [mm]\n0,1;1\n", 'write delimiter = ";" and decimal = "," below [files]'),
        ("t [s]\tx [mm]\n0\t1\n", r'write delimiter = "\t" below [files]'),
        (b"t [s],x [\xb5m]\n0,1\n", "row 1: byte 0xb5 is not UTF-8 text; save the file as UTF-8, or write [files] encoding"),
        (b"t [s],x [mm]\n0,1\n\x80,2\n", "row 3: byte 0x80"),
        (b"\x00\x01\x02binary", "binary"),
        ("t [s],x [mm]\n0,1\n".encode("utf-16"), "UTF-16"),
        (b"\x89PNG\r\n\x1a\n", "UTF-8"),
    ],
)
def test_files_that_are_no_table(content: str | bytes, said: str, tmp_path: Path) -> None:
    assert said in refused(write(tmp_path, content))


def test_rows_beyond_the_file_and_a_cell_without_end(tmp_path: Path) -> None:
    assert "skip_rows = 9" in refused(write(tmp_path, PLAIN), FileLayout(skip_rows=9))
    assert "row 3" in refused(write(tmp_path, "t [s],x [mm]\n0,1\n1," + "2" * 200_000 + "a\n"))


def test_unknown_extension_absent_file_and_folder(tmp_path: Path) -> None:
    line = refused(write(tmp_path, PLAIN, "run.xlsx"))
    assert "'.xlsx'" in line and ".csv" in line and ".mat" in line
    assert "no such file" in refused(tmp_path / "none.csv")
    (tmp_path / "folder.csv").mkdir()
    assert "not a file" in refused(tmp_path / "folder.csv")


def test_a_file_that_the_system_refuses_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, layout: FileLayout) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setitem(READERS, ".csv", fail)
    assert "Permission denied" in refused(write(tmp_path, PLAIN))


def test_matlab_vectors_are_columns_and_the_rest_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {"t": np.arange(5.0)[:, None], "x": np.arange(5)[None, :], "gain": 35.0, "short": np.arange(3.0)}
    content |= {"text": "hello", "grid": np.ones((5, 5)), "wave": np.arange(5) * 1j, "s": {"a": 1.0}}
    scipy.io.savemat(path, content)
    table = read_table(path, FileLayout())
    assert list(table.frame.columns) == ["t", "x"]
    assert table.row_word == "sample" and list(table.frame.index) == [1, 2, 3, 4, 5]
    np.testing.assert_array_equal(table.numbers("x", False, "f"), np.arange(5.0))
    assert set(table.ignored) == {"gain", "short", "text", "grid", "wave", "s"}
    assert "3 values where the other vectors have 5" in table.ignored["short"]


def test_matlab_files_that_cannot_be_read(tmp_path: Path) -> None:
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + b"\0" * 64
    assert "-v7" in refused(write(tmp_path, header, "new.mat"))
    assert "not a MATLAB file" in refused(write(tmp_path, b"t,x\n0,1\n" * 40, "text.mat"))
    assert "not a MATLAB file" in refused(write(tmp_path, b"", "empty.mat"))
    scipy.io.savemat(tmp_path / "scalars.mat", {"a": 1.0})
    assert "no vector" in refused(tmp_path / "scalars.mat")


@settings(deadline=None)
@given(
    content=st.binary(max_size=60) | st.text(alphabet="0123456789.,;[]\"' \t\r\nx\x0c\u2028-e", max_size=60),
    header=st.booleans(),
    gaps=st.booleans(),
    delimiter=st.sampled_from([",", ";", "\t", "whitespace"]),
    ending=st.sampled_from([".csv", ".mat"]),
)
def test_no_content_fails_otherwise_than_with_one_line(
    tmp_path_factory: pytest.TempPathFactory,
    content: bytes | str,
    header: bool,
    gaps: bool,
    delimiter: str,
    ending: str,
) -> None:
    path = write(tmp_path_factory.getbasetemp(), content, f"any{ending}")
    problem = ""
    try:
        table = read_table(path, FileLayout(delimiter=delimiter, header=header, gaps=gaps))
        for column in table.frame.columns:
            table.numbers(column, gaps, str(path))
    except UserError as error:
        problem = str(error)
    assert "\n" not in problem
