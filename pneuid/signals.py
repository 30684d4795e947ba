"""The vocabulary: every signal once, with symbol, unit, sign and pressure reference.

Inside the program every signal is in SI and every pressure is absolute; the laws of the
friction literature use gauge pressure and say so where they do. Chamber 1 is the cap side,
chamber 2 the rod side, ``x`` grows as the rod extends.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Signal:
    """One measured or simulated quantity.

    ``unit`` is the SI unit used inside; ``display_unit`` is what figures and tables show;
    ``meaning`` states sign and, for pressures, the reference.
    """

    name: str
    symbol: str
    unit: str
    display_unit: str
    meaning: str


_ALL = (
    Signal("t", "t", "s", "s", "time from the start of the run, strictly increasing"),
    Signal("u", "u", "V", "V", "valve command; above null it pressurises chamber 1"),
    Signal("x", "x", "m", "mm", "piston position from the cap end, positive when extending"),
    Signal("v", "v", "m/s", "mm/s", "piston velocity, positive when extending"),
    Signal("p1", "p₁", "Pa", "kPa", "pressure in the cap-side chamber, absolute inside the program"),
    Signal("p2", "p₂", "Pa", "kPa", "pressure in the rod-side chamber, absolute inside the program"),
    Signal("psup", "pₛ", "Pa", "kPa", "supply pressure at the valve, absolute inside the program"),
    Signal("F", "F", "N", "N", "external driving force on the rod, positive in +x"),
)

SIGNALS: dict[str, Signal] = {signal.name: signal for signal in _ALL}
"""Every signal by its identifier."""

PRESSURES = ("p1", "p2", "psup")
"""Signals whose recorded reference (gauge or absolute) the rig states."""
