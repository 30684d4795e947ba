"""Short formulas for the shape of an unknown function: the simplest of a few physically sensible ones that fits.

Every shape of ``formula:`` is fitted to the curve from several starts, its amplitudes by linear least squares inside
(variable projection; Golub, Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), weighted by how often the data visit each place
and how well they determine it. The simplest one within ``ENOUGH`` of the curve wins, else the nearest within ``AT_MOST``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pneuid.effects._formula import SHAPES, UNITS, Shape, distance_of, formula_name
from pneuid.effects._spline import Term
from pneuid.estimation.curves import Curve, signal_of
from pneuid.estimation.fit import Fit

ENOUGH, AT_MOST = 0.10, 0.35
"""Rms distance of a formula from the curve, over the rms of the curve about its mean: near, and too far."""

NEARER = 0.6
"""A formula with more numbers must come nearer by this factor."""

VISITED = 0.5
"""Share of the range that the data must visit: through the few pressures of a bench's runs goes a curve of any shape."""

WAVES = (0.7, 24.0)
"""Numbers of waves over the visited range that are tried for a period."""

LEADING = 2
"""Functions of a shape by which its numbers are searched: a wave's length is that of its fundamental."""

STARTS = 3


@dataclass(frozen=True)
class Distilled:
    """A formula: ``name`` to add it by, ``text`` for people, rms ``error`` over the rms of the curve about its mean."""

    name: str
    text: str
    error: float


def distilled(term: Term, curve: Curve, fit: Fit) -> Distilled | None:
    """The formula of a term's curve, None where no shape comes near it or the data visit few places of it."""
    at, value = np.array(curve.at), np.array(curve.value)
    visits = _visits(term, at, fit)
    if np.mean(visits > 0) < VISITED:
        return None
    weight = _weight(visits, np.array(curve.std))
    spread = _spread(value, weight)
    if not spread > 0.0:
        return None
    best: tuple[float, str, np.ndarray, np.ndarray] | None = None
    for kind, shape in SHAPES.items():
        if kind == "decay" and term.signal != "t":
            continue
        error, numbers, amplitudes = _fitted(term, shape, at, value, weight)
        error /= spread
        fewer = best is None or error < NEARER * best[0]
        if error < AT_MOST and fewer and (best is None or best[0] > ENOUGH):
            best = error, kind, numbers, amplitudes
    if best is None:
        return None
    error, kind, numbers, amplitudes = best
    return Distilled(formula_name(term, kind, numbers.tolist()), _text(term, kind, numbers, amplitudes), error)


def _visits(term: Term, at: np.ndarray, fit: Fit) -> np.ndarray:
    """Number of samples near every place."""
    every = np.concatenate([signal_of(run, term.signal, fit) for run in fit.runs])
    step = at[1] - at[0]
    return np.histogram(every, np.append(at - 0.5 * step, at[-1] + 0.5 * step))[0]


def _weight(visits: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Weight of every place: visits over the variance of the curve there; they add up to 1."""
    weight = np.minimum(visits, np.median(visits) + 1.0) / (std**2 + np.median(std) ** 2)
    return np.asarray(weight / weight.sum())


def _spread(value: np.ndarray, weight: np.ndarray) -> float:
    return float(np.sqrt(weight @ (value - weight @ value) ** 2))


def _fitted(
    term: Term, shape: Shape, at: np.ndarray, value: np.ndarray, weight: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Weighted rms distance of the best formula of a shape, its numbers (SI) and amplitudes."""
    root, span = np.sqrt(weight), at[-1] - at[0]
    # in the search lengths count from the middle of the range, in ranges
    scale = np.array([1.0 if name == "n" else span for name in shape.numbers])
    shift = np.array([at[0] + 0.5 * span if name == "s0" else 0.0 for name in shape.numbers])

    def solved(z: np.ndarray, leading: int = LEADING) -> tuple[np.ndarray, np.ndarray]:
        columns = shape.columns(at, shift + scale * z, distance_of(term.signal))[:leading]
        # the factor's anchor and the base model's own constants take the constant up, whether the effect has one or not
        A = np.column_stack([*columns, np.ones(at.size)]) * root[:, None]
        amplitudes = np.linalg.lstsq(A, root * value, rcond=1e-9)[0]
        return A @ amplitudes - root * value, amplitudes

    low = np.array([{"s0": -0.6, "n": 0.3}.get(name, 0.02) for name in shape.numbers])
    high = np.array([{"s0": 0.6, "n": 3.5, "L": 1.0 / WAVES[0]}.get(name, 1.0) for name in shape.numbers])
    grid = sorted(_starts(shape.numbers), key=lambda z: float(np.sum(solved(np.array(z))[0] ** 2)))

    def distance(z: np.ndarray) -> np.ndarray:
        return solved(z)[0]

    found = [least_squares(distance, np.clip(z, low, high), bounds=(low, high), max_nfev=40) for z in grid[:STARTS]]
    best = min(found, key=lambda item: float(item.cost))
    left, amplitudes = solved(best.x, shape.amplitudes)
    return float(np.linalg.norm(left)), shift + scale * best.x, amplitudes


def _starts(numbers: Sequence[str]) -> Iterator[tuple[float, ...]]:
    """Starts of a shape's numbers, in ranges from the middle."""
    options = {
        "s0": np.linspace(-0.5, 0.5, 21), "w": np.array([0.05, 0.12, 0.3]), "n": np.array([0.5, 2.0]),
        "L": 1.0 / np.geomspace(*WAVES, 90),
    }  # fmt: skip
    grids = np.meshgrid(*(options[name] for name in numbers), indexing="ij")
    yield from zip(*(grid.ravel().tolist() for grid in grids), strict=True)


# --- words ---

_SHOWN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "Pa": ("kPa", 1e-3), "s": ("s", 1.0), "1": ("", 1.0)}
_VALUES = {
    "kg/s": ("g/s", 1e3), "Pa/s": ("kPa/s", 1e-3), "m": ("um", 1e6), "Pa": ("kPa", 1e-3), "1": ("", 1.0), "N": ("N", 1.0),
}  # fmt: skip


def _text(term: Term, kind: str, numbers: np.ndarray, amplitudes: np.ndarray) -> str:
    """The formula for people, pressures absolute."""
    unit, factor = _SHOWN[UNITS[term.signal][0]]
    named = zip(SHAPES[kind].numbers, numbers, strict=True)
    shown = [f"{value * (1.0 if name == 'n' else factor):.3g}" for name, value in named]
    length, per = f" {unit}" if unit else "", f"{distance_of(term.signal) * factor:g} {unit}".strip()
    s = f"({term.signal})" if "-" in term.signal else term.signal
    words = {
        "decay": "exp(-{s}/{0}{u})", "power": "(({s} - {0}{u})/{per})^{1}", "parabola": "(({s} - {0}{u})/{per})^2",
        "above": "max(0, {s} - {0}{u})/{per}", "saturation": "tanh(({s} - {0}{u})/{1}{u})",
        "bump": "exp(-(({s} - {0}{u})/{1}{u})^2)", "pull": "d exp(-d^2)/0.43, d = ({0}{u} - {s})/{1}{u}",
        "period": "a wave in {s} of length {0}{u}",
    }[kind].format(*shown, s=s, u=length, per=per)  # fmt: skip
    amount, large = _VALUES[term.unit]
    size = float(np.hypot(*amplitudes[:2])) if kind == "period" else float(amplitudes[0])
    times = f" * {term.factor}" if term.factor else ""
    return f"{size * large:.3g}{' ' + amount if amount else ''} * {words}{times}"
