"""What the computing process does: fit, compare, diagnose, report; results go to the same files as the commands'."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pneuid import api
from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.comparison.ladder import Rung, from_json, rung_of, to_json
from pneuid.criticism.prediction.horizons import Prediction
from pneuid.criticism.screening.signature import signature
from pneuid.effects import CATALOGUE, easily_confused
from pneuid.errors import UserError
from pneuid.model import file_sha256
from pneuid.physics.friction import LAWS
from pneuid.recording import Recording
from pneuid.report import style
from pneuid.report.signal_figures import errors_of, telling_run
from pneuid.report.signal_units import axis_label, error_unit, shown
from pneuid.report.summary import metrics_json
from pneuid.rig import Rig
from pneuid.signals import SIGNALS
from pneuid.story import read_ladder
from pneuid.workbench.payload import (
    Channel,
    ComparisonView,
    DefectRow,
    EffectCard,
    ParameterRow,
    RegionRow,
    RunView,
    SignalView,
    SignatureRow,
    SignatureView,
)
from pneuid.workbench.project import write
from pneuid.workbench.regions import region_mask
from pneuid.workbench.request import FitRequest
from pneuid.workbench.shapes import SHAPES, shapes_of
from pneuid.zero_reading import ZeroReading

Report = Callable[[str, int, float], None]
Say = Callable[[str], None]

_known: dict[str, api.IdentifiedModel] = {}
"""Models fitted in this process by path, with the fit behind them: a diagnosis need not fit again."""


def _read(folder: Path, names: Sequence[str], rig: Rig) -> list[Recording]:
    return [Recording.read(folder / name, rig) for name in names]


def _free_folder(folder: Path, name: str) -> Path:
    found, count = folder / name, 2
    while found.exists():
        found, count = folder / f"{name}_{count}", count + 1
    return found


@contextmanager
def _result_folder(target: Path) -> Iterator[Path]:
    """Where to write a result: it becomes ``target`` when all of it is there, and nothing is left otherwise."""
    part = target.with_name(f".{target.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    try:
        yield part
        part.rename(target)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def fit(request: FitRequest, monitor: Report, say: Say) -> tuple[str, ComparisonView]:
    """Fit, compare and write a result folder; its name and the comparison. Raises ``UserError``."""
    if not request.train:
        raise UserError("no run has the role 'train'; give at least one run that role in the Data view")
    folder = request.folder
    parent_file = folder / request.parent / "model.json" if request.parent else None
    parent = api.load(parent_file) if parent_file else None
    rig = parent.content.rig if parent else Rig.from_toml(folder / "rig.toml")
    train, held = _read(folder, request.train, rig), _read(folder, request.hold_out, rig)
    add = [*(parent.content.effects if parent else ()), *request.add]
    friction = request.friction or (parent.content.friction if parent else None)
    start = {**(parent.values if parent else {}), **(request.start or {})}
    say(f"fitting {len(train)} runs, {sum(run.n for run in train)} samples")
    target = _free_folder(folder, "identify")
    model = api.fit(
        rig, train, add=add, friction=friction, start=start or None, name=target.name, hold_out=held,
        parent=file_sha256(parent_file) if parent_file else None, monitor=monitor,
    )  # fmt: skip
    say("comparing with the recordings")
    comparison = model.compare(train, held)
    before = read_ladder(parent_file.parent / "ladder.json") if parent_file else []
    rungs = [*before, *_rejected(folder, request.diagnosis), rung_of(comparison, request.added)]
    with _result_folder(target) as part:
        write(part / "ladder.json", json.dumps(to_json(rungs), indent=1))
        write(part / "metrics.json", json.dumps(metrics_json(comparison), indent=1, allow_nan=False))
        model.save(part / "model.json")
    _known[str(target)] = model
    return target.name, view_of(comparison)


def _rejected(folder: Path, diagnosis: str | None) -> list[Rung]:
    """Rungs that a diagnosis tried and rejected."""
    if diagnosis is None:
        return []
    path = folder / diagnosis / "diagnosis.json"
    raw = json.loads(path.read_text(encoding="utf-8"))
    return [rung for rung in from_json(raw.get("rungs", []), str(path)) if not rung.accepted]


def _model(folder: Path, name: str) -> api.IdentifiedModel:
    path = folder / name
    loaded = api.load(path / "model.json")
    known = _known.get(str(path))
    # a command may have replaced the file since
    return known if known is not None and known.values == loaded.values else loaded


def compare(folder: Path, name: str, train: Sequence[str], held: Sequence[str], say: Say) -> ComparisonView:
    """Simulate a model of the project against its runs. Raises ``UserError``."""
    model = _model(folder, name)
    rig = model.content.rig
    say(f"simulating {len(train) + len(held)} runs")
    return view_of(model.compare(_read(folder, train, rig), _read(folder, held, rig)))


def diagnose(
    folder: Path, name: str, train: Sequence[str], held: Sequence[str], zero: Sequence[str], monitor: Report, say: Say
) -> str:
    """Diagnose a model of the project, with a ``zero`` reading or none; the folder of diagnosis.json. Raises ``UserError``."""
    if len(zero) > 1:
        raise UserError(f"{', '.join(zero)}: one zero reading is used; give the others the role 'not used' in the Data view")
    model = _fitted(folder, name, train, monitor, say)
    rig = model.content.rig
    at_zero = ZeroReading.read(folder / zero[0], rig) if zero else None
    say("screening every effect of the catalogue")
    found = api.diagnose(model, _read(folder, train, rig), _read(folder, held, rig), monitor, say, zero=at_zero)
    target = _free_folder(folder, f"{name}_diagnosed")
    content = {**found.diagnosis.to_dict(), "rungs": to_json(found.rungs), "model": name}
    with _result_folder(target) as part:
        write(part / "diagnosis.json", json.dumps(content, indent=1, allow_nan=False))
        _write_shapes(part, model, content, say)
    return target.name


def draw_shapes(folder: Path, name: str, train: Sequence[str], diagnosed: str, monitor: Report, say: Say) -> None:
    """Write the shapes of a diagnosis that a command has made of model ``name``. Raises ``UserError``."""
    content = json.loads((folder / diagnosed / "diagnosis.json").read_text(encoding="utf-8"))
    _write_shapes(folder / diagnosed, _fitted(folder, name, train, monitor, say), content, say)


def _write_shapes(target: Path, model: api.IdentifiedModel, diagnosis: dict[str, Any], say: Say) -> None:
    say("laying the leading effects over the measured defect")
    if model.fitted is not None:
        write(target / SHAPES, json.dumps(shapes_of(model.fitted, diagnosis), allow_nan=False))


def _fitted(folder: Path, name: str, train: Sequence[str], monitor: Report, say: Say) -> api.IdentifiedModel:
    """A model of the project with the fit behind it on these runs, made again where this process has not made it."""
    model = _model(folder, name)
    runs = _read(folder, train, model.content.rig)
    if model.fitted is None or [run.recording.sha256 for run in model.fitted.runs] != [run.sha256 for run in runs]:
        say("fitting the model again on its relaxed problem")
        content = model.content
        model = api.IdentifiedModel(content, api.refitted(api.IdentifiedModel(content), runs, monitor))
        _known[str(folder / name)] = model
    return model


def parameters(folder: Path, effects: Sequence[str], friction: str | None) -> list[ParameterRow]:
    """Parameters that a fit with these effects would have. Raises ``UserError``."""
    plant = api.plant_of(Rig.from_toml(folder / "rig.toml"), effects, friction=friction)
    return [
        ParameterRow(item.name, item.symbol, item.unit, float(item.lower), float(item.upper), float(item.start),
                     plant.owner[item.name] or "base model")
        for item in plant.parameters
    ]  # fmt: skip


def catalogue(folder: Path) -> tuple[list[EffectCard], tuple[str, ...]]:
    """The effects that can show on this rig, and the friction laws."""
    rig = Rig.from_toml(folder / "rig.toml")
    cards = [
        EffectCard(item.name, item.mechanism, item.equation, item.experiment, item.reference, easily_confused(item))
        for item in CATALOGUE.values()
        if rig.kind in item.rigs
    ]
    return cards, tuple(LAWS)


def signature_view(folder: Path, name: str) -> SignatureView | None:
    """How an effect of the catalogue shows on this rig; None for a change of the friction law, which has no size."""
    effect = CATALOGUE.get(name)
    if effect is None:
        return None
    rig = Rig.from_toml(folder / "rig.toml")
    found = signature(effect, rig)
    rows = []
    for signal, without in found.without.items():
        change = found.with_it[signal] - without
        unit = error_unit(signal, float(np.nanmax(np.abs(change))))
        rows.append(SignatureRow(
            axis_label(signal), shown_as(signal, without, rig.patm), shown_as(signal, found.with_it[signal], rig.patm),
            f"Δ{SIGNALS[signal].symbol} ({unit.unit})", change * unit.factor,
            style.FLOOR_BAND * found.noise[signal] * unit.factor,
        ))  # fmt: skip
    signal, course = found.command
    command = Channel(axis_label(signal), shown_as(signal, course, rig.patm))
    return SignatureView(name, found.experiment, found.t, command, tuple(rows))


# --- as it is shown ---


def view_of(comparison: Comparison) -> ComparisonView:
    """A comparison as arrays in display units."""
    runs = tuple(
        _run_view(comparison, k) for k in range(len(comparison.predictions)) if comparison.predictions[k].run.n
    )
    regions = tuple(RegionRow(item.signal, item.share, item.samples, item.region) for item in comparison.where)
    defects = tuple(
        DefectRow(item.equation, item.unit, float(item.rms), float(item.expected_rms)) for item in comparison.defects
    )
    return ComparisonView(comparison.model.name, runs, regions, defects, telling_run(comparison))


def _run_view(comparison: Comparison, k: int) -> RunView:
    ahead, free, role = comparison.predictions[k], comparison.free[k], comparison.roles[k]
    rig, run = comparison.model.rig, comparison.predictions[k].run
    floors = errors_of(comparison, role)
    outputs = {
        signal: _signal_view(ahead, None if free is ahead else free, i, rig.patm, floors[signal].noise_floor)
        for i, signal in enumerate(run.outputs)
    }
    features = _features(ahead, rig.patm)
    numbers = {name: channel.values for name, channel in features.items()} | {"t": run.t}
    masks = tuple(
        region_mask(item.region, run.name, numbers, 0.0 if np.isnan(rig.null) else rig.null)
        for item in comparison.where
    )
    return RunView(
        run.name, role, np.asarray(run.t), outputs, features, "u" if "u" in features else "v", masks,
    )  # fmt: skip


def _signal_view(ahead: Prediction, free: Prediction | None, i: int, patm: float, floor: float) -> SignalView:
    run = ahead.run
    signal = run.outputs[i]
    error = _whole(run.n, ahead.index, ahead.error[i])
    unit = error_unit(signal, float(np.nanmax(np.abs(error))) if np.isfinite(error).any() else floor)
    weight = run.weight(signal)
    measured = np.where(weight > 0, shown_as(signal, run.measured(signal), patm), np.nan)
    band = style.FLOOR_BAND * floor * unit.factor
    return SignalView(
        label=axis_label(signal), measured=measured.astype(np.float32),
        ahead=_whole(run.n, ahead.index, shown_as(signal, ahead.predicted[i], patm)),
        free=None if free is None else _whole(run.n, free.index, shown_as(signal, free.predicted[i], patm)),
        error_label=f"{SIGNALS[signal].symbol} error ({unit.unit})", error=error * np.float32(unit.factor),
        band=float(band) if np.isfinite(band) else 0.0,
    )  # fmt: skip


def shown_as(signal: str, values: np.ndarray, patm: float) -> np.ndarray:
    """Values in display units, NaN where a prediction left every scale."""
    with np.errstate(invalid="ignore", over="ignore"):
        found = np.asarray(shown(signal, values, patm), dtype=float)
        return np.where(np.abs(found) < 1e9, found, np.nan)


def _whole(n: int, index: np.ndarray, values: np.ndarray) -> np.ndarray:
    found = np.full(n, np.nan, dtype=np.float32)
    found[index] = values
    return found


def _features(item: Prediction, patm: float) -> dict[str, Channel]:
    """Signals over the whole run that the error may depend on, in display units, pressures gauge."""
    run = item.run
    found = {"v": run.input("v") if "v" in run.inputs else run.motion.v, "x": run.motion.x}
    found |= {name: run.recording.signals[name] for name in ("p1", "p2") if name in run.recording.signals}
    found |= {name: run.input(name) for name in ("psup", "u") if name in run.inputs}
    return {
        name: Channel(axis_label(name), np.asarray(shown(name, values, patm), dtype=np.float32))
        for name, values in found.items()
    }


def write_report(folder: Path, name: str, train: Sequence[str], held: Sequence[str], say: Say) -> str:
    """Write report.html beside a model; its path inside the project. Raises ``UserError``."""
    from pneuid.report.reports import identify_report  # noqa: PLC0415 - brings every figure

    model = _model(folder, name)
    rig = model.content.rig
    say("simulating and drawing the report")
    comparison = model.compare(_read(folder, train, rig), _read(folder, held, rig))
    identify_report(folder / name / "report.html", comparison, read_ladder(folder / name / "ladder.json"), None)
    return f"{name}/report.html"
