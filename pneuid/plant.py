"""Composes the base physics and a list of effects into one symbolic system; knows no effect by name.

Everything a model needs to be evaluated is one column of numbers, ``theta``: the parameters, then the constants of the
rig and the run, then the smoothing widths. So compiled code depends on the structure alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, wraps
from types import SimpleNamespace
from typing import Any, Concatenate, ParamSpec, TypeVar

import casadi as ca
import numpy as np

from pneuid.effect import Constraint, Effect, Parameter, Scope, State
from pneuid.physics import chamber, friction, motion, valve
from pneuid.physics.friction import LAWS
from pneuid.physics.gas import RHO_REFERENCE
from pneuid.physics.smoothing import FINE, Expression, Smoothing
from pneuid.rig import Rig

P = ParamSpec("P")
R = TypeVar("R")

SMOOTHING_NAMES = ("smooth_speed", "smooth_opening", "smooth_laminar")

_CONSTANTS = (
    "mass_nominal", "mass_run", "supply_nominal", "supply_shift", "incline", "A1", "A2", "V01", "V02", "stroke", "patm", "T",
    "b", "full_scale", "null", "carrier_stiffness", "carrier_damping",
    "p1_low", "p1_high", "p2_low", "p2_high", "x_low", "x_high",
)  # fmt: skip

RANGES = ("p1_low", "p1_high", "p2_low", "p2_high", "x_low", "x_high")
"""Constants that are ranges of the data a model was fitted on (Pa absolute, m)."""


@dataclass(frozen=True)
class CoreState:
    """A state of the base model: name, SI unit, and the error in it that matters over a few milliseconds."""

    name: str
    unit: str
    scale: float


_SERVO_STATES = (
    CoreState("x", "m", 1e-4), CoreState("v", "m/s", 1e-2), CoreState("p1", "Pa", 1e3), CoreState("p2", "Pa", 1e3),
    CoreState("z", "m", 1e-5),
)  # fmt: skip


@dataclass
class Stages:
    """Every value of one evaluation of the plant, in the order of evaluation (SI, absolute pressures)."""

    explicit: list[Expression] = field(default_factory=list)
    """Rates of the states that are stepped explicitly (servo: x, v, p1, p2)."""
    relaxing: list[tuple[Expression, Expression]] = field(default_factory=list)
    """``(source, decay)`` of the states with ``ds/dt = source - decay s``: the bristle, then the effects' states."""
    outputs: dict[str, Expression] = field(default_factory=dict)
    """What the sensors show, by signal."""
    opening: Expression = None
    edges: valve.Edges | None = None
    mdot1: Expression = None
    mdot2: Expression = None
    friction: Expression = None
    coefficients: Any = None
    mass: Expression = None
    """Moving mass, kg, effects included."""


_SLOW = "slow ramps of 0.5 to 5 mm/s from rest, with reversals"
_EXPERIMENTS = {
    "Fc": "strokes at constant speeds of 10 to 100 mm/s in both directions",
    "Fs": _SLOW, "vs": _SLOW, "sigma0": _SLOW,
    "sigma1": "abrupt stops and small fast reversals, recorded at 1 kHz or faster",
    "sigma2": "strokes at constant speeds up to the fastest the rig reaches",
    "n": "the valve closed abruptly during fast strokes, so that the piston compresses the closed chambers",
    "C": "large steps of the command that fill and vent both chambers through the fully open valve",
}  # fmt: skip
"""The recording that determines each parameter of the base model."""


def _base_parameters(rig: Rig, law: friction.FrictionLaw) -> tuple[Parameter, ...]:
    """Fitted parameters of the base model with starts scaled to the rig's size."""
    # a few per cent of the force at one bar is where friction of real cylinders lies
    force = max(3.0, 0.1 * rig.A1 * 1e5)
    source = "LuGre model, Canudas de Wit et al. 1995"

    def positive(
        name: str, symbol: str, unit: str, start: float, span: float, where: str = source, prior: float | None = None
    ) -> Parameter:
        return Parameter(
            name, symbol, unit, start / span, start * span, start, 1.0, where, positive=True, prior=prior,
            experiment=_EXPERIMENTS[name],
        )  # fmt: skip

    every = {
        "Fc": positive("Fc", "F_c", "N", force, 1e3),
        "Fs": positive("Fs", "F_s", "N", 1.5 * force, 1e3, prior=2.5),
        # weak priors: records without slow motion leave the pre-sliding coefficients open by orders of magnitude
        "vs": Parameter(
            "vs", "v_s", "m/s", 2e-4, 0.5, 0.01, 1.0, source, positive=True, prior=2.0, experiment=_EXPERIMENTS["vs"]
        ),
        "sigma0": positive("sigma0", "σ0", "N/m", force / 3e-5, 1e3, prior=2.5),
        "sigma1": positive("sigma1", "σ1", "N*s/m", 0.4 * np.sqrt(force / 3e-5 * rig.mass), 1e3, prior=1.5),
        "sigma2": positive("sigma2", "σ2", "N*s/m", 3.0 * force, 1e4),
    }
    found = [every[name] for name in law.fitted]
    if rig.kind == "servo":
        exponent = "polytropic exponent, isothermal to adiabatic"
        found.append(Parameter("n", "n", "1", 1.0, 1.4, 1.2, 0.1, exponent, experiment=_EXPERIMENTS["n"]))
        found.append(positive("C", "C", "m^3/(s*Pa)", rig.conductance, 30.0, "ISO 6358-1 sonic conductance"))
    return tuple(found)


class Plant:
    """The symbolic system of one rig with one friction law and a list of effects.

    Attributes (all tuples, fixed order): ``parameters`` declarations, base first; ``states`` and ``state_scales``;
    ``inputs`` and ``outputs`` signal names; ``theta_names``. ``owner[name]`` is the effect that brought a parameter,
    None for the base model.
    """

    def __init__(self, rig: Rig, law: str, effects: Sequence[Effect] = ()) -> None:
        self.rig, self.law, self.effects = rig, LAWS[law], tuple(effects)
        self.servo = rig.kind == "servo"
        base = _base_parameters(rig, self.law)
        self.parameters: tuple[Parameter, ...] = base
        self.owner: dict[str, str | None] = {parameter.name: None for parameter in base}
        self._own: dict[str, tuple[str, ...]] = {}
        for effect in self.effects:
            declared = effect.parameters(rig, self.law)
            self._own[effect.name] = tuple(parameter.name for parameter in declared)
            self.owner |= {parameter.name: effect.name for parameter in declared}
            self.parameters += declared
        self.effect_states: tuple[State, ...] = tuple(state for effect in self.effects for state in effect.states)
        core = _SERVO_STATES if self.servo else _SERVO_STATES[-1:]
        self.core_states = core
        self.explicit_count = len(core) - 1
        self.states = tuple(state.name for state in core) + tuple(state.name for state in self.effect_states)
        self.state_scales = np.array([state.scale for state in core] + [state.scale for state in self.effect_states])
        self.inputs = ("u", "psup") if self.servo else ("x", "v", "a", "p1", "p2")
        self.outputs = ("x", "p1", "p2") if self.servo else ("F",)
        self.parameter_names = tuple(parameter.name for parameter in self.parameters)
        self.theta_names = self.parameter_names + _CONSTANTS + SMOOTHING_NAMES

    # --- numbers ---

    def starts(self) -> dict[str, float]:
        """Start values of all parameters, SI."""
        return {parameter.name: parameter.start for parameter in self.parameters}

    def own_parameters(self, effect: str) -> tuple[str, ...]:
        """Names of the parameters that one effect brought."""
        return self._own[effect]

    def theta(
        self,
        values: Mapping[str, float],
        ranges: Mapping[str, float],
        mass_run: float | None = None,
        smoothing: Smoothing = FINE,
        supply_shift: float = 0.0,
    ) -> np.ndarray:
        """Column ``(len(theta_names),)`` from parameter values (SI), data ranges, and what one run has for itself.

        mass_run : its moving mass, kg; supply_shift : by how much its supply is above the stated one, Pa.
        """
        rig, servo = self.rig, self.servo
        carrier = rig.mass * friction.CARRIER_FREQUENCY**2 if servo else friction.CARRIER_STIFFNESS_BENCH
        damping = 2 * friction.CARRIER_DAMPING_RATIO * friction.CARRIER_FREQUENCY * rig.mass if servo else 0.0
        constants = {
            "mass_nominal": rig.mass, "mass_run": rig.mass if mass_run is None else mass_run,
            "supply_nominal": rig.supply if servo else rig.patm, "supply_shift": supply_shift, "incline": rig.incline,
            "A1": rig.A1, "A2": rig.A2, "V01": rig.V01 if servo else 1.0, "V02": rig.V02 if servo else 1.0,
            "stroke": rig.stroke if servo else 1.0, "patm": rig.patm, "T": rig.temperature,
            "b": rig.critical_ratio if servo else 0.3, "full_scale": rig.full_scale if servo else 1.0,
            "null": rig.null if servo else 0.0, "carrier_stiffness": carrier, "carrier_damping": damping, **ranges,
        }  # fmt: skip
        widths = (smoothing.speed, smoothing.opening, smoothing.laminar)
        return np.array(
            [values[name] for name in self.parameter_names] + [constants[name] for name in _CONSTANTS] + list(widths)
        )

    # --- symbols ---

    def _scopes(self, state: dict[str, Expression], theta: dict[str, Expression]) -> list[Scope]:
        rig = SimpleNamespace(**{name: theta[name] for name in _CONSTANTS})
        smoothing = Smoothing(*(theta[name] for name in SMOOTHING_NAMES))
        return [
            Scope(
                rig=rig,
                smoothing=smoothing,
                p=SimpleNamespace(**{name: theta[name] for name in self._own[effect.name]}),
                state=SimpleNamespace(**{own.name: state[own.name] for own in effect.states}),
            )
            for effect in self.effects
        ]

    def _named(self, s: Any, w: Any, theta: Any) -> tuple[dict, dict, dict]:
        return (
            {name: s[i] for i, name in enumerate(self.states)},
            {name: w[i] for i, name in enumerate(self.inputs)},
            {name: theta[i] for i, name in enumerate(self.theta_names)},
        )

    def evaluate(
        self, s: Any, w: Any, theta: Any, friction: Callable[[Expression], Expression] | None = None
    ) -> Stages:
        """All stages at state ``s``, input ``w`` and ``theta`` (indexable, numbers or symbols).

        friction : what resists the motion [N, against +v] where another than the model's own, which it is given, is known.
        """
        state, given, th = self._named(s, w, theta)
        known = given | state
        if self.servo:
            known["psup"] = known["psup"] + th["supply_shift"]
        scopes = self._scopes(state, th)
        for scope in scopes:
            for name in ("x", "v", "p1", "p2", "z"):
                setattr(scope, name, known[name])
        stages = Stages()
        if self.servo:
            self._pneumatics(stages, known, th, scopes)
        self._mechanics(stages, known, th, scopes, friction)
        for effect, scope in zip(self.effects, scopes, strict=True):
            scope.F = stages.outputs.get("F")
            targets = effect.relaxations(scope)
            for own in effect.states:
                target, time_constant = targets[own.name]
                stages.relaxing.append((target / time_constant, 1.0 / time_constant))
        for signal in self.outputs:
            value = stages.outputs[signal]
            for effect, scope in zip(self.effects, scopes, strict=True):
                value = effect.sensor(signal, value, scope)
            stages.outputs[signal] = value
        return stages

    def _pneumatics(self, stages: Stages, known: dict, th: dict, scopes: list[Scope]) -> None:
        """Valve, flows and pressures: the first half of the evaluation order."""
        smoothing = Smoothing(*(th[name] for name in SMOOTHING_NAMES))
        x, v, p1, p2 = known["x"], known["v"], known["p1"], known["p2"]
        opening, psup = valve.relative_command(known["u"], th["null"], th["full_scale"]), known["psup"]
        for effect, scope in zip(self.effects, scopes, strict=True):
            scope.opening, scope.psup = opening, psup
            opening = effect.valve(opening, scope)
        edge_1, edge_2 = valve.edges(opening, smoothing)
        edges = valve.Edges(supply_1=edge_1, supply_2=edge_2, exhaust_1=edge_2, exhaust_2=edge_1)
        b, m = th["b"], valve.ELLIPSE
        for effect, scope in zip(self.effects, scopes, strict=True):
            scope.opening_1, scope.opening_2 = edge_1, edge_2
            b, m = effect.critical_ratio(b, scope), effect.subsonic_index(m, scope)
        for effect, scope in zip(self.effects, scopes, strict=True):
            scope.b = b
            edges = effect.edges(edges, scope)
            psup = effect.supply(psup, scope)

        def flow(p_from: Expression, p_to: Expression) -> Expression:
            return valve.mass_flow(p_from, p_to, th["C"], b, th["T"], smoothing.laminar, m)

        supply_1, supply_2 = edges.supply_1 * flow(psup, p1), edges.supply_2 * flow(psup, p2)

        def valve_flows(port_1: Expression, port_2: Expression) -> tuple[Expression, Expression]:
            return (
                edges.supply_1 * flow(psup, port_1) - edges.exhaust_1 * flow(port_1, th["patm"]),
                edges.supply_2 * flow(psup, port_2) - edges.exhaust_2 * flow(port_2, th["patm"]),
            )

        mdot1, mdot2 = valve_flows(p1, p2)
        for scope in scopes:
            scope.psup, scope.valve_flow_1, scope.valve_flow_2, scope.valve_flows = psup, mdot1, mdot2, valve_flows
            scope.supply_flow, scope.full_flow = supply_1 + supply_2, th["C"] * RHO_REFERENCE * known["psup"]
        V1, V2 = th["V01"] + th["A1"] * x, th["V02"] + th["A2"] * (th["stroke"] - x)
        for effect, scope in zip(self.effects, scopes, strict=True):
            supply_1, supply_2 = effect.drawn(supply_1, supply_2, scope)
            mdot1, mdot2 = effect.flows(mdot1, mdot2, scope)
            V1, V2 = effect.volumes(V1, V2, scope)
        # a solver's trial point may lie beyond the end stops, where the volume must stay positive
        V1, V2 = ca.fmax(V1, 0.2 * th["V01"]), ca.fmax(V2, 0.2 * th["V02"])
        stages.opening, stages.edges, stages.mdot1, stages.mdot2 = opening, edges, mdot1, mdot2
        rate1 = chamber.pressure_rate(p1, V1, th["A1"] * v, mdot1, th["n"], th["T"])
        rate2 = chamber.pressure_rate(p2, V2, -th["A2"] * v, mdot2, th["n"], th["T"])
        for scope in scopes:
            scope.mdot1, scope.mdot2, scope.V1, scope.V2, scope.n = mdot1, mdot2, V1, V2, th["n"]
            scope.supply_flow = supply_1 + supply_2
        for effect, scope in zip(self.effects, scopes, strict=True):
            rate1, rate2 = effect.pressure_rates(rate1, rate2, scope)
        for scope in scopes:
            scope.p1_rate, scope.p2_rate = rate1, rate2
        stages.explicit = [rate1, rate2]

    def _mechanics(
        self, stages: Stages, known: dict, th: dict, scopes: list[Scope],
        replaced: Callable[[Expression], Expression] | None,
    ) -> None:  # fmt: skip
        """Friction and force balance: the second half of the evaluation order."""
        x, v, z = known["x"], known["v"], known["z"]
        base = {name: th[name] for name in self.law.fitted}
        k = self.law.coefficients(base, th["carrier_stiffness"], th["carrier_damping"])
        for effect, scope in zip(self.effects, scopes, strict=True):
            k = effect.coefficients(k, scope)
        for scope in scopes:
            scope.Fc = k.Fc
        stribeck_speed, mass = v, th["mass_run"]
        for effect, scope in zip(self.effects, scopes, strict=True):
            stribeck_speed = effect.stribeck_speed(stribeck_speed, scope)
        decay = friction.bristle_decay(k, v, th["smooth_speed"], stribeck_speed)
        resisting = friction.friction_force(k, z, v - decay * z, v)
        for effect, scope in zip(self.effects, scopes, strict=True):
            resisting = effect.friction(resisting, scope)
            mass = effect.mass(mass, scope)
        resisting = resisting if replaced is None else replaced(resisting)
        for scope in scopes:
            scope.mass, scope.friction = mass, resisting
        other = -resisting - mass * motion.GRAVITY * ca.sin(th["incline"])
        if self.servo:
            other = other - motion.end_stop_force(x, v, th["stroke"])
        for effect, scope in zip(self.effects, scopes, strict=True):
            other = effect.force(other, scope)
        pushing = motion.pressure_force(known["p1"], known["p2"], th["A1"], th["A2"], th["patm"])
        stages.coefficients, stages.friction, stages.mass = k, resisting, mass
        stages.relaxing = [(v, decay)]
        acceleration = (pushing + other) / mass if self.servo else known["a"]
        for scope in scopes:
            scope.acceleration, scope.pressure_force = acceleration, pushing
        if self.servo:
            stages.explicit = [v, acceleration, *stages.explicit]
            stages.outputs = {"x": x, "p1": known["p1"], "p2": known["p2"]}
        else:
            stages.outputs = {"F": mass * known["a"] - pushing - other}

    def constraints(self, theta: Any) -> tuple[Constraint, ...]:
        """Inequalities ``value >= 0`` among the parameters (``theta`` indexable, numbers or symbols)."""
        th = {name: theta[i] for i, name in enumerate(self.theta_names)}
        base = {name: th[name] for name in self.parameter_names if self.owner[name] is None}
        found: list[Constraint] = []
        if "Fs" in base:
            found.append(Constraint("Fs - Fc", base["Fs"] - base["Fc"]))
        none = {state.name: 0.0 for state in self.effect_states}
        for effect, scope in zip(self.effects, self._scopes(none, th), strict=True):
            found += effect.constraints(base, scope)
        return tuple(found)


def structure_key(plant: Plant) -> tuple:
    """What symbols and generated code depend on: the kind of rig, the friction law and the effects."""
    return (
        plant.rig.kind,
        plant.law.name,
        tuple(type(effect) for effect in plant.effects),
        plant.theta_names,
    )


class _Alike:
    """A plant that equals every other of its structure."""

    def __init__(self, plant: Plant) -> None:
        self.plant, self.key = plant, structure_key(plant)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Alike) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


def once_per_structure(
    kept: int,
) -> Callable[[Callable[Concatenate[Plant, P], R]], Callable[Concatenate[Plant, P], R]]:
    """Decorator: what is made of a plant's symbols is made once for all plants of a structure; the last ``kept`` stay."""

    def decorated(make: Callable[Concatenate[Plant, P], R]) -> Callable[Concatenate[Plant, P], R]:
        made = lru_cache(kept)(lambda alike, *more, **named: make(alike.plant, *more, **named))

        @wraps(make)
        def found(plant: Plant, *more: P.args, **named: P.kwargs) -> R:
            return made(_Alike(plant), *more, **named)  # type: ignore[arg-type]  # lru_cache says what cannot be hashed

        found.forget = made.cache_clear  # type: ignore[attr-defined]
        return found

    return decorated
