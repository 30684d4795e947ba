"""The schema of rig.toml: which keys there are, their units and what is physically possible.

Everything that is wrong with a rig file is one ``UserError`` of one line: file, dotted key, value,
what is expected and what to do.
"""

from __future__ import annotations

import codecs
import difflib
import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    StrictStr,
    ValidationError,
    model_validator,
)

from pneuid.errors import UserError
from pneuid.units import parse_quantity, shown


def _between(unit: str, low: float, high: float, low_open: bool = True) -> BeforeValidator:
    """Reads a quantity in ``unit`` to SI, in (low, high], or [low, high] unless ``low_open``."""

    def read(text: object) -> float:
        value = parse_quantity(text, unit)
        if value > high or value < low or (low_open and value == low):
            opening = "(" if low_open else "["
            raise ValueError(f"{shown(text)} is outside {opening}{low:g}, {high:g}] {unit}")
        return value

    return BeforeValidator(read)


def _ratio(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{shown(value)} is not a plain number; write for example 0.3")
    if not 0.0 <= value < 1.0:
        raise ValueError(f"{value} is outside [0, 1)")
    return float(value)


def _angle(text: object) -> float:
    value = parse_quantity(text, "rad")
    if abs(value) > math.pi / 2 * (1 + 1e-9):
        raise ValueError(f"{shown(text)} is outside [-90, 90] deg")
    return value


def _delimiter(value: object) -> str:
    if value == "whitespace":
        return "whitespace"
    if not isinstance(value, str) or len(value) != 1 or value.isalnum() or value in "+-.\"'\r\n[]":
        raise ValueError(f'{shown(value)} is not a delimiter; write "whitespace" or one character such as ";" or "\\t"')
    if value == " ":
        raise ValueError('for columns split at blanks write "whitespace"')
    return value


def _encoding(value: object) -> str:
    try:
        # one byte for each of these: what splits rows and cells must be found in the bytes
        plain = isinstance(value, str) and "0;,\n".encode(value) == b"0;,\n"
    except (LookupError, ValueError):
        plain = False
    if not plain:
        raise ValueError(f'{shown(value)} is not an encoding of plain text; write for example "utf-8" or "cp1252"')
    return codecs.lookup(str(value)).name


def _column(value: object) -> str | int:
    if isinstance(value, str) and value.strip():
        return value
    if isinstance(value, int) and not isinstance(value, bool) and value >= 1:
        return value
    raise ValueError(f"{shown(value)} is not a column; write its name, or its number counted from 1")


def _gain(value: object) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = repr(value)
    if not isinstance(value, str):
        raise ValueError(f'{shown(value)} is not a gain; write for example "-1" or "35 N/V"')
    return value


def _name(value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError(f"{shown(value)} is not a name")
    return value


Length = Annotated[float, _between("m", 0.0, 100.0)]
# the largest cylinders of any kind have a bore below a metre and a half
Bore = Annotated[float, _between("m", 0.0, 1.5)]
RodOrZero = Annotated[float, _between("m", 0.0, 1.5, low_open=False)]
Volume = Annotated[float, _between("m^3", 0.0, 10.0)]
Mass = Annotated[float, _between("kg", 0.0, 1e6)]
Angle = Annotated[float, BeforeValidator(_angle)]
Conductance = Annotated[float, _between("m^3/(s*Pa)", 0.0, 1e-3)]
Ratio = Annotated[float, BeforeValidator(_ratio)]
FullScale = Annotated[float, _between("V", 0.0, 1e4)]
Voltage = Annotated[float, _between("V", -1e4, 1e4, low_open=False)]
# 1000 bar is far above any pneumatic supply, so that MPa written for kPa is caught.
Pressure = Annotated[float, _between("Pa", -1e8, 1e8, low_open=False)]
AbsolutePressure = Annotated[float, _between("Pa", 0.0, 1e8)]
Temperature = Annotated[float, _between("K", 0.0, 2000.0)]
Delimiter = Annotated[str, BeforeValidator(_delimiter)]
Encoding = Annotated[str, BeforeValidator(_encoding)]
ColumnName = Annotated[str | int, BeforeValidator(_column)]
Gain = Annotated[str, BeforeValidator(_gain)]
Name = Annotated[str, BeforeValidator(_name)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Conventions(_Section):
    """How pressures are recorded, and how inputs run between samples."""

    pressure: Literal["gauge", "abs"] | None = None
    input_hold: Literal["linear", "zero-order"] = "linear"


class Cylinder(_Section):
    """Geometry [m, m^3]."""

    bore: Bore | None = None
    rod: RodOrZero | None = None
    rod_1: RodOrZero | None = None
    rod_2: RodOrZero | None = None
    stroke: Length | None = None
    dead_volume_1: Volume | None = None
    dead_volume_2: Volume | None = None


class Load(_Section):
    """Moving mass [kg] and inclination [rad]."""

    mass: Mass
    incline: Angle = 0.0


class Valve(_Section):
    """Data-sheet valve: conductance [m^3/(s*Pa)], critical ratio, voltages [V]."""

    conductance: Conductance
    critical_ratio: Ratio
    full_scale: FullScale
    null: Voltage = 0.0


class Supply(_Section):
    """Supply pressure [Pa], still in the file's convention."""

    pressure: Pressure


class Ambient(_Section):
    """Surroundings: absolute pressure [Pa], temperature [K]."""

    pressure: AbsolutePressure = 101325.0
    temperature: Temperature = 293.15


class Files(_Section):
    """Layout of text files."""

    delimiter: Delimiter = ","
    header: StrictBool = True
    skip_rows: Annotated[StrictInt, Field(ge=0, le=1_000_000)] = 0
    gaps: StrictBool = False
    decimal: Literal[".", ","] = "."
    encoding: Encoding = "utf-8"
    units: StrictBool = False

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.units and not self.header:
            raise ValueError("units = true means a line below the header; with header = false state units in [columns]")
        if self.delimiter == self.decimal:
            raise ValueError('decimal = "," needs another delimiter; write for example delimiter = ";"')
        return self


class Column(_Section):
    """Where one signal comes from; offset as text, since its unit is the signal's."""

    column: ColumnName
    unit: StrictStr | None = None
    gain: Gain | None = None
    offset: Any = None


class Run(_Section):
    """What differs in one run."""

    supply: Pressure | None = None
    mass: Mass | None = None
    free: list[Name] = []


class RigFile(_Section):
    """All of rig.toml."""

    kind: Literal["servo", "bench"]
    base_effects: list[Name] = []
    friction: Literal["lugre", "dahl", "stribeck", "coulomb"] = "lugre"
    conventions: Conventions = Conventions()
    cylinder: Cylinder = Cylinder()
    load: Load
    valve: Valve | None = None
    supply: Supply | None = None
    ambient: Ambient = Ambient()
    sensors: dict[str, Any] = {}
    files: Files = Files()
    columns: dict[str, Column] = {}
    runs: dict[str, Run] = {}


def parse(raw: Mapping[str, Any], where: str) -> RigFile:
    """Check ``raw`` key by key. Raises ``UserError`` of one line naming ``where``, the key and the value."""
    try:
        return RigFile.model_validate(dict(raw))
    except ValidationError as error:
        # A misspelt key is also a missing one: the misspelling is what to say.
        problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        raise UserError(_message(problems[0], where)) from error


def dotted(location: tuple[str | int, ...]) -> str:
    """``("runs", "monday_3.csv", "mass")`` as written in TOML: ``runs."monday_3.csv".mass``."""
    parts = [
        str(part)
        if not isinstance(part, str) or part.replace("_", "").replace("-", "").isalnum()
        else json.dumps(part, ensure_ascii=not part.isprintable())
        for part in location
    ]
    return ".".join(parts)


def _message(problem: Any, where: str) -> str:
    location, value = problem["loc"], problem["input"]
    place = f"{where}: {dotted(location)}"
    kind = problem["type"]
    if kind == "extra_forbidden":
        return f"{place}: unknown key; {_advice(location)}"
    if kind == "missing":
        return f"{place}: is missing; {_EXAMPLES.get(dotted(location), 'add it')}"
    if kind == "literal_error":
        allowed = problem["ctx"]["expected"]
        near = nearest(value, [word.strip("'") for word in allowed.replace(" or ", ", ").split(", ")])
        return f"{place}: {shown(value)} is not known; expected {allowed}{near}"
    if kind == "value_error":
        return f"{place}: {problem['ctx']['error']}"
    if kind in ("model_type", "dict_type"):
        return f"{place}: {shown(value)} is not a table; write [{dotted(location)}] and its keys below"
    return f"{place}: {shown(value)}: {_EXPECTED.get(kind, problem['msg'].lower())}"


_EXAMPLES = {
    "kind": 'write kind = "servo" or kind = "bench"',
    "load": 'add [load] with mass = "2.4 kg"',
    "load.mass": 'add all that moves, such as mass = "2.4 kg"',
    "valve.conductance": 'add the data sheet\'s sonic conductance, such as "1.2e-8 m^3/(s*Pa)"',
    "valve.critical_ratio": "add the data sheet's b, such as 0.3",
    "valve.full_scale": 'add |u - null| at which the valve is fully open, such as "10 V"',
    "supply.pressure": 'add it in the convention of [conventions], such as "600 kPa"',
}


_EXPECTED = {
    "list_type": 'write a list, such as ["first", "second"]',
    "bool_type": "write true or false, without quotes",
    "string_type": "write text in quotes",
    "int_type": "write a whole number",
}


def nearest(word: object, allowed: list[str]) -> str:
    """``; did you mean 'x'?`` when one of ``allowed`` is close to ``word``, else nothing."""
    close = difflib.get_close_matches(str(word), allowed, n=1, cutoff=0.6)
    return f"; did you mean '{close[0]}'?" if close else ""


def _advice(location: tuple[str | int, ...]) -> str:
    """The nearest key of the same table, the table the key belongs to, or the keys there are."""
    key = str(location[-1])
    fields = _fields(location[:-1])
    near = nearest(key, fields)
    if near:
        return near.removeprefix("; ")
    for table, field in RigFile.model_fields.items():
        section = _section(field.annotation)
        if section is not None and key in section.model_fields:
            return f"it belongs in [{table}]"
    return f"known here: {', '.join(fields)}"


def _fields(location: tuple[str | int, ...]) -> list[str]:
    section: type[BaseModel] = RigFile
    for part in location:
        field = section.model_fields.get(str(part))
        section = (_section(field.annotation) if field is not None else None) or section
    return list(section.model_fields)


def _section(annotation: Any) -> type[BaseModel] | None:
    """The table class in ``X``, ``X | None`` or ``dict[str, X]``."""
    candidates = (annotation, *get_args(annotation))
    return next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
