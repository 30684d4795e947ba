"""The model in python-control: the same motion, linear models that an independent rig agrees with, loop margins."""

from __future__ import annotations

import json
import re

import control
import helpers
import numpy as np
import pytest

from controllers.control_model import ControlModel
from controllers.export import linear, linearised, operating_point, to_control
from controllers.export.figures import bode_png, limit_cycle_png, loop_png
from controllers.export.io_system import passing_point
from controllers.export.limit_cycles import limit_cycle_map
from controllers.export.loop_gain import loop_margins, swept_sine
from controllers.export.pieces import tuned
from controllers.model_plant import ModelPlant
from controllers.tuning import Design
from pneuid.errors import ComputationError, UserError
from pneuid.model import nominal_model
from pneuid.virtual_rig import IDEAL_SENSORS, ServoPlant, TruthServo

SUPPLY = 6e5
CONTENT = nominal_model(helpers.rig(), helpers.TRUTH, helpers.RANGES)


@pytest.fixture(scope="module")
def model():
    return ControlModel(CONTENT.plant, CONTENT.theta())


@pytest.fixture(scope="module")
def found(model):
    return tuned(model, Design(SUPPLY), refined=False)


def test_the_nonlinear_system_moves_as_the_model(model):
    axis = to_control(CONTENT)
    assert axis.state_labels == list(CONTENT.plant.states)
    t = np.linspace(0.0, 0.05, 51)
    start = model.rest(0.2, 3e5, 3.5e5)
    given = np.vstack([np.full(t.size, 4.0), np.full(t.size, SUPPLY)])
    seen = control.input_output_response(
        axis, t, given, start, solve_ivp_method="BDF", solve_ivp_kwargs={"rtol": 1e-8, "atol": 1e-10}
    )
    plant = ModelPlant(model)
    plant.reset(0.2, SUPPLY)
    plant.array[:] = start
    for _ in t[1:]:
        plant.step(4.0, 1e-3)
    # the plant's fixed step is of second order: 1 um and 10 Pa in 50 ms
    np.testing.assert_allclose(seen.outputs[:2, -1], plant.array[:2], atol=2e-5)
    np.testing.assert_allclose(seen.outputs[2:, -1], plant.array[2:4], rtol=1e-3)


def test_parameters_of_a_simulation_are_the_models_by_name(model):
    axis = to_control(model)
    still = model.rest(0.25, 4e5, 4e5)
    plain, wide = (axis.dynamics(0.0, still, [5.0, SUPPLY], params) for params in ({}, {"C": 2.0 * model.value("C")}))
    assert wide[2] == pytest.approx(2.0 * plain[2])


def test_a_bench_model_is_refused():
    with pytest.raises(UserError, match="servo rig"):
        to_control(nominal_model(helpers.rig("bench"), {}, helpers.RANGES))


@pytest.mark.parametrize("speed", [0.1, -0.05])
def test_an_operating_point_stands_still_and_its_matrices_are_slopes(speed, model):
    point = operating_point(model, 0.2, SUPPLY, speed)
    axis, system = to_control(model), linearised(model, point)
    rates = axis.dynamics(0.0, point.state, [point.u, SUPPLY], {})
    assert rates[0] == pytest.approx(speed)
    np.testing.assert_allclose(rates[1:], 0.0, atol=0.5)  # m/s^2, Pa/s, Pa/s, m/s
    steps = np.array([1e-6, 1e-6, 1.0, 1.0, 1e-9])
    for j, h in enumerate(steps):
        beside = point.state + h * np.eye(5)[j]
        slope = (axis.dynamics(0.0, beside, [point.u, SUPPLY], {}) - rates) / h
        np.testing.assert_allclose(slope, system.A[:, j], rtol=1e-3, atol=1e-3 * np.abs(system.A[:, j]).max())


def test_a_speed_out_of_reach_is_said(model):
    with pytest.raises(ComputationError, match="cannot slide steadily at 5 m/s"):
        operating_point(model, 0.2, SUPPLY, 5.0)


@pytest.mark.parametrize("bar", [3.0, 7.0])
def test_a_swept_sine_on_the_independent_rig_agrees(bar, model):
    """Position and pressures per volt; the sine is small and short beside what makes the rig nonlinear."""
    supply = model.value("patm") + bar * 1e5
    point = operating_point(model, 0.25, supply, 0.1)
    rig = ServoPlant(TruthServo(), sensors=IDEAL_SENSORS)
    for answer in swept_sine(rig, 0.25, supply, point.u, 0.1, (8.0, 20.0), 1e-3):
        about = passing_point(model, answer.passed, point.u, supply)
        expected = np.asarray(linearised(model, about)(2j * np.pi * answer.frequency))[:, 0]
        for place, seen in ((0, answer.x), (2, answer.p1), (3, answer.p2)):
            assert abs(seen / expected[place] - 1.0) < 0.03


def test_margins_shrink_with_delay_and_tell_the_gain_that_is_too_much(model, found):
    plant = ModelPlant(model, x_noise=0.0, x_grid=1e-9, p_noise=0.0)
    frequencies = np.geomspace(10.0, 300.0, 10)
    margins = loop_margins(found.servo, plant, 0.25, SUPPLY, 0.1, 0.1, frequencies)
    assert margins.phase > 30.0
    assert 1.5 < margins.gain < 20.0
    late = ModelPlant(model, delay=2e-3, x_noise=0.0, x_grid=1e-9, p_noise=0.0)
    delayed = loop_margins(found.servo, late, 0.25, SUPPLY, 0.1, 0.1, frequencies)
    # 2 ms at the crossover, in degrees
    assert margins.phase - delayed.phase == pytest.approx(360.0 * 2e-3 * margins.crossover, abs=6.0)
    assert delayed.gain < margins.gain


def test_over_compensation_hunts_and_the_servo_is_left_as_it_was(found):
    before = found.servo.gains
    result = limit_cycle_map(found.servo, SUPPLY, (0.8, 1.0), (0.7,), 0.6)
    assert result.wander[0, 0] < 100e-6 < result.wander[1, 0]
    assert found.servo.gains == before


def test_the_bundle_is_whole(found, monkeypatch):
    monkeypatch.setattr(linear, "SWEPT", (20.0,))
    monkeypatch.setattr(linear, "LOOP", (20.0, 40.0, 200.0))
    monkeypatch.setattr(linear, "ALPHAS", (0.8,))
    monkeypatch.setattr(linear, "FACTORS", (1.0,))
    result = linear.linear_export(found, lambda _: None)
    content = json.loads(json.dumps(linear.as_json(result, found, "axis"), allow_nan=False))
    assert {(round(p["x"], 3), round(p["speed"], 3)) for p in content["operating_points"]} == {
        (x, v) for x in (0.1, 0.25, 0.4) for v in (0.1, -0.1)
    }
    assert np.shape(content["operating_points"][0]["A"]) == (5, 5)
    patm = found.model.value("patm")
    for picture in (bode_png(result.cases, patm), loop_png(result.loops, patm), limit_cycle_png(result.cycles)):
        assert picture.startswith(b"\x89PNG")
    report = linear.as_report(result, found, "axis")
    assert len(re.findall(r"^\| \d", report, flags=re.MULTILINE)) == 4  # three supplies, one alpha
