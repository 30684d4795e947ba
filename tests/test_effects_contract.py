"""One suite for every effect of the catalogue, on every kind of rig it names and with every friction law.

A check takes an effect, a rig and a friction law and raises ``AssertionError``. A new effect is tested by its line in the
registry alone. Each check must refuse an effect that is broken in that one way (``BROKEN``) and accept ``Honest``.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, TRUTH, off_values, rig

from pneuid.effect import EQUATIONS, Constraint, Effect, Parameter, State
from pneuid.effects import CATALOGUE, LAW_STEPS, effects_by_name
from pneuid.errors import UserError
from pneuid.physics.friction import LAWS, FrictionLaw
from pneuid.plant import Plant
from pneuid.rig import Rig
from pneuid.signals import SIGNALS
from pneuid.units import base_unit

NAMES_OF_THE_CONTRACT = {
    "friction_pressure", "friction_direction", "friction_position", "friction_dwell", "friction_warmup",
    "friction_viscous_nonlinear", "friction_lag", "friction_presliding_memory", "gravity", "load_mass",
    "load_spring", "backlash", "end_cushion", "leakage_internal", "leakage_external_1", "leakage_external_2",
    "dead_volume", "heat_transfer", "line_delay", "supply_droop", "valve_dead_zone", "valve_offset",
    "valve_asymmetry", "valve_lag", "valve_hysteresis", "valve_critical_ratio", "sensor_offset_p1",
    "sensor_offset_p2", "sensor_offset_F", "sensor_lag_F", "law:stribeck", "law:dahl", "law:lugre",
}  # fmt: skip
GUARANTEES = {"dissipative", "conserves mass"}
POINTS = 12

# a rig on which nothing is zero by accident
RIGS = {
    "servo": rig(
        "servo",
        {"load": {"incline": "8 deg"}, "valve": {"null": "0.4 V", "critical_ratio": 0.35}},
        ambient={"temperature": "300 K", "pressure": "98 kPa"},
    ),
    "bench": rig("bench", {"load": {"incline": "8 deg"}}),
}


@dataclass(frozen=True)
class Case:
    """One effect on one rig with one friction law; ``company`` stands beside it in the plant."""

    effect: Effect
    rig: Rig
    law: FrictionLaw

    def plant(self, company: Sequence[Effect] = (), without: bool = False) -> Plant:
        every = [*company] if without else [*company, self.effect]
        order = {name: i for i, name in enumerate(CATALOGUE)}
        every.sort(key=lambda effect: order.get(effect.name, len(order)))
        return Plant(self.rig, self.law.name, every)


CASES = [
    pytest.param(Case(effect, RIGS[kind], LAWS[law]), id=f"{effect.name}-{kind}-{law}")
    for effect in [*CATALOGUE.values(), *LAW_STEPS.values()]
    for kind in effect.rigs
    for law in effect.laws
    # what does not touch friction is tested beside one friction law
    if effect.equation == "friction" or law == ("lugre" if "lugre" in effect.laws else effect.laws[0])
]


# --- evaluating a plant by name ---


def _stages(plant: Plant, s: Any, w: Any, theta: Any) -> dict[str, list]:
    """What stands at each port, by the name of the stage."""
    at = plant.evaluate(s, w, theta)
    k = at.coefficients
    found = {
        "friction": [at.friction, k.Fc, k.Fs, k.vs, k.sigma0, k.sigma1, k.sigma2],
        "bristle": list(at.relaxing[0]),
        **{f"shown_{name}": [value] for name, value in at.outputs.items()},
    }
    if plant.servo:
        found |= {
            "valve": [at.opening, at.edges.supply_1, at.edges.supply_2, at.edges.exhaust_1, at.edges.exhaust_2],
            "flow": [at.mdot1, at.mdot2],
            "pressure": at.explicit[2:],
            "force": at.explicit[1:2],
        }
    return found


def _names(plant: Plant) -> list[str]:
    return [*plant.states, *(f"input {name}" for name in plant.inputs), *plant.theta_names]


class Probe:
    """Stages and their derivatives as functions of named values."""

    def __init__(self, plant: Plant) -> None:
        self.plant, self.names = plant, _names(plant)
        y = ca.SX.sym("y", len(self.names))
        parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(self.names)])
        stages = _stages(plant, *parts)
        self.labels = [f"{stage}[{i}]" for stage, items in stages.items() for i in range(len(items))]
        column = ca.densify(ca.vertcat(*(item for items in stages.values() for item in items)))
        self.value = ca.Function("value", [y], [column])
        self.jacobian = ca.Function("jacobian", [y], [ca.densify(ca.jacobian(column, y))])

    def column(self, point: dict[str, float]) -> np.ndarray:
        return np.array([point[name] for name in self.names])

    def values(self, points: Sequence[dict[str, float]]) -> np.ndarray:
        """``(rows, points)``."""
        return np.column_stack([np.asarray(self.value(self.column(point))).ravel() for point in points])

    def slopes(self, points: Sequence[dict[str, float]], names: Sequence[str]) -> np.ndarray:
        """``(rows, names, points)``."""
        chosen = [self.names.index(name) for name in names]
        return np.stack([np.asarray(self.jacobian(self.column(point)))[:, chosen] for point in points], axis=2)

    def by_stage(self, points: Sequence[dict[str, float]]) -> dict[str, np.ndarray]:
        """``(items, points)`` by stage."""
        found: dict[str, list[np.ndarray]] = {}
        for label, row in zip(self.labels, self.values(points), strict=True):
            found.setdefault(label.split("[")[0], []).append(row)
        return {stage: np.array(rows) for stage, rows in found.items()}


@cache
def _probe(plant_key: tuple) -> Probe:
    return Probe(_PLANTS[plant_key])


_PLANTS: dict[tuple, Plant] = {}


def probe(plant: Plant) -> Probe:
    """The probe of a plant, built once; effects are told apart by identity, which the plant keeps alive."""
    key = (plant.rig.kind, plant.law.name, tuple(id(effect) for effect in plant.effects))
    _PLANTS.setdefault(key, plant)
    return _probe(key)


# --- random operating points and parameter values ---


def operating_point(plant: Plant, rng: np.random.Generator) -> dict[str, float]:
    """States, inputs and base parameters somewhere a cylinder can be, at least 2 mm/s from rest."""
    v = float(rng.choice((-1, 1)) * 10 ** rng.uniform(np.log10(2e-3), np.log10(0.6)))
    # the ends of the travel are visited more often than the middle
    motion = {"x": 0.25 - 0.24 * np.cos(np.pi * rng.uniform()), "v": v}
    motion |= {"p1": rng.uniform(1.2e5, 7e5), "p2": rng.uniform(1.2e5, 7e5)}
    motion |= {"a": rng.uniform(-5, 5), "u": rng.uniform(-9, 9), "psup": rng.uniform(3e5, 8e5)}
    point = {name: float(motion[name]) for name in plant.states if name in motion}
    point |= {f"input {name}": float(motion[name]) for name in plant.inputs}
    point["z"] = float(rng.uniform(-6e-5, 6e-5))
    point |= {own.name: own.initial + own.scale * rng.uniform(-1, 1) for own in plant.effect_states}
    values = {name: TRUTH[name] * 10 ** rng.uniform(-0.2, 0.2) for name in plant.parameter_names if name in TRUTH}
    if "Fs" in values:
        values["Fs"] = values["Fc"] * rng.uniform(1.1, 2.0)
    if "n" in values:
        values["n"] = rng.uniform(1.02, 1.38)
    # a run with a payload of its own
    theta = plant.theta(plant.starts() | values, RANGES, mass_run=plant.rig.mass * rng.uniform(0.8, 1.6))
    return dict(zip(plant.theta_names, theta.tolist(), strict=True)) | point


def drawn(effect: Effect, plant: Plant, rng: np.random.Generator, wide: bool = False) -> dict[str, float]:
    """Values of an effect's parameters inside its bounds: about their typical size, or ``wide`` up to the bounds."""
    found = {}
    for item in effect.parameters(plant.rig, plant.law):
        centre = item.start if item.off is None else item.off
        reach = 10 ** rng.uniform(-2, 3 if wide else 0.0)
        if item.positive:
            value = centre * np.exp(rng.uniform(-1, 1))
        else:
            value = centre + rng.choice((-1, 1)) * item.scale * reach
            # an amplitude that may only grow is drawn to the side where it may
            if not item.lower < value < item.upper:
                value = centre - (value - centre)
        found[item.name] = float(np.clip(value, item.lower, item.upper))
    return found


def constraint_values(plant: Plant, point: dict[str, float]) -> np.ndarray:
    theta = np.array([point[name] for name in plant.theta_names])
    return np.array([float(item.value) for item in plant.constraints(theta)])


def allowed_point(case: Case, plant: Plant, rng: np.random.Generator, wide: bool = False) -> dict[str, float]:
    """An operating point with the effect on, its amplitudes halved towards off until the constraints hold."""
    point = operating_point(plant, rng) | drawn(case.effect, plant, rng, wide)
    off = off_values(plant, case.effect)
    for _ in range(60):
        if np.all(constraint_values(plant, point) >= 0.0):
            return point
        point |= {name: value + 0.5 * (point[name] - value) for name, value in off.items()}
    raise AssertionError(f"{case.effect.name}: its constraints do not hold even next to off")


def _points(
    case: Case, plant: Plant, seed: int = 11, wide: bool = False, count: int = POINTS
) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return [allowed_point(case, plant, rng, wide) for _ in range(count)]


def _company(case: Case) -> list[Effect]:
    return [
        item
        for item in CATALOGUE.values()
        if case.rig.kind in item.rigs and case.law.name in item.laws and item.name != case.effect.name
    ]


def _switched_off(case: Case, plant: Plant, point: dict[str, float]) -> dict[str, float]:
    return point | off_values(plant, case.effect)


# --- the checks ---


def check_words(case: Case) -> None:
    """Everything that a user is told about it is there."""
    effect = case.effect
    assert re.fullmatch(r"(law:)?[a-z][a-z0-9_]*([a-z0-9]|_F)", effect.name), effect.name
    assert CATALOGUE.get(effect.name, effect) is effect, f"{effect.name} stands in the registry for another effect"
    assert 20 < len(effect.mechanism) < 200, f"mechanism is not one sentence: {effect.mechanism}"
    assert not re.search(r"[.;!?\n]", effect.mechanism.rstrip(".")), (
        f"mechanism is not one sentence: {effect.mechanism}"
    )
    plant = Plant(case.rig, case.law.name)
    # a bench's inputs are read by sensors too, a servo rig's command is not
    sensors = {f"sensor_{name}" for name in (*plant.outputs, *(() if plant.servo else plant.inputs))}
    assert effect.equation in (*EQUATIONS, *sensors), f"unknown equation {effect.equation}"
    assert re.search(r"\b(1[6-9]|20)\d\d\b", effect.reference), f"no year in the reference: {effect.reference}"
    assert len(effect.experiment) > 15, f"no experiment: {effect.experiment}"
    assert effect.__doc__ and len(effect.__doc__) > 20, "no docstring with its formula"
    known = NAMES_OF_THE_CONTRACT | set(CATALOGUE)
    assert set(effect.confused_with) <= known - {effect.name}, f"confused with {effect.confused_with}"
    assert effect.rigs and set(effect.rigs) <= {"servo", "bench"}, effect.rigs
    assert set(effect.guarantees) <= GUARANTEES, effect.guarantees


def check_parameters(case: Case) -> None:
    """Bounds, starts, units and scales make sense, and the same declaration comes every time."""
    declared = case.effect.parameters(case.rig, case.law)
    assert declared == case.effect.parameters(case.rig, case.law), "the declarations change from call to call"
    assert any(item.off is not None for item in declared), "no amplitude: nothing can be switched off"
    for item in declared:
        base_unit(item.unit, item.name)
        numbers = [item.lower, item.upper, item.start, item.scale]
        assert np.all(np.isfinite(numbers)), item
        assert item.lower < item.upper, item
        starts_off = item.off is not None and item.start == item.off
        assert item.lower < item.start < item.upper or (starts_off and item.lower <= item.start <= item.upper), item
        assert item.off is None or item.lower <= item.off <= item.upper, item
        assert item.scale > 0.0 and (item.prior is None or item.prior > 0.0), item
        assert not item.positive or item.lower > 0.0, item
        assert item.symbol and len(item.source) > 10, item


def check_names(case: Case) -> None:
    """Its names collide with none of the base model's, the constants', the signals' or another effect's."""
    plant = case.plant(_company(case))
    names = _names(plant)
    twice = {name for name in names if names.count(name) > 1}
    assert not twice, f"names used twice: {twice}"
    own = {item.name for item in case.effect.parameters(case.rig, case.law)} | {
        item.name for item in case.effect.states
    }
    assert not own & set(SIGNALS), f"names of signals: {own & set(SIGNALS)}"
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in own), own


def check_states(case: Case) -> None:
    """Its states relax to a finite target with a positive time constant everywhere inside the bounds."""
    plant = case.plant()
    for state in case.effect.states:
        base_unit(state.unit, state.name)
        assert state.spread > 0.0 and state.scale > 0.0 and np.isfinite(state.initial), state
    y = ca.SX.sym("y", len(_names(plant)))
    parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(_names(plant))])
    relaxing = plant.evaluate(*parts).relaxing[1:]
    assert len(relaxing) == len(case.effect.states), "a state without a relaxation"
    decays = ca.Function(
        "decays", [y], [ca.vertcat(*(decay for _, decay in relaxing)), ca.vertcat(*(a for a, _ in relaxing))]
    )
    for point in _points(case, plant, wide=True):
        decay, source = decays([point[name] for name in _names(plant)])
        assert np.all(np.asarray(decay) > 0.0) and np.all(np.isfinite(np.asarray(source))), "a state that runs away"


def _assert_absent(case: Case, company: Sequence[Effect]) -> None:
    plant, bare = case.plant(company), case.plant(company, without=True)
    rng = np.random.default_rng(5)
    points = []
    for _ in range(POINTS):
        point = operating_point(plant, rng)
        for effect in plant.effects:
            point |= drawn(effect, plant, rng)
        points.append(_switched_off(case, plant, point))
    on, off = probe(plant), probe(bare)
    assert on.labels == off.labels
    one, other = on.values(points), off.values(points)
    # identical operations up to the rounding of terms that cancel
    size = np.abs(other).max(axis=1, keepdims=True)
    worst = np.max(np.abs(one - other) / np.maximum(size, 1e-300), axis=1)
    assert np.all(worst <= 1e-12), f"off is not absent in {[on.labels[i] for i in np.flatnonzero(worst > 1e-12)]}"
    shared = [*bare.states, *(f"input {name}" for name in bare.inputs), *bare.parameter_names]
    one, other = on.slopes(points, shared), off.slopes(points, shared)
    size = np.abs(other).max(axis=2, keepdims=True)
    # columns of different units are compared each by its own size, at least a billionth of the row's largest
    gap = np.abs(one - other) > 1e-9 * size + 1e-18 * size.max(axis=1, keepdims=True)
    assert not gap.any(), f"off changes derivatives of {[on.labels[i] for i in np.unique(np.nonzero(gap)[0])]}"
    shapes = [item.name for item in case.effect.parameters(plant.rig, plant.law) if item.off is None]
    felt = np.abs(on.slopes(points, shapes)) if shapes else np.zeros(1)
    assert not felt.any(), "a shape is felt while the amplitudes are off"


def check_off_is_absent(case: Case) -> None:
    """At the off-values every rate, output and derivative is that of the plant without it."""
    _assert_absent(case, [])


def check_off_is_absent_in_company(case: Case) -> None:
    """The same beside all other effects at work: an effect never tests whether another is there."""
    _assert_absent(case, _company(case))


def check_amplitudes_are_felt(case: Case) -> None:
    """At the off-values every amplitude moves something, or screening could never see it."""
    plant = case.plant()
    points = [_switched_off(case, plant, point) for point in _points(case, plant, seed=3, count=40)]
    found = probe(plant)
    size = np.abs(found.values(points)).max(axis=1)
    for item in case.effect.parameters(plant.rig, plant.law):
        if item.off is not None:
            typical = item.scale * (item.off if item.positive else 1.0)  # a positive one counts in e-folds
            moved = np.abs(found.slopes(points, [item.name])[:, 0]).max(axis=1) * typical
            assert np.any(moved > 1e-6 * np.maximum(size, 1e-12)), f"{item.name} moves nothing at its off-value"


def check_derivatives(case: Case) -> None:
    """CasADi's derivatives with the effect at work agree with central differences away from kinks."""
    plant = case.plant()
    found = probe(plant)
    points = _points(case, plant, seed=7, count=6)
    names = [*plant.states, *(f"input {name}" for name in plant.inputs), *plant.parameter_names]
    exact = found.slopes(points, names)
    scale = np.abs(exact).max(axis=2)
    # an edge that is closed is the difference of numbers as large as one that is open
    size = np.abs(found.values(points)).max(axis=1)
    kinks = 0
    for k, point in enumerate(points):
        middle = found.values([point])[:, 0]
        for j, name in enumerate(names):
            h = 1e-6 * max(abs(point[name]), 1e-9)
            up, down = found.values([point | {name: point[name] + h}, point | {name: point[name] - h}]).T
            central = (up - down) / (2 * h)
            # second order in h, and the rounding of the difference
            allowed = 1e-5 * scale[:, j] + (1e-14 * np.abs(middle) + 1e-15 * size) / h
            wrong = ~(np.abs(central - exact[:, j, k]) <= allowed)
            bent = np.abs(up - 2 * middle + down) / h > 1e-3 * np.abs(exact[:, j, k]) + allowed
            kinks += int(np.any(wrong & bent))
            wrong &= ~bent
            assert not wrong.any(), f"d {[found.labels[i] for i in np.flatnonzero(wrong)]} / d {name} is wrong"
    # points are random: a few may fall on a clamp, no more
    assert kinks <= 0.05 * len(points) * len(names), f"{kinks} kinks in {len(points) * len(names)} differences"


def check_finite(case: Case) -> None:
    """Values and derivatives are finite where real runs go: at rest, closed, at equal pressures, at the ends."""
    plant = case.plant()
    found = probe(plant)
    awkward: list[dict[str, float]] = [
        {"v": 0.0, "input v": 0.0, "z": 0.0},
        {"input u": plant.rig.null}, {"input u": plant.rig.null + plant.rig.full_scale},
        {"p1": 3e5, "p2": 3e5, "input psup": 3e5, "input p1": 3e5, "input p2": 3e5},
        {"p1": plant.rig.patm, "p2": plant.rig.patm, "input p1": plant.rig.patm, "input p2": plant.rig.patm},
        {"x": 0.0, "input x": 0.0}, {"x": 0.5, "input x": 0.5}, {"x": RANGES["x_low"]}, {"x": -1e-3}, {"x": 0.501},
        {"p1": RANGES["p1_low"], "p2": RANGES["p2_high"], "input p1": RANGES["p1_low"], "input p2": RANGES["p2_high"]},
        {own.name: own.initial for own in plant.effect_states},
    ]  # fmt: skip
    for point in _points(case, plant, seed=2, count=2):
        for base in (point, _switched_off(case, plant, point)):
            for odd in [*awkward, {name: value for one in awkward[:5] for name, value in one.items()}]:
                at = base | {name: value for name, value in odd.items() if name in base}
                assert np.all(np.isfinite(found.values([at]))), f"value not finite at {odd}"
                assert np.all(np.isfinite(found.slopes([at], found.names))), f"derivative not finite at {odd}"


def check_numbers_equal_symbols(case: Case) -> None:
    """The one contribution serves floats and symbols alike."""
    plant = case.plant()
    found = probe(plant)
    for point in _points(case, plant, count=3):
        s = [point[name] for name in plant.states]
        w = [point[f"input {name}"] for name in plant.inputs]
        theta = [point[name] for name in plant.theta_names]
        plain = [float(item) for items in _stages(plant, s, w, theta).values() for item in items]
        symbolic = found.values([point])[:, 0]
        np.testing.assert_allclose(plain, symbolic, rtol=1e-12, atol=1e-12 * np.abs(symbolic).min(initial=1.0))


REACHES = {
    "valve": {"valve", "flow", "pressure"},
    "flow_1": {"flow", "pressure"},
    "flow_2": {"flow", "pressure"},
    "pressure_1": {"pressure"},
    "pressure_2": {"pressure"},
    "friction": {"friction", "bristle", "force", "shown_F"},
    "force": {"force", "shown_F"},
}
"""What an effect in each equation may change at a given state; a sensor changes what it shows alone."""

BESIDE = {
    "channel_skew": {"shown_x", "shown_p2"}, "sensor_offset_p1": {"shown_F"}, "sensor_offset_p2": {"shown_F"},
    "end_cushion": {"force"}, "mounting_compliance": {"shown_x"},
}  # fmt: skip
"""What an effect changes besides: one cause in three sensors; on a bench the force that belongs to the pressures shown; the
trapped air of a cushion pushes too; a position read on the machine shows the recoil of the body."""


def check_enters_where_it_says(case: Case) -> None:
    """It changes the equation it declares and nothing that stands before or beside it."""
    plant, equation = case.plant(), case.effect.equation
    points = _points(case, plant, seed=13, count=40)
    on = probe(plant).by_stage(points)
    off = probe(case.plant(without=True)).by_stage(points)
    changed = {stage for stage in on if not np.allclose(on[stage], off[stage], rtol=1e-9, atol=0.0)}
    may = REACHES.get(equation, {equation.replace("sensor_", "shown_")}) | BESIDE.get(case.effect.name, set())
    first = equation.replace("sensor_", "shown_").removesuffix("_1").removesuffix("_2")
    must = {"shown_F"} if not plant.servo and first in ("force", "shown_p1", "shown_p2") else {first}
    assert changed <= may, f"declares {equation} and changes {changed - may}"
    if equation == "friction" and "bristle" in changed:
        must = set()  # it changes how fast the bristle follows, from which its force comes
    assert must <= changed, f"declares {equation} and does not change it"


def _settle(plant: Plant, points: list[dict[str, float]]) -> None:
    """Bring bristle and effects' states in place to where steady sliding holds them; on the way they store energy."""
    y = ca.SX.sym("y", len(_names(plant)))
    parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(_names(plant))])
    targets = [source / decay for source, decay in plant.evaluate(*parts).relaxing]
    function = ca.Function("targets", [y], [ca.vertcat(*targets)])
    names = ["z", *(own.name for own in plant.effect_states)]
    for point in points:
        # the bristle last and alone: a state that feeds back on its own target may still be on its way
        for moved in [names] * (20 if plant.effect_states else 0) + [["z"]]:
            settled = np.asarray(function([point[name] for name in _names(plant)])).ravel()
            point |= dict(zip(moved, settled.tolist(), strict=False))


def check_guarantees(case: Case) -> None:
    """What it promises holds up to its bounds; seals take power out of the motion whether promised or not."""
    plant = case.plant()
    points = _points(case, plant, seed=17, wide=True, count=40)
    on = probe(plant).by_stage(points)
    if "conserves mass" in case.effect.guarantees:
        assert plant.servo, "conserves mass on a rig without flows"
        before, after = probe(case.plant(without=True)).by_stage(points)["flow"], on["flow"]
        # the leak may be larger than the flows: rounding is that of the terms that cancel
        assert np.all(np.abs(after.sum(axis=0) - before.sum(axis=0)) <= 1e-12 * np.abs(after).max(axis=0)), (
            "makes or loses air"
        )
    if "dissipative" in case.effect.guarantees or case.effect.equation == "friction":
        _settle(plant, points)
        settled = probe(plant).by_stage(points)
        power = settled["friction"][0] * settled["bristle"][0]
        assert np.all(power >= 0.0), f"friction drives the motion with {-power.min():.3g} W"


def check_constraints_hold_at_the_start(case: Case) -> None:
    """A fit begins inside its own inequalities, at the declared starts and with the effect off."""
    plant = case.plant()
    for values in (plant.starts(), plant.starts() | off_values(plant, case.effect)):
        theta = plant.theta(values, RANGES)
        for item in plant.constraints(theta):
            assert np.isfinite(float(item.value)) and float(item.value) >= 0.0, f"{item.name} = {float(item.value)}"


CHECKS: tuple[Callable[[Case], None], ...] = (
    check_words, check_parameters, check_names, check_states, check_off_is_absent, check_off_is_absent_in_company,
    check_amplitudes_are_felt, check_derivatives, check_finite, check_numbers_equal_symbols, check_enters_where_it_says,
    check_guarantees, check_constraints_hold_at_the_start,
)  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_every_effect_keeps_the_contract(check, case):
    check(case)


# --- negative controls: an honest effect, and one broken copy of it for every check ---


class Honest(Effect):
    """A force ``-a tanh(x/L)`` with a state that follows the speed."""

    name = "honest"
    mechanism = "a soft spring pulls the load back towards the cap end"
    equation = "force"
    reference = "Hooke, De potentia restitutiva, 1678"
    experiment = "slow strokes over the whole travel"
    states: Sequence[State] = (State("v_followed", "m/s", 0.0, 0.1, 0.1),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:  # noqa: ARG002 - the signature of the contract
        return (
            Parameter("a_pull", "a", "N", -1e3, 1e3, 0.0, 5.0, "a source with words", off=0.0),
            Parameter("L_pull", "L", "m", 0.01, 10.0, 0.2, 1.0, "a source with words", positive=True),
        )

    def force(self, force, scope):
        return force - scope.p.a_pull * (ca.tanh(scope.x / scope.p.L_pull) + scope.state.v_followed)

    def relaxations(self, scope):
        return {"v_followed": (scope.v, scope.p.L_pull)}


def _changed(**attributes: Any) -> Effect:
    """The honest effect with some attributes or methods replaced."""
    return type("Broken", (Honest,), {"__doc__": Honest.__doc__, **attributes})()


def _first_parameter(**changes: Any) -> Effect:
    def parameters(self, rig, law):
        amplitude, shape = Honest.parameters(self, rig, law)
        return replace(amplitude, **changes), shape

    return _changed(parameters=parameters)


def _force(change: Callable) -> Effect:
    return _changed(force=lambda _, force, scope: change(force, scope))


def _friction(change: Callable, **attributes: Any) -> Effect:
    plain = {"force": Effect.force, "equation": "friction"}
    return _changed(**plain, friction=lambda _, force, scope: change(force, scope), **attributes)


class _Counting(Honest):
    """A force ``-a tanh(x/L)`` whose declaration depends on how often it was asked."""

    asked = 0

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        type(self).asked += 1
        amplitude, shape = super().parameters(rig, law)
        return replace(amplitude, scale=float(self.asked)), shape


def _replaces(_, m, scope):
    """Sets the mass instead of changing the one it is given: alone it is absent when off, beside load_mass it is not."""
    return scope.rig.mass_run + scope.p.a_pull


def _ripple(force, scope):
    """Below rounding in value, not in slope."""
    return force + 1e-12 * ca.sin(1e13 * scope.x) - scope.p.a_pull * scope.x


def _branching(force, scope):
    return ca.if_else(scope.p.a_pull == 0.0, force, force - scope.p.a_pull * scope.x)


def _tells_numbers_apart(force, scope):
    return force - scope.p.a_pull * (1.0 if isinstance(scope.x, float) else 2.0)


def _resists(_, force, scope):
    return force - scope.p.a_pull


def _runs_away(_, scope):
    return {"v_followed": (scope.v, -scope.p.L_pull)}


def _leaking(arrives: float) -> Effect:
    def flows(_, mdot1, mdot2, scope):
        return mdot1 - scope.p.a_pull * scope.x, mdot2 + arrives * scope.p.a_pull * scope.x

    return _changed(force=Effect.force, equation="flow_1", guarantees=("conserves mass",), flows=flows)


def _constrained(value: Callable) -> Effect:
    def constraints(_, base, scope):
        assert "Fc" in base
        return (Constraint("a - 1", value(scope.p.a_pull)),)

    return _changed(constraints=constraints)


BROKEN: list[tuple[Callable[[Case], None], str, str, Effect]] = [
    (check_words, "name", "Not A Name", _changed(name="Not A Name")),
    (check_words, "name of another", "for another effect", _changed(name="gravity")),
    (check_words, "two sentences", "one sentence", _changed(mechanism="a spring pulls the load. It is soft")),
    (check_words, "equation", "unknown equation", _changed(equation="temper")),
    (check_words, "sensor of nothing", "unknown equation", _changed(equation="sensor_u")),
    (check_words, "reference", "no year", _changed(reference="common knowledge")),
    (check_words, "experiment", "no experiment", _changed(experiment="")),
    (check_words, "docstring", "no docstring", _changed(__doc__=None)),
    (check_words, "confused with itself", "confused with", _changed(confused_with=("honest",))),
    (check_words, "confused with a misprint", "confused with", _changed(confused_with=("gravitiy",))),
    (check_words, "rigs", "boat", _changed(rigs=("boat",))),
    (check_words, "guarantee", "cheap", _changed(guarantees=("cheap",))),
    (check_parameters, "unit", "newtonish", _first_parameter(unit="newtonish")),
    (check_parameters, "bounds", "lower=2000", _first_parameter(lower=2e3)),
    (check_parameters, "start outside", "start=2000", _first_parameter(start=2e3)),
    (check_parameters, "start on a bound, not off", "start=1000", _first_parameter(start=1e3)),
    (check_parameters, "off outside", "off=-2000", _first_parameter(off=-2e3)),
    (check_parameters, "no amplitude", "no amplitude", _first_parameter(off=None)),
    (check_parameters, "scale", "scale=0.0", _first_parameter(scale=0.0)),
    (check_parameters, "logarithm of a negative bound", "positive=True", _first_parameter(positive=True)),
    (check_parameters, "moving declarations", "change from call to call", _Counting()),
    (check_names, "base parameter", "'Fc'", _first_parameter(name="Fc")),
    (check_names, "constant", "'incline'", _first_parameter(name="incline")),
    (check_names, "another effect's", "'F_g'", _first_parameter(name="F_g")),
    (check_names, "signal", "'psup'", _first_parameter(name="psup")),
    (check_names, "core state", "'z'", _changed(states=(replace(Honest.states[0], name="z"),))),
    (check_states, "runs away", "runs away", _changed(relaxations=_runs_away)),
    (check_states, "no spread", "spread=0.0", _changed(states=(replace(Honest.states[0], spread=0.0),))),
    (check_off_is_absent, "constant rest", "off is not absent", _force(lambda f, at: f - at.p.a_pull - 1e-3)),
    (check_off_is_absent, "slope of the rest", "off changes derivatives", _force(_ripple)),
    (check_off_is_absent, "shape felt", "shape is felt", _force(lambda f, at: f - at.p.a_pull + 1e-13 * at.p.L_pull)),
    (check_off_is_absent_in_company, "replaces", "off is not absent", _changed(force=Effect.force, mass=_replaces)),
    (check_amplitudes_are_felt, "hidden by a branch", "a_pull moves nothing", _force(_branching)),
    (check_amplitudes_are_felt, "quadratic", "a_pull moves nothing", _force(lambda f, at: f - at.p.a_pull**2 * at.x)),
    (check_derivatives, "staircase", "is wrong", _force(lambda f, at: f - at.p.a_pull * ca.floor(1e9 * at.x) / 1e9)),
    (
        check_finite,
        "root at rest",
        "derivative not finite",
        _force(lambda f, at: f - at.p.a_pull * ca.sqrt(ca.fabs(at.v))),
    ),
    (check_finite, "pole at zero", "value not finite", _force(lambda f, at: f - at.p.a_pull / at.x)),
    (
        check_numbers_equal_symbols,
        "symbols only",
        "has no attribute",
        _force(lambda f, at: f - at.x.attachAssert(at.x, "")),
    ),
    (check_numbers_equal_symbols, "numbers differ", "Not equal", _force(_tells_numbers_apart)),
    (check_enters_where_it_says, "friction", "declares force and changes", _changed(friction=_resists)),
    (check_enters_where_it_says, "nothing", "does not change it", _changed(force=Effect.force)),
    (check_guarantees, "drives the motion", "drives the motion", _friction(lambda f, at: f - at.p.a_pull * at.v)),
    (
        check_guarantees,
        "promised and not kept",
        "drives the motion",
        _changed(guarantees=("dissipative",), friction=_resists),
    ),
    (check_guarantees, "makes air", "makes or loses air", _leaking(1.001)),
    (check_constraints_hold_at_the_start, "start outside", "a - 1 = -1", _constrained(lambda a: a - 1.0)),
    (check_constraints_hold_at_the_start, "not a number", "nan", _constrained(lambda a: a * float("nan"))),
]


def _on_servo(effect: Effect) -> Case:
    return Case(effect, RIGS["servo"], LAWS["lugre"])


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("kind", ["servo", "bench"])
def test_an_honest_effect_passes(check, kind):
    check(Case(Honest(), RIGS[kind], LAWS["lugre"]))


@pytest.mark.parametrize(
    ("check", "words", "effect"),
    [pytest.param(check, words, effect, id=f"{check.__name__}-{how}") for check, how, words, effect in BROKEN],
)
def test_a_broken_effect_is_refused(check, words, effect):
    # a unit that does not exist is a UserError, a method that floats do not have an AttributeError
    with pytest.raises((AssertionError, UserError, AttributeError), match=words):
        check(_on_servo(effect))


def test_a_leak_that_keeps_its_promise_passes():
    check_guarantees(_on_servo(_leaking(1.0)))


def test_an_effect_that_replaces_is_refused_in_company_only():
    check_off_is_absent(_on_servo(_changed(force=Effect.force, mass=_replaces)))


def test_every_check_has_seen_a_broken_effect():
    assert {check for check, *_ in BROKEN} == set(CHECKS)


# --- the registry ---


def test_the_registry_is_keyed_by_name_and_names_are_those_of_the_contract():
    assert [effect.name for effect in CATALOGUE.values()] == list(CATALOGUE)
    assert len({type(effect) for effect in CATALOGUE.values()}) == len(CATALOGUE)


def test_the_order_of_the_registry_is_the_same_in_every_process():
    found = subprocess.run(
        [sys.executable, "-c", "from pneuid.effects import CATALOGUE; print(' '.join(CATALOGUE))"],
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert found.stdout.split() == list(CATALOGUE)


def test_effects_by_name_sorts_into_port_order_and_takes_each_once():
    names = list(CATALOGUE)
    assert [effect.name for effect in effects_by_name(names[::-1])] == names
    assert effects_by_name([names[3], names[3]]) == (CATALOGUE[names[3]],)
    assert effects_by_name([]) == ()


def test_an_unknown_name_is_refused_in_one_line_that_lists_the_catalogue():
    with pytest.raises(UserError, match="leakage_internal") as caught:
        effects_by_name(["leakage"])
    assert "\n" not in str(caught.value) and "'leakage'" in str(caught.value)


def test_the_full_plant_holds_every_effect_on_every_kind_of_rig():
    for kind, stand in RIGS.items():
        chosen = [effect for effect in CATALOGUE.values() if kind in effect.rigs and "lugre" in effect.laws]
        plant = Plant(stand, "lugre", chosen)
        assert len(set(plant.parameter_names)) == len(plant.parameter_names)
        assert all(plant.owner[name] == effect.name for effect in chosen for name in plant.own_parameters(effect.name))
        assert len(plant.parameters) == sum(len(plant.own_parameters(e.name)) for e in chosen) + (
            8 if kind == "servo" else 6
        )
