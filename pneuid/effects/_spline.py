"""A smooth unknown function of one signal in one equation: an effect that has no name yet.

``spline:EQUATION(SIGNAL)`` is an effect like those of the catalogue, with the amplitudes of cubic B-splines for
parameters. Forms of the name:

- ``spline:force(x)``: f(x) is added to the forces on the moving mass;
- ``spline:force(x*sign(v))``, ``spline:force(x*v)``: f(x) times the direction or times the speed over 0.1 m/s;
- ``spline:flow_1(psup*u)``: f(psup) times the signed relative opening of the valve;
- ``spline:flow_1(x*dp)``: f(x) times the difference of the chambers' pressures over 1 bar, such as a leak at a place;
- ``spline:flow_1(x*v)``: f(x) times the speed over 0.1 m/s, such as a recess in the bore that the piston opens;
- ``spline:flow_1(psup-p1)``: f of the difference between supply and chamber, such as a leak from the supply;
- ``spline:force(x*p1)``: f(x) times the gauge pressure over 1 bar, such as a hose that the pressure stiffens;
- ``spline:valve(u)``, ``spline:valve(dp)``: added to the relative opening; of other signals, a change of the valve's gain;
- ``spline:force(t)``: f of the time since the recording began, such as a zero that creeps or a coil that warms;
- ``spline:force(x,40)``: 40 splines over the range of the data in place of 10.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, TypeVar

import casadi as ca

from pneuid.effect import Effect, Parameter, Scope, State
from pneuid.errors import UserError
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.gas import RHO_REFERENCE
from pneuid.physics.smoothing import FINE, Expression
from pneuid.rig import Rig

PREFIX = "spline:"

KNOTS = 10
"""Splines over the range of a signal where the name does not say."""

FEWEST, MOST = 5, 64

SPEED = 0.05
"""Speed in m/s at which half of the knots for ``v`` lie beyond: slow motion has most of the knots."""

DIRECTION_WIDTH = 1e-3
"""Speed in m/s over which ``sign(v)`` changes its sign: a force of no direction at rest."""

REFERENCE_SPEED = 0.1
"""Speed in m/s at which a factor ``v`` is 1."""

REFERENCE_PRESSURE = 1e5
"""Difference of pressures, and gauge pressure, in Pa at which a factor ``dp``, ``p1`` or ``p2`` is 1."""

EARLY = 4.0
"""Time in s at which half of the knots for ``t`` lie beyond: what warms or creeps does so at first."""

LASTING = 1e5
"""Time constant in s of the state that counts the time: at 10 minutes it is behind by 0.3 %."""

SUPPLY_RANGE = 1e6
"""Range in Pa above ambient over which the knots for the supply pressure lie."""

LEAST_FRICTION = 0.05
"""Share of the friction level that is left at least."""

SIGNALS_OF: dict[str, tuple[str, ...]] = {
    "valve": ("u", "x", "p1", "p2", "dp", "psup", "t"),
    "flow_1": ("p1", "p2", "dp", "x", "v", "u", "psup", "psup-p1"),
    "flow_2": ("p2", "p1", "dp", "x", "v", "u", "psup", "psup-p2"),
    "pressure_1": ("p1", "p2", "dp", "x", "v", "u", "psup"),
    "pressure_2": ("p2", "p1", "dp", "x", "v", "u", "psup"),
    "friction": ("v", "x", "p1", "p2", "dp", "t"),
    "force": ("x", "v", "p1", "p2", "dp", "t"),
    "sensor_x": ("x", "v", "p1", "p2", "u", "t"),
    "sensor_p1": ("p1", "p2", "x", "v", "u", "t"),
    "sensor_p2": ("p2", "p1", "x", "v", "u", "t"),
    "sensor_F": ("x", "v", "p1", "p2", "t"),
}
"""Signals that are known where each equation is evaluated; ``dp`` is ``p1 - p2``, ``t`` the time since the run began."""

DIFFERENCES = {"dp": ("p1", "p2"), "psup-p1": ("psup", "p1"), "psup-p2": ("psup", "p2")}
"""Signals that are the difference of two recorded ones."""

FACTORS = {"sign(v)": "v", "v": "v", "u": "u", "dp": "dp", "p1": "p1", "p2": "p2"}
"""What f may be multiplied by, and the signal in it."""

_NAME = re.compile(
    r"spline:(?P<equation>[a-z]+(?:_[A-Za-z0-9]+)?)\((?P<signal>[a-z0-9-]+)(?:\*(?P<factor>sign\(v\)|v|u|dp|p1|p2))?(?:,(?P<knots>\d+))?\)"
)
_SOURCE = "de Boor, A Practical Guide to Splines (Springer 1978), chapter IX"
_BENCH_ONLY, _SERVO_SIGNALS = ("sensor_F",), ("u", "psup")
_SERVO_EQUATIONS = ("valve", "flow_1", "flow_2", "pressure_1", "pressure_2", "sensor_x", "sensor_p1", "sensor_p2")


@dataclass(frozen=True)
class Term:
    """What the name of a spline says: the equation it enters, the signal, a factor (empty for none), how many splines."""

    equation: str
    signal: str
    factor: str = ""
    knots: int = KNOTS

    @property
    def name(self) -> str:
        """The name that says it."""
        factor = f"*{self.factor}" if self.factor else ""
        knots = f",{self.knots}" if self.knots != KNOTS else ""
        return f"{PREFIX}{self.equation}({self.signal}{factor}{knots})"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The signals that it depends on, by the contract's names."""
        first, factor = DIFFERENCES.get(self.signal, (self.signal,)), FACTORS.get(self.factor, "")
        return (*first, *(DIFFERENCES.get(factor, (factor,)) if factor else ()))

    @property
    def anchored(self) -> bool:
        """Whether f is zero in the middle of its range, because a constant is a parameter of the base model already."""
        relative = self.equation == "valve" and not self.opens
        return self.factor not in ("", "dp", "p1", "p2") or self.equation in ("friction", "sensor_x") or relative

    @property
    def opens(self) -> bool:
        """Whether f is added to the valve's opening: what the command leaves, or where a pressure pushes the spool."""
        return self.equation == "valve" and self.signal in ("u", "dp") and not self.factor

    @property
    def unit(self) -> str:
        """Unit of f."""
        return {"force": "N", "friction": "N", "flow_1": "kg/s", "flow_2": "kg/s", "pressure_1": "Pa/s",
                "pressure_2": "Pa/s", "valve": "1", "sensor_x": "m", "sensor_p1": "Pa", "sensor_p2": "Pa",
                "sensor_F": "N"}[self.equation]  # fmt: skip

    def size(self, rig: Rig) -> float:
        """Typical amplitude on this rig, in ``unit``."""
        if self.unit == "N":
            return max(1.0, 0.05 * rig.A1 * 1e5)
        if self.unit == "kg/s":
            return 0.02 * rig.conductance * RHO_REFERENCE * rig.supply
        if self.unit == "Pa/s":
            return 1e5
        return {"1": 0.02, "m": 1e-4, "Pa": 1e3}[self.unit]


# --- the basis; the same lines serve floats, arrays and CasADi symbols ---


def _positive(a: Any) -> Any:
    return 0.5 * (a + abs(a))


def _larger(a: Any, b: Any) -> Any:
    return 0.5 * (a + b + abs(a - b))


def _clipped(s: Any) -> Any:
    """``s`` within 0..1."""
    return 0.5 * (abs(s) - abs(s - 1.0) + 1.0)


def basis(s: Any, knots: int) -> list[Any]:
    """Values at ``s`` (0..1) of ``knots`` uniform cubic B-splines, which add up to 1; de Boor, chapter IX."""
    width = 1.0 / (knots - 3)
    found = []
    for j in range(knots):
        t = abs(s / width - (j - 1))
        found.append((_positive(2.0 - t) ** 3 - 4.0 * _positive(1.0 - t) ** 3) / 6.0)
    return found


def coordinate(signal: str, scope: Scope) -> Any:
    """Place of a signal in its range, 0..1 and clamped there; ranges are those of the data a model was fitted on."""
    rig = scope.rig
    if signal == "v":
        return 0.5 + 0.5 * scope.v / ((scope.v * scope.v + DIRECTION_WIDTH**2) ** 0.5 + SPEED)
    if signal == "u":
        return _clipped(0.5 + 0.5 * scope.opening)
    if signal == "t":
        return scope.t / (scope.t + EARLY)
    if signal == "psup":
        return _clipped((scope.psup - rig.patm) / SUPPLY_RANGE)
    if signal == "dp":
        value, low, high = scope.p1 - scope.p2, rig.p1_low - rig.p2_high, rig.p1_high - rig.p2_low
    elif signal in DIFFERENCES:
        # runs at a higher supply than stated mostly have pressures above it
        chamber = DIFFERENCES[signal][1]
        top = _larger(rig.supply_nominal, _larger(rig.p1_high, rig.p2_high))
        value, low, high = scope.psup - getattr(scope, chamber), 0.0, top - getattr(rig, f"{chamber}_low")
    else:
        value, low, high = getattr(scope, signal), getattr(rig, f"{signal}_low"), getattr(rig, f"{signal}_high")
    return _clipped((value - low) / (high - low))


def factor_value(factor: str, scope: Scope) -> Any:
    """What f is multiplied by, 1 for no factor."""
    if factor == "sign(v)":
        return scope.v / (scope.v * scope.v + DIRECTION_WIDTH**2) ** 0.5
    if factor == "v":
        return scope.v / REFERENCE_SPEED
    if factor == "dp":
        return (scope.p1 - scope.p2) / REFERENCE_PRESSURE
    if factor in ("p1", "p2"):
        return (getattr(scope, factor) - scope.rig.patm) / REFERENCE_PRESSURE
    return scope.opening if factor == "u" else 1.0


def columns(term: Term, scope: Scope) -> list[Any]:
    """What each amplitude is multiplied by: the splines, less their values at the anchor, times the factor."""
    splines = basis(coordinate(term.signal, scope), term.knots)
    if term.anchored:
        splines = [value - still for value, still in zip(splines, basis(0.5, term.knots), strict=True)]
    if not term.factor:
        return splines
    factor = factor_value(term.factor, scope)
    return [value * factor for value in splines]


# --- the effect ---


class UnknownTerm(Effect, ABC):
    """A value added to one equation. Subclasses made by ``entering`` override the one port of that equation."""

    term: Term
    reference = f"{_SOURCE}; Eilers and Marx, Statistical Science 11 (1996) 89"
    experiment = "recordings that visit the whole range of the signal, slowly and fast, in both directions"

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Amplitudes with a weak prior: a ridge for places that the data never visit."""
        size = self.term.size(rig)
        return tuple(
            Parameter(name, f"f{j}", self.term.unit, -50 * size, 50 * size, 0.0, size, _SOURCE, off=0.0, prior=10 * size)
            for j, name in enumerate(self.amplitudes, 1)
        )

    @property
    @abstractmethod
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the amplitudes, along the signal's range."""

    @abstractmethod
    def function(self, scope: Scope) -> Expression:
        """The function at the scope's signals, times its factor."""

    def value(self, scope: Scope) -> Expression:
        """What is added, in the equation's unit."""
        for clock in self.states:
            # a solver's trial point may lie before the beginning
            scope.t = ca.fmax(getattr(scope.state, clock.name), 0.0)
        return self.function(scope)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The time grows by one second per second."""
        return {clock.name: (LASTING, LASTING) for clock in self.states}


class Spline(UnknownTerm):
    """``f(signal)``, the sum of amplitudes times cubic B-splines over the range of the data; constant beyond it."""

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the amplitudes, along the signal's range."""
        return tuple(f"{_stem(self.name)}_{j}" for j in range(1, self.term.knots + 1))

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Another process makes the same object from the same name."""
        return spline_by_name, (self.name,)

    def function(self, scope: Scope) -> Expression:
        """The function at the scope's signals."""
        found: Expression = 0.0
        for name, column in zip(self.amplitudes, columns(self.term, scope), strict=True):
            found = found + getattr(scope.p, name) * column
        return found


def _stem(name: str) -> str:
    """How the names of its parameters and states begin."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")


def _force(self: UnknownTerm, force: Expression, scope: Scope) -> Expression:
    return force + self.value(scope)


def _friction_level(self: UnknownTerm, k: Coefficients, scope: Scope) -> Coefficients:
    more = self.value(scope)
    return replace(
        k, Fc=ca.fmax(k.Fc + more, LEAST_FRICTION * k.Fc), Fs=ca.fmax(k.Fs + more, LEAST_FRICTION * k.Fs)
    )


def _flow_1(self: UnknownTerm, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
    return mdot1 + self.value(scope), mdot2


def _flow_2(self: UnknownTerm, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
    return mdot1, mdot2 + self.value(scope)


def _opening(self: UnknownTerm, opening: Expression, scope: Scope) -> Expression:
    return opening + self.value(scope)


def _valve_gain(self: UnknownTerm, opening: Expression, scope: Scope) -> Expression:
    return opening * (1.0 + self.value(scope))


def _sensor(self: UnknownTerm, signal: str, value: Expression, scope: Scope) -> Expression:
    return value + self.value(scope) if self.equation == f"sensor_{signal}" else value


def _port(term: Term) -> tuple[str, Callable[..., Any]]:
    """The port by which a term enters its equation, and what it does there."""
    if term.equation == "friction":
        # a force that depends on speed vanishes at rest; a level that depends on place or pressure holds at rest too
        return ("friction", _force) if term.signal == "v" else ("coefficients", _friction_level)
    if term.equation == "valve":
        return "valve", _opening if term.opens else _valve_gain
    if term.equation.startswith("sensor_"):
        return "sensor", _sensor
    others: dict[str, tuple[str, Callable[..., Any]]] = {
        "force": ("force", _force), "flow_1": ("flows", _flow_1), "flow_2": ("flows", _flow_2),
        "pressure_1": ("pressure_rates", _flow_1), "pressure_2": ("pressure_rates", _flow_2),
    }  # fmt: skip
    return others[term.equation]


Kind = TypeVar("Kind", bound=UnknownTerm)


def entering(kind: type[Kind], term: Term, name: str) -> Kind:
    """The effect of this kind in the term's equation; a class of its own, as compiled code is told apart by classes."""
    port, function = _port(term)
    rigs: tuple[str, ...] = ("servo", "bench")
    if term.equation in _BENCH_ONLY:
        rigs = ("bench",)
    elif term.equation in _SERVO_EQUATIONS or set(term.depends_on) & set(_SERVO_SIGNALS):
        rigs = ("servo",)
    signal = f"{term.signal} times {term.factor}" if term.factor else term.signal
    clock = State("since_" + _stem(name), "s", 0.0, 1e-3, 1.0, clock=True)
    declared = {
        "name": name, "term": term, "equation": term.equation, "rigs": rigs, port: function,
        "states": (clock,) if term.signal == "t" else (),
        "mechanism": f"something without a name yet that follows {signal} acts in the equation {term.equation}",
        "__doc__": kind.__doc__, "__module__": __name__,
    }  # fmt: skip
    made: type[Kind] = type(kind.__name__, (kind,), declared)
    return made()


@lru_cache(maxsize=256)
def spline(term: Term) -> Spline:
    """The effect of a term; the same object for the same term."""
    return entering(Spline, term, term.name)


def spline_by_name(name: str) -> Spline:
    """The effect that ``spline:EQUATION(SIGNAL)`` names. Raises ``UserError`` for a name that says no such function."""
    found = _NAME.fullmatch(name.replace(" ", ""))
    if found is None:
        raise UserError(
            f"effect '{name}' cannot be read; write spline:EQUATION(SIGNAL), such as spline:force(x), "
            "spline:force(x*sign(v)) or spline:force(x,40) for 40 splines"
        )
    equation, signal, factor = found["equation"], found["signal"], found["factor"] or ""
    knots = KNOTS if found["knots"] is None else int(found["knots"])
    if equation not in SIGNALS_OF:
        raise UserError(f"effect '{name}': no equation '{equation}'; choose one of {', '.join(SIGNALS_OF)}")
    if signal not in SIGNALS_OF[equation]:
        known = ", ".join(SIGNALS_OF[equation])
        raise UserError(f"effect '{name}': signal '{signal}' is not known in {equation}; choose one of {known}")
    usable = [item for item, inside in FACTORS.items() if inside in (*SIGNALS_OF[equation], "v") and inside != signal]
    if factor and factor not in usable:
        raise UserError(f"effect '{name}': factor '{factor}' cannot stand here; choose one of {', '.join(usable)}")
    if not FEWEST <= knots <= MOST:
        raise UserError(f"effect '{name}': {knots} splines; choose {FEWEST} to {MOST}")
    return spline(Term(equation, signal, factor, knots))


def curve(term: Term, amplitudes: Sequence[float], ranges: Mapping[str, float], signal: Any) -> Any:
    """f ``(n,)`` in the term's unit at values ``(n,)`` of its signal: SI, absolute, ``u`` as relative opening.

    ranges : those of the model (``x_low`` ...), ``patm`` and ``supply_nominal``. The factor is not part of f.
    """
    return sum(a * column for a, column in zip(amplitudes, curve_columns(term, ranges, signal), strict=True))


def curve_columns(term: Term, ranges: Mapping[str, float], signal: Any) -> list[Any]:
    """What each amplitude is multiplied by in ``curve``."""
    scope = Scope(rig=SimpleNamespace(**ranges), smoothing=FINE, p=SimpleNamespace(), state=SimpleNamespace())
    if term.signal in DIFFERENCES:
        for name, value in zip(DIFFERENCES[term.signal], (signal, 0.0), strict=True):
            setattr(scope, name, value)
    else:
        setattr(scope, "opening" if term.signal == "u" else term.signal, signal)
    splines = basis(coordinate(term.signal, scope), term.knots)
    still = basis(0.5, term.knots) if term.anchored else [0.0] * term.knots
    return [value - at for value, at in zip(splines, still, strict=True)]
