"""Units of pressure that are taken for one another."""

from __future__ import annotations

from pneuid.units import factor_and_offset

_UNITS = ("Pa", "mbar", "kPa", "psi", "bar", "MPa")


def factors_into(share: float, low: float = 0.35, high: float = 1.05) -> str:
    """The pairs of units that would bring ``share``, a pressure over the one expected, into ``low``..``high``, in words.

    ``"psi written as kPa"``: the numbers are psi, the file says kPa. The most likely units in industry first.
    """
    found = []
    for written in _UNITS:
        for meant in _UNITS:
            factor = factor_and_offset(meant, "Pa", "")[0] / factor_and_offset(written, "Pa", "")[0]
            if written != meant and low <= factor * share <= high:
                found.append((_UNITS.index(written) + _UNITS.index(meant) < 4, f"{meant} written as {written}"))
    return " or ".join(words for _, words in sorted(found)[:3])
