"""What the browser tests of the workbench share: a running workbench, a headless Chromium window, and the pictures.

Chromium and chromedriver come from the system (Debian: ``apt install chromium-driver``), selenium from pip. Where one of
them is absent the browser tests are skipped with a line that says so.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from PIL import Image

from pneuid.resources import scenario_path

for module in ("nicegui", "plotly", "tsdownsample"):
    pytest.importorskip(module, reason='the extra is absent: pip install "pneuid[workbench]"')
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is absent: pip install selenium")

CSS, TAG, ENTER = "css selector", "tag name", "\ue007"
CHROMIUM, DRIVER = shutil.which("chromium") or shutil.which("chromium-browser"), shutil.which("chromedriver")
if CHROMIUM is None or DRIVER is None:
    pytest.skip("chromium or chromedriver is absent: apt install chromium-driver", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[1]
PICTURES = Path(os.environ["PNEUID_PICTURES"]).resolve() if os.environ.get("PNEUID_PICTURES") else None
"""Folder for pictures of the views; none are made without it."""

LARGEST_PICTURE = 200_000
"""Bytes; the pictures are kept with the docs."""

NARROW, WIDE = (1280, 800), (1920, 1080)

MISFITS = """
const found = [], wide = document.documentElement.clientWidth, shown = e => e.getClientRects().length > 0;
if (document.documentElement.scrollWidth > wide) found.push(`the page is ${document.documentElement.scrollWidth} px wide`);
const speaks = e => [...e.childNodes].some(node => node.nodeType === Node.TEXT_NODE && node.data.trim());
for (const e of document.querySelectorAll(".bar *, [role=main] *, .q-dialog *")) {
  const counts = speaks(e) || e.matches(".panel, table, .js-plotly-plot");
  if (!counts || !shown(e) || e.closest("svg, .q-uploader__input, .sr-only")) continue;
  const box = e.getBoundingClientRect(), name = e.dataset.testid || e.innerText.slice(0, 40) || e.className;
  if (box.right > wide + 1 || box.left < -1) found.push(`${name}: leaves the window`);
  const cut = e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== "visible";
  if (cut && !e.classList.contains("ellipsis")) found.push(`${name}: is cut off`);
}
for (const plot of document.querySelectorAll(".js-plotly-plot")) {
  if (!shown(plot)) continue;
  const outer = plot.getBoundingClientRect(), texts = [...plot.querySelectorAll("svg text")].filter(shown);
  for (const e of texts) {
    const box = e.getBoundingClientRect();
    if (box.width && (box.left < outer.left - 1 || box.right > outer.right + 1 || box.bottom > outer.bottom + 1))
      found.push(`${plot.dataset.testid}: '${e.textContent}' leaves the plot`);
  }
  const ticks = texts.filter(e => e.closest(".xtick, .ytick, .xaxislayer-above, .yaxislayer-above, .legend, .infolayer"));
  const boxes = ticks.map(e => [e.textContent, e.getBoundingClientRect()]).filter(pair => pair[1].width && pair[0].trim());
  for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++) {
    const a = boxes[i][1], b = boxes[j][1];
    if (a.left + 2 < b.right && b.left + 2 < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom)
      found.push(`${plot.dataset.testid}: '${boxes[i][0]}' lies over '${boxes[j][0]}'`);
  }
}
return [...new Set(found)];
"""
"""Looks for what a person would call broken; empty where all is well."""


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

    @contextmanager
    def held(self) -> Iterator[None]:
        """Its computing processes stand still: what runs in them cannot end before a window has pressed Cancel."""
        computing = psutil.Process(self.process.pid).children(recursive=True)
        for one in computing:
            one.suspend()
        try:
            yield
        finally:
            for one in computing:
                with suppress(psutil.NoSuchProcess):  # the one whose job was cancelled
                    one.resume()

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
            # no name is looked up and no address but this machine's is reached: the page has to do without the internet
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
        ):  # fmt: skip
            options.add_argument(word)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.site = site
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
        self.requests: dict[str, str] = {}
        self.complaints: list[str] = []
        self.unfit: list[str] = []
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

    def wait(self, until, seconds: float = 120, what: str = "") -> None:
        end = time.monotonic() + seconds
        while not until():
            job = self.text("job")
            assert ": failed" not in job and ": refused" not in job, job
            assert time.monotonic() < end, f"waited {seconds} s for {what or until}; job: {job!r}"
            time.sleep(0.1)

    def enabled(self, name: str) -> bool:
        script = 'const e = document.querySelector(`[data-testid="${arguments[0]}"]`); return !!e && !e.disabled'
        return bool(self.driver.execute_script(script, name))

    def press(self, name: str) -> None:
        # in one script: a view drawn anew between finding and asking leaves a stale element behind
        script = """
            const e = document.querySelector(`[data-testid="${arguments[0]}"]`), ready = !!e && !e.disabled;
            if (ready) e.click();
            return ready;
        """
        self.wait(lambda: self.driver.execute_script(script, name), what=name)

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

    def press_until(self, script: str, done, what: str) -> None:
        """Run a script that clicks until its effect shows, for the same reason."""
        for _ in range(10):
            self.driver.execute_script(script)
            end = time.monotonic() + 5
            while time.monotonic() < end:
                if done():
                    return
                time.sleep(0.1)
        raise AssertionError(f"waited for {what}; job: {self.text('job')!r}")

    def cancel(self) -> None:
        """Stop the running job, pressing until it stops."""
        press = """document.querySelector('[data-testid="cancel"]')?.click()"""
        self.press_until(press, lambda: "cancelled" in self.text("job"), "the cancel")

    def pick(self, label: str, words: str) -> None:
        """Choose with the mouse from the menu of the field with this label."""
        option = f"[...document.querySelectorAll('.q-menu .q-item')].find(item => item.innerText.trim() === '{words}')"
        for _ in range(10):
            self.driver.find_element(CSS, f'[aria-label="{label}"]').click()
            end = time.monotonic() + 3
            while time.monotonic() < end:
                if self.driver.execute_script(f"const o = {option}; if (o) o.click(); return !!o"):
                    return
                time.sleep(0.1)
        raise AssertionError(f"{words} cannot be chosen in {label}")

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

    def quiet(self) -> None:
        """Wait until no message covers the view and every plot has been laid out."""
        self.wait(lambda: not self.driver.find_elements(CSS, ".q-notification"), 60, "the messages to go")
        time.sleep(0.7)

    def misfits(self) -> list[str]:
        """What does not fit: a page wider than the window, text cut off without a mark, a plot beyond its panel."""
        return self.driver.execute_script(MISFITS)

    def fits(self, view: str) -> None:
        """The view as it stands, in both sizes and on both grounds: pictures if wanted, ``unfit`` what is cut off."""
        turn = '[aria-label="light or dark"]'
        for size, ground in ((NARROW, "light"), (WIDE, "light"), (WIDE, "dark"), (NARROW, "dark")):
            self.size(*size)
            if size == WIDE and ground == "dark":
                self.driver.find_element(CSS, turn).click()
            self.quiet()
            self.picture(view, size, ground)
            self.unfit += [f"{view}, {size[0]} px, {ground}: {words}" for words in self.misfits()]
        self.driver.find_element(CSS, turn).click()
        self.quiet()

    def picture(self, view: str, size: tuple[int, int], ground: str) -> None:
        if PICTURES is None:
            return
        PICTURES.mkdir(parents=True, exist_ok=True)
        extra = [str(size[0])] * (size != NARROW) + [ground] * (ground != "light")
        if extra and not os.environ.get("PNEUID_PICTURES_ALL"):
            return
        path = PICTURES / f"{'_'.join([view, *extra])}.png"
        shot = Image.open(io.BytesIO(self.driver.get_screenshot_as_png())).convert("RGB")
        shot.save(path, optimize=True)
        assert path.stat().st_size < LARGEST_PICTURE or extra

    def logs(self) -> None:
        """Collect what the browser asked for and complained about."""
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                self.requests[message["params"]["request"]["url"]] = message["params"]["request"]["method"]
            elif message["method"] == "Network.webSocketCreated":
                self.requests[message["params"]["url"]] = "WS"
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


def outside(window: Window) -> list[str]:
    """What the browser asked of anything but the workbench; its own pages (chrome://) are part of it."""
    own = (window.site.url, window.site.url.replace("http", "ws"), "data:", "blob:", "chrome:", "chrome-untrusted:")
    return [url for url in window.requests if not url.startswith(own)]


def short_demo(folder: Path, samples: int) -> Path:
    """The embedded hidden-effect data, cut so that a fit takes seconds."""
    folder.mkdir()
    source = scenario_path("demo")
    shutil.copy(source / "rig.toml", folder)
    for name in ("train_1", "train_2", "train_3", "hold_out_1", "hold_out_2"):
        lines = (source / f"{name}.csv").read_text().splitlines(keepends=True)
        (folder / f"{name}.csv").write_text("".join(lines[: samples + 1]))
    return folder
