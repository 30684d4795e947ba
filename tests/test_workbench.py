"""The workbench without a browser: who may talk to it, which names it takes, what it writes, how it thins and marks."""

from __future__ import annotations

import asyncio
import json
import time

import numpy as np
import pytest

from pneuid.errors import UserError
from pneuid.workbench import look, reading
from pneuid.workbench.project import Project, default_role, demo_project
from pneuid.workbench.regions import region_mask, stretches
from pneuid.workbench.security import SUFFIXES, LocalOnly, safe_name

# --- names ---


@pytest.mark.parametrize(
    "name",
    [
        "../rig.csv", "..\\rig.csv", "/etc/passwd.csv", "a/b.csv", "C:\\x.csv", ".hidden.csv", "", "..", "a\0.csv", "a\n.csv",
        "x" * 200 + ".csv", "con|.csv",
    ],
)  # fmt: skip
def test_a_name_that_is_a_path_is_refused(name, tmp_path):
    project = Project(tmp_path / "p")
    with pytest.raises(UserError, match="not a plain file name"):
        safe_name(name)
    with pytest.raises(UserError):
        project.incoming(name)
    with pytest.raises(UserError):
        project.set_role(name, "train")
    with pytest.raises(UserError):
        project.remove(name)


def test_another_extension_is_refused():
    with pytest.raises(UserError, match=r"run\.exe: not a kind of recording"):
        safe_name("run.exe")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    outside = tmp_path / "outside.csv"
    outside.write_text("t [s]\n")
    project = Project(tmp_path / "p")
    (project.folder / "link.csv").symlink_to(outside)
    with pytest.raises(UserError, match="leads outside"):
        project.path("link.csv")


def test_a_result_outside_the_folder_is_not_read(tmp_path):
    (tmp_path / "model.json").write_text("{}")
    project = Project(tmp_path / "p")
    assert project.result("..", "model.json") is None


def test_suffixes_are_those_of_the_readers():
    from pneuid.formats import READERS

    assert tuple(READERS) == SUFFIXES


# --- hosts, origins, sizes ---


def asked(kind="http", method="GET", **headers):
    """Status that the middleware answers with; 200 where it lets the request through."""
    passed, sent = [], []

    async def app(_scope, _receive, send):
        passed.append(True)
        if kind == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive():
        raise AssertionError("a refused request is not read")

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "method": method,
             "headers": [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]}  # fmt: skip
    asyncio.run(LocalOnly(app, 8011, 200 * 2**20)(scope, receive, send))
    if kind == "websocket":
        return 200 if passed else sent[0]["code"]
    assert (sent[0]["status"] == 200) == bool(passed)
    return sent[0]["status"]


@pytest.mark.parametrize("host", ["127.0.0.1:8011", "localhost:8011", "LOCALHOST:8011"])
def test_this_machine_is_served(host):
    assert asked(host=host) == 200
    assert asked("websocket", host=host, origin=f"http://{host.lower()}") == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8011", "127.0.0.1", "127.0.0.1:9", "192.168.0.7:8011", ""]
)
def test_a_rebound_name_is_refused(host):
    assert asked(host=host) == 403
    assert asked("websocket", host=host, origin="http://127.0.0.1:8011") == 1008


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9", "https://localhost:8011"])
def test_another_origin_is_refused(origin):
    assert asked(host="localhost:8011", origin=origin) == 403
    assert asked(method="POST", host="localhost:8011", origin=origin, content_length="5") == 403
    assert asked("websocket", host="localhost:8011", origin=origin) == 1008


def test_a_websocket_without_an_origin_is_refused():
    assert asked("websocket", host="localhost:8011") == 1008


@pytest.mark.parametrize(
    ("length", "status"), [("1000", 200), (str(2 * 2**30), 413), (str(200 * 2**20 + 1), 413), ("-1", 411)]
)
def test_an_upload_is_judged_before_it_is_read(length, status):
    assert asked(method="POST", host="localhost:8011", content_length=length) == status


def test_an_upload_without_a_length_is_refused():
    assert asked(method="POST", host="localhost:8011") == 411


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """The shared state on the demo, with processes that take tasks and never start."""
    from pneuid.workbench.jobs import Job, Worker
    from pneuid.workbench.state import Workbench
    from pneuid.workbench.worker import Task

    def submit(self, title, module, name, arguments, live=(), then=None, otherwise=None, first=False, **_):
        return Job(title, Task(0, module, name, arguments, live), then, otherwise)

    monkeypatch.setattr(Worker, "submit", submit)
    return Workbench(demo_project(tmp_path / "demo"))


def test_two_gigabytes_in_the_folder_are_not_read(bench):
    with (bench.project.folder / "large.csv").open("wb") as stream:
        stream.truncate(2 * 2**30)
    bench.look()
    assert bench.faults == {
        "large.csv": "large.csv: 2.0 GB is more than the 1 GB a run may have; cut it into several runs"
    }
    with pytest.raises(UserError, match=r"large\.csv: 2\.0 GB .*; mend it, or give it the role 'not used'"):
        bench.fit()
    bench.project.set_role("large.csv", "unused")
    bench.look()
    bench.fit()
    assert bench.job.title == "fit"


def test_a_second_job_is_refused_while_one_runs(bench):
    bench.fit()
    with pytest.raises(UserError, match=r"a job is running already \(fit\); wait for it or cancel it"):
        bench.diagnose()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--max-upload", "4096"], "--max-upload 4096: must lie between 0 and 1024 MB"),
        (["--port", "70000"], "--port 70000: must lie between 1 and 65535"),
    ],
)
def test_a_limit_that_is_none_is_refused(arguments, words, tmp_path):
    from pneuid.workbench.__main__ import main

    with pytest.raises(UserError, match=words):
        main([str(tmp_path / "p"), *arguments])


def test_a_result_is_there_whole_or_not_at_all(tmp_path):
    from pneuid.workbench.computing import _result_folder

    def interrupted():
        with _result_folder(target) as part:
            (part / "ladder.json").write_text("[]")
            raise OSError("the disk is full")

    target = tmp_path / "identify"
    with pytest.raises(OSError, match="full"):
        interrupted()
    assert list(tmp_path.iterdir()) == []
    with _result_folder(target) as part:
        (part / "ladder.json").write_text("[]")
    assert [path.name for path in tmp_path.rglob("*")] == ["identify", "ladder.json"]


# --- the project ---


def test_the_demo_is_copied_and_results_are_kept(tmp_path):
    project = demo_project(tmp_path / "demo")
    assert [run.role for run in project.runs()] == ["hold_out", "hold_out", "train", "train", "train"]
    (project.folder / "rig.toml").write_text("mine")
    assert demo_project(tmp_path / "demo").rig_text() == "mine"


def test_roles_are_kept(tmp_path):
    project = demo_project(tmp_path / "demo")
    project.set_role("train_1.csv", "unused")
    assert "train_1.csv" not in Project(project.folder).of_role("train")
    with pytest.raises(UserError, match="no role"):
        project.set_role("train_1.csv", "judge")


@pytest.mark.parametrize(
    ("name", "role"), [("zero.csv", "zero"), ("Zero_1.mat", "zero"), ("held_3.csv", "hold_out"), ("monday.csv", "train")]
)
def test_a_name_may_say_the_role(name, role):
    assert default_role(name) == role


def test_a_zero_reading_is_read_as_one_and_joins_the_diagnosis(bench):
    path = bench.project.folder / "zero.csv"
    path.write_text("p1 [kPa],p2 [kPa]\n" + "0.1,7.9\n0.1,8.1\n" * 100)
    asked = []
    bench._on_file = lambda _, name, arguments, **more: asked.append((name, arguments, more))
    bench.look()
    name, arguments, more = asked[-1]
    assert name == "read_zero"
    words = reading.read_zero(**arguments)
    assert words.startswith("p1 0.1 kPa") and "p2 8.0" in words
    more["then"](words)
    assert bench.zeros == {"zero.csv": words} and not bench.faults
    bench.diagnose()
    assert bench.job.task.arguments["zero"] == ["zero.csv"]
    # in another role it is a run like any other, and one without motion
    bench.project.set_role("zero.csv", "train")
    bench.look()
    assert asked[-1][0] == "read_run" and not bench.zeros


def test_a_single_column_is_an_upload_where_it_is_a_zero_reading(tmp_path):
    project = demo_project(tmp_path / "demo")
    for name in ("zero.csv", "run.csv"):
        (tmp_path / name).write_text("p1 [kPa]\n" + "0.1\n0.2\n" * 100)
    assert reading.check_upload(tmp_path / "zero.csv", project.rig_text()) == ""
    with pytest.raises(UserError, match="not a recording"):
        reading.check_upload(tmp_path / "run.csv", project.rig_text())


def test_one_zero_reading_is_used(tmp_path):
    from pneuid.workbench import computing

    with pytest.raises(UserError, match=r"zero_1\.csv, zero_2\.csv: one zero reading is used"):
        computing.diagnose(tmp_path, "fit", [], [], ["zero_1.csv", "zero_2.csv"], lambda *_: None, lambda _: None)


def test_a_removed_run_is_put_aside(tmp_path):
    project = demo_project(tmp_path / "demo")
    project.remove("train_1.csv")
    assert (project.folder / "removed" / "train_1.csv").is_file()
    assert "train_1.csv" not in [run.name for run in project.runs()]


def test_an_upload_does_not_replace_a_run(tmp_path):
    with pytest.raises(UserError, match="holds a run of this name"):
        demo_project(tmp_path / "demo").incoming("train_1.csv")


def test_a_damaged_result_is_none(tmp_path):
    project = Project(tmp_path / "p")
    (project.folder / "identify").mkdir()
    (project.folder / "identify" / "model.json").write_text("{not json")
    assert project.models() == ["identify"]
    assert project.result("identify", "model.json") is None


# --- one visual language ---


def test_colours_are_those_of_the_report():
    from pneuid.report import style

    for name in ("SIMULATED", "FREE_RUN", "RESIDUAL", "FLOOR", "ACCEPTED", "REJECTED", "NEUTRAL", "MARKS"):
        assert getattr(look, name) == getattr(style, name)
    assert style.MEASURED == look.MEASURED_LIGHT


# --- regions ---

FEATURES = {
    "t": np.arange(6.0), "v": np.array([-20.0, -5, 0, 5, 20, 60]), "p2": np.array([100.0, 300, 420, 450, 500, 380]),
    "u": np.array([5.0, 4, 6, 9, 1, 5]),
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "inside"),
    [
        ("v < 0 and p2 > 200 kPa gauge", [1]),
        ("|v| > 10 mm/s and p2 > 400 kPa gauge", [4]),
        ("p2 = 300 to 450 kPa gauge", [2, 5]),
        ("|u - 5 V| > 2 V", [3, 4]),
        ("t > 3.5 s and run a.csv", [4, 5]),
        ("run b.csv", []),
        ("x < 100 mm", []),
    ],
)
def test_the_words_of_a_region_become_its_samples(words, inside):
    assert list(np.flatnonzero(region_mask(words, "a.csv", FEATURES, 5.0))) == inside


def test_stretches_are_joined_and_whole():
    inside = np.array([1, 1, 0, 1, 0, 0, 0, 1], dtype=bool)
    assert stretches(np.arange(8.0), inside, 2.5) == [(0.0, 4.0), (7.0, 7.0)]
    assert stretches(np.arange(8.0), ~inside & inside, 1.0) == []


# --- a million samples ---


def test_a_million_samples_keep_their_extremes():
    pytest.importorskip("tsdownsample")
    from pneuid.workbench.traces import POINTS, thin

    t = np.arange(1_000_000) / 1000.0
    y = np.sin(t / 30.0).astype(np.float32)
    y[[123_456, 800_000]] = 9.0, -9.0
    began = time.perf_counter()
    _, shown = thin(t, y)
    assert time.perf_counter() - began < 1.0
    assert shown.size <= POINTS and shown.max() == 9.0 and shown.min() == -9.0
    near, detail = thin(t, y, (123.4, 123.5))
    assert detail.max() == 9.0 and np.isin(t[123_400:123_501], near).all() and near.size < 210
    y[500_000:600_000] = np.nan
    _, shown = thin(t, y)
    assert np.isnan(shown).sum() >= 1 and np.nanmax(shown) == 9.0


def test_what_was_refitted_and_rejected_is_in_the_ranking():
    from pneuid.workbench.charts import ranking_chart

    ranking = [{"effect": f"e{k}", "screen_gain": 0.1 / (k + 1), "hold_out_error_ratio": None} for k in range(20)]
    ranking.append({"effect": "tried", "screen_gain": 0.001, "hold_out_error_ratio": 1.2, "excess_explained": -0.3,
                    "p_value": 0.4})  # fmt: skip
    figure = ranking_chart({"verdict": "unknown", "effects": [], "ranking": ranking}, look.LIGHT)
    assert figure["layout"]["yaxis"]["categoryarray"][-1] == "tried"
    assert [trace["name"] for trace in figure["data"] if "tried" in trace["y"]] == ["rejected", "rejected"]
    assert figure["layout"]["annotations"][0]["text"].startswith("1.20, explains 0 %")


# --- jobs ---


def finished(worker, job, seconds=60.0):
    end = time.monotonic() + seconds
    while not job.over:
        worker.poll()
        assert time.monotonic() < end, job
        time.sleep(0.02)
    return job


def test_jobs_run_in_order_and_a_stuck_one_is_ended():
    from pneuid.workbench.jobs import Worker

    worker, results = Worker("test", ()), []
    try:
        first = worker.submit("add", "operator", "add", {}, otherwise=results.append)
        stuck = worker.submit("wait", "multiprocessing.connection", "wait", {"object_list": [], "timeout": 60})
        last = worker.submit("turn", "fractions", "Fraction", {"numerator": 3}, then=results.append)
        assert finished(worker, first).state == "failed"
        while worker.current is not stuck:
            worker.poll()
        began = time.monotonic()
        worker.cancel(stuck)
        assert finished(worker, stuck).state == "cancelled"
        assert time.monotonic() - began < 10
        assert finished(worker, last).state == "done"
        assert "TypeError" in results[0] and results[1:] == [3]
    finally:
        worker.stop()


def test_a_job_that_waits_is_cancelled_itself_and_not_the_one_before_it():
    from pneuid.workbench.jobs import Worker

    worker, results = Worker("test", ()), []
    try:
        running = worker.submit("turn", "fractions", "Fraction", {"numerator": 3}, then=results.append)
        told = {"then": results.append, "otherwise": results.append}
        waiting = worker.submit("turn", "fractions", "Fraction", {"numerator": 4}, **told)
        worker.cancel(waiting)
        assert waiting.state == "cancelled" and waiting.over and results == ["cancelled"]
        assert finished(worker, running).state == "done"
        assert results == ["cancelled", 3] and not worker.busy
    finally:
        worker.stop()


# --- the first second ---


def test_the_page_and_the_reader_start_without_what_they_do_not_use():
    """In processes of their own: what is imported late must not have been imported by another test."""
    import subprocess
    import sys

    def missing(code: str, names: tuple[str, ...]) -> str:
        found = f"import sys; {code}; print(sorted(set({names!r}) & set(sys.modules)))"
        return subprocess.run([sys.executable, "-c", found], capture_output=True, text=True, check=True).stdout.strip()

    page = "from pneuid.workbench.quick import import_nicegui; import_nicegui(); import pneuid.workbench.server"
    heavy = ("matplotlib", "scipy.signal", "casadi")
    assert missing(page, (*heavy, "pandas", "pint", "requests", "aiohttp", "websocket")) == "[]"
    assert missing("import pneuid.workbench.reading", heavy) == "[]"
    # hidden for the moment of the import alone
    assert missing(f"{page}; import requests", ("requests",)) == "['requests']"


# --- over the measured defect ---


@pytest.mark.slow
def test_shapes_are_drawn_for_a_diagnosis_that_a_command_made(tmp_path):
    """The model is one that this process did not fit: it is fitted again, and the unknown function comes along."""
    from pneuid.workbench import computing
    from pneuid.workbench.request import FitRequest

    project, said = demo_project(tmp_path / "demo"), []
    for run in project.runs():
        path = project.path(run.name)
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:2001]))
    train = tuple(project.of_role("train"))
    name, _ = computing.fit(FitRequest(project.folder, train, ()), lambda *_: None, said.append)
    computing._known.clear()
    names = ["friction_position", "friction_pressure", "gravity", "backlash", "load_mass", "load_spring"]
    ranking = [{"effect": effect, "screen_gain": 0.1, "hold_out_error_ratio": None} for effect in names]
    ranking[1]["hold_out_error_ratio"] = 0.2
    curve = {"effect": "spline:flow_1(u)", "equation": "flow_1", "signal": "u", "times": "", "unit": "kg/s", "at": [-1.0, 1.0],
             "value": [1e-3, 2e-3], "std": [1e-4, 1e-4], "provisional": True}  # fmt: skip
    folder = project.folder / "by_command"
    folder.mkdir()
    found = {"effects": [], "ranking": ranking, "unknown": {"curve": curve}}
    (folder / "diagnosis.json").write_text(json.dumps(found))
    computing.draw_shapes(project.folder, name, train, "by_command", lambda *_: None, said.append)
    drawn = project.result("by_command", "shapes.json")
    assert "fitting the model again on its relaxed problem" in said
    assert [item["effect"] for item in drawn["shapes"]] == ["friction_pressure", "friction_position", "gravity", "backlash"]
    first = drawn["shapes"][0]
    assert first["y_label"] == "unexplained force<br>against the motion (N)" and first["share"] > drawn["shapes"][1]["share"]
    assert len(first["at"]) == len(first["measured"]) == len(first["spread"]) == len(first["taken"])
    assert (drawn["unknown"]["x_label"], drawn["unknown"]["y_label"]) == ("relative opening of the valve", "flow_1 (g/s)")
    assert drawn["unknown"]["value"] == pytest.approx([1.0, 2.0])
