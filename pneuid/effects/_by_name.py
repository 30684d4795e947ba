"""Effects that their names say in full: splines and formulas."""

from __future__ import annotations

from pneuid.effects._formula import PREFIX as FORMULA
from pneuid.effects._formula import formula_by_name
from pneuid.effects._spline import PREFIX as SPLINE
from pneuid.effects._spline import UnknownTerm, spline_by_name


def unknown_by_name(name: str) -> UnknownTerm | None:
    """The function that a name says, None for the name of another effect. Raises ``UserError`` for one that says it wrong."""
    if name.startswith(SPLINE):
        return spline_by_name(name)
    return formula_by_name(name) if name.startswith(FORMULA) else None


def canonical(name: str) -> str:
    """The one way to write the name of a function; other names as they are. Raises ``UserError`` as ``unknown_by_name``."""
    found = unknown_by_name(name)
    return name if found is None else found.name
