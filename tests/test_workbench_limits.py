"""What the workbench refuses, shown in a real browser and at the bare socket; and a recording of a million samples."""

from __future__ import annotations

import http.client
import http.server
import os
import statistics
import threading
import time
from pathlib import Path

import pytest
from workbench_window import CSS, Site, Window, outside, short_demo

GIGABYTE = 2**30
PROSE = "dear diary, today\nnothing moved, again\nstill nothing, sorry\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    found = Site(short_demo(tmp_path_factory.mktemp("limits") / "monday", 800))
    yield found
    found.stop()


@pytest.fixture(scope="module")
def window(site, tmp_path_factory):
    found = Window(site, tmp_path_factory.mktemp("profile"))
    found.wait(lambda: found.plotted("run-plot"), 60, "the first run")
    yield found
    found.driver.quit()


def tree(folder: Path) -> set[str]:
    """Every file around the project, the server's log apart."""
    return {str(path.relative_to(folder.parent)) for path in folder.parent.rglob("*") if path.is_file()}


def dismissed(window: Window) -> None:
    for button in window.driver.find_elements(CSS, '[aria-label="dismiss"]'):
        button.click()
    window.wait(lambda: not window.find("refused"), what="the message to go")


def upload_path(window: Window) -> str:
    """Where the page sends its uploads: the address of a harmless one, with the number that the element has now."""
    if not any("/upload/" in url for url in window.requests):
        harmless = window.site.folder.parent / "diary.csv"
        harmless.write_text(PROSE)
        window.upload(harmless)
        window.wait(lambda: "diary.csv: not a recording" in window.text("refused"), what="the refusal of prose")
        harmless.unlink()
        dismissed(window)
        window.logs()
    seen = next(url for url in window.requests if "/upload/" in url).removeprefix(window.site.url.rstrip("/"))
    number = window.driver.execute_script("return document.querySelector('[data-testid=upload]').id.slice(1)")
    return f"{seen.rsplit('/', 1)[0]}/{number}"


def asked(site: Site, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, bytes]:
    """A request as no browser would make it."""
    connection = http.client.HTTPConnection("127.0.0.1", site.port, timeout=20)
    connection.putrequest(method, path, skip_host="Host" in headers)
    for name, value in ({"Content-Length": str(len(body))} | headers if body or headers else headers).items():
        connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    found = answer.status, answer.read()
    connection.close()
    return found


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../../evil.csv", "evil.csv: not a recording"), ("..\\\\evil.csv", "evil.csv: not a recording"),
        ("/srv/evil.csv", "evil.csv: not a recording"), (".evil.csv", "not a plain file name"),
        ("evil.exe", "not a kind of recording"),
    ],
)  # fmt: skip
def test_an_upload_cannot_choose_its_place(window, name, words):
    """The framework cuts folders off a name; what is left is judged as any other upload, in its waiting place."""
    path, before = upload_path(window), tree(window.site.folder)
    body = (
        f'--edge\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
        f"Content-Type: text/csv\r\n\r\n{PROSE}\r\n--edge--\r\n"
    ).encode()
    asked(window.site, "POST", path, body, **{"Content-Type": "multipart/form-data; boundary=edge"})
    window.wait(lambda: words in window.text("refused"), what="the refusal")
    dismissed(window)
    assert tree(window.site.folder) == before
    assert not Path("/srv/evil.csv").exists()


@pytest.mark.parametrize("path", ["/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/monday/rig.toml", "/rig.toml"])
def test_a_path_leads_nowhere(site, path):
    status, body = asked(site, "GET", path)
    assert status == 404
    assert b"root:" not in body and b"[cylinder]" not in body


def test_a_picture_is_no_recording(window, tmp_path):
    picture = tmp_path / "photo.csv"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 40)
    window.upload(picture)
    window.wait(lambda: "photo.csv" in window.text("refused"), what="the refusal of a picture")
    assert "binary data" in window.text("refused")
    dismissed(window)


def test_two_gigabytes_are_refused_before_they_are_read(window, tmp_path):
    path, large = upload_path(window), tmp_path / "large.csv"
    with large.open("wb") as stream:
        stream.truncate(2 * GIGABYTE)
    window.upload(large)
    words = "refused: an upload may have 200 MB; copy larger files into the project folder instead"
    window.wait(lambda: words in window.driver.find_element(CSS, "body").text, what="the refusal in the page")
    close = "return getComputedStyle(document.querySelector('.q-notification .q-btn')).color"
    assert window.driver.execute_script(close) == "rgb(255, 255, 255)", "the word on its coloured ground"
    # answered although not a byte of the body is ever sent
    status, body = asked(window.site, "POST", path, **{"Content-Length": str(2 * GIGABYTE)})
    assert status == 413
    assert b"2048 MB is more than the 200 MB" in body
    # and one that was copied into the folder is named, not read
    target = window.site.folder / "large.csv"
    large.replace(target)
    window.wait(lambda: "cannot be used" in window.text("runs"), 20, "the mark on the large run")
    row = "[...document.querySelectorAll('.run-row')].find(row => row.innerText.includes('large.csv')).click()"
    window.press_until(row, lambda: "2.0 GB is more than the 1 GB" in window.text("fault"), "the reason")
    target.unlink()
    window.wait(lambda: "large.csv" not in window.text("runs"), 20, "the run to go")


def test_two_windows_cannot_start_two_fits(site, window, tmp_path):
    second = Window(site, tmp_path / "second")
    try:
        for one in (window, second):
            one.go("fit", "fit")
            one.wait(lambda one=one: one.find("fit")[0].is_enabled(), 60, "the button")
        click = "document.querySelector('[data-testid=fit]').click()"
        window.press_until(click, lambda: window.text("job").startswith("fit: "), "the fit")
        with site.held():
            second.press_until(click, lambda: second.text("job").startswith("fit: "), "the fit in the second window")
            second.wait(lambda: not second.find("fit")[0].is_enabled(), what="the button to be held back")
            second.cancel()
        for one in (window, second):
            one.wait(lambda one=one: "cancelled" in one.text("job"), 20, "the cancel")
        assert list(site.folder.glob("identify*")) == []
    finally:
        second.driver.quit()
    window.go("data", "upload")


STRANGER = b"""<!doctype html><title>stranger</title><script>
const home = "http://127.0.0.1:%d", found = {};
const tries = [
  fetch(home + "/").then(r => r.text()).then(t => { found.read = t.length }, () => { found.read = "refused" }),
  fetch(home + "%s", {method: "POST", body: new FormData()}).then(() => { found.post = 1 }, () => { found.post = "refused" }),
  new Promise(done => {
    const socket = new WebSocket("ws://127.0.0.1:%d/_nicegui_ws/socket.io/?EIO=4&transport=websocket");
    socket.onopen = () => { found.socket = 1; done() };
    socket.onerror = () => { found.socket = "refused"; done() };
  }),
];
Promise.all(tries).then(() => { window.found = found });
</script>"""


def test_a_page_of_another_origin_cannot_drive_it(site, window, tmp_path):
    path = upload_path(window).encode()

    class Stranger(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(STRANGER % (site.port, path, site.port))

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stranger)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    other = Window(site, tmp_path / "stranger")
    try:
        other.driver.get(f"http://127.0.0.1:{server.server_port}/")
        other.wait(lambda: other.driver.execute_script("return !!window.found"), what="the stranger's tries")
        found = other.driver.execute_script("return window.found")
        assert found == {"read": "refused", "post": "refused", "socket": "refused"}
    finally:
        other.driver.quit()
        server.shutdown()
        server.server_close()


def test_another_host_name_is_refused(site):
    assert asked(site, "GET", "/", Host=f"evil.example:{site.port}")[0] == 403
    assert asked(site, "GET", "/", Host="127.0.0.1")[0] == 403
    assert asked(site, "GET", "/", Host=f"localhost:{site.port}")[0] == 200


def test_the_browser_did_not_complain(window):
    window.logs()
    assert outside(window) == []
    assert [line for line in window.complaints if "413" not in line] == []


# --- a million samples ---


def million(path: Path, source: Path) -> None:
    """A recording of 1000 s at 1 kHz: a demo run to and fro, so that it has no seams."""
    lines = source.read_text().splitlines()
    rows = [line.split(",", 1)[1] for line in lines[1:]]
    period = rows + rows[::-1]
    with path.open("w") as stream:
        stream.write(lines[0] + "\n")
        stream.writelines(f"{k / 1000:.3f},{period[k % len(period)]}\n" for k in range(1_000_000))


PAN = """
const plot = document.querySelector('[data-testid="run-plot"]'), done = arguments[0], frames = [], ranges = [];
const box = plot.querySelector(".nsewdrag").getBoundingClientRect(), y = box.top + box.height / 2;
const at = (type, x, where) => where.dispatchEvent(new MouseEvent(type, {bubbles: true, cancelable: true, view: window,
  clientX: x, clientY: y, button: 0, buttons: type === "mouseup" ? 0 : 1}));
let k = 0, before = performance.now(), x = box.left + 0.7 * box.width;
at("mousedown", x, plot.querySelector(".nsewdrag"));
const step = now => {
  frames.push(now - before); before = now; ranges.push(plot._fullLayout.xaxis.range[0]);
  if (k++ < 60) { at("mousemove", x -= 5, document.querySelector(".dragcover") || document); requestAnimationFrame(step); }
  else { at("mouseup", x, document.querySelector(".dragcover") || document); done([frames.slice(2), ranges]); }
};
requestAnimationFrame(step);
"""
"""Drags the plot by five pixels a frame, and says how long each frame took and where the axis stood."""

ZOOM = """
const plot = document.querySelector('[data-testid="run-plot"]'), {Plotly} = await import("nicegui-plotly");
plot.querySelector('[data-attr="dragmode"][data-val="pan"]').click();
await Plotly.relayout(plot, {"xaxis.range": [400, 420]});
"""

SHOWN = """
const plot = document.querySelector('[data-testid="run-plot"]');
if (!plot || !plot._fullLayout) return 0;
const [a, b] = plot._fullLayout.xaxis.range; return plot.data[0].x.filter(t => t >= a && t <= b).length;
"""


END = """
const plot = document.querySelector('[data-testid="run-plot"]');
return plot && plot._fullLayout ? plot._fullLayout.xaxis.range[1] : 0;
"""


@pytest.mark.slow
@pytest.mark.skipif("PNEUID_MEASURE" not in os.environ, reason="a measurement: PNEUID_MEASURE=1 on a quiet machine")
def test_a_million_samples_open_and_pan(tmp_path, capsys):
    """The figures are printed (``docs/workbench.md`` has those of a quiet machine) and not judged."""
    site = Site(short_demo(tmp_path / "monday", 2000))
    window = Window(site, tmp_path / "profile")
    try:
        window.wait(lambda: window.text("runs").count("2 000 samples") == 5, 60, "the short runs")
        million(tmp_path / "long.csv", site.folder / "train_1.csv")
        (tmp_path / "long.csv").replace(site.folder / "long.csv")
        row = "[...document.querySelectorAll('.run-row')].find(row => row.innerText.includes('long.csv'))"
        window.wait(
            lambda: window.driver.execute_script(f"const r = {row}; if (r) r.click(); return !!r"), 20, "the run"
        )
        noticed = time.monotonic()
        window.wait(lambda: window.driver.execute_script(END) > 900, 60, "the first look")
        first = time.monotonic() - noticed
        window.wait(lambda: "1 000 000 samples" in window.text("runs"), 60, "the whole recording")
        whole = time.monotonic() - noticed
        window.driver.execute_script(f"return (async () => {{{ZOOM}}})()")
        window.wait(lambda: 1000 < window.driver.execute_script(SHOWN) < 5000, what="the detail of 20 s")
        window.driver.set_script_timeout(60)
        for _ in range(5):  # a drag that meets a redraw is lost, as it is for a person
            frames, ranges = window.driver.execute_async_script(PAN)
            dragged = time.monotonic()
            if abs(ranges[-1] - ranges[0]) > 3:
                break
        assert abs(ranges[-1] - ranges[0]) > 3, "the plot was not dragged"
        window.wait(lambda: 1000 < window.driver.execute_script(SHOWN) < 5000, what="the detail after the drag")
        detail = time.monotonic() - dragged
        with capsys.disabled():
            print(  # noqa: T201 - the figures are what this test is run for
                f"\nfirst page {site.first_page:.2f} s after the command; a million samples: first look {first:.2f} s, "
                f"whole {whole:.2f} s after it was noticed; pan: median {statistics.median(frames):.0f} ms, longest "
                f"{max(frames):.0f} ms of {len(frames)} frames, detail {detail:.2f} s; load {os.getloadavg()[0]:.1f}"
            )
        window.logs()
        assert window.complaints == []
    finally:
        window.driver.quit()
        site.stop()
