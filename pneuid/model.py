"""The identified model: parameters with errors and verdicts, what it was fitted on, and its file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pneuid.effect import Effect, Parameter
from pneuid.effects import effects_by_name
from pneuid.errors import UserError
from pneuid.estimation.curves import Curve, curves_of
from pneuid.estimation.fit import Fit
from pneuid.estimation.own import key, of_key
from pneuid.estimation.shooting import Scaling
from pneuid.physics.smoothing import FINE, Smoothing
from pneuid.plant import RANGES, Plant
from pneuid.recording import Recording
from pneuid.rig import Rig

SCHEMA = 1


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter, SI. ``std`` is None where the fit is relaxed; ``effect`` is None for the base model."""

    name: str
    unit: str
    value: float
    std: float | None
    lower: float
    upper: float
    start: float
    effect: str | None
    run: str | None
    verdict: str


@dataclass(frozen=True)
class FitSummary:
    """How the fit ended, as in model.json; lacking : whether it showed that no parameters of the model follow the data."""

    stage: str
    converged: bool
    status: str
    cost_per_sample: float
    solver: str
    iterations: int
    seconds: float
    lacking: bool = False


@dataclass(frozen=True)
class DataFile:
    """A recording the model has seen: file, its sha256, samples, and its role ``train`` or ``hold_out``."""

    file: str
    sha256: str
    samples: int
    role: str


@dataclass(frozen=True)
class Model:
    """An identified model (SI, absolute pressures).

    noise : 1-sigma per signal that the fit used; ranges : position and pressures it was fitted on; substeps per sample
    of the fit; parent : sha256 of the model file it came from.
    """

    name: str
    rig: Rig
    friction: str
    effects: tuple[str, ...]
    parameters: tuple[Estimate, ...]
    fit: FitSummary
    data: tuple[DataFile, ...]
    noise: dict[str, float]
    ranges: dict[str, float]
    substeps: int
    parent: str | None = None
    own: tuple[Effect, ...] = ()
    """Those of its effects that come from a user's own file."""
    curves: tuple[Curve, ...] = ()
    """Shapes of its unknown functions with their bands."""

    @property
    def values(self) -> dict[str, float]:
        """Parameter values by name, SI."""
        return {item.name if item.run is None else key(item.name, item.run): item.value for item in self.parameters}

    @property
    def plant(self) -> Plant:
        """The symbolic system."""
        return Plant(self.rig, self.friction, effects_by_name(self.effects, self.own))

    def theta(self, mass_run: float | None = None, smoothing: Smoothing = FINE) -> np.ndarray:
        """The plant's column of numbers for a run with its own moving mass (kg) or the rig's."""
        return self.plant.theta(self.values, self.ranges, mass_run, smoothing)

    # --- file ---

    def to_dict(self) -> dict[str, Any]:
        """The content of model.json."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "rig": self.rig.to_dict(),
            "friction": self.friction,
            "effects": list(self.effects),
            "parameters": [vars(item) for item in self.parameters],
            "fit": vars(self.fit),
            "data": [vars(item) for item in self.data],
            "parent": self.parent,
            "noise": self.noise,
            "ranges": self.ranges,
            "substeps": self.substeps,
            "effect_files": effect_files(self.own),
            "curves": [item.to_dict() for item in self.curves],
        }

    def save(self, path: str | Path) -> None:
        """Write model.json, whole or not at all."""
        target = Path(path)
        part = target.with_name(target.name + ".part")
        part.write_text(json.dumps(self.to_dict(), indent=1, allow_nan=False), encoding="utf-8")
        part.replace(target)


def _verdict(fit: Fit, declared: Parameter) -> str:
    """The exact fit's verdict; a relaxed one, which has no standard errors, knows only its bounds."""
    if declared.name in fit.verdicts:
        return fit.verdicts[declared.name]
    scaling = Scaling([declared])
    on_bound = not declared.positive and scaling.on_bound(scaling.to_q(np.array([fit.values[declared.name]])))[0]
    return "on its bound" if on_bound else "weakly determined"


def model_of(fit: Fit, name: str, hold_out: Sequence[Recording] = (), parent: str | None = None) -> Model:
    """The model that a fit identified."""
    plant = fit.plant
    every = fit.problem.declared
    stds = fit.spread.std if fit.spread is not None else [None] * len(every)
    estimates = tuple(
        Estimate(
            name=of_key(item.name)[0], unit=item.unit,
            # the solver may end a rounding beyond a bound
            value=float(np.clip(fit.values[item.name], item.lower, item.upper)),
            std=None if std is None else float(std),
            lower=float(item.lower), upper=float(item.upper), start=float(item.start),
            effect=plant.owner.get(item.name), run=of_key(item.name)[1], verdict=_verdict(fit, item),
        )
        for item, std in zip(every, stds, strict=True)
    )  # fmt: skip
    summary = FitSummary(
        fit.stage, fit.converged, fit.status, fit.cost_per_sample, "ipopt", fit.iterations, round(fit.seconds, 3),
        fit.lacking,
    )
    data = tuple(
        DataFile(run.file or run.name, run.sha256, run.n, role)
        for role, runs in (("train", [item.recording for item in fit.runs]), ("hold_out", list(hold_out)))
        for run in runs
    )
    return Model(
        name=name, rig=plant.rig, friction=plant.law.name, effects=tuple(effect.name for effect in plant.effects),
        parameters=estimates, fit=summary, data=data, noise=dict(fit.noise), ranges=dict(fit.ranges),
        substeps=fit.substeps, parent=parent, own=tuple(effect for effect in plant.effects if effect.origin),
        curves=curves_of(fit),
    )  # fmt: skip


def nominal_model(
    rig: Rig, values: Mapping[str, float], ranges: Mapping[str, float], effects: Sequence[str] = ()
) -> Model:
    """A model with stated values (SI) instead of fitted ones; parameters not named keep their typical start."""
    plant = Plant(rig, rig.friction, effects_by_name(tuple(effects)))
    known = plant.starts() | dict(values)
    estimates = tuple(
        Estimate(item.name, item.unit, known[item.name], None, item.lower, item.upper, item.start,
                 plant.owner[item.name], None, "not visible")
        for item in plant.parameters
    )  # fmt: skip
    summary = FitSummary("relaxed", False, "nominal: values were stated, not fitted", 0.0, "none", 0, 0.0)
    names = tuple(effect.name for effect in plant.effects)
    return Model("nominal", rig, rig.friction, names, estimates, summary, (), {}, dict(ranges), 2)


def effect_files(own: Sequence[Effect]) -> list[dict[str, Any]]:
    """The files behind a user's own effects, as in model.json."""
    files = dict.fromkeys(effect.origin for effect in own if effect.origin)
    return [
        {"file": item.file, "sha256": item.sha256, "effects": [effect.name for effect in own if effect.origin == item]}
        for item in files
    ]


def _own_of(raw: Mapping[str, Any], own: Sequence[Effect], path: str | Path) -> tuple[Effect, ...]:
    """The user's own effects that a model has. Raises ``UserError`` where their file is not given or is another."""
    known = {effect.name: effect for effect in own}
    for entry in raw.get("effect_files", []):
        file, digest = str(entry["file"]), str(entry["sha256"])
        for name in entry["effects"]:
            if name not in known:
                raise UserError(f"{path}: effect '{name}' is in your own file {file}; name it with --effect-file {file}")
            origin = known[name].origin
            if origin is None or origin.sha256 != digest:
                now = origin.sha256[:12] if origin else "none"
                raise UserError(
                    f"{path}: {file} is not the file the model was fitted with (sha256 {now}, then {digest[:12]}); "
                    "give that file, or fit again with this one"
                )
    return tuple(effect for effect in own if effect.name in raw["effects"])


def load(path: str | Path, own: Sequence[Effect] = ()) -> Model:
    """Read model.json; ``own`` are the effects of the user's own files.

    Raises ``UserError`` naming the file and key for anything that is not a model of this program, and where an effect's
    file is missing or has changed.
    """
    if Path(path).is_dir():
        raise UserError(f"{path}: is a folder; name the model in it, such as {Path(path) / 'model.json'}")
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot read the model: {error}") from error
    try:
        raw = json.loads(text)
    except json.JSONDecodeError as error:
        raise UserError(f"{path}: line {error.lineno}: not JSON ({error.msg}); give the model.json of a fit") from error
    except RecursionError as error:
        raise UserError(f"{path}: nested too deeply for a model; give the model.json of a fit") from error
    if not isinstance(raw, dict) or raw.get("schema") != SCHEMA:
        raise UserError(f"{path}: schema: expected {SCHEMA}; this is not a model.json of this version")
    try:
        model = Model(
            name=str(raw["name"]), rig=Rig.from_dict(raw["rig"], f"{path}: rig"), friction=str(raw["friction"]),
            effects=tuple(raw["effects"]), parameters=tuple(Estimate(**item) for item in raw["parameters"]),
            fit=FitSummary(**raw["fit"]), data=tuple(DataFile(**item) for item in raw["data"]),
            noise={key: float(value) for key, value in raw["noise"].items()},
            ranges={key: float(raw["ranges"][key]) for key in RANGES}, substeps=int(raw["substeps"]), parent=raw["parent"],
            own=_own_of(raw, own, path), curves=tuple(Curve.from_dict(item) for item in raw.get("curves", [])),
        )  # fmt: skip
        wanted = set(model.plant.parameter_names)
    except UserError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UserError(f"{path}: key {error} is missing or malformed; give the model.json of a fit") from error
    _check_numbers(model, str(path))
    missing = wanted - set(model.values)
    if missing:
        raise UserError(
            f"{path}: parameters: {', '.join(sorted(missing))} missing for effects {list(model.effects)}; "
            "identify the model again if an earlier version wrote it"
        )
    return model


def _check_numbers(model: Model, where: str) -> None:
    """Raises ``UserError`` for numbers that no fit writes."""
    names = [item.name if item.run is None else key(item.name, item.run) for item in model.parameters]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(f"{where}: parameters: {', '.join(twice)} stands twice")
    for item in model.parameters:
        _check_estimate(item, where)
    for name, number in model.noise.items():
        if not (np.isfinite(number) and number > 0):
            raise UserError(f"{where}: noise: {name} is {number:g}; it must be positive")
    for name, number in model.ranges.items():
        if not np.isfinite(number):
            raise UserError(f"{where}: ranges: {name} is {number:g}; it must be a finite number")
    if model.substeps < 1:
        raise UserError(f"{where}: substeps is {model.substeps}; it must be at least 1")


def _check_estimate(item: Estimate, where: str) -> None:
    for field in ("value", "lower", "upper", "start", "std"):
        number = getattr(item, field)
        if field == "std" and number is None:
            continue
        if not isinstance(number, int | float) or isinstance(number, bool) or not np.isfinite(number):
            raise UserError(f"{where}: parameters: {item.name}: {field} is {number!r}; it must be a finite number")
    if not item.lower <= item.value <= item.upper:
        raise UserError(
            f"{where}: parameters: {item.name}: value {item.value:g} {item.unit} lies outside its bounds "
            f"{item.lower:g} to {item.upper:g}"
        )


def file_sha256(path: str | Path) -> str:
    """Hex digest of a file, to name a parent by."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def renamed(model: Model, name: str) -> Model:
    """The same model under another name."""
    return replace(model, name=name)
