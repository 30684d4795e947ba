"""The files of an export by name, all made before the first is written."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from controllers.base import Controller
from controllers.export.figures import bode_png, limit_cycle_png, loop_png
from controllers.export.fmu import fmu_bytes, units
from controllers.export.library import ExportedNmpc, ExportedServo, build_library, structure_bytes
from controllers.export.linear import as_json, as_report, linear_export
from controllers.export.pieces import Controllers
from controllers.export.recorded import Recorded, hard_track, record
from controllers.export.sources import NMPC, PLANT, SERVO, c_sources, template
from controllers.model_plant import ModelPlant
from pneuid.compiled import compiler
from pneuid.errors import ComputationError, UserError

Doing = Callable[[str], None]
EQUAL = 1e-9
"""Largest difference in V between the command of the C and of Python, at every sample of the recordings."""

FAST_MOVE = 0.4
"""Seconds in which the predictive controller's recording covers an eighth of the stroke; see ``hard_track``."""


def c_bundle(found: Controllers, name: str, doing: Doing) -> dict[str, bytes]:
    """The folder of C with recordings, harness, Makefile and README, checked against Python where there is a compiler.

    Raises ``ComputationError`` when the compiled C does not command what Python commanded.
    """
    doing("generating C")
    texts = c_sources(found, name)
    doing("recording closed loops to check it with")
    runs = {"servo": recording(found.servo, found), "nmpc": recording(found.nmpc, found)}
    sizes = {"servo": "see sizeof", "nmpc": "see sizeof"}
    if compiler() is None:
        doing(
            "no C compiler found: the C was generated, but not compiled and compared; run make check where there is one"
        )
    else:
        doing("compiling it and comparing with Python")
        with tempfile.TemporaryDirectory() as folder:
            sizes = _checked(texts, runs, Path(folder))
    texts["main.c"] = template("main.c")
    texts["Makefile"] = _filled(template("Makefile"), {})
    texts["README.md"] = _filled(template("README.md"), _words(found, name, sizes))
    texts |= {f"{kind}.csv": run.csv() for kind, run in runs.items()}
    return {file: text.encode() for file, text in texts.items()}


def recording(controller: Controller, found: Controllers, seconds: float = 1.0) -> Recorded:
    """A hard closed loop on the identified model, noise included."""
    lasts = FAST_MOVE if controller is found.nmpc else 0.0
    track = hard_track(found.model, controller.sample_time, seconds, controller.preview, lasts)
    return record(controller, ModelPlant(found.model), track, found.design_supply, seed=1)


def _checked(texts: Mapping[str, str], runs: Mapping[str, Recorded], folder: Path) -> dict[str, str]:
    """Compile, play the recordings back, compare; the controllers' structure sizes."""
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    library = build_library(folder, folder / "exported.so")
    for kind, exported in (("servo", ExportedServo), ("nmpc", ExportedNmpc)):
        run = runs[kind]
        largest = float(abs(exported(library).play(run.seen, run.target) - run.u).max())
        if not largest <= EQUAL:
            raise ComputationError(f"the exported {kind} differs from Python by {largest:.2g} V; nothing was written")
    return {kind: str(structure_bytes(library, kind)) for kind in runs}


def _words(found: Controllers, name: str, sizes: Mapping[str, str]) -> dict[str, str]:
    gains = found.servo.gains
    return {
        "NAME": name, "SERVO_BYTES": sizes["servo"], "NMPC_BYTES": sizes["nmpc"],
        "SERVO_MS": f"{1e3 * found.servo.sample_time:g}", "NMPC_MS": f"{1e3 * found.nmpc.sample_time:g}",
        "PREVIEW": str(found.nmpc.preview), "SUPPLY_BAR": f"{found.design_supply / 1e5:.2f}", "ALPHA": f"{gains.alpha:g}",
    }  # fmt: skip


def _filled(text: str, words: Mapping[str, str]) -> str:
    """The template with its ``@WORDS@`` replaced."""
    lists = {"SERVO": " ".join(SERVO), "NMPC": " ".join(NMPC), "PLANT": " ".join(PLANT)}
    for key, value in {**lists, **words}.items():
        text = text.replace(f"@{key}@", value)
    return text


def fmu_bundle(found: Controllers, name: str, doing: Doing) -> dict[str, bytes]:
    """Three FMUs. Raises ``UserError`` without a C compiler."""
    if compiler() is None:
        raise UserError(
            "an FMU holds compiled code and no C compiler was found; install gcc or clang, or name one in the variable CC"
        )
    doing("generating C")
    sources = c_sources(found, name)
    built = {}
    for unit in units(found):
        doing(f"building {unit.name}.fmu")
        built[f"{unit.name}.fmu"] = fmu_bytes(unit, sources, name)
    return built


def control_bundle(found: Controllers, name: str, doing: Doing) -> dict[str, bytes]:
    """Matrices, Bode plot, loop gain, limit-cycle map and the report."""
    result, patm = linear_export(found, doing), found.model.value("patm")
    return {
        "control.json": json.dumps(as_json(result, found, name), indent=1, allow_nan=False).encode(),
        "bode.png": bode_png(result.cases, patm),
        "loop_gain.png": loop_png(result.loops, patm),
        "limit_cycles.png": limit_cycle_png(result.cycles),
        "report.md": as_report(result, found, name).encode(),
    }


BUNDLES: Mapping[str, Callable[[Controllers, str, Doing], dict[str, bytes]]] = {
    "c": c_bundle,
    "fmu": fmu_bundle,
    "control": control_bundle,
}
"""What ``--to`` chooses from."""
