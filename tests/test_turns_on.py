"""The signals by which what an effect's form lacks can differ from it."""

from __future__ import annotations

import pytest
from helpers import rig

from pneuid.criticism.decision.turns_on import own_signals
from pneuid.effects import CATALOGUE
from pneuid.plant import Plant


@pytest.mark.parametrize(
    ("kind", "name", "equation", "signals"),
    [
        ("servo", "load_spring", "force", {"x"}), ("bench", "load_spring", "force", {"x"}),
        ("servo", "gravity", "force", set()), ("servo", "load_mass", "force", {"x", "v", "p1", "p2"}),
        ("bench", "friction_pressure", "friction", {"p1", "p2", "v"}), ("bench", "friction_direction", "friction", {"v"}),
        ("servo", "leakage_internal", "flow_1", {"p1", "p2"}), ("servo", "leakage_external_1", "flow_2", set()),
        ("servo", "valve_curve", "valve", {"u"}), ("servo", "valve_flow_force", "valve", {"u", "p1", "p2", "psup"}),
        ("servo", "dead_volume", "pressure_1", None), ("bench", "gravity", "valve", None),
    ],
)  # fmt: skip
def test_an_effect_turns_an_equation_on_what_its_parameters_bring_in(kind, name, equation, signals):
    base, plant = Plant(rig(kind), "lugre"), Plant(rig(kind), "lugre", [CATALOGUE[name]])
    assert own_signals(plant, base, equation) == signals


def test_a_model_with_no_parameter_more_brings_nothing_in():
    plant = Plant(rig(), "lugre")
    assert own_signals(plant, plant, "force") == set()


def test_what_the_standing_effects_turn_on_is_not_a_new_ones_own():
    spring = Plant(rig(), "lugre", [CATALOGUE["load_spring"]])
    both = Plant(rig(), "lugre", [CATALOGUE["load_spring"], CATALOGUE["gravity"]])
    assert own_signals(both, spring, "force") == set()
