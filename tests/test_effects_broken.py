"""Negative controls of the contract: an honest effect passes every check, which refuses one broken in its way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import pytest
from contract_checks import (
    CHECKS,
    check_amplitudes_are_felt,
    check_constraints_hold_at_the_start,
    check_derivatives,
    check_enters_where_it_says,
    check_finite,
    check_guarantees,
    check_names,
    check_numbers_equal_symbols,
    check_off_is_absent,
    check_off_is_absent_in_company,
    check_parameters,
    check_states,
    check_words,
)
from contract_points import RIGS, Case

from pneuid.effect import Constraint, Effect, Parameter, State
from pneuid.errors import UserError
from pneuid.physics.friction import LAWS, FrictionLaw
from pneuid.rig import Rig


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
