"""A short formula in one equation: what an unknown function was distilled into, or what a user suspects.

``formula:EQUATION(SHAPE(SIGNAL[*FACTOR],NUMBERS))`` is an effect like the catalogue's. EQUATION, SIGNAL and FACTOR are those of
``spline:``; the NUMBERS (SI, pressures absolute) are where the search for the shape's own parameters starts. Shapes:

- ``period(s,L)``: two waves of length L and a third of it; ``above(s,s0)``: grows in proportion beyond s0;
- ``saturation(s,s0,w)``: a step at s0 of width w; ``bump(s,s0,w)`` and ``pull(s,s0,w)``: a hill, and its slope;
- ``decay(t,w)``: falls by e in every w;
- ``power(s,s0,n)``: the distance from s0 to the power n, with its sign; ``parabola(s,s0)``.

Example: ``formula:force(period(x,0.025))``. A constant stands beside every shape where the base model has none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from pneuid.effect import Parameter, Scope
from pneuid.effects._spline import (
    DIFFERENCES,
    REFERENCE_SPEED,
    SIGNALS_OF,
    Term,
    UnknownTerm,
    entering,
    factor_value,
    spline_by_name,
)
from pneuid.errors import UserError
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import Expression
from pneuid.rig import Rig

PREFIX = "formula:"

UNITS = {"x": ("m", 1.0), "v": ("m/s", REFERENCE_SPEED), "p1": ("Pa", 1e5), "p2": ("Pa", 1e5), "dp": ("Pa", 1e5),
         "psup": ("Pa", 1e5), "t": ("s", 1.0), "psup-p1": ("Pa", 1e5), "psup-p2": ("Pa", 1e5), "u": ("1", 1.0)}  # fmt: skip
"""Unit of a signal, and the distance by which ``above``, ``power`` and ``parabola`` count (x: of 0.1 m)."""

HINGE = 0.05
"""Width over which ``above`` bends, in those distances."""


@dataclass(frozen=True)
class Shape:
    """One kind of formula.

    numbers : names of its own parameters, in the order of the name; amplitudes : how many functions it has; columns :
    ``(s, numbers, distance) -> functions`` of the signal, for floats, arrays and CasADi symbols alike.
    """

    numbers: tuple[str, ...]
    amplitudes: int
    columns: Callable[[Any, Sequence[Any], float], list[Any]]


def _sin(a: Any) -> Any:
    return ca.sin(a) if isinstance(a, ca.SX | ca.MX) else np.sin(a)


def _exp(a: Any) -> Any:
    return ca.exp(a) if isinstance(a, ca.SX | ca.MX) else np.exp(a)


def _tanh(a: Any) -> Any:
    return ca.tanh(a) if isinstance(a, ca.SX | ca.MX) else np.tanh(a)


def _period(s: Any, p: Sequence[Any], _: float) -> list[Any]:
    angle, quarter = 2.0 * np.pi * s / p[0], 0.5 * np.pi
    return [_sin(angle), _sin(angle + quarter), _sin(3.0 * angle), _sin(3.0 * angle + quarter)]


def _decay(s: Any, p: Sequence[Any], _: float) -> list[Any]:
    return [_exp(-s / p[0])]


def _above(s: Any, p: Sequence[Any], distance: float) -> list[Any]:
    d = (s - p[0]) / distance
    return [0.5 * (d + (d * d + HINGE**2) ** 0.5)]


def _power(s: Any, p: Sequence[Any], distance: float) -> list[Any]:
    d = (s - p[0]) / distance
    return [d * (d * d + 1e-6) ** (0.5 * (p[1] - 1.0))]


def _bump(s: Any, p: Sequence[Any], _: float) -> list[Any]:
    d = (s - p[0]) / p[1]
    return [_exp(-d * d)]


def _pull(s: Any, p: Sequence[Any], _: float) -> list[Any]:
    d = (s - p[0]) / p[1]
    return [-d * _exp(0.5 - d * d) * 2.0**0.5]


SHAPES: dict[str, Shape] = {
    "decay": Shape(("w",), 1, _decay),
    "power": Shape(("s0", "n"), 1, _power),
    "parabola": Shape(("s0",), 1, lambda s, p, distance: [((s - p[0]) / distance) ** 2]),
    "above": Shape(("s0",), 1, _above),
    "saturation": Shape(("s0", "w"), 1, lambda s, p, _: [_tanh((s - p[0]) / p[1])]),
    "bump": Shape(("s0", "w"), 1, _bump),
    "pull": Shape(("s0", "w"), 1, _pull),
    "period": Shape(("L",), 4, _period),
}
"""Every shape by name, simplest first."""


def distance_of(signal: str) -> float:
    """Distance by which ``above``, ``power`` and ``parabola`` count."""
    return 0.1 if signal == "x" else UNITS[signal][1]


def signal_value(signal: str, scope: Scope) -> Any:
    """The signal as formulas see it: SI, absolute, ``u`` as relative opening."""
    if signal in DIFFERENCES:
        first, second = DIFFERENCES[signal]
        return getattr(scope, first) - getattr(scope, second)
    return getattr(scope, "opening" if signal == "u" else signal)


class Formula(UnknownTerm):
    """A constant and a shape with fitted amplitudes; its own numbers are fitted too, from those of the name."""

    shape: str
    start: tuple[float, ...]

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Another process makes the same object from the same name."""
        return formula_by_name, (self.name,)

    @property
    def stem(self) -> str:
        """How its parameters begin."""
        return re.sub(r"[^A-Za-z0-9]+", "_", f"{self.shape}_{self.term.equation}_{self.term.signal}").strip("_")

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the amplitudes: of the shape's functions, then of the constant where there is one."""
        names = [f"{self.stem}_a{j}" for j in range(1, SHAPES[self.shape].amplitudes + 1)]
        return (*names, *(() if self.term.anchored else (f"{self.stem}_a0",)))

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the shape's own parameters."""
        return tuple(f"{self.stem}_{name}" for name in SHAPES[self.shape].numbers)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Amplitudes as of a spline, then the shape's own numbers within what keeps the shape in sight."""
        found = list(super().parameters(rig, law))
        unit, distance = UNITS[self.term.signal]
        for name, kind, start in zip(self.numbers, SHAPES[self.shape].numbers, self.start, strict=True):
            if kind == "n":
                item = Parameter(name, kind, "1", 0.2, 4.0, start, 0.1, self.reference, prior=1.0)
            elif kind == "s0":
                room = 10.0 * distance
                item = Parameter(
                    name, kind, unit, start - room, start + room, start, 0.1 * distance, self.reference, prior=distance
                )
            else:
                item = Parameter(
                    name, kind, unit, 0.5 * start, 2.0 * start, start, 0.05 * start, self.reference, prior=0.5 * start
                )
            found.append(item)
        return tuple(found)

    def function(self, scope: Scope) -> Expression:
        """The function at the scope's signals, times its factor."""
        numbers = [getattr(scope.p, name) for name in self.numbers]
        functions = SHAPES[self.shape].columns(signal_value(self.term.signal, scope), numbers, distance_of(self.term.signal))
        functions = functions if self.term.anchored else [*functions, 1.0]
        found: Expression = 0.0
        for name, function in zip(self.amplitudes, functions, strict=True):
            found = found + getattr(scope.p, name) * function
        return found * factor_value(self.term.factor, scope)


_NAME = re.compile(
    r"formula:(?P<equation>\w+)\((?P<shape>\w+)\((?P<on>[a-z0-9-]+(?:\*[a-z0-9()]+)?)(?P<numbers>(?:,[-+.eE\d]+)*)\)\)"
)


def formula_name(term: Term, shape: str, numbers: Sequence[float]) -> str:
    """The name that says a formula."""
    factor = f"*{term.factor}" if term.factor else ""
    return f"{PREFIX}{term.equation}({shape}({term.signal}{factor}{''.join(f',{value:.6g}' for value in numbers)}))"


@lru_cache(maxsize=256)
def formula_by_name(name: str) -> Formula:
    """The effect that ``formula:EQUATION(SHAPE(SIGNAL,NUMBERS))`` names. Raises ``UserError`` for a name that says none."""
    found = _NAME.fullmatch(name.replace(" ", ""))
    if found is None:
        raise UserError(
            f"effect '{name}' cannot be read; write formula:EQUATION(SHAPE(SIGNAL,NUMBERS)), such as "
            "formula:force(period(x,0.025))"
        )
    if found["shape"] not in SHAPES:
        raise UserError(f"effect '{name}': no shape '{found['shape']}'; choose one of {', '.join(SHAPES)}")
    shape = SHAPES[found["shape"]]
    try:
        numbers = tuple(float(value) for value in found["numbers"].split(",")[1:])
    except ValueError as error:
        raise UserError(f"effect '{name}': {error}; write plain numbers in SI units") from error
    if len(numbers) != len(shape.numbers):
        raise UserError(f"effect '{name}': {found['shape']} needs {len(shape.numbers)} numbers: {', '.join(shape.numbers)}")
    for kind, value in zip(shape.numbers, numbers, strict=True):
        if kind in ("L", "w", "n") and not value > 0.0:
            raise UserError(f"effect '{name}': {kind} is {value:g}; it must be positive")
    if found["equation"] not in SIGNALS_OF:
        raise UserError(f"effect '{name}': no equation '{found['equation']}'; choose one of {', '.join(SIGNALS_OF)}")
    term = spline_by_name(f"spline:{found['equation']}({found['on']})").term
    made = entering(Formula, term, formula_name(term, found["shape"], numbers))
    made.shape, made.start = found["shape"], numbers
    return made

