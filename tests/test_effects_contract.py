"""One suite for every effect of the catalogue, on every kind of rig it names and with every friction law; and the registry.

A new effect is tested by its line in the registry alone.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from contract_checks import CHECKS
from contract_points import RIGS, Case

from pneuid.effects import CATALOGUE, LAW_STEPS, effects_by_name
from pneuid.errors import UserError
from pneuid.physics.friction import LAWS
from pneuid.plant import Plant

CASES = [
    pytest.param(Case(effect, RIGS[kind], LAWS[law]), id=f"{effect.name}-{kind}-{law}")
    for effect in [*CATALOGUE.values(), *LAW_STEPS.values()]
    for kind in effect.rigs
    for law in effect.laws
    # what does not touch friction is tested beside one friction law
    if effect.equation == "friction" or law == ("lugre" if "lugre" in effect.laws else effect.laws[0])
]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_every_effect_keeps_the_contract(check, case):
    check(case)


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
