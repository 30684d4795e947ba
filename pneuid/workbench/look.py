"""The visual language of ``pneuid.report.style``, for the page: a test holds the two together.

Repeated as plain constants because that module brings matplotlib, which the page's first second cannot afford.
"""

from __future__ import annotations

from dataclasses import dataclass

SIMULATED = "#0072b2"
FREE_RUN = "#e69f00"
RESIDUAL = "#aa4499"
FLOOR = "#8c8c8c"
ACCEPTED = "#009e73"
REJECTED = "#d55e00"
NEUTRAL = "#9aa5b1"
MARKS = {"x": "o", "p1": "s", "p2": "D", "F": "o", "v": "^"}

MEASURED_LIGHT, MEASURED_DARK = "#1a1a1a", "#f2f2f2"
"""The measured trace is the strongest ink on either ground."""

PLOTLY_MARKS = {"o": "circle-open", "s": "square-open", "D": "diamond-open", "^": "triangle-up-open"}


@dataclass(frozen=True)
class Ink:
    """Colours that depend on the ground."""

    measured: str
    simulated: str
    text: str
    grid: str
    paper: str
    highlight: str
    residual: str


LIGHT = Ink(MEASURED_LIGHT, SIMULATED, "#1b1f24", "#e3e3e3", "#ffffff", "rgba(230,159,0,0.22)", RESIDUAL)
DARK = Ink(MEASURED_DARK, "#56b4e9", "#e6e9ed", "#3a424b", "#1b2026", "rgba(230,159,0,0.17)", "#e08fd0")


def ink(dark: bool) -> Ink:
    """Colours for a light or a dark ground."""
    return DARK if dark else LIGHT
