"""References, metrics, scenario files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers import loop
from controllers.conditions import Played
from controllers.references import Ramp, Sine, Smooth, Steps
from controllers.scenario import read_scenario
from pneuid.errors import UserError
from pneuid.resources import scenario_path
from pneuid.virtual_rig.hidden import NOTHING

REFERENCES = [
    Steps("steps", 0.1, 3.0, (0.1, 0.101, -0.02), 0.9, 0.4),
    Sine("sine", 0.25, 2.0, 0.05, 1.0, 0.4),
    Ramp("ramp", 0.25, 2.0, 0.005, 0.3, 0.1),
    Smooth("random", 0.25, 2.0, 0.05, 1.5, 0.4, seed=3),
]


# --- references ---


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda reference: reference.name)
def test_each_column_is_the_derivative_of_the_one_before(reference):
    step = 1e-5
    t = np.linspace(0.013, reference.duration - 0.017, 400)
    before, here, after = (reference.samples(t + shift) for shift in (-step, 0.0, step))
    for column in range(3):
        slope = (after[:, column] - before[:, column]) / (2 * step)
        largest = np.max(np.abs(here[:, column + 1])) + 1e-12
        # second differences of the next derivative, and rounding of the position over the step
        np.testing.assert_allclose(slope, here[:, column + 1], atol=2e-3 * largest)


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda reference: reference.name)
def test_a_reference_starts_at_rest_at_its_centre(reference):
    np.testing.assert_allclose(reference.samples(np.array([0.0]))[0, :3], [reference.centre, 0.0, 0.0], atol=1e-12)


def test_steps_arrive_and_keep_the_top_speed():
    reference = REFERENCES[0]
    track = reference.over(1e-3)
    for i, target in enumerate(reference.targets):
        assert track[round((i + 1) * 0.9 / 1e-3) - 1, 0] == pytest.approx(reference.centre + target, abs=1e-9)
    assert np.max(np.abs(track[:, 1])) <= 0.4 * (1 + 1e-9)


def test_the_random_track_is_its_seed():
    again, other = replace(REFERENCES[3]), replace(REFERENCES[3], seed=4)
    np.testing.assert_array_equal(REFERENCES[3].over(0.01), again.over(0.01))
    assert np.max(np.abs(REFERENCES[3].over(0.01) - other.over(0.01))) > 1e-3
    assert np.max(np.abs(REFERENCES[3].over(1e-3)[:, 0] - 0.25)) <= 0.05 * 1.001


# --- metrics ---


def test_metrics_of_a_known_run():
    T, count = 1e-3, 2000
    reference = np.zeros((count, 4))
    reference[:1000, 1] = 1.0
    x = np.full(count, -1e-3)
    x[1000:] = 20e-6 + 5e-6 * np.sin(0.1 * np.arange(1000))
    u = np.tile([0.0, 1.0], 1000)
    found = loop.metrics(loop.Run(T * np.arange(count), reference, x, u, np.full(count, 1e-5)))
    assert found.peak == pytest.approx(1e-3)
    assert found.rms == pytest.approx(np.sqrt(0.5 * (1e-6 + (20e-6) ** 2)), rel=1e-3)
    assert found.worst_steady == pytest.approx(20e-6, rel=0.02)
    assert found.wander == pytest.approx(10e-6, rel=0.01)
    assert found.travel == pytest.approx(1000.0, rel=1e-3)
    assert found.step_median == 1e-5


def test_a_run_without_a_dwell_has_no_steady_figures():
    count = 100
    reference = np.ones((count, 4))
    run = loop.Run(1e-3 * np.arange(count), reference, np.ones(count), np.zeros(count), np.ones(count))
    found = loop.metrics(run)
    assert np.isnan(found.steady) and np.isnan(found.worst_steady) and np.isnan(found.wander)


# --- scenario files ---

SMALL = """
title = "small"
controllers = ["pid"]
supplies = ["5 bar"]
[design]
supply = "5 bar"
refine = false
[[references]]
name = "sine"
kind = "sine"
centre = "250 mm"
amplitude = "20 mm"
frequency = "1 Hz"
fade = "0.2 s"
duration = "0.4 s"
"""


def written(tmp_path, text):
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_grid_loads():
    scenario, truth, hidden = read_scenario(scenario_path("pressure_grid.toml"))
    assert [round((p - truth.patm) / 1e5) for p in scenario.supplies] == [3, 5, 7]
    assert [own.name for own in scenario.references] == [
        "steps", "sine 1 Hz", "sine 0.5 Hz", "ramp 1 mm/s", "ramp 5 mm/s", "random"
    ]  # fmt: skip
    assert truth.friction.Fs_ps > 0.0 and hidden.load_mass == 0.0


def test_the_disturbances_hold_every_condition_that_is_asked():
    scenario, truth, hidden = read_scenario(scenario_path("disturbances.toml"))
    by_name = {own.name: Played(truth, hidden, scenario.sensors).under(own) for own in scenario.conditions}
    plain = by_name["as known"]
    assert plain == Played(truth, hidden, scenario.sensors)
    assert by_name["friction -30 %"].truth.friction.Fs_ps == pytest.approx(0.7 * truth.friction.Fs_ps)
    assert by_name["friction +30 %"].truth.friction.sigma0 == truth.friction.sigma0
    assert by_name["valve gain +15 %"].truth.conductance == pytest.approx(1.15 * truth.conductance)
    assert by_name["mass +50 %"].hidden.load_mass == pytest.approx(0.5 * truth.mass)
    assert by_name["noise 20 um"].sensors.x_noise == pytest.approx(20e-6)
    hidden_of = {
        "dead zone 5 %": "valve_dead_zone", "leak across the piston": "leakage_internal", "supply droop": "supply_droop",
        "exhaust back-pressure": "exhaust_restriction", "load +100 N": "gravity",
    }  # fmt: skip
    for name, effect in hidden_of.items():
        assert getattr(by_name[name].hidden, effect) > 0.0
    assert len(scenario.references) == 6 and len(scenario.seeds) == 3


def test_the_price_list_plays_each_effect_on_a_rig_of_its_own():
    scenario, _, hidden = read_scenario(scenario_path("price_list.toml"))
    assert scenario.models == "identified" and hidden == NOTHING
    assert [own.effect for own in scenario.prices] == [own.name for own in scenario.conditions]
    for price in scenario.prices:
        assert getattr(price.condition.hidden, price.effect) != 0.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('controllers = ["pid"]', 'controllers = ["lqr"]', "controllers.0"),
        ('supplies = ["5 bar"]', "supplies = [5]", "supplies.0"),
        ('amplitude = "20 mm"', 'amplitude = "20 bar"', "amplitude"),
        ('amplitude = "20 mm"', 'amplitude = "300 mm"', "the stroke is 500 mm"),
        ("refine = false", "refine = false\nspeed = 3", "design.speed"),
        ("[design]", "[truth.hidden]\nleakage = 0.1\n[design]", "truth.hidden.leakage"),
        ("[design]", "[truth.hidden]\nvalve_lag = -1.0\n[design]", "valve_lag"),
        ('title = "small"', 'title = "small', "not valid TOML"),
        ("[design]", '[[conditions]]\nname = "x"\nfriction = 0.0\n[design]', "conditions.0.friction"),
        ("[design]", '[[conditions]]\nname = "as known"\n[design]', "named twice"),
        ("[design]", '[[conditions]]\nname = "x"\nhidden = {encoder_bow = 1e-5}\n[design]', "acts in recordings only"),
        (
            "[design]",
            '[[prices]]\neffect = "gravity"\nhidden = {gravity = 5.0}\n[design]',
            'models.source = "identified"',
        ),
        ("[design]", '[[prices]]\neffect = "weather"\nhidden = {}\n[design]', "prices.0.effect"),
    ],
)
def test_a_wrong_scenario_is_refused_by_file_and_key(tmp_path, old, new, said):
    assert old in SMALL
    path = written(tmp_path, SMALL.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        read_scenario(path)
    assert str(path) in str(caught.value) and said in str(caught.value)


def test_a_missing_scenario_is_named(tmp_path):
    with pytest.raises(UserError, match="cannot read"):
        read_scenario(tmp_path / "absent.toml")
