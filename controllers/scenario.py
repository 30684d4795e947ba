"""A study's scenario: what is run, read from a declarative file with units and checked on load."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from controllers.references import Ramp, Reference, Sine, Smooth, Steps
from controllers.registry import CONTROLLERS
from controllers.tuning import Design
from pneuid.errors import UserError
from pneuid.units import parse_quantity
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.sensors import CONTROL_SENSORS, Sensors
from pneuid.virtual_rig.truth import TruthServo


@dataclass(frozen=True)
class Scenario:
    """What a study runs, SI; ``supplies`` and the design's are absolute Pa.

    One set of gains per controller and model, made for ``design.supply``, is used at every supply. ``seeds`` are those
    of the sensors' noise; ``refined`` says whether gains are refined on each controller's own model.
    """

    title: str
    controllers: tuple[str, ...]
    supplies: tuple[float, ...]
    references: tuple[Reference, ...]
    design: Design
    seeds: tuple[int, ...] = (1,)
    sensors: Sensors = CONTROL_SENSORS
    refined: bool = True


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
    alpha: float = Field(default=0.8, ge=0.0, le=1.0)
    hold: Length = 1e-5
    refine: bool = True


_AMPLITUDES: dict[str, Any] = {name: (float, value) for name, value in vars(NOTHING).items()}
_HiddenTable: Any = create_model("_HiddenTable", __config__=ConfigDict(extra="forbid"), **_AMPLITUDES)


class _Truth(_Table):
    friction: Literal["2011", "constant"] = "constant"
    payload: Mass = 0.0
    hidden: _HiddenTable = _HiddenTable()


class _Sensors(_Table):
    x_noise: Length = CONTROL_SENSORS.x_noise
    x_grid: Length = CONTROL_SENSORS.x_grid
    p_noise: Pressure = CONTROL_SENSORS.p_noise


class _File(_Table):
    title: str
    controllers: list[Literal[tuple(CONTROLLERS)]]  # type: ignore[valid-type]
    supplies: list[Gauge] = Field(min_length=1)
    seeds: list[int] = Field(default=[1], min_length=1)
    design: _Design
    truth: _Truth = _Truth()
    sensors: _Sensors = _Sensors()
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
    if parsed.truth.friction == "2011":
        truth = replace(truth, friction=FRICTION_2011)
    try:
        hidden = Hidden(**parsed.truth.hidden.model_dump())
    except ValueError as error:
        raise UserError(f"{where}: truth.hidden: {error}") from error
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
    )
    return scenario, truth, replace(hidden, load_mass=hidden.load_mass + parsed.truth.payload)


def _check_stroke(reference: Reference, stroke: float, where: str) -> None:
    track = reference.over(1e-3)[:, 0]
    if track.min() < 0.0 or track.max() > stroke:
        span = f"{track.min() * 1e3:.1f} to {track.max() * 1e3:.1f} mm"
        raise UserError(f"{where}: reference '{reference.name}' runs from {span}, the stroke is {stroke * 1e3:g} mm")
