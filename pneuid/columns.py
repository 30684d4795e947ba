"""Which column of a table bears which signal, and what takes its numbers to SI."""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.errors import UserError
from pneuid.formats import RawTable
from pneuid.rig import Rig
from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import base_unit, factor_and_offset, shown


def used_columns(table: RawTable, rig: Rig, signals: Sequence[str], where: str) -> dict[str, str | int]:
    """Column of each of ``signals`` that is there: what [columns] says, then the columns that bear a signal's name."""
    used: dict[str, str | int] = {}
    for signal, entry in rig.columns.items():
        if signal not in signals:
            continue
        column = _mapped(signal, entry.column, table, where)
        if column in used.values():
            other = next(name for name, taken in used.items() if taken == column)
            raise UserError(f"{where}: column {shown(column)} is mapped to {other} and to {signal} (rig: [columns])")
        used[signal] = column
    elsewhere = {entry.column for signal, entry in rig.columns.items() if signal not in signals}
    heads = {name: {name, f"{name} [{table.units.get(name)}]"} for name in table.frame.columns}
    mapped = {*used.values(), *(name for name, written in heads.items() if written & elsewhere)}
    for signal in signals:
        if signal in used:
            continue
        if signal in table.frame.columns and signal not in mapped:
            used[signal] = signal
        elif signal in table.apart:
            raise UserError(f"{where}: column {shown(signal)} cannot be used: {table.apart[signal]}")
        else:
            _refuse_other_case(signal, mapped, table, where)
    return used


def _mapped(signal: str, wanted: str | int, table: RawTable, where: str) -> str | int:
    """The column that [columns] names for ``signal``; refuses one that is not there."""
    names: list[str | int] = list(table.frame.columns)
    if isinstance(wanted, int):
        if wanted > len(names):
            raise UserError(f"{where}: column {wanted} for {signal} is missing; the file has {len(names)} columns")
        return names[wanted - 1]
    # A person may copy the header cell as it stands, unit and all.
    for name in names:
        if wanted in (name, f"{name} [{table.units.get(name)}]"):
            return name
    reason = table.ignored.get(wanted) or table.apart.get(wanted)
    why = f"it cannot be used: {reason}" if reason else f"columns there: {listed(names)}"
    raise UserError(f"{where}: column {shown(wanted)} for {signal} is missing; {why}")


def listed(names: Sequence[object]) -> str:
    """Names for a message; a file of hundreds of columns still gives one readable line."""
    few = ", ".join(str(name) for name in names[:12])
    return few + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _refuse_other_case(signal: str, mapped: set[str | int], table: RawTable, where: str) -> None:
    """Refuse ``P1 [kPa]``, which would pass for an absent p1; ``V [V]`` is not a v and stays an extra column."""
    for name in table.frame.columns:
        if name in mapped or str(name).lower() != signal.lower() or name not in table.units:
            continue
        try:
            factor_and_offset(table.units[name], SIGNALS[signal].unit, where)
        except UserError:
            continue
        raise UserError(
            f"{where}: column {shown(name)} is not read as {signal}; name it {signal}, "
            f'or add {signal} = {{column = "{name}"}} to [columns] in rig.toml'
        )


def conversion(signal: str, column: str | int, table: RawTable, rig: Rig, where: str) -> tuple[float, float]:
    """Factor and offset from the column's numbers to SI, absolute pressure."""
    entry = rig.columns.get(signal)
    stated = entry.unit if entry is not None else None
    header = table.units.get(column)
    place = f"{where}: column {shown(column)}"
    unit = stated or header
    if unit is None:
        example = SIGNALS[signal].display_unit
        raise UserError(
            f"{place} has no unit; write {signal} [{example}] in the header, give its unit in [columns] in rig.toml, or "
            "write units = true below [files] where the line below the header states them"
        )
    if stated is not None and header is not None and stated != header:
        # mm and millimeter agree; bar and kPa do not, and either could be the one that is wrong.
        base = base_unit(header, place)
        if factor_and_offset(stated, base, place) != factor_and_offset(header, base, place):
            raise UserError(
                f"{place}: the header says [{header}], rig.toml (columns.{signal}.unit) says {shown(stated)}; "
                "make them agree"
            )
    if entry is not None:
        factor, offset = entry.factor_and_offset(unit, place)
    else:
        factor, offset = factor_and_offset(unit, SIGNALS[signal].unit, place)
    if signal in PRESSURES and rig.pressure_convention == "gauge":
        offset += rig.patm
    return factor, offset
