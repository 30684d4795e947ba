"""The pre-sliding memory's Maxwell elements against closed forms, on the bench."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from helpers import rig
from hypothesis import given, settings
from hypothesis import strategies as some
from operating import at
from test_effects_friction import moved, plant_with

from pneuid.effects import CATALOGUE
from pneuid.plant import Plant

ELEMENT = {
    "w_element": 10.0, "d_element": 1e-4, "c_element": 0.0, "Fc": 1.0, "Fs": 1.0, "sigma0": 1e-6, "sigma1": 0.0, "sigma2": 0.0,
}  # fmt: skip
"""One element of 10 N, and a bristle too soft to be felt."""


def element_force(places: list[float], speed: float = 1e-3, changes: dict[str, float] | None = None) -> tuple:
    """Position and friction force along straight moves between ``places`` in m, starting at 0."""
    h = 2e-6 / speed
    corners = np.concatenate([[0.0], places])
    v = np.concatenate(
        [np.full(max(round(abs(b - a) / 2e-6), 1), np.sign(b - a) * speed) for a, b in pairwise(corners)]
    )
    v = np.append(v, v[-1])
    force, _ = moved(plant_with("friction_presliding_memory"), v, h, ELEMENT | (changes or {}))
    # between samples the speed is linear, so a reversal takes one sample
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * h)])
    return x, force


def test_the_element_is_elastic_then_slips_at_its_break_force():
    x, force = element_force([4e-4])
    k = 10.0 / 1e-4
    assert force[20] == pytest.approx(k * x[20], rel=1e-3)
    assert force[-1] == pytest.approx(10.0, rel=0.01)
    # rounded at the corner alone
    assert np.all(force <= np.minimum(k * x, 10.0) + 0.15)
    assert np.all(force >= np.minimum(k * x, 10.0) - 0.9)


def test_two_elements_break_one_after_the_other_and_add_to_the_break_force():
    shares = {"c_element": 0.4, "r_element": 3.0}
    x, force = element_force([8e-4], changes=shares)
    between = int(np.argmax(x > 2e-4))
    assert force[20] == pytest.approx((0.6 / 1e-4 + 0.4 / 3e-4) * 10.0 * x[20], rel=1e-3)
    assert force[between] == pytest.approx(0.6 * 10.0 + 0.4 * 10.0 * x[between] / 3e-4, rel=0.01), "the second still sticks"
    assert force[-1] == pytest.approx(10.0, rel=0.01)


def test_what_presses_the_seal_raises_the_break_force_of_the_elements():
    plant = Plant(rig(), "lugre", [CATALOGUE["friction_pressure"], CATALOGUE["friction_presliding_memory"]])
    values = {"Fc": 10.0, "Fs": 10.0, "k1": 4e-5, "k2": 0.0, "w_element": 0.5, "d_element": 1e-4, "r_element": 4.0}
    broken = {"z": 0.0, "v": 0.0, "z_element": 1e-4, "z_second": 4e-4}
    # without the bristle's own rate, which is nought at rest
    low, high = (float(at(plant, broken | {"p1": p1}, values).friction) for p1 in (3.0e5, 5.0e5))
    assert high - low == pytest.approx(0.5 * 4e-5 * 2e5, rel=1e-6)


def test_branches_are_the_doubled_virgin_curve_and_close_at_the_turning_point():
    virgin_x, virgin = element_force([3e-4])
    x, force = element_force([3e-4, -3e-4, 3e-4])
    turn = int(np.argmax(x[: x.size // 2]))
    down = slice(turn + 1, int(np.argmin(x)))
    # Masing: F(x) = F_turn - 2 virgin((x_turn - x) / 2); the corner of this rounded element is not doubled
    expected = force[turn] - 2 * np.interp(0.5 * (x[turn] - x[down]), virgin_x, virgin)
    assert np.abs(force[down] - expected).max() < 0.1 * 10.0
    assert np.sqrt(np.mean((force[down] - expected) ** 2)) < 0.03 * 10.0
    assert force[-1] == pytest.approx(force[turn], rel=2e-3)


def test_an_inner_loop_returns_to_the_point_it_left():
    # sticking memory beyond the last reversal: a small loop leaves no trace
    x, force = element_force([6e-5, 3e-5, 6e-5, 2e-4])
    plain_x, plain = element_force([2e-4])
    after = x > 7e-5
    assert np.abs(force[after] - np.interp(x[after], plain_x, plain)).max() < 0.02 * 10.0


def test_the_element_does_not_depend_on_the_speed_or_the_step():
    _, slow = element_force([3e-4, -1e-4, 2e-4], speed=1e-4)
    _, fast = element_force([3e-4, -1e-4, 2e-4], speed=1e-2)
    np.testing.assert_allclose(slow, fast, atol=0.02 * 10.0)
    # one coarse step over many break displacements ends at the break force, not beyond
    force, _ = moved(plant_with("friction_presliding_memory"), np.full(60, 0.5), 1e-3, ELEMENT)
    assert force[30:] == pytest.approx(10.0, rel=0.01)


@settings(max_examples=25, deadline=None)
@given(some.lists(some.floats(-4e-4, 4e-4), min_size=1, max_size=5), some.floats(2e-5, 2e-4))
def test_from_rest_the_element_only_takes_energy(places, d):
    x, force = element_force([round(place / 2e-6) * 2e-6 + 1e-6 for place in places], changes={"d_element": d})
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x))])
    assert work.min() >= -1e-9 * 10.0
