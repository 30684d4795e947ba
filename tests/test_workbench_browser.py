"""The workbench in a real browser: the whole story on the embedded hidden-effect data, cancel, a broken file.

The story takes minutes and is marked slow: ``pytest -m slow tests/test_workbench_browser.py``. With
``PNEUID_PICTURES=docs/workbench`` the tests write a picture of each view there (``PNEUID_PICTURES_ALL=1``: the large window
and the dark ground too), with ``PNEUID_PICTURES_STUDY=FOLDER`` of a finished closed-loop study also that of Control.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import replace

import helpers
import pandas as pd
import pytest
from workbench_window import CSS, ENTER, NARROW, TAG, WIDE, Site, Window, outside, short_demo

from pneuid.model import nominal_model
from pneuid.resources import scenario_path
from pneuid.rig import Rig
from pneuid.virtual_rig import NOTHING, SERVO_SENSORS
from pneuid.virtual_rig.at_zero import record_zero
from pneuid.zero_reading import ZeroReading

SAMPLES = 3000
"""Length of the runs: two runs of 2.5 s are too little to tell how friction follows the pressure, and diagnose says so."""

PATIENCE = 600
"""Longest wait for a computation, s: the first one compiles, and other work may share the machine."""

STUDY = os.environ.get("PNEUID_PICTURES_STUDY")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    found = Site(short_demo(tmp_path_factory.mktemp("site") / "monday", SAMPLES))
    yield found
    if found.process.poll() is None:
        found.stop()


@pytest.fixture(scope="module")
def window(site, tmp_path_factory):
    found = Window(site, tmp_path_factory.mktemp("profile"))
    yield found
    found.driver.quit()


def test_the_data_are_seen_and_a_key_changes_the_view(window):
    window.wait(lambda: window.plotted("run-plot"), 60, "the first run")
    assert "hold_out_2.csv" in window.text("runs")
    window.wait(lambda: window.text("runs").count("3 000 samples") == 5, 60, "the other runs")
    window.driver.find_element(TAG, "body").send_keys("5")
    window.wait(lambda: "No rung yet" in window.driver.find_element(TAG, "body").text, what="the ladder by key 5")
    window.wait(lambda: window.driver.current_url.endswith("?view=ladder"), what="the address")
    window.driver.refresh()  # as after a lost connection
    window.wait(lambda: "No rung yet" in window.driver.find_element(TAG, "body").text, what="the ladder, loaded anew")
    window.quiet()
    window.driver.find_element(TAG, "body").send_keys("1")
    window.wait(lambda: window.plotted("run-plot"), what="the data by key 1")
    window.fits("data")


def test_the_role_of_a_run_is_chosen_with_the_mouse(window):
    for word, kept in (("not used", "unused"), ("train", "train")):
        window.pick("role of train_3.csv", word)
        settings = window.site.folder / "workbench.json"
        window.wait(lambda: settings.exists() and json.loads(settings.read_text())["roles"]["train_3.csv"] == kept, 20, word)  # noqa: B023
    window.wait(lambda: not window.text("status"), 60, "the reader")
    assert json.loads((window.site.folder / "workbench.json").read_text())["roles"]["train_3.csv"] == "train"


@pytest.mark.parametrize(
    ("view", "hint"),
    [
        ("fit", "No model yet: press Fit"), ("where", "There is no model yet"), ("missing", "There is no model yet: fit one"),
        ("ladder", "No rung yet"), ("control", "python -m controllers.study --out monday/study"),
    ],
)  # fmt: skip
def test_an_empty_view_says_what_to_do(window, view, hint):
    window.press(f"tab-{view}")
    window.wait(lambda: hint in window.driver.find_element(TAG, "body").text, what=hint)
    assert window.misfits() == []


def test_a_broken_file_is_refused_with_the_row(window, tmp_path):
    window.go("data", "upload")
    lines = (scenario_path("demo") / "train_2.csv").read_text().splitlines()[:200]
    lines[77] = lines[77].rsplit(",", 1)[0] + ",oops"
    broken = tmp_path / "broken.csv"
    broken.write_text("\n".join(lines))
    window.upload(broken)
    window.wait(lambda: "broken.csv: row 78" in window.text("refused"), what="the message")
    assert "'oops' is not a number" in window.text("refused")
    assert "\n" not in window.text("refused").removesuffix("close").strip()
    assert not (window.site.folder / "broken.csv").exists()
    assert window.misfits() == []
    dismiss = """document.querySelector('[aria-label="dismiss"]')?.click()"""
    window.press_until(dismiss, lambda: not window.find("refused"), "the message to go")


@pytest.fixture
def foreign(window, tmp_path):
    """A recording whose position has another name, in the project for the length of a test: the next ones fit without it."""
    before = (window.site.folder / "rig.toml").read_text()
    lines = (scenario_path("demo") / "train_2.csv").read_text().splitlines()[:400]
    other = tmp_path / "other.csv"
    other.write_text("\n".join([lines[0].replace("x [mm]", "weg [mm]"), *lines[1:]]))
    window.upload(other)
    window.wait(lambda: "other.csv" in window.text("runs"), what="the new run")
    yield other.name
    (window.site.folder / other.name).unlink()
    (window.site.folder / "rig.toml").write_text(before)
    window.wait(lambda: other.name not in window.text("runs"), what="the run to go")


def test_columns_of_other_names_are_mapped_with_the_file_in_view(window, foreign):
    choose = f"[...document.querySelectorAll('.run-row')].find(row => row.innerText.includes('{foreign}')).click()"
    window.press_until(choose, lambda: "column x is missing" in window.text("fault"), "what is missing")
    open_map = """document.querySelector('[data-testid="map"]')?.click()"""
    window.press_until(open_map, lambda: window.find("save-columns"), "the head of the file")
    assert "weg [mm]" in window.driver.find_element(CSS, ".q-dialog").text
    window.quiet()
    window.picture("columns", NARROW, "light")
    assert window.misfits() == []
    window.pick("column of x", "weg")
    window.press("save-columns")
    window.wait(lambda: 'x = {column = "weg"}' in (window.site.folder / "rig.toml").read_text(), what="the mapping")
    window.wait(lambda: window.plotted("run-plot"), what="the run by its new names")


def test_a_zero_reading_is_shown_as_what_the_sensors_read(window, tmp_path):
    rig = Rig.from_toml(window.site.folder / "rig.toml")
    seen = record_zero(replace(NOTHING, sensor_offset_p1=3e3), rig.patm, SERVO_SENSORS, 1)
    vented = tmp_path / "zero_vented.csv"
    pd.DataFrame({f"{name} [kPa]": (seen[name] - rig.patm) / 1e3 for name in ("p1", "p2")}).to_csv(vented, index=False)
    window.go("data", "upload")
    window.upload(vented)
    read = str(ZeroReading.read(vented, rig))
    window.wait(lambda: read in window.text("runs"), 60, "what the sensors show")
    choose = "[...document.querySelectorAll('.run-row')].find(row => row.innerText.includes('zero_vented.csv')).click()"
    shown = f"The sensors with both chambers vented and nothing pulling show {read}"
    window.press_until(choose, lambda: shown in window.driver.find_element(TAG, "body").text, "the reading in the view")
    window.quiet()
    window.picture("zero", NARROW, "light")
    assert window.misfits() == []
    (window.site.folder / vented.name).unlink()
    window.wait(lambda: vented.name not in window.text("runs"), what="the reading to go")


@pytest.mark.slow
def test_a_running_fit_is_cancelled_and_the_second_window_sees_it(site, window, tmp_path):
    second = Window(site, tmp_path / "second", WIDE)
    try:
        window.go("fit", "fit")
        second.go("fit", "fit")
        window.begin("fit", "fit")
        with site.held():
            second.wait(lambda: "running" in second.text("job"), what="the second window to see the fit")
            second.cancel()
        window.wait(lambda: "cancelled" in window.text("job"), 20, "the cancel")
        assert not list(site.folder.glob("identify*"))
        second.logs()
        assert second.complaints == []
    finally:
        second.driver.quit()


@pytest.mark.slow
def test_the_story(window):
    site = window.site
    window.go("fit", "fit")
    window.begin("fit", "fit")
    window.wait(lambda: "iteration" in window.text("job"), PATIENCE, "iterations")
    window.wait(lambda: "fit: done" in window.text("job"), PATIENCE, "the fit")
    window.wait(lambda: window.find("errors"), what="the errors")
    before = {signal: window.held_out_error(signal) for signal in ("x", "p1", "p2")}
    window.fits("fit")

    window.go("where", "overlay")
    window.wait(lambda: window.plotted("overlay") and window.plotted("residual"), what="the overlays")
    plain, dots = window.shapes("overlay"), window.traces("residual")
    window.wait(lambda: window.find("region-0"), what="a region")
    window.find("region-0")[0].send_keys(ENTER)
    window.wait(
        lambda: window.plotted("overlay") and window.shapes("overlay") > plain, what="the highlighted stretches"
    )
    window.wait(lambda: window.plotted("residual") and window.traces("residual") == dots + 1, what="the residual")
    window.wait(lambda: window.plotted("phase") and window.traces("phase") == 2, what="the phase plane")
    window.fits("where")

    window.go("missing", "diagnose")
    window.begin("diagnose", "diagnose identify")
    window.wait(lambda: window.find("verdict"), PATIENCE, "the verdict")
    assert "friction_pressure" in window.text("verdict")
    window.wait(lambda: window.plotted("ranking"), what="the ranking")
    window.wait(lambda: window.plotted("shape-friction_pressure"), what="the effect over the measured defect")
    window.fits("missing")
    panel = """document.querySelector('[data-testid="over-defect"]').scrollIntoView({block: "start"})"""
    window.driver.execute_script(panel)
    window.quiet()
    window.picture("over_defect", NARROW, "light")
    window.driver.execute_script("scrollTo(0, 0)")
    window.driver.find_element(CSS, '[data-testid="how-friction_pressure"] .q-item').click()
    window.wait(lambda: window.plotted("signature-friction_pressure"), 60, "the signature")
    window.fits("signature")
    window.driver.find_element(CSS, '[data-testid="how-friction_pressure"] .q-item').click()

    window.begin("add-friction_pressure", "fit with friction_pressure")
    window.wait(lambda: "fit with friction_pressure: done" in window.text("job"), PATIENCE, "the second fit")
    window.wait(lambda: window.held_out_error("p1") != before["p1"], what="the new errors")
    after = {signal: window.held_out_error(signal) for signal in before}
    assert all(after[signal] < 0.8 * before[signal] for signal in before), (before, after)

    window.go("ladder", "ladder")
    window.wait(lambda: window.plotted("ladder"), what="the ladder")
    assert "+ friction_pressure" in window.text("rungs")
    window.fits("ladder")
    # what the workbench wrote, the commands read
    rungs = json.loads((site.folder / "identify_2" / "ladder.json").read_text())
    assert [rung["added"] for rung in rungs if rung["accepted"]] == [None, "friction_pressure"]


@pytest.fixture
def later(tmp_path):
    """A window on a project of its own that holds a model already."""
    site = Site(short_demo(tmp_path / "tuesday", SAMPLES))
    (site.folder / "before").mkdir()
    rig = Rig.from_toml(site.folder / "rig.toml")
    nominal_model(rig, {}, helpers.RANGES).save(site.folder / "before" / "model.json")
    found = Window(site, tmp_path / "profile")
    yield found
    found.driver.quit()
    site.stop()


@pytest.mark.slow
def test_an_unknown_function_is_drawn_and_can_be_added(later):
    """From files as ``pneuid.diagnose`` writes them: the search itself takes long and is tested elsewhere."""
    x = [0.1 * k for k in range(5)]
    curve = {"effect": "spline:force(x)", "equation": "force", "signal": "x", "times": "", "unit": "N", "at": x,
             "value": x, "std": x, "provisional": True}  # fmt: skip
    unknown = {"equation": "force", "depends_on": ["x"], "rms": 3.0, "unit": "N", "effect": "spline:force(x)", "curve": curve,
               "formula": "sin", "formula_effect": "formula:force(period(x,0.025))", "formula_error": 0.1}  # fmt: skip
    folder = later.site.folder / "later_diagnosed"
    folder.mkdir()
    found = {"schema": 1, "verdict": "unknown", "effects": [], "ranking": [], "unknown": unknown, "next_experiment": None,
             "sentences": [], "model": "before"}  # fmt: skip
    shown = {"x_label": "x (mm)", "y_label": "force (N)", "at": x, "value": x, "std": x}
    (folder / "shapes.json").write_text(json.dumps({"shapes": [], "unknown": shown}))
    (folder / "diagnosis.json").write_text(json.dumps(found))
    later.go("missing", "diagnose")
    later.wait(lambda: later.plotted("unknown"), 60, "the function")
    assert later.misfits() == []
    later.wait(lambda: later.enabled("add-formula:force(period(x,0.025))"), 60, "the formula to be offered")
    later.begin("add-spline:force(x)", "fit with spline:force(x)")
    with later.site.held():
        later.cancel()


@pytest.mark.skipif(STUDY is None, reason="PNEUID_PICTURES_STUDY names no folder of a finished study")
def test_a_study_is_shown(window):
    shutil.copytree(str(STUDY), window.site.folder / "study")
    # the folder is looked at every two seconds
    time.sleep(3)
    window.go("control", "study")
    window.wait(lambda: window.plotted("study"), what="the study")
    assert window.traces("study") > 0
    window.fits("control")


def test_nothing_left_the_machine_and_nothing_complained(window):
    window.logs()
    assert len(window.requests) > 10
    assert outside(window) == []
    assert window.complaints == []
    assert window.unfit == []


def test_ctrl_c_ends_it_cleanly(site):
    assert site.stop() == 130
    assert "Traceback" not in site.log.read_text()
