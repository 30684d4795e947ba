"""The rig: everything about one test stand that the user states and the program never fits unasked.

A ``Rig`` is read from ``rig.toml`` (or the same as a dict). Inside, every quantity is an SI float
and every pressure is absolute; ``to_dict`` gives back exactly what was read.
"""

from __future__ import annotations

import copy
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pneuid.errors import UserError
from pneuid.formats import FileLayout
from pneuid.formats.rig_toml import Column, Cylinder, RigFile, Run, dotted, nearest, parse
from pneuid.signals import SIGNALS
from pneuid.units import UnitProblem, base_unit, factor_and_offset, parse_quantity, quantity, shown

SERVO_SIGNALS = ("t", "u", "x", "v", "p1", "p2", "psup")
"""Signals a servo rig can record; ``u``, ``x``, ``p1``, ``p2`` and ``t`` are required."""
BENCH_SIGNALS = ("t", "x", "v", "p1", "p2", "F")
"""Signals a bench can record; ``x``, ``F`` and ``t`` are required."""

FREE_IN_A_RUN = ("supply", "mass")
"""Quantities that ``[runs."x.csv"] free`` may name."""

_LEAST_SUPPLY = 1e4  # Pa above ambient: less moves no cylinder, and is mPa written for MPa


@dataclass(frozen=True)
class ColumnSource:
    """Where a signal comes from: ``column`` (name, or number from 1), its ``unit`` (None: the file's header
    says), and ``value = gain * raw + offset`` with ``gain`` a quantity as text and ``offset`` [SI of the signal]."""

    signal: str
    column: str | int
    unit: str | None
    gain: str | None
    offset: float

    def factor_and_offset(self, unit: str, where: str) -> tuple[float, float]:
        """Factor and offset from raw numbers in ``unit`` to the signal in SI.

        Raises ``UserError`` naming ``where`` when unit and gain do not give the signal's dimension.
        """
        target = SIGNALS[self.signal].unit
        if self.gain is None:
            factor, zero = factor_and_offset(unit, target, where)
            return factor, zero + self.offset
        base = base_unit(unit, where)
        to_base, zero = factor_and_offset(unit, base, where)
        if zero != 0.0:
            raise UserError(f"{where}: unit {shown(unit)} has an offset, which a gain cannot follow; use one without")
        try:
            gain = parse_quantity(self.gain, f"({target})/({base})")
        except UnitProblem:
            # The message of the parser would speak of base units that nobody wrote.
            per = unit if unit.isalnum() else f"({unit})"
            text = f"gain {shown(self.gain)} times a column in {shown(unit)} is not {self.signal} in {target}"
            raise UserError(f'{where}: {text}; write for example gain = "1.0 {target}/{per}"') from None
        return gain * to_base, self.offset


@dataclass(frozen=True)
class RunSettings:
    """What differs in one run: ``supply`` [Pa, absolute], ``mass`` [kg] (None: as the rig says), and the
    names fitted for this run alone (``free``)."""

    supply: float | None = None
    mass: float | None = None
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rig:
    """One test stand, SI inside, pressures absolute [Pa].

    Quantities that a bench does not state are NaN, so that their use shows; ``A1`` and ``A2`` [m^2] are
    0.0 on a bench whose bore (or rod) is not stated. Two rigs are equal when their files say the same.
    """

    raw: dict[str, Any] = field(repr=False)
    where: str = field(compare=False)
    kind: str = field(compare=False)
    base_effects: tuple[str, ...] = field(compare=False)
    friction: str = field(compare=False)
    pressure_convention: str = field(compare=False)
    input_hold: str = field(compare=False)
    A1: float = field(compare=False)
    A2: float = field(compare=False)
    stroke: float = field(compare=False)
    V01: float = field(compare=False)
    V02: float = field(compare=False)
    mass: float = field(compare=False)
    incline: float = field(compare=False)
    conductance: float = field(compare=False)
    critical_ratio: float = field(compare=False)
    full_scale: float = field(compare=False)
    null: float = field(compare=False)
    supply: float = field(compare=False)
    patm: float = field(compare=False)
    temperature: float = field(compare=False)
    noise: dict[str, float] = field(compare=False)
    runs: dict[str, RunSettings] = field(compare=False)
    files: FileLayout = field(compare=False)
    columns: dict[str, ColumnSource] = field(compare=False)

    @classmethod
    def from_toml(cls, path: str | Path) -> Rig:
        """Read ``rig.toml``. Raises ``UserError`` naming the file and the key for anything not usable."""
        try:
            text = Path(path).read_bytes().decode("utf-8-sig")
        except OSError as error:
            raise UserError(f"{path}: cannot read the rig file: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise UserError(f"{path}: not UTF-8 text (byte {error.start}); save the rig file as UTF-8") from error
        try:
            raw = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise UserError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from error
        return cls.from_dict(raw, where=str(path))

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any], where: str = "rig") -> Rig:
        """Build a rig from the content of a rig.toml. Raises ``UserError`` naming ``where`` and the key."""
        if not isinstance(raw, Mapping):
            raise UserError(f"{where}: {shown(raw)} is not a table of rig.toml keys")
        return _build(_plain(raw), parse(raw, where), where)

    def to_dict(self) -> dict[str, Any]:
        """The rig as in rig.toml: strings with units, JSON-able; ``from_dict`` of it is the same rig."""
        return copy.deepcopy(self.raw)

    def run(self, name: str) -> RunSettings:
        """Settings of the run in file ``name`` (a path is reduced to its file name); empty when none are given."""
        return self.runs.get(Path(name).name, RunSettings())

    @property
    def known_signals(self) -> tuple[str, ...]:
        """Signals that this kind of rig can record."""
        return SERVO_SIGNALS if self.kind == "servo" else BENCH_SIGNALS

    @property
    def chambers(self) -> tuple[str, ...]:
        """Pressures of the chambers that the rig has: one side of a bench may be open, or both."""
        return tuple(name for name, area in (("p1", self.A1), ("p2", self.A2)) if area > 0.0)


def _build(raw: dict[str, Any], parsed: RigFile, where: str) -> Rig:
    """The rig in SI from a file whose keys are checked one by one; checks what concerns several keys."""
    _check_complete(parsed, where)
    _check_names("base_effects", parsed.base_effects, where)
    area_1, area_2 = _areas(parsed.cylinder, parsed.kind, where)
    cylinder, valve, ambient = parsed.cylinder, parsed.valve, parsed.ambient
    supply = parsed.supply.pressure if parsed.supply is not None else None
    return Rig(
        raw=raw,
        where=where,
        kind=parsed.kind,
        base_effects=tuple(parsed.base_effects),
        friction=parsed.friction,
        pressure_convention=parsed.conventions.pressure or "gauge",
        input_hold=parsed.conventions.input_hold,
        A1=area_1,
        A2=area_2,
        stroke=_or_nan(cylinder.stroke),
        V01=_or_nan(cylinder.dead_volume_1),
        V02=_or_nan(cylinder.dead_volume_2),
        mass=parsed.load.mass,
        incline=parsed.load.incline,
        conductance=valve.conductance if valve is not None else math.nan,
        critical_ratio=valve.critical_ratio if valve is not None else math.nan,
        full_scale=valve.full_scale if valve is not None else math.nan,
        null=valve.null if valve is not None else math.nan,
        supply=_or_nan(_absolute_supply(supply, parsed, f"{where}: supply.pressure")),
        patm=ambient.pressure,
        temperature=ambient.temperature,
        noise={signal: _noise(signal, text, f"{where}: sensors.{signal}") for signal, text in parsed.sensors.items()},
        runs={name: _run(name, run, parsed, where) for name, run in parsed.runs.items()},
        files=FileLayout(**parsed.files.model_dump()),
        columns=_columns(parsed, where),
    )


def _plain(value: Any) -> Any:
    """A copy with dicts and lists only, so that a trip through JSON changes nothing."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


_SERVO_NEEDS = {
    "cylinder.bore": "32 mm",
    "cylinder.stroke": "500 mm",
    "cylinder.dead_volume_1": "12 cm^3",
    "cylinder.dead_volume_2": "14 cm^3",
    "conventions.pressure": "gauge",
}


def _check_complete(parsed: RigFile, where: str) -> None:
    """What a servo rig cannot do without, and the pressure convention wherever pressures matter."""
    if parsed.kind == "servo":
        for key, example in _SERVO_NEEDS.items():
            section, name = key.split(".")
            if getattr(getattr(parsed, section), name) is None:
                raise UserError(f'{where}: {key}: is missing; a servo rig needs it, such as {name} = "{example}"')
        for section in ("valve", "supply"):
            if getattr(parsed, section) is None:
                raise UserError(f"{where}: {section}: is missing; a servo rig needs the table [{section}]")
    elif parsed.conventions.pressure is None and (parsed.cylinder.bore is not None or parsed.supply is not None):
        raise UserError(
            f"{where}: conventions.pressure: is missing; a rig with a bore or a supply has pressures: "
            'write pressure = "gauge" or "abs"'
        )


def _check_names(key: str, names: list[str], where: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"{where}: {key}: {shown(name)} is listed twice; list it once")


def _areas(cylinder: Cylinder, kind: str, where: str) -> tuple[float, float]:
    """Effective areas (A1, A2) [m^2]; 0.0 on a bench for what is not stated."""
    if cylinder.rod is not None and (cylinder.rod_1 is not None or cylinder.rod_2 is not None):
        raise UserError(
            f"{where}: cylinder.rod: given beside rod_1 or rod_2; write rod (one rod, through chamber 2) "
            "or both rod_1 and rod_2"
        )
    rod_1 = cylinder.rod_1 if cylinder.rod_1 is not None else 0.0
    rod_2 = cylinder.rod_2 if cylinder.rod_2 is not None else cylinder.rod
    if (cylinder.rod_1 is not None or kind == "servo") and rod_2 is None:
        key, advice = ("rod_2", "beside rod_1") if cylinder.rod_1 is not None else ("rod", "on a servo rig")
        raise UserError(f'{where}: cylinder.{key}: is missing; needed {advice}, such as "12 mm" ("0 mm": rodless)')
    if cylinder.bore is None:
        if rod_2 is not None:
            raise UserError(f'{where}: cylinder.bore: is missing; a rod is given, so add the bore, such as "32 mm"')
        return 0.0, 0.0
    for key in ("rod", "rod_1", "rod_2"):
        rod = getattr(cylinder, key)
        if rod is not None and rod >= cylinder.bore:
            raise UserError(
                f"{where}: cylinder.{key}: {rod * 1e3:g} mm is not smaller than the bore, {cylinder.bore * 1e3:g} mm"
            )
    area_1 = math.pi / 4 * (cylinder.bore**2 - rod_1**2)
    return area_1, 0.0 if rod_2 is None else math.pi / 4 * (cylinder.bore**2 - rod_2**2)


def _absolute_supply(pressure: float | None, parsed: RigFile, where: str) -> float | None:
    """A supply pressure of the file as absolute [Pa]; None stays None."""
    if pressure is None:
        return None
    patm = parsed.ambient.pressure
    gauge = parsed.conventions.pressure != "abs"
    absolute = pressure + patm if gauge else pressure
    if absolute < patm + _LEAST_SUPPLY:
        kind = "gauge" if gauge else "absolute"
        raise UserError(
            f"{where}: {pressure / 1e3:g} kPa {kind} is not {_LEAST_SUPPLY / 1e3:g} kPa above ambient "
            f"({patm / 1e3:g} kPa absolute); "
            "check the unit and conventions.pressure"
        )
    return absolute


def _signal(name: str, allowed: tuple[str, ...], parsed: RigFile, where: str) -> None:
    if name in allowed:
        return
    if name in SIGNALS:
        raise UserError(f"{where}: {name} is no signal of a {parsed.kind} rig; its signals: {', '.join(allowed)}")
    raise UserError(f"{where}: unknown signal; known: {', '.join(allowed)}{nearest(name, list(allowed))}")


def _noise(signal: str, text: object, where: str) -> float:
    """1-sigma noise of a sensor in SI."""
    if signal == "t" or signal not in SIGNALS:
        known = [name for name in SIGNALS if name != "t"]
        raise UserError(f"{where}: unknown signal; known: {', '.join(known)}{nearest(signal, known)}")
    value = quantity(text, SIGNALS[signal].unit, where)
    if value <= 0.0:
        raise UserError(f"{where}: {shown(text)} is not above zero; leave the sensor out to estimate its noise")
    return value


def _run(name: str, run: Run, parsed: RigFile, where: str) -> RunSettings:
    place = f"{where}: {dotted(('runs', name))}"
    _check_names(f"{dotted(('runs', name))}.free", run.free, where)
    for wanted in run.free:
        if wanted not in FREE_IN_A_RUN:
            known = ", ".join(FREE_IN_A_RUN)
            near = nearest(wanted, list(FREE_IN_A_RUN))
            raise UserError(f"{place}.free: {shown(wanted)} cannot be fitted for one run; known: {known}{near}")
    if parsed.kind == "bench" and (run.supply is not None or "supply" in run.free):
        raise UserError(f"{place}.supply: a bench has no valve supply; remove it")
    return RunSettings(_absolute_supply(run.supply, parsed, f"{place}.supply"), run.mass, tuple(run.free))


def _columns(parsed: RigFile, where: str) -> dict[str, ColumnSource]:
    allowed = SERVO_SIGNALS if parsed.kind == "servo" else BENCH_SIGNALS
    taken: dict[str | int, str] = {}
    sources: dict[str, ColumnSource] = {}
    for signal, entry in parsed.columns.items():
        place = f"{where}: columns.{signal}"
        _signal(signal, allowed, parsed, place)
        if entry.column in taken:
            raise UserError(f"{place}.column: {shown(entry.column)} is {taken[entry.column]} already")
        if isinstance(entry.column, str) and not parsed.files.header:
            raise UserError(f"{place}.column: {shown(entry.column)}: without a header columns go by number, from 1")
        taken[entry.column] = signal
        sources[signal] = _column_source(signal, entry, place)
    if not parsed.files.header and not sources:
        raise UserError(f"{where}: columns: is missing; with files.header = false it says which column is which")
    return sources


def _column_source(signal: str, entry: Column, place: str) -> ColumnSource:
    unit = SIGNALS[signal].unit
    offset = 0.0 if entry.offset is None else quantity(entry.offset, unit, f"{place}.offset")
    source = ColumnSource(signal, entry.column, entry.unit, entry.gain, offset)
    if entry.unit is not None:
        factor, _ = source.factor_and_offset(entry.unit, place)
        if factor == 0.0:
            raise UserError(f"{place}.gain: {shown(entry.gain)} makes every value the same; give one that is not zero")
    return source
