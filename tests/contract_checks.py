"""What every effect has to keep: one check a promise, each of which raises ``AssertionError`` on an effect that breaks it.

A check takes an effect, a rig and a friction law.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from contract_points import (
    POINTS,
    Case,
    company_of,
    drawn,
    names_of,
    operating_point,
    points_of,
    probe,
    stages_of,
    switched_off,
)
from helpers import RANGES, off_values

from pneuid.effect import EQUATIONS, Effect
from pneuid.effects import CATALOGUE
from pneuid.plant import Plant
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
    plant = case.plant(company_of(case))
    names = names_of(plant)
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
    y = ca.SX.sym("y", len(names_of(plant)))
    parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(names_of(plant))])
    relaxing = plant.evaluate(*parts).relaxing[1:]
    assert len(relaxing) == len(case.effect.states), "a state without a relaxation"
    decays = ca.Function(
        "decays", [y], [ca.vertcat(*(decay for _, decay in relaxing)), ca.vertcat(*(a for a, _ in relaxing))]
    )
    for point in points_of(case, plant, wide=True):
        decay, source = decays([point[name] for name in names_of(plant)])
        assert np.all(np.asarray(decay) > 0.0) and np.all(np.isfinite(np.asarray(source))), "a state that runs away"


def _assert_absent(case: Case, company: Sequence[Effect]) -> None:
    plant, bare = case.plant(company), case.plant(company, without=True)
    rng = np.random.default_rng(5)
    points = []
    for _ in range(POINTS):
        point = operating_point(plant, rng)
        for effect in plant.effects:
            point |= drawn(effect, plant, rng)
        points.append(switched_off(case, plant, point))
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
    _assert_absent(case, company_of(case))


def check_amplitudes_are_felt(case: Case) -> None:
    """At the off-values every amplitude moves something, or screening could never see it."""
    plant = case.plant()
    points = [switched_off(case, plant, point) for point in points_of(case, plant, seed=3, count=40)]
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
    points = points_of(case, plant, seed=7, count=6)
    names = [*plant.states, *(f"input {name}" for name in plant.inputs), *plant.parameter_names]
    exact = found.slopes(points, names)
    scale = np.abs(exact).max(axis=2)
    # an edge that is closed, maybe at every point, is the difference of numbers as large as one that is open
    open_edge = [float(label.startswith("valve")) for label in found.labels]
    size = np.maximum(np.abs(found.values(points)).max(axis=1), open_edge)
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
    for point in points_of(case, plant, seed=2, count=2):
        for base in (point, switched_off(case, plant, point)):
            for odd in [*awkward, {name: value for one in awkward[:5] for name, value in one.items()}]:
                at = base | {name: value for name, value in odd.items() if name in base}
                assert np.all(np.isfinite(found.values([at]))), f"value not finite at {odd}"
                assert np.all(np.isfinite(found.slopes([at], found.names))), f"derivative not finite at {odd}"


def check_numbers_equal_symbols(case: Case) -> None:
    """The one contribution serves floats and symbols alike."""
    plant = case.plant()
    found = probe(plant)
    for point in points_of(case, plant, count=3):
        s = [point[name] for name in plant.states]
        w = [point[f"input {name}"] for name in plant.inputs]
        theta = [point[name] for name in plant.theta_names]
        plain = [float(item) for items in stages_of(plant, s, w, theta).values() for item in items]
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
    points = points_of(case, plant, seed=13, count=40)
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
    y = ca.SX.sym("y", len(names_of(plant)))
    parts = ca.vertsplit(y, [0, len(plant.states), len(plant.states) + len(plant.inputs), len(names_of(plant))])
    targets = [source / decay for source, decay in plant.evaluate(*parts).relaxing]
    function = ca.Function("targets", [y], [ca.vertcat(*targets)])
    names = ["z", *(own.name for own in plant.effect_states)]
    for point in points:
        # the bristle last and alone: a state that feeds back on its own target may still be on its way
        for moved in [names] * (20 if plant.effect_states else 0) + [["z"]]:
            settled = np.asarray(function([point[name] for name in names_of(plant)])).ravel()
            point |= dict(zip(moved, settled.tolist(), strict=False))


def check_guarantees(case: Case) -> None:
    """What it promises holds up to its bounds; seals take power out of the motion whether promised or not."""
    plant = case.plant()
    points = points_of(case, plant, seed=17, wide=True, count=40)
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
