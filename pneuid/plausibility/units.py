"""Units of pressure that are taken for one another."""

from __future__ import annotations

from pneuid.units import factor_and_offset

_UNITS = ("Pa", "mbar", "kPa", "psi", "bar", "MPa")


def factors_into(share: float, low: float = 0.35, high: float = 1.05, stated: str | None = None) -> str:
    """The pairs of units that would bring ``share``, a pressure over the one expected, into ``low``..``high``, in words.

    ``"psi written as kPa"``: the numbers are psi, the file says kPa. The most likely units in industry first; those
    written as the ``stated`` unit alone, where it is known and any of them does.
    """
    found = []
    for written in _UNITS:
        for meant in _UNITS:
            factor = factor_and_offset(meant, "Pa", "")[0] / factor_and_offset(written, "Pa", "")[0]
            if written != meant and low <= factor * share <= high:
                found.append((_UNITS.index(written) + _UNITS.index(meant) < 4, f"{meant} written as {written}", written))
    found = [one for one in found if one[2] == stated] or found
    return " or ".join(words for _, words, _ in sorted(found)[:3])
