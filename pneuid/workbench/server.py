"""The server: NiceGUI on 127.0.0.1, its assets from this machine, one shared state behind every window."""

from __future__ import annotations

import contextlib
import socket
import threading
import webbrowser

from nicegui import app, ui

from pneuid.errors import UserError
from pneuid.workbench.page import Page
from pneuid.workbench.security import LocalOnly
from pneuid.workbench.state import Workbench

HOST = "127.0.0.1"
FIRST_PORT = 8011
TICK_SECONDS = 0.1


def free_port(wanted: int | None) -> int:
    """``wanted`` if it is free; without a wish the first free one. Raises ``UserError``."""
    for port in [wanted] if wanted is not None else [*range(FIRST_PORT, FIRST_PORT + 20), 0]:
        with contextlib.closing(socket.socket()) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise UserError(f"port {wanted} is taken; choose another --port, or leave it out")


def serve(bench: Workbench, port: int, browser: bool) -> None:
    """Serve until ctrl-C."""
    address = f"http://{HOST}:{port}"

    @ui.page("/", title=f"pneuid workbench: {bench.project.folder.name}")
    def index(view: str = "") -> None:
        Page(bench, view)

    def started() -> None:
        bench.open()
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    app.on_startup(started)
    app.on_shutdown(bench.close)
    app.timer(TICK_SECONDS, bench.tick)
    app.add_middleware(LocalOnly, port=port, limit=bench.limit)
    ui.run(
        host=HOST, port=port, show=False, reload=False, title="pneuid workbench", show_welcome_message=False, dark=None,
        favicon=_ICON, uvicorn_logging_level="error", reconnect_timeout=20.0,
    )  # fmt: skip


_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">'
    '<rect x="2" y="9" width="20" height="14" rx="2" fill="#0072b2"/>'
    '<rect x="10" y="9" width="3" height="14" fill="#fff"/><rect x="13" y="14" width="17" height="4" fill="#e69f00"/>'
    "</svg>"
)
