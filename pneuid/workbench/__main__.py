"""``python -m pneuid.workbench``: the loop in the browser."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

from pneuid.errors import UserError
from pneuid.terminal import DEMO_ROOT, CommandParser, run_command
from pneuid.workbench.project import Project, demo_project
from pneuid.workbench.quick import import_nicegui
from pneuid.workbench.security import LARGEST_RUN, LARGEST_UPLOAD
from pneuid.workbench.state import Workbench

_EXAMPLE = """example:
  python -m pneuid.workbench monday
opens the folder monday with its rig.toml, recordings and results; it is made where it does not exist.
Without DIR the embedded demonstration is copied to pneuid-demo/workbench. Only this machine can reach the page."""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser(
        "python -m pneuid.workbench", "The loop of fit, compare, diagnose and add, in the browser.", _EXAMPLE
    )
    found.add_argument("folder", nargs="?", metavar="DIR", help="folder of a project: rig.toml, recordings, results")
    found.add_argument("--port", type=int, help="port on 127.0.0.1 (default: the first free one from 8011)")
    found.add_argument("--no-browser", action="store_true", help="print the address without opening a browser")
    found.add_argument(
        "--max-upload",
        type=float,
        metavar="MB",
        default=LARGEST_UPLOAD / 2**20,
        help="largest upload (default: 200 MB)",
    )
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input."""
    given = parser().parse_args(arguments)
    missing = [name for name in ("nicegui", "plotly", "tsdownsample") if importlib.util.find_spec(name) is None]
    if missing:
        raise UserError(f'the workbench needs {", ".join(missing)}; install it with: pip install "pneuid[workbench]"')
    if given.port is not None and not 1 <= given.port <= 65535:
        raise UserError(f"--port {given.port}: must lie between 1 and 65535")
    if not 0 < given.max_upload <= LARGEST_RUN / 2**20:
        raise UserError(f"--max-upload {given.max_upload:g}: must lie between 0 and {LARGEST_RUN / 2**20:.0f} MB")
    project = Project(Path(given.folder)) if given.folder else demo_project(Path(DEMO_ROOT) / "workbench")
    bench = Workbench(project, int(given.max_upload * 2**20))
    try:
        # it imports what reading needs while this process imports what the page needs
        bench.reader.start()
        import_nicegui()
        from pneuid.workbench.server import free_port, serve  # noqa: PLC0415 - the extra, and a second of imports

        port = free_port(given.port)
        print(f"workbench: http://127.0.0.1:{port}  (project {project.folder}; ctrl-C ends it)", flush=True)
        serve(bench, port, browser=not given.no_browser and sys.stdout.isatty())
    finally:
        bench.close()


if __name__ == "__main__":
    run_command(main)
