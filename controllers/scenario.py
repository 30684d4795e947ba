"""A study's scenario: what is run, read from a declarative file with units and checked on load."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from controllers.conditions import AS_KNOWN, Condition
from controllers.references import Ramp, Reference, Sine, Smooth, Steps
from controllers.registry import CONTROLLERS
from controllers.tuning import ALPHA, Design
from pneuid.effects import CATALOGUE
from pneuid.errors import UserError
from pneuid.units import parse_quantity
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.sensors import CONTROL_SENSORS, RECORDED_ONLY, Sensors
from pneuid.virtual_rig.truth import TruthServo


@dataclass(frozen=True)
class Recordings:
    """How the rig is measured for identified models: seconds per run and the seed of noise and motion."""

    duration: float = 6.0
    seed: int = 1


@dataclass(frozen=True)
class Price:
    """An effect whose worth is asked: its name in the catalogue and the rig that has it."""

    effect: str
    condition: Condition


@dataclass(frozen=True)
class Scenario:
    """What a study runs, SI; ``supplies`` and the design's are absolute Pa.

    One set of gains per controller and model, made for ``design.supply``, is used at every supply. ``seeds`` are those
    of the sensors' noise; ``refined`` says whether gains are refined on each controller's own model; ``conditions`` are the
    rigs it is played on, the first the one that controllers are made for; ``models`` says where the models come from and
    ``recordings`` how the rig is measured for them; ``prices`` are effects of which each is played on a rig of its own.
    """

    title: str
    controllers: tuple[str, ...]
    supplies: tuple[float, ...]
    references: tuple[Reference, ...]
    design: Design
    seeds: tuple[int, ...] = (1,)
    sensors: Sensors = CONTROL_SENSORS
    refined: bool = True
    conditions: tuple[Condition, ...] = (AS_KNOWN,)
    models: Literal["known", "identified"] = "known"
    recordings: Recordings = Recordings()
    prices: tuple[Price, ...] = ()


def _quantity(unit: str, lowest: float = 0.0) -> BeforeValidator:
    def read(text: object) -> float:
        value = parse_quantity(text, unit)
        if value < lowest:
            raise ValueError(f"must be at least {lowest:g} {unit}, got {text!r}")
        return value

    return BeforeValidator(read)


Length = Annotated[float, _quantity("m")]
Signed = Annotated[float, _quantity("m", float("-inf"))]
Speed = Annotated[float, _quantity("m/s", 1e-6)]
Seconds = Annotated[float, _quantity("s", 1e-3)]
Frequency = Annotated[float, _quantity("Hz", 1e-3)]
Gauge = Annotated[float, _quantity("Pa", 1e4)]
Pressure = Annotated[float, _quantity("Pa")]
Mass = Annotated[float, _quantity("kg")]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Steps(_Table):
    name: str
    kind: Literal["steps"]
    centre: Length
    duration: Seconds
    targets: list[Signed]
    period: Seconds
    top_speed: Speed


class _Sine(_Table):
    name: str
    kind: Literal["sine"]
    centre: Length
    duration: Seconds
    amplitude: Length
    frequency: Frequency
    fade: Seconds


class _Ramp(_Table):
    name: str
    kind: Literal["ramp"]
    centre: Length
    duration: Seconds
    speed: Speed
    dwell: Seconds
    fade: Seconds


class _Random(_Table):
    name: str
    kind: Literal["random"]
    centre: Length
    duration: Seconds
    amplitude: Length
    highest: Frequency
    fade: Seconds
    seed: int


class _Design(_Table):
    supply: Gauge
    alpha: float = Field(default=ALPHA, ge=0.0, le=1.0)
    hold: Length = 1e-5
    refine: bool = True


_AMPLITUDES: dict[str, Any] = {name: (float, value) for name, value in vars(NOTHING).items() if name != "form"}
_HiddenTable: Any = create_model("_HiddenTable", __config__=ConfigDict(extra="forbid"), **_AMPLITUDES)


class _Truth(_Table):
    friction: Literal["2011", "constant"] = "constant"
    payload: Mass = 0.0
    hidden: _HiddenTable = _HiddenTable()


class _Sensors(_Table):
    x_noise: Length = CONTROL_SENSORS.x_noise
    x_grid: Length = CONTROL_SENSORS.x_grid
    p_noise: Pressure = CONTROL_SENSORS.p_noise


Factor = Annotated[float, Field(gt=0.0, le=10.0)]


class _Condition(_Table):
    name: str
    friction: Factor = 1.0
    valve_gain: Factor = 1.0
    payload: Mass = 0.0
    x_noise: Length | None = None
    hidden: _HiddenTable = _HiddenTable()


class _Models(_Table):
    source: Literal["known", "identified"] = "known"
    duration: Seconds = 6.0
    seed: int = 1


class _Price(_Table):
    effect: Literal[tuple(CATALOGUE)]  # type: ignore[valid-type]
    hidden: _HiddenTable


class _File(_Table):
    title: str
    controllers: list[Literal[tuple(CONTROLLERS)]]  # type: ignore[valid-type]
    supplies: list[Gauge] = Field(min_length=1)
    seeds: list[int] = Field(default=[1], min_length=1)
    design: _Design
    truth: _Truth = _Truth()
    sensors: _Sensors = _Sensors()
    models: _Models = _Models()
    conditions: list[_Condition] = []
    prices: list[_Price] = []
    references: list[Annotated[_Steps | _Sine | _Ramp | _Random, Field(discriminator="kind")]] = Field(min_length=1)


_BUILD: dict[str, Callable[..., Reference]] = {
    "steps": lambda targets, **rest: Steps(targets=tuple(targets), **rest),
    "sine": Sine,
    "ramp": Ramp,
    "random": Smooth,
}


def read_scenario(path: str | Path) -> tuple[Scenario, TruthServo, Hidden]:
    """The scenario in a file, and the virtual rig it is played on.

    Raises ``UserError`` naming the file and the key for anything that cannot be used.
    """
    try:
        raw = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        parsed = _File.model_validate(raw)
    except OSError as error:
        raise UserError(f"{path}: cannot read the scenario: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{path}: {key}: {first['msg']}; got {first['input']!r}") from error
    return _scenario(parsed, str(path))


def _scenario(parsed: _File, where: str) -> tuple[Scenario, TruthServo, Hidden]:
    truth = TruthServo()
    conditions = _conditions(parsed, where)
    if parsed.truth.friction == "2011":
        truth = replace(truth, friction=FRICTION_2011)
    hidden = _hidden(parsed.truth.hidden, f"{where}: truth")
    references = []
    for entry in parsed.references:
        values = entry.model_dump()
        reference = _BUILD[values.pop("kind")](**values)
        _check_stroke(reference, truth.stroke, where)
        references.append(reference)
    scenario = Scenario(
        title=parsed.title,
        controllers=tuple(parsed.controllers),
        supplies=tuple(truth.patm + gauge for gauge in parsed.supplies),
        references=tuple(references),
        design=Design(truth.patm + parsed.design.supply, parsed.design.alpha, parsed.design.hold),
        seeds=tuple(parsed.seeds),
        sensors=replace(CONTROL_SENSORS, **parsed.sensors.model_dump()),
        refined=parsed.design.refine,
        conditions=conditions,
        models=parsed.models.source,
        recordings=Recordings(parsed.models.duration, parsed.models.seed),
        prices=tuple(Price(own.effect, at) for own, at in zip(parsed.prices, conditions, strict=False)),
    )
    return scenario, truth, replace(hidden, load_mass=hidden.load_mass + parsed.truth.payload)


def _conditions(parsed: _File, where: str) -> tuple[Condition, ...]:
    """Those of the file: one per price, or the nominal one and its deviations."""
    if parsed.prices and (parsed.conditions or parsed.models.source != "identified"):
        raise UserError(f'{where}: prices: need models.source = "identified" and no [[conditions]] beside them')
    if parsed.prices:
        found = [
            Condition(own.effect, hidden=_hidden(own.hidden, f"{where}: prices.{own.effect}")) for own in parsed.prices
        ]
    else:
        found = [AS_KNOWN]
    for own in parsed.conditions:
        hidden = _hidden(own.hidden, f"{where}: conditions.{own.name}")
        hidden = replace(hidden, load_mass=hidden.load_mass + own.payload)
        found.append(Condition(own.name, own.friction, own.valve_gain, own.x_noise, hidden))
    names = [own.name for own in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(f"{where}: conditions: {', '.join(twice)}: named twice; every one needs a name of its own")
    return tuple(found)


def _hidden(table: Any, where: str) -> Hidden:
    """Hidden effects of a table. Raises ``UserError`` for what a rig cannot be, or what only recordings have."""
    try:
        hidden = Hidden(**table.model_dump())
    except ValueError as error:
        raise UserError(f"{where}.hidden: {error}") from error
    recorded = [name for name in RECORDED_ONLY if getattr(hidden, name) != 0.0]
    if recorded:
        raise UserError(
            f"{where}.hidden: {', '.join(recorded)}: acts in recordings only, a closed loop does not have it"
        )
    return hidden


def _check_stroke(reference: Reference, stroke: float, where: str) -> None:
    track = reference.over(1e-3)[:, 0]
    if track.min() < 0.0 or track.max() > stroke:
        span = f"{track.min() * 1e3:.1f} to {track.max() * 1e3:.1f} mm"
        raise UserError(f"{where}: reference '{reference.name}' runs from {span}, the stroke is {stroke * 1e3:g} mm")
