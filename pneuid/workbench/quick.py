"""Imports NiceGUI without the HTTP clients that python-socketio would bring along and a server never uses.

They are a third of the time that the first page waits for Python. Both packages do without them where they are absent.
"""

from __future__ import annotations

import importlib
import sys

CLIENTS = ("requests", "aiohttp", "websocket")


def import_nicegui() -> None:
    """Import NiceGUI once; the clients can be imported as ever afterwards."""
    hidden = [name for name in CLIENTS if name not in sys.modules]
    # None in this table is what an import of a package that is not installed meets
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]
    try:
        importlib.import_module("nicegui")
    except ImportError:
        # a release that needs one of them: from the beginning, with all
        for name in [name for name in sys.modules if name.split(".")[0] in ("nicegui", "socketio", "engineio", *hidden)]:
            del sys.modules[name]
        importlib.import_module("nicegui")
    finally:
        for name in hidden:
            if name in sys.modules and sys.modules[name] is None:
                del sys.modules[name]
