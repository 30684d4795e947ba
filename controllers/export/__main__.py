"""``python -m controllers.export``: the identified model and the controllers, for a target."""

from __future__ import annotations

import argparse
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from controllers.export.bundle import BUNDLES
from controllers.export.io_system import control_model
from controllers.export.pieces import tuned
from controllers.tuning import ALPHA, Design
from pneuid import api
from pneuid.errors import UserError
from pneuid.model import Model
from pneuid.story import demo_runs
from pneuid.terminal import (
    DEMO_ROOT,
    CommandParser,
    Progress,
    add_effect_file_option,
    add_output_options,
    result_folder,
    run_command,
)

_EXAMPLE = """example:
  python -m controllers.export monday/model.json --to c --out monday_c
without MODEL the embedded demonstration's model is exported into pneuid-demo/export_TO"""

_NEXT = {
    "c": "make -C {folder} check",
    "fmu": "fmpy validate {folder}/pneuid_plant.fmu",
    "control": "see {folder}/report.md",
}


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    found = CommandParser(
        "python -m controllers.export", "Export the identified model and its controllers for a target.", _EXAMPLE
    )
    found.add_argument("model", nargs="?", metavar="MODEL", help="model.json of a fit")
    found.add_argument(
        "--to",
        choices=tuple(BUNDLES),
        default="c",
        help="C99 source (the default), FMI 2.0 units, or python-control matrices and plots",
    )
    found.add_argument(
        "--alpha", type=float, default=ALPHA, help=f"share of the friction model that is believed, 0 to 1 ({ALPHA})"
    )
    add_effect_file_option(found)
    add_output_options(found)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command. Raises ``UserError`` for bad input and ``ComputationError`` when an export fails its check."""
    given = parser().parse_args(arguments)
    if not 0.0 <= given.alpha <= 1.0:
        raise UserError(f"--alpha {given.alpha:g}: must lie between 0 and 1")
    embedded = given.model is None
    content = _demo_model() if embedded else api.load(given.model, given.effect_file).content
    model = control_model(content)
    folder = result_folder(given.out, f"export_{given.to}", embedded, given.overwrite)
    try:
        with Progress() as progress:
            progress.doing("tuning the controllers on the model")
            found = tuned(model, Design(content.rig.supply, alpha=given.alpha))
            files = BUNDLES[given.to](found, content.name, progress.doing)
    except BaseException:
        if not any(folder.iterdir()):
            folder.rmdir()  # nothing was made, so nothing is left behind
        raise
    write_files(folder, files)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    console.print(f"wrote {len(files)} files to {folder}: {', '.join(sorted(files))}")
    console.print(f"next: {_NEXT[given.to].format(folder=shlex.quote(str(folder)))}")


def _demo_model() -> Model:
    """The model of the embedded story, identified here where ``pneuid.identify`` has not left it."""
    path = Path(DEMO_ROOT) / "identify" / "model.json"
    if path.exists():
        return api.load(path).content
    runs = demo_runs()
    with Progress() as progress:
        progress.doing("identifying the demonstration's model first")
        return api.fit(runs.rig, runs.train, name="identify", hold_out=runs.hold_out, monitor=progress.monitor).content


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write all files beside ``folder``, then move them in, so that a full disk leaves no half of an export."""
    with tempfile.TemporaryDirectory(dir=folder.parent) as staged:
        for name, content in files.items():
            (Path(staged) / name).write_bytes(content)
        for name in files:
            (Path(staged) / name).replace(folder / name)


if __name__ == "__main__":
    run_command(main)
