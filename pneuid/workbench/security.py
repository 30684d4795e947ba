"""Who may talk to the workbench, how much, and under which names.

The server listens on 127.0.0.1 only, but a page of another site open in the same browser can still reach it: by its own
requests (told by ``Origin``) or by a host name made to point here (told by ``Host``). Both are refused, on HTTP and on
websockets.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from pneuid.errors import UserError

SUFFIXES = (".csv", ".txt", ".dat", ".mat", ".h5", ".hdf5", ".parquet", ".mf4", ".mdf", ".tdms")
"""Extensions of recordings (the keys of ``pneuid.formats.READERS``, which brings pandas)."""

LONGEST_NAME = 120
LARGEST_UPLOAD = 200 * 2**20
"""Largest body of one request in bytes, unless the command says otherwise."""

LARGEST_RUN = 2**30
"""Size in bytes above which a file of the folder is not read: it would take the memory that the fit needs."""

_FORBIDDEN = re.compile(r'[\x00-\x1f\x7f<>:"|?*]')

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def safe_name(name: str, suffixes: tuple[str, ...] = SUFFIXES) -> str:
    """``name`` if it is a plain file name of a recording.

    Raises ``UserError`` for a path, a hidden file, control characters or another extension.
    """
    shown = repr(name if len(name) <= LONGEST_NAME else name[:LONGEST_NAME] + "...")
    if (
        not name
        or "/" in name
        or "\\" in name
        or name.startswith(".")
        or _FORBIDDEN.search(name)
        or len(name) > LONGEST_NAME
    ):
        raise UserError(f"{shown} is not a plain file name; rename the file, without folders or special characters")
    if not name.lower().endswith(suffixes):
        raise UserError(f"{name}: not a kind of recording that can be read; known: {', '.join(suffixes)}")
    return name


class LocalOnly:
    """ASGI middleware: serves this machine's own page, refuses every other host, origin and oversized body."""

    def __init__(self, app: App, port: int, limit: int = LARGEST_UPLOAD) -> None:
        self.app, self.limit = app, limit
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve or refuse one request or websocket."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if refused is None:
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": refused[1]})
        else:
            body = (refused[1] + "\n").encode()
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()),
                       (b"connection", b"close")]  # fmt: skip
            await send({"type": "http.response.start", "status": refused[0], "headers": headers})
            await send({"type": "http.response.body", "body": body})

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and words where the request is refused."""
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        if headers.get("host", "").lower() not in self.hosts:
            return 403, "refused: the workbench answers to 127.0.0.1 and localhost only"
        origin = headers.get("origin")
        if (origin is not None and origin.lower() not in self.origins) or (
            origin is None and scope["type"] == "websocket"
        ):
            return 403, "refused: another site may not use the workbench"
        if scope["type"] == "http" and scope["method"] in ("POST", "PUT", "PATCH"):
            return self._too_large(headers)
        return None

    def _too_large(self, headers: dict[str, str]) -> tuple[int, str] | None:
        """Judged by the stated length, before a byte of the body is read."""
        length = headers.get("content-length", "")
        if not length.isdigit():
            return 411, "refused: the size of the upload is not stated"
        if int(length) > self.limit:
            return 413, (
                f"refused: {int(length) / 2**20:.0f} MB is more than the {self.limit / 2**20:.0f} MB an upload may have; "
                "copy the file into the project folder instead"
            )
        return None


_HEADERS = [
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    # the page's framework compiles templates in the browser; nothing may come from or go to another machine
    (
        b"content-security-policy",
        b"default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'",
    ),
]


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *_HEADERS]
        await send(message)

    return sending
