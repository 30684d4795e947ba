"""Units at the edge of the program: strings with units become SI floats and back."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import pint

from pneuid.errors import UserError

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_UNIT = re.compile(r"[\w */^()·⋅⁻°%.-]*")
_WITH_REFERENCE = re.compile(r"(Pa|hPa|kPa|MPa|mbar|bar|psi|atm) ?\(?(?:g|a|abs|gauge)\)?", re.IGNORECASE)
"""A unit of pressure with its reference, as gauges have it: barg, psia, bar(g), bar abs."""
_SHOWN_CHARACTERS = 60


class UnitProblem(ValueError):
    """What is wrong with a unit or a quantity, without the place; the caller adds the place."""


def shown(value: object) -> str:
    """``value`` as one short line for a message; strings in quotes, control characters escaped."""
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else text[: _SHOWN_CHARACTERS - 3] + "..."


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[float]:
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


@lru_cache(maxsize=512)
def _parse_unit(unit: str) -> pint.Unit:
    if _UNIT.fullmatch(unit) is None:
        # pint drops characters it cannot read: "volts?" would pass for volts.
        raise UnitProblem(f"{shown(unit)} is not a unit; write for example mm, kPa or N")
    try:
        return _registry().Unit(unit)
    except Exception as error:  # pint raises many kinds for text that is not a unit
        of_pressure = _WITH_REFERENCE.fullmatch(unit.strip())
        hint = (
            f"{of_pressure[1]}; [conventions] pressure in rig.toml says whether pressures are gauge or abs"
            if of_pressure
            else "for example mm, kPa or N"
        )
        raise UnitProblem(f"{shown(unit)} is not a unit; write {hint}") from error


@lru_cache(maxsize=512)
def _affine(unit: str, si_unit: str) -> tuple[float, float]:
    """Factor and offset of ``unit`` into ``si_unit``; raises ``UnitProblem``."""
    parsed, target = _parse_unit(unit), _parse_unit(si_unit)
    if not parsed.is_compatible_with(target):
        raise UnitProblem(f"unit {shown(unit)} has the wrong dimension, expected a unit such as '{si_unit}'")
    registry = _registry()
    zero = float(registry.Quantity(0.0, parsed).to(target).magnitude)
    one = float(registry.Quantity(1.0, parsed).to(target).magnitude)
    return one - zero, zero


def factor_and_offset(unit: str, si_unit: str, where: str) -> tuple[float, float]:
    """Factor and offset with ``value_si = factor * value + offset``.

    Raises ``UserError`` naming ``where`` when ``unit`` is unknown or of the wrong dimension.
    """
    try:
        return _affine(unit, si_unit)
    except UnitProblem as problem:
        raise UserError(f"{where}: {problem}") from problem


def base_unit(unit: str, where: str) -> str:
    """The SI base unit of ``unit``, such as ``kilogram * meter ** 2 / ampere / second ** 3`` for ``mV``.

    Raises ``UserError`` naming ``where`` when ``unit`` is unknown.
    """
    try:
        return str(_registry().get_base_units(_parse_unit(unit))[1])
    except UnitProblem as problem:
        raise UserError(f"{where}: {problem}") from problem


def parse_quantity(text: object, si_unit: str) -> float:
    """Read ``"32 mm"`` as a finite SI float; raises ``UnitProblem`` without naming the place.

    A bare number is taken only where ``si_unit`` is dimensionless.
    """
    if not isinstance(text, str):
        number = shown(text) if isinstance(text, int | float) and not isinstance(text, bool) else "1.0"
        raise UnitProblem(f"{shown(text)} has no unit; {_with_unit(number, si_unit)}")
    stripped = text.strip()
    if stripped.lower().lstrip("+-").startswith(("nan", "inf")):
        raise UnitProblem(f"{shown(text)} is not a finite number")
    match = _NUMBER.match(stripped)
    if match is None:
        raise UnitProblem(f'{shown(text)} is not a number with a unit, such as "1.0 {si_unit}"')
    number, unit = match.group(), stripped[match.end() :].strip()
    if unit[:1] in (",", "_", "."):
        raise UnitProblem(f'{shown(text)} is not a number with a decimal point and a unit, such as "1.5 {si_unit}"')
    value = float(number)
    if not math.isfinite(value):
        raise UnitProblem(f"{shown(text)} is not a finite number")
    if not unit and not _parse_unit(si_unit).dimensionless:
        raise UnitProblem(f"{shown(text)} has no unit; {_with_unit(number, si_unit)}")
    factor, offset = _affine(unit, si_unit)
    return factor * value + offset


def _with_unit(number: str, si_unit: str) -> str:
    """What to write in place of a bare number: no example that could be copied where it may be in another unit."""
    usual = {"Pa": "Pa, kPa, bar or psi", "m": "um, mm or m", "m^3": "cm^3 or l", "s": "ms or s", "kg": "g or kg"}
    if si_unit not in usual:
        return f'write for example "{number} {si_unit}"'
    return f'write "{number} UNIT" with the unit that it is in ({usual[si_unit]})'


def quantity(text: object, si_unit: str, where: str) -> float:
    """Read ``"32 mm"`` as a finite SI float.

    Raises ``UserError`` naming ``where`` for anything that is not a number with a unit of the
    dimension of ``si_unit``.
    """
    try:
        return parse_quantity(text, si_unit)
    except UnitProblem as problem:
        raise UserError(f"{where}: {problem}") from problem


def to_display(value: float, si_unit: str, display_unit: str) -> float:
    """Convert an SI value for a person to read (``"Pa"`` to ``"kPa"``)."""
    factor, offset = factor_and_offset(display_unit, si_unit, "display unit")
    return (value - offset) / factor
