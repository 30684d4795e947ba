"""Numbers as an engineer writes them: a handy unit, as many digits as the standard error carries, no raw exponents."""

from __future__ import annotations

import math

HANDY: dict[str, tuple[str, float]] = {
    "1": ("", 1.0),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "m/s": ("mm/s", 1e3),
    "Pa": ("kPa", 1e-3),
    "N/m": ("N/mm", 1e-3),
    "N*s/m": ("N·s/m", 1.0),
    "m^3/(s*Pa)": ("dm³/(s·bar)", 1e8),
    "kg/(s*Pa)": ("g/(s·bar)", 1e8),
    "N/Pa": ("N/bar", 1e5),
    "m/(s*Pa)": ("mm/(s·bar)", 1e8),
    "N*s/(m*Pa)": ("N·s/(m·bar)", 1e5),
    "Pa*s/kg": ("kPa·s/g", 1e-6),
}
"""SI unit -> unit shown, factor from SI."""

_UPPER = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_MARKS = (("^2", "²"), ("^3", "³"), ("**2", "²"), ("**3", "³"), ("*", "·"))


def handy(unit: str) -> tuple[str, float]:
    """The unit in which a value is shown and the factor from SI; the SI unit itself where none is agreed."""
    if unit in HANDY:
        return HANDY[unit]
    written = unit
    for code, mark in _MARKS:
        written = written.replace(code, mark)
    return written, 1.0


def number(value: float, digits: int = 3) -> str:
    """A plain number with so many significant digits; powers of ten only beyond 1e-4 and 1e7."""
    if not math.isfinite(value):
        return "not finite"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -4 <= exponent < 7:
        return f"{value / 10.0**exponent:.{digits - 1}f}·10{str(exponent).translate(_UPPER)}".replace("-", "−")
    return fixed(round(value, digits - 1 - exponent), max(0, digits - 1 - exponent))


def fixed(value: float, decimals: int) -> str:
    """So many decimals, thousands apart, a true minus sign."""
    # "+ 0.0" and the second rounding: never "-0"
    return f"{round(value, decimals) + 0.0:,.{decimals}f}".replace(",", " ").replace("-", "−")


def with_error(value: float, std: float | None) -> tuple[str, str]:
    """Value and standard error, both to the second significant digit of the error; ``—`` where there is none."""
    if std is None or not math.isfinite(std) or std <= 0.0:
        return number(value, 4), "—"
    exponent = math.floor(math.log10(std))
    largest = math.floor(math.log10(abs(value))) if value else exponent
    if exponent < -5 or largest >= 7:
        return number(value, 4), number(std, 2)
    decimals = max(0, 1 - exponent)
    return fixed(value, decimals), fixed(std, decimals)


def times(ratio: float) -> str:
    """A multiple such as ``1.0×`` or ``190×``."""
    if not math.isfinite(ratio):
        return "diverged"
    return f"{number(ratio, 2) if ratio >= 10 else f'{ratio:.1f}'}×"


def percent(share: float) -> str:
    """A share as whole percent; ``< 1 %`` and ``> 99 %`` next to none and to all."""
    if not math.isfinite(share):
        return "—"
    if 0.995 <= share < 1.0:
        return "> 99 %"
    return "< 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %".replace("-", "−")


def change(before: float, after: float) -> str:
    """A relative change as whole percent with its sign; ``—`` where one of the values is missing."""
    share = after / before - 1.0 if before else math.nan
    return f"{round(100 * share):+d} %" if math.isfinite(share) else "—"


def probability(p: float) -> str:
    """A p-value with its sign: ``= 0.03``, ``< 10⁻⁵``, below 1e-9 only that."""
    if p >= 1e-3:
        return f"= {p:.2g}"
    # the next power of ten above
    exponent = -9 if p < 1e-9 else math.floor(math.log10(p)) + 1
    return f"< 10{str(exponent).translate(_UPPER)}"
