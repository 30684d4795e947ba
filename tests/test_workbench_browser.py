"""The workbench in a real browser: the whole story on the embedded hidden-effect data, cancel, a broken file.

Headless Chromium driven by selenium. ``PNEUID_PICTURES=1`` writes docs/workbench/*.png as the story goes on.
Nothing here needs the internet, and the last test shows that nothing used it.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from pneuid.resources import scenario_path

for module in ("nicegui", "plotly", "tsdownsample"):
    pytest.importorskip(module, reason='the extra is absent: pip install "pneuid[workbench]"')
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is absent: pip install selenium")

CSS, TAG, ENTER = "css selector", "tag name", "\ue007"
CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("chromium-browser"), shutil.which("chromedriver")
if CHROMIUM is None or DRIVER is None:
    pytest.skip("chromium or chromedriver is absent: apt install chromium-driver", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "workbench" if os.environ.get("PNEUID_PICTURES") else None
SAMPLES = 3000
"""Length of the runs: two runs of 2.5 s are too little to tell how friction follows the pressure, and diagnose says so."""

PATIENCE = 400
"""Longest wait for a computation, s: the first one compiles, and other work may share the machine."""

STUDY = os.environ.get("PNEUID_PICTURES_STUDY")
"""Folder of a finished closed-loop study that the pictures show."""


class Site:
    """A running workbench on a project folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/"
        command = [sys.executable, "-m", "pneuid.workbench", str(folder), "--no-browser", "--port", str(self.port)]
        self.began = time.monotonic()
        # NiceGUI has a mode of its own for servers that a test started
        own = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "NICEGUI"))}
        self.log = folder.parent / "server.log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(command, cwd=ROOT, env=own, stdout=log, stderr=subprocess.STDOUT)
        self.first_page = self._wait()

    def _wait(self) -> float:
        while time.monotonic() - self.began < 60:
            try:
                urllib.request.urlopen(self.url, timeout=5).close()  # noqa: S310 - our own address
            except OSError:
                assert self.process.poll() is None, self.log.read_text()
                time.sleep(0.05)
            else:
                return time.monotonic() - self.began
        raise AssertionError("the workbench did not come up")

    def stop(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(20)


class Window:
    """A browser window with short words for what a person does."""

    def __init__(self, site: Site, profile: Path, size: tuple[int, int] = (1280, 800)) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for word in (
            "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync",
            "--disable-component-update", "--hide-scrollbars", f"--user-data-dir={profile}",
        ):  # fmt: skip
            options.add_argument(word)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.site = site
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
        self.requests: set[str] = set()
        self.complaints: list[str] = []
        self.size(*size)
        self.driver.get(site.url)

    def size(self, width: int, height: int) -> None:
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def find(self, name: str):
        return self.driver.find_elements(CSS, f'[data-testid="{name}"]')

    def text(self, name: str) -> str:
        return self.driver.execute_script(
            "const e = document.querySelector(`[data-testid=\"${arguments[0]}\"]`); return e ? e.innerText : ''", name
        )

    def wait(self, until, seconds: float = 30, what: str = "") -> None:
        end = time.monotonic() + seconds
        while not until():
            assert time.monotonic() < end, f"waited {seconds} s for {what or until}; job: {self.text('job')!r}"
            time.sleep(0.1)

    def press(self, name: str) -> None:
        self.wait(lambda: any(item.is_enabled() for item in self.find(name)), what=name)
        self.driver.execute_script('document.querySelector(`[data-testid="${arguments[0]}"]`).click()', name)

    def begin(self, name: str, job: str) -> None:
        """Press a button until its job runs: a view drawn anew in the same moment swallows a press."""
        for _ in range(10):
            self.press(name)
            end = time.monotonic() + 5
            while time.monotonic() < end:
                if self.text("job").startswith(f"{job}: ") and "cancelled" not in self.text("job"):
                    return
                time.sleep(0.1)
        raise AssertionError(f"{job} did not start; job: {self.text('job')!r}")

    def go(self, view: str, shows: str) -> None:
        self.press(f"tab-{view}")
        self.wait(lambda: bool(self.find(shows)), what=shows)

    def plotted(self, name: str) -> bool:
        script = 'const e = document.querySelector(`[data-testid="${arguments[0]}"]`); return !!(e && e._fullLayout)'
        return bool(self.driver.execute_script(script, name))

    def shapes(self, name: str) -> int:
        script = 'return document.querySelector(`[data-testid="${arguments[0]}"]`)._fullLayout.shapes.length'
        return int(self.driver.execute_script(script, name))

    def traces(self, name: str) -> int:
        script = 'return document.querySelector(`[data-testid="${arguments[0]}"]`).data.length'
        return int(self.driver.execute_script(script, name))

    def upload(self, path: Path) -> None:
        self.driver.find_element(CSS, "input[type=file]").send_keys(str(path))

    def picture(self, name: str) -> None:
        if PICTURES:
            time.sleep(1.5)
            PICTURES.mkdir(exist_ok=True)
            self.driver.save_screenshot(str(PICTURES / f"{name}.png"))

    def logs(self) -> None:
        """Collect what the browser asked for and complained about."""
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                self.requests.add(message["params"]["request"]["url"])
            elif message["method"] == "Network.webSocketCreated":
                self.requests.add(message["params"]["url"])
        for entry in self.driver.get_log("browser"):
            if entry["level"] == "SEVERE":
                self.complaints.append(entry["message"])

    def held_out_error(self, signal: str) -> float:
        """What the table of errors shows for a signal on held-out runs."""
        script = """const table = document.querySelector('[data-testid="errors"]');
            return table ? [...table.rows].map(row => [...row.cells].map(cell => cell.innerText.trim())) : []"""
        for cells in self.driver.execute_script(script):
            if cells[:2] == [signal, "held out"]:
                return float(cells[2].replace("\u2009", "").replace(" ", ""))
        raise AssertionError(f"no held-out error of {signal} in {self.text('errors')!r}")


def short_demo(folder: Path, samples: int) -> Path:
    """The embedded hidden-effect data, cut so that a fit takes seconds."""
    folder.mkdir()
    source = scenario_path("demo")
    shutil.copy(source / "rig.toml", folder)
    for name in ("train_1", "train_2", "train_3", "hold_out_1", "hold_out_2"):
        lines = (source / f"{name}.csv").read_text().splitlines(keepends=True)
        (folder / f"{name}.csv").write_text("".join(lines[: samples + 1]))
    return folder


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
    assert "3 000 samples" in window.text("runs")
    window.driver.find_element(TAG, "body").send_keys("5")
    window.wait(lambda: "No rung yet" in window.driver.find_element(TAG, "body").text, what="the ladder by key 5")
    window.driver.find_element(TAG, "body").send_keys("1")
    window.wait(lambda: window.plotted("run-plot"), what="the data by key 1")
    window.picture("data")


def test_a_broken_file_is_refused_with_the_row(window, tmp_path):
    lines = (scenario_path("demo") / "train_2.csv").read_text().splitlines()[:200]
    lines[77] = lines[77].rsplit(",", 1)[0] + ",oops"
    broken = tmp_path / "broken.csv"
    broken.write_text("\n".join(lines))
    window.upload(broken)
    window.wait(lambda: "broken.csv: row 78" in window.text("refused"), what="the message")
    assert "'oops' is not a number" in window.text("refused")
    assert not (window.site.folder / "broken.csv").exists()
    prose = tmp_path / "prose.csv"
    prose.write_text("dear diary, today\nnothing moved, again\nstill nothing, sorry\n")
    window.driver.find_element(CSS, '[aria-label="dismiss"]').click()
    window.wait(lambda: not window.find("refused"), what="the message to go")
    window.upload(prose)
    window.wait(lambda: "not a recording" in window.text("refused"), what="the refusal of prose")
    window.driver.find_element(CSS, '[aria-label="dismiss"]').click()


def test_a_running_fit_is_cancelled_and_the_second_window_sees_it(site, window, tmp_path):
    second = Window(site, tmp_path / "second", (1920, 1080))
    try:
        window.go("fit", "fit")
        second.go("fit", "fit")
        window.begin("fit", "fit")
        second.wait(lambda: "running" in second.text("job"), what="the second window to see the fit")
        window.wait(lambda: "iteration" in window.text("job"), PATIENCE, "the first iteration")
        second.press("cancel")
        window.wait(lambda: "cancelled" in window.text("job"), 20, "the cancel")
        assert not list(site.folder.glob("identify*"))
        second.logs()
        assert second.complaints == []
    finally:
        second.driver.quit()


def test_the_story(window):
    site = window.site
    window.go("fit", "fit")
    window.begin("fit", "fit")
    window.wait(lambda: "iteration" in window.text("job"), PATIENCE, "iterations")
    window.wait(lambda: "fit: done" in window.text("job"), PATIENCE, "the fit")
    window.wait(lambda: window.find("errors"), what="the errors")
    before = {signal: window.held_out_error(signal) for signal in ("x", "p1", "p2")}
    window.picture("fit")

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
    window.picture("where")

    window.go("missing", "diagnose")
    window.begin("diagnose", "diagnose identify")
    window.wait(lambda: window.find("verdict"), PATIENCE, "the verdict")
    assert "friction_pressure" in window.text("verdict")
    window.wait(lambda: window.plotted("ranking"), what="the ranking")
    window.picture("missing")

    window.begin("add-friction_pressure", "fit with friction_pressure")
    window.wait(lambda: "fit with friction_pressure: done" in window.text("job"), PATIENCE, "the second fit")
    window.wait(lambda: window.held_out_error("p1") != before["p1"], what="the new errors")
    after = {signal: window.held_out_error(signal) for signal in before}
    assert all(after[signal] < 0.8 * before[signal] for signal in before), (before, after)

    window.go("ladder", "ladder")
    window.wait(lambda: window.plotted("ladder"), what="the ladder")
    assert "+ friction_pressure" in window.text("rungs")
    window.picture("ladder")
    # what the workbench wrote, the commands read
    rungs = json.loads((site.folder / "identify_2" / "ladder.json").read_text())
    assert [rung["added"] for rung in rungs if rung["accepted"]] == [None, "friction_pressure"]
    if STUDY:
        shutil.copytree(STUDY, site.folder / "study")
        time.sleep(3)
        window.go("control", "study")
        window.wait(lambda: window.plotted("study"), what="the study")
        window.picture("control")
        window.size(1920, 1080)
        window.go("where", "overlay")
        window.wait(lambda: window.plotted("overlay"), what="the overlays")
        window.picture("where_1920")
        window.driver.find_element(CSS, '[aria-label="light or dark"]').click()
        window.picture("where_dark")
        window.size(1280, 800)


def test_nothing_left_the_machine_and_nothing_complained(window):
    window.logs()
    own = (window.site.url, window.site.url.replace("http", "ws"), "data:", "blob:")
    assert len(window.requests) > 10
    assert [url for url in window.requests if not url.startswith(own)] == []
    assert window.complaints == []


def test_ctrl_c_ends_it_cleanly(site):
    assert site.stop() == 130
    assert "Traceback" not in site.log.read_text()
