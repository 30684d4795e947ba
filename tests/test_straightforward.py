"""The frozen baseline solves the same problem as the product: a slower way to the same optimum."""

from __future__ import annotations

import numpy as np
import pytest
from compare_straightforward import RIG, TRUTH, synthetic
from straightforward_ipopt import INTERPRETED, solve_straightforward, whole_intervals

from pneuid.estimation.first_guess import first_guess, first_nodes, motions
from pneuid.estimation.fit import fit
from pneuid.estimation.preparation import data_ranges, noise_of, prepare
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant
from pneuid.rig import Rig


def test_baseline_and_product_meet_at_one_optimum():
    plant = Plant(Rig.from_dict(RIG), "lugre")
    recording, _ = synthetic(plant, 300, 1, TRUTH)
    product = fit(plant, [recording])
    runs = (prepare(recording, plant, noise_of(plant.rig, [recording])),)
    moved = motions(runs)
    guess = first_guess(plant, runs, moved)
    theta = plant.theta(guess, data_ranges([recording], plant), smoothing=FINE)
    nodes = first_nodes(plant, runs, moved, guess, INTERPRETED.samples)
    found = solve_straightforward(
        plant, theta, plant.parameter_names, runs[0].data, nodes, product.substeps, options=INTERPRETED
    )
    assert found["status"] in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert product.exact is not None
    # the product adds a weak prior on the first bristle state and stops at 1e-3 of the gradient
    assert 2 * found["cost"] / len(plant.outputs) == pytest.approx(2 * product.exact.cost / 900, rel=1e-4)
    # 300 samples leave vs and sigma1 a few per cent of standard error, the others less
    for name in ("Fc", "sigma2", "n", "C"):
        assert found["values"][name] == pytest.approx(TRUTH[name], rel=0.02)


def test_intervals_never_cross_a_run():
    plant = Plant(Rig.from_dict(RIG), "lugre")
    data = np.arange(11.0 * 60).reshape(11, 60)
    padded, linked = whole_intervals(plant, data, [33], 25)
    assert padded.shape == (11, 100)
    assert linked == [0, 2]
    np.testing.assert_array_equal(padded[-3:, 33:50], 0.0)
    np.testing.assert_array_equal(padded[:, 50:77], data[:, 33:])
