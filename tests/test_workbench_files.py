"""What the workbench does with files: their layout and columns, uploads, and one of which its reader dies."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pneuid.errors import UserError
from pneuid.workbench.project import Project, demo_project
from pneuid.workbench.rig_text import with_columns, with_files

# --- layout and columns ---


def test_a_mapping_goes_into_rig_toml_and_comes_back(tmp_path):
    from pneuid.rig import Rig

    text = demo_project(tmp_path / "demo").rig_text() + '\n[columns]\nx = {column = "old"}\n[columns.u]\ncolumn = "U"\n'
    made = with_columns(text, {"x": ('weg "1"', "mm"), "p1": ("druck", "")})
    path = tmp_path / "rig.toml"
    path.write_text(made)
    columns = Rig.from_toml(path).columns
    assert {name: (item.column, item.unit) for name, item in columns.items()} == {
        "x": ('weg "1"', "mm"), "p1": ("druck", None),
    }  # fmt: skip
    assert "data sheet; the fit starts from it" in made


def test_gain_and_offset_of_a_mapped_signal_stay(tmp_path):
    from pneuid.rig import Rig

    text = demo_project(tmp_path / "demo").rig_text() + (
        '[files]\nheader = false\ngaps = true\n[columns]\nt = {column = 1, unit = "ms"}\n'
        'x = {column = 2, unit = "mm", gain = "-1", offset = "500 mm"}\n'
    )
    path = tmp_path / "rig.toml"
    path.write_text(with_columns(text, {"t": ("1", "s"), "x": ("3", "mm")}))
    rig = Rig.from_toml(path)
    assert (rig.columns["t"].column, rig.columns["t"].unit) == (1, "s")
    assert (rig.columns["x"].column, rig.columns["x"].gain, rig.columns["x"].offset) == (3, "-1", 0.5)
    layout = {"delimiter": ";", "decimal": ",", "header": True, "skip_rows": 0, "encoding": "utf-8"}
    path.write_text(with_columns(with_files(text, layout), {"t": ("Zeit", "ms")}))
    files = Rig.from_toml(path).files
    assert (files.delimiter, files.decimal, files.header, files.gaps) == (";", ",", True, True)
    assert with_files(text, {"header": False}) == text


def test_a_logger_of_its_own_layout_is_taken_and_its_head_is_shown(tmp_path):
    from pneuid.workbench.reading import check_upload, raw_head

    rig = demo_project(tmp_path / "demo").rig_text()
    path = tmp_path / "log.csv"
    path.write_bytes("Zeit;Weg [\u00b5m];P_A\n".encode("cp1252") + b"".join(b"%d,5;1%d,0;3\n" % (k, k) for k in range(400)))
    assert "is not UTF-8 text" in check_upload(path, rig)
    assert "is not UTF-8 text" in check_upload(path, None)
    head = raw_head(path, rig)
    assert head.columns == ("Zeit", "Weg", "P_A") and head.units == {"Weg": "\u00b5m"} and not head.fault
    assert head.rows[1] == ("1.5", "11", "3")
    assert (head.layout["delimiter"], head.layout["decimal"], head.layout["encoding"]) == (";", ",", "cp1252")
    wrong = raw_head(path, rig, head.layout | {"delimiter": "\t"})
    assert "only one column found" in wrong.fault and "tmp" not in wrong.fault and len(wrong.rows) == 6
    assert "column t is missing" in check_upload(path, with_files(rig, head.layout))
    path.write_text("t;x\ns;mm\n" + "".join(f"{k},5;1\n" for k in range(100)))
    head = raw_head(path, rig)
    assert head.units == {"t": "s", "x": "mm"} and head.layout["units"] and head.rows[0] == ("0.5", "1")


# --- uploads that are no recordings ---


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x89PNG\r\n\x1a\n\0\0", "binary data"),
        (b"", "is empty"),
        (b"dear diary, today\nnothing moved, again\n", "not a recording"),
        (b"t [s],u [V],x [mm],p1 [kPa],p2 [kPa]\n0,1,2,3,4\n1,1,2,3\n", "row 3 is short"),
    ],
)
def test_an_upload_that_is_no_recording_is_refused(content, words, tmp_path):
    from pneuid.workbench.reading import check_upload

    path = tmp_path / "new.csv"
    path.write_bytes(content)
    with pytest.raises(UserError, match=words):
        check_upload(path, demo_project(tmp_path / "demo").rig_text())


def test_an_upload_with_other_names_is_taken_and_says_what_to_map(tmp_path):
    from pneuid.workbench.reading import check_upload, raw_head

    lines = (demo_project(tmp_path / "demo").folder / "train_1.csv").read_text().splitlines()
    path = tmp_path / "new.csv"
    path.write_text("\n".join(["zeit [s],u [V],x [mm],p1 [kPa],p2 [kPa]", *lines[1:200]]))
    rig = Project(tmp_path / "demo").rig_text()
    assert "column t is missing" in check_upload(path, rig)
    head = raw_head(path, rig)
    assert head.columns[0] == "zeit"
    assert head.units["zeit"] == "s"
    assert check_upload(path, with_columns(rig, {"t": ("zeit", "")})) == ""


def test_a_large_text_file_is_seen_before_it_is_checked(tmp_path, monkeypatch):
    from pneuid.workbench import reading

    project = demo_project(tmp_path / "demo")
    path, rig = project.path("train_1.csv"), project.rig_text()
    assert reading.preview_run(path, rig) is None
    monkeypatch.setattr(reading, "LARGE_TEXT", 1000)
    monkeypatch.setattr(reading, "PREVIEW_SAMPLES", 500)
    seen, whole = reading.preview_run(path, rig), reading.read_run(path, rig)
    assert seen.preview and not whole.preview
    assert 490 <= seen.samples <= 500 and whole.samples == 6000
    assert np.array_equal(seen.channels["x"].values, whole.channels["x"].values[np.searchsorted(whole.t, seen.t)])
    assert np.diff(seen.t).max() < 3 * np.median(np.diff(seen.t)) and seen.t[0] == whole.t[0]


# --- a library that dies of a file ---


def test_a_file_that_kills_or_holds_its_reader_costs_nothing_but_itself(tmp_path, monkeypatch):
    from pneuid.workbench import state
    from pneuid.workbench.jobs import Worker

    monkeypatch.setattr(state, "READ_SECONDS", 3.0)
    project = demo_project(tmp_path / "demo")
    for name in ("train_2.csv", "train_3.csv", "hold_out_1.csv", "hold_out_2.csv"):
        (project.folder / name).unlink()
    for name in ("dies.tdms", "hangs.mf4"):
        (project.folder / name).write_bytes(b"damaged")
    bench = state.Workbench(project)
    bench.reader, bench.computer = Worker("reader", (state.READING, "deadly_reader")), Worker("computer", ())

    def until_idle():
        end = time.monotonic() + 120
        while bench.reader.busy or bench._doubtful:
            bench.tick()
            assert time.monotonic() < end
            time.sleep(0.02)

    try:
        bench.open()
        until_idle()
        assert bench.faults == {
            "dies.tdms": "dies.tdms: its reader crashed; the file is damaged, or not what its ending says",
            "hangs.mf4": "hangs.mf4: not read within 3 s; the file is damaged, or too long: cut it into several runs",
        }  # fmt: skip
        assert bench.data["train_1.csv"].samples == 6000
        waiting = project.incoming("dropped.tdms")
        waiting.write_bytes(b"damaged")
        bench.uploaded("dropped.tdms", waiting)
        until_idle()
        assert bench.refused["dropped.tdms"].startswith("dropped.tdms: its reader crashed")
        assert not waiting.exists() and not (project.folder / "dropped.tdms").exists()
    finally:
        bench.close()
