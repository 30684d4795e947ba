"""Every controller of the registry through one suite, and what the good ones must reach on the independent rig."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers import loop
from controllers.base import Controller, Measurement
from controllers.conditions import scaled
from controllers.control_model import ControlModel
from controllers.nominal import nominal_model, rig_of
from controllers.references import Sine, Smooth, Steps
from controllers.registry import CONTROLLERS, build
from controllers.tuning import Design
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.plant import Plant
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.sensors import CONTROL_SENSORS
from pneuid.virtual_rig.servo import ServoPlant
from pneuid.virtual_rig.truth import TruthServo

TRUTH = TruthServo()
SEALS_2011 = replace(TRUTH, friction=FRICTION_2011)
FIVE_BAR = TRUTH.patm + 5e5
DESIGN = Design(FIVE_BAR)
SINE = Sine("sine", 0.25, 2.0, 0.05, 1.0, 0.5)
RANDOM = Smooth("random", 0.25, 2.5, 0.06, 1.5, 0.5, seed=3)
STEPS = Steps("steps", 0.2, 2.0, (0.05, 0.051), 1.0, 0.4)
FIRST_MOVE = Steps("first move", 0.15, 1.3, (0.01,), 1.2, 0.4)
REST = Steps("rest", 0.2, 1.2, (), 1.0, 0.4)

NAMES = list(CONTROLLERS)
MODELS = {"base": nominal_model(TRUTH), "2011": nominal_model(SEALS_2011)}


@pytest.fixture(scope="module")
def made():
    """Controllers with the formulas' gains by name and model, each built once."""
    built = {}

    def get(name, model="base"):
        if (name, model) not in built:
            built[name, model] = build(name, ControlModel(*MODELS[model]), DESIGN, refined=False)
        return built[name, model]

    return get


def track(controller, reference, rows=1):
    return reference.samples(controller.sample_time * np.arange(rows + controller.preview))


def at_rest(supply=FIVE_BAR, x=0.2):
    return Measurement(x, 4e5, 4.65e5, supply)


# --- contract ---


@pytest.mark.parametrize("name", NAMES)
def test_a_reset_gives_an_identical_repeat(name, made):
    controller, plant = made(name), ServoPlant(TRUTH)
    first = loop.run(controller, plant, STEPS, FIVE_BAR, seed=4)
    loop.run(controller, plant, RANDOM, FIVE_BAR + 2e5, seed=5)
    again = loop.run(controller, plant, STEPS, FIVE_BAR, seed=4)
    np.testing.assert_array_equal(first.u, again.u)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("fault", ["stuck", "nan", "infinite", "huge", "random", "vacuum"])
def test_nonsense_in_is_never_nonsense_out(name, fault, made):
    controller, rng = made(name), np.random.default_rng(1)
    rows = track(controller, SINE, 300)
    controller.reset(at_rest(x=0.25), rows[: controller.preview])
    broken = {
        "stuck": lambda: at_rest(x=0.25),
        "nan": lambda: Measurement(math.nan, math.nan, 4e5, math.nan),
        "infinite": lambda: Measurement(math.inf, -math.inf, math.inf, FIVE_BAR),
        "huge": lambda: Measurement(1e12, 1e15, -1e15, 1e15),
        "random": lambda: Measurement(*(rng.standard_normal(4) * (1.0, 1e6, 1e6, 1e6))),
        "vacuum": lambda: Measurement(0.25, 0.0, 0.0, 0.0),
    }[fault]
    commands = [controller.step(broken(), rows[k : k + controller.preview]) for k in range(300)]
    assert np.all(np.isfinite(commands))
    assert controller.lowest <= min(commands) and max(commands) <= controller.highest
    # and it recovers: the next run is as good as if nothing had happened
    controller.reset(at_rest(x=0.25), rows[: controller.preview])
    assert math.isfinite(controller.step(at_rest(x=0.25), rows[: controller.preview]))


@pytest.mark.parametrize("name", ["cascade", "servo", "nmpc"])
def test_estimates_stay_where_a_cylinder_can_be(name, made):
    controller, rng = made(name), np.random.default_rng(3)
    rows = track(controller, SINE, 200)
    controller.reset(at_rest(x=0.25), rows[: controller.preview])
    for k in range(200):
        wild = Measurement(rng.uniform(-50.0, 50.0), *rng.uniform(-1e7, 1e7, 2), FIVE_BAR)
        controller.step(wild, rows[k : k + controller.preview])
        x, v, p1, p2 = controller.memory[:4]
        assert abs(v) <= 20.0 and -0.005 <= x <= 0.505
        assert min(p1, p2) > 0.0 and max(p1, p2) <= 2.0 * FIVE_BAR


class Broken(Controller):
    """Commands NaN every other sample; counts its restarts."""

    name = "broken"
    starts = 0

    def retune(self, gains):
        self.gains = gains

    def _start(self, _):
        self.starts, self.samples = self.starts + 1, 0

    def _command(self, *_):
        self.samples += 1
        return 3.0 if self.samples % 2 else math.nan


def test_a_command_that_is_not_finite_closes_the_valve_and_restarts():
    controller = Broken(1e-3, -10.0, 10.0, 0.5)
    controller.reset(at_rest(), np.zeros((2, 4)))
    assert [controller.step(at_rest(), np.zeros((2, 4))) for _ in range(4)] == [3.0, 0.5, 3.0, 0.5]
    assert controller.starts == 3


class Probe:
    """A plant that stands still and notes what it is given."""

    def __init__(self):
        self.given, self.array = [], np.array([0.2])

    def reset(self, *_):
        self.given.clear()

    def step(self, u, _):
        self.given.append(u)

    def measure(self, _):
        return {"x": 0.2, "p1": 4e5, "p2": 4e5}


def test_a_command_acts_one_sample_after_the_measurement_it_answers():
    controller, plant = Broken(1e-3, -10.0, 10.0, 0.5), Probe()
    run = loop.run(controller, plant, replace(REST, duration=5e-3), FIVE_BAR, seed=None)
    assert plant.given == [0.5, 3.0, 0.5, 3.0, 0.5]
    assert run.u.tolist() == plant.given


@pytest.mark.parametrize("name", NAMES)
def test_it_holds_a_constant_reference_without_a_limit_cycle(name, made):
    found = loop.metrics(loop.run(made(name), ServoPlant(TRUTH), REST, FIVE_BAR, seed=2))
    assert found.peak < 100e-6
    assert found.wander < 100e-6


@pytest.mark.parametrize("name", NAMES)
def test_a_start_needs_finite_measurements_and_the_whole_preview(name, made):
    controller = made(name)
    rows = track(controller, SINE)[: controller.preview]
    with pytest.raises(ValueError, match="finite measurements"):
        controller.reset(Measurement(math.nan, 4e5, 4e5, FIVE_BAR), rows)
    with pytest.raises(ValueError, match="finite reference of shape"):
        controller.reset(at_rest(), rows[1:])


@pytest.mark.parametrize("name", NAMES)
def test_the_supply_it_is_told_is_the_supply_it_uses(name, made):
    """A told supply that changes the command shows that the model, not a table, decides; the PID has no model."""
    controller = made(name)
    rows = track(controller, SINE, 40)
    commands = {}
    for supply in (TRUTH.patm + 4.5e5, TRUTH.patm + 7e5):
        controller.reset(at_rest(supply, x=0.25), rows[: controller.preview])
        commands[supply] = [
            controller.step(at_rest(supply, x=0.25), rows[k : k + controller.preview]) for k in range(40)
        ]
    low, high = (float(np.sum(np.abs(values))) for values in commands.values())
    assert low == high if name == "pid" else high < low


def test_an_unknown_controller_is_named_with_the_known_ones():
    with pytest.raises(KeyError, match="cascade_eso"):
        build("lqr", ControlModel(*MODELS["base"]), DESIGN)


# --- what they reach ---


@pytest.mark.parametrize("bar", [3.0, 5.0, 7.0])
@pytest.mark.parametrize(("name", "limit"), [("servo", 0.2e-3), ("nmpc", 0.1e-3)])
def test_tracking_with_a_right_model(name, limit, bar, made):
    """The design's figures on a 1 Hz sine of 50 mm and the random track, friction after the 2011 laws."""
    plant, supply = ServoPlant(SEALS_2011), TRUTH.patm + bar * 1e5
    for reference in (SINE, RANDOM):
        assert loop.metrics(loop.run(made(name, "2011"), plant, reference, supply, seed=1)).rms < limit


@pytest.mark.parametrize("name", ["servo", "nmpc"])
def test_steady_state(name, made):
    found = loop.metrics(loop.run(made(name), ServoPlant(TRUTH), STEPS, FIVE_BAR, seed=1))
    assert found.worst_steady < 25e-6
    assert found.wander < 100e-6


@pytest.mark.parametrize("name", ["servo", "nmpc"])
@pytest.mark.parametrize(
    ("truth", "hidden"),
    [
        (replace(TRUTH, friction=replace(TRUTH.friction, Fc=8.4, Fs=14.0, sigma2=31.5)), Hidden()),
        (replace(TRUTH, friction=replace(TRUTH.friction, Fc=15.6, Fs=26.0, sigma2=58.5)), Hidden()),
        (replace(TRUTH, conductance=1.15 * TRUTH.conductance), Hidden()),
        (TRUTH, Hidden(load_mass=1.2, rolling_coefficient=0.0)),
        (TRUTH, Hidden(valve_lag=2.5e-3)),
    ],
    ids=["friction x0.7", "friction x1.3", "valve gain x1.15", "mass x1.5", "valve lag 2.5 ms"],
)
def test_no_limit_cycle_when_the_model_is_wrong(name, truth, hidden, made):
    found = loop.metrics(loop.run(made(name), ServoPlant(truth, hidden), STEPS, FIVE_BAR, seed=1))
    assert found.wander < 100e-6


@pytest.mark.parametrize("name", ["servo", "nmpc"])
@pytest.mark.parametrize(("share", "noise"), [(0.7, 2e-6), (1.0, 20e-6)], ids=["friction x0.7", "noise 20 um"])
def test_no_hunting_after_the_first_move(name, share, noise, made):
    """Friction is learned within the first move, a tenth of a second: what ``alpha`` holds back, or has too much, would
    let the axis stick and slip in the dwell after it."""
    plant = ServoPlant(
        replace(SEALS_2011, friction=scaled(FRICTION_2011, share)), sensors=replace(CONTROL_SENSORS, x_noise=noise)
    )
    for seed in (1, 2):
        assert loop.metrics(loop.run(made(name, "2011"), plant, FIRST_MOVE, FIVE_BAR, seed=seed)).wander < 100e-6


def test_a_plan_at_the_end_of_the_command_has_authority_whatever_its_last_digit(made):
    """The valve saturates at the bound itself: linearised there, rounding decides between full authority and none."""
    nmpc, far = made("nmpc"), Steps("far", 0.1, 1.0, (0.2,), 0.5, 20.0)
    ahead = track(nmpc, far, rows=20)[10:]
    gains, commands = [], []
    for last_digit in (-4e-16, 0.0, 4e-16):
        nmpc.reset(at_rest(x=0.1), ahead[: nmpc.preview])
        for k in range(6):
            nmpc._plan_x[:, -1] *= 1.0 + last_digit
            commands.append(nmpc.step(at_rest(x=0.1), ahead[k : k + nmpc.preview]))
        assert nmpc.iterations > 0
        gains.append(nmpc.program.B[:, 2:4].copy())
    assert np.all(np.abs(gains[1]).max(axis=1) > 0.0)
    np.testing.assert_allclose(gains[0], gains[1], rtol=1e-6)
    np.testing.assert_allclose(gains[2], gains[1], rtol=1e-6)
    np.testing.assert_allclose(np.reshape(commands, (3, 6)).std(axis=0), 0.0, atol=1e-6)


def test_pressure_laws_pay_where_the_supply_left_the_tuning_point(made):
    constant = build("nmpc", ControlModel(*nominal_model(SEALS_2011, frozen_at=FIVE_BAR)), DESIGN, refined=False)
    plant, supply = ServoPlant(SEALS_2011), TRUTH.patm + 7e5
    aware, plain = (
        loop.metrics(loop.run(controller, plant, RANDOM, supply, seed=1)).rms
        for controller in (made("nmpc", "2011"), constant)
    )
    assert aware < 0.7 * plain


# --- identified effects act without being named ---


def with_effects(names, **values):
    """The rig's own model with effects of the catalogue, at their start values unless stated."""
    _, base = MODELS["base"]
    plant = Plant(rig_of(TRUTH), "lugre", effects_by_name(names))
    known = dict(zip(MODELS["base"][0].theta_names, base, strict=True))
    parameters = plant.starts() | {name: known[name] for name in MODELS["base"][0].parameter_names} | values
    ranges = {name: known[name] for name in ("p1_low", "p1_high", "p2_low", "p2_high", "x_low", "x_high")}
    return plant, plant.theta(parameters, ranges)


@pytest.mark.parametrize("name", ["servo", "nmpc"])
def test_effects_that_are_off_change_nothing(name, made):
    """All of the catalogue at its off-values: the same commands, up to rounding that the loop's feedback amplifies."""
    names = tuple(own for own, effect in CATALOGUE.items() if "servo" in effect.rigs)
    every = build(name, ControlModel(*with_effects(names)), DESIGN, refined=False)
    runs = [
        loop.run(controller, ServoPlant(TRUTH), replace(SINE, duration=0.2), FIVE_BAR, seed=None)
        for controller in (made(name), every)
    ]
    # the inverse valve resolves 0.08 mV
    np.testing.assert_allclose(runs[0].u, runs[1].u, atol=2e-3)


@pytest.mark.parametrize("name", ["servo", "nmpc"])
def test_a_known_dead_zone_and_a_known_load_are_worth_knowing(name, made):
    """A spool overlap of 5 % and a pull of 15 N, in forms unlike the model's: no controller mentions either."""
    effects = with_effects(["valve_dead_zone", "gravity"], dead_zone=0.05, F_g=15.0)
    known = build(name, ControlModel(*effects), DESIGN, refined=False)
    plant = ServoPlant(TRUTH, Hidden(valve_dead_zone=0.05, gravity=15.0))
    after, before = (
        loop.metrics(loop.run(controller, plant, SINE, FIVE_BAR, seed=1)).rms for controller in (known, made(name))
    )
    assert after < 0.6 * before
