"""The parts of the controllers: inverse valve, observer, horizon, model plant, tuning."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers import loop
from controllers.conditions import scaled
from controllers.control_model import ControlModel
from controllers.horizon import build_horizon
from controllers.inplace import InPlace
from controllers.inverse_valve import InverseValve
from controllers.model_plant import ModelPlant
from controllers.nominal import nominal_model, rig_of
from controllers.pid import Pid
from controllers.references import Sine, Steps
from controllers.registry import CONTROLLERS, build
from controllers.tuning import (
    BANDWIDTH_FACTORS,
    Design,
    Trial,
    authority,
    cascade_bandwidth,
    default_bandwidth,
    pid_gains,
    refine_bandwidth,
    refine_gains,
)
from pneuid.effects import effects_by_name
from pneuid.plant import Plant
from pneuid.rig import Rig
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.servo import ServoPlant
from pneuid.virtual_rig.truth import TruthServo

TRUTH = TruthServo()
SUPPLY = TRUTH.patm + 5e5
RANGES = {"p1_low": 0.0, "p1_high": 1e8, "p2_low": 0.0, "p2_high": 1e8, "x_low": 0.0, "x_high": 0.5}


def model_with(names, **values):
    seal = TRUTH.friction
    plant = Plant(rig_of(TRUTH), "lugre", effects_by_name(names))
    known = {name: getattr(seal, name) for name in ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")}
    known |= {"n": TRUTH.polytropic, "C": TRUTH.conductance} | values
    return ControlModel(plant, plant.theta(plant.starts() | known, RANGES))


BASE = model_with([])
VALVES = {
    "base": InverseValve(BASE, 2e-3),
    "dead zone, leak, droop": InverseValve(
        model_with(["valve_dead_zone", "leakage_internal", "supply_droop"], dead_zone=0.05, r_supply=0.1), 2e-3
    ),
}


# --- the model ---


def test_mass_is_read_from_the_composed_plant():
    assert BASE.mass == pytest.approx(TRUTH.mass, rel=1e-9)
    assert model_with(["load_mass"], mass=3.7).mass == pytest.approx(3.7, rel=1e-9)


def test_a_bench_has_no_valve_to_command():
    plant = Plant(Rig.from_dict({"kind": "bench", "load": {"mass": "1 kg"}}), "lugre")
    with pytest.raises(ValueError, match="servo rig"):
        ControlModel(plant, np.zeros(len(plant.theta_names)))


def test_theta_of_another_plant_is_refused():
    with pytest.raises(ValueError, match="values"):
        ControlModel(BASE.plant, BASE.theta[1:])


def test_arrays_of_another_size_are_refused():
    x = ca.SX.sym("x", 3)
    with pytest.raises(ValueError, match="sizes"):
        InPlace(ca.Function("test_square", [x], [x**2]), (np.zeros(2),), (np.zeros(3),))


def test_a_call_in_place_reads_and_writes():
    x = ca.SX.sym("x", 3)
    given_, found = np.array([1.0, 2.0, 3.0]), np.zeros(3)
    call = InPlace(ca.Function("test_square", [x], [x**2]), (given_,), (found,))
    call()
    given_[0] = 5.0
    call()
    assert found.tolist() == [25.0, 4.0, 9.0]


# --- inverse valve ---

states = st.tuples(
    st.floats(0.02, 0.48), st.floats(-1.0, 1.0), st.floats(1.1e5, 0.97 * SUPPLY), st.floats(1.1e5, 0.97 * SUPPLY)
)


def full_state(valve, x, v, p1, p2):
    s = valve.model.rest(x, p1, p2)
    s[1] = v
    return s


@pytest.mark.parametrize("name", list(VALVES))
@given(states, st.floats(-10.0, 10.0))
def test_the_inverse_inverts_the_composed_flow(name, state, u):
    valve = VALVES[name]
    s = full_state(valve, *state)
    wanted = valve.forward(s, u, SUPPLY)
    # 0.08 mV of command, at the steepest about 1 kN/(s V)
    assert valve.forward(s, valve(wanted, s, SUPPLY), SUPPLY) == pytest.approx(wanted, abs=0.5)


@pytest.mark.parametrize("name", list(VALVES))
@given(states, st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=6))
def test_the_map_rises_with_the_command(name, state, commands):
    valve = VALVES[name]
    s = full_state(valve, *state)
    rates = [valve.forward(s, u, SUPPLY) for u in sorted(commands)]
    assert np.all(np.diff(rates) >= -1e-6)


@pytest.mark.parametrize(("wanted", "limit"), [(1e9, 10.0), (-1e9, -10.0)])
def test_out_of_reach_is_a_limit(wanted, limit):
    valve = VALVES["base"]
    assert valve(wanted, BASE.rest(0.25, 4e5, 4e5), SUPPLY) == pytest.approx(limit, abs=1e-3)


# --- observer ---


def test_the_observer_knows_the_state_of_a_plant_it_models():
    """Without noise, on its own model, with all friction believed: position, speed and pressures one sample ahead."""
    servo = build("servo", BASE, Design(SUPPLY, alpha=1.0), refined=False)
    plant, reference = ModelPlant(BASE), Sine("sine", 0.25, 1.0, 0.05, 1.0, 0.3)
    run = loop.run(servo, plant, reference, SUPPLY, seed=None)
    estimate = servo.memory[: BASE.states]
    # the memory is the prediction for the sample after the last one: where the plant stands now
    assert estimate[0] == pytest.approx(plant.array[0], abs=2e-7)
    assert estimate[1] == pytest.approx(plant.array[1], abs=2e-4)
    np.testing.assert_allclose(estimate[2:4], plant.array[2:4], rtol=1e-4)
    assert np.all(np.isfinite(run.u))


def test_the_residual_is_the_force_that_the_model_does_not_know():
    loaded = model_with(["gravity"], F_g=8.0)
    servo = build("cascade_eso", BASE, Design(SUPPLY, hold=0.0), refined=False)
    plant = ModelPlant(loaded)
    # slow enough for the observer, all of friction and the load are residual
    loop.run(servo, plant, Steps("move", 0.2, 0.45, (0.1,), 1.0, 0.2), SUPPLY, seed=None)
    seal = TRUTH.friction
    speed = plant.array[1]
    expected = 8.0 + seal.Fc + (seal.Fs - seal.Fc) * np.exp(-((speed / seal.vs) ** 2)) + seal.sigma2 * speed
    assert servo.memory[BASE.states] == pytest.approx(expected, rel=0.05)


def test_the_share_of_friction_is_learned_up_and_down():
    light = replace(TRUTH, friction=scaled(TRUTH.friction, 0.7))
    heavy = replace(TRUTH, friction=scaled(TRUTH.friction, 1.2))
    learned = {}
    for label, truth in (("lighter", light), ("right", TRUTH), ("heavier", heavy)):
        servo = build("servo", BASE, Design(SUPPLY), refined=False)
        loop.run(servo, ServoPlant(truth), Sine("sine", 0.25, 2.0, 0.05, 1.0, 0.5), SUPPLY, seed=1)
        learned[label] = servo.gains.alpha + servo.memory[BASE.states + 1]
    assert learned["right"] == pytest.approx(1.0, abs=0.05)
    assert learned["lighter"] == pytest.approx(0.7, abs=0.1)
    assert learned["heavier"] == pytest.approx(1.2, abs=0.1)


# --- horizon ---


def test_stage_derivatives_are_those_of_the_stage():
    h = build_horizon(BASE, 4, 2e-3)
    rng = np.random.default_rng(0)
    s = np.array([0.25, 0.2, 4e5, 4.5e5, 2.0]) / h.scale * rng.uniform(0.9, 1.1, (4, 5))
    du, force = rng.uniform(-0.5, 0.5, 4), rng.uniform(-20.0, 20.0, 4)

    def after(states, changes):
        return h.dynamics(states.T, changes, force, SUPPLY, BASE.theta)[0].full().T

    _, A, B = (value.full() for value in h.dynamics(s.T, du, force, SUPPLY, BASE.theta))
    step = 1e-4
    for j in range(5):
        moved = np.zeros(5)
        moved[j] = step
        slope = (after(s + moved, du) - after(s - moved, du)) / (2 * step)
        # limited by the difference step
        np.testing.assert_allclose(A.reshape(5, 4, 5)[:, :, j].T, slope, rtol=1e-5, atol=1e-6)
    slope = (after(s, du + step) - after(s, du - step)) / (2 * step)
    np.testing.assert_allclose(B.T, slope, rtol=1e-5, atol=1e-6)


def test_friction_ahead_starts_at_the_bristle_and_ends_on_the_steady_curve():
    """A reversal: the bristle is still bent the other way when the reference already moves."""
    h = build_horizon(BASE, 40, 2e-3)
    seal, speed = TRUTH.friction, 0.005
    x, pressures = 0.2 + 2e-3 * speed * np.arange(41), 4e5 * np.ones(40)
    bent, none = -seal.Fc / seal.sigma0, np.zeros((0, 40))
    found = h.friction(bent, x, np.full(41, speed), pressures, pressures, none, 1.0, 5.0, BASE.theta)
    force = found.full().ravel() - 5.0
    steady = seal.Fc + (seal.Fs - seal.Fc) * np.exp(-((speed / seal.vs) ** 2)) + seal.sigma2 * speed
    assert force[0] < 0.0
    assert force[-1] == pytest.approx(steady, rel=1e-3)


# --- tuning, on the model alone ---


def test_authority_is_linear_where_the_valve_is_sonic():
    low, high = authority(BASE, TRUTH.patm + 5e5), authority(BASE, TRUTH.patm + 7e5)
    assert high.gain > low.gain and high.stiffness > low.stiffness
    # seven bar gauge against five: absolute pressures scale by 8/6 and the flow with them
    assert high.gain / low.gain == pytest.approx(8.0 / 6.0, rel=0.03)


def test_a_slower_sample_time_means_a_lower_bandwidth():
    assert default_bandwidth(BASE, SUPPLY, 4e-3) < default_bandwidth(BASE, SUPPLY, 1e-3)


@pytest.mark.parametrize(
    ("effect", "delay"),
    [("valve_lag", {"tau_valve": 4e-3}), ("line_delay", {"tau_line": 2e-3, "damping_line": 1.0, "surge_line": 0.0})],
)
def test_a_lag_delays_the_authority_and_leaves_its_size(effect, delay):
    """Taken at the instant of the command, a valve that follows late would seem to have no gain at all."""
    prompt, late = authority(BASE, SUPPLY), authority(model_with([effect], **delay), SUPPLY)
    assert late.gain == pytest.approx(prompt.gain, rel=0.02)
    assert late.fastest == pytest.approx(prompt.fastest, rel=0.02)
    assert prompt.delay == 0.0
    assert late.delay == pytest.approx(4e-3, rel=0.03)


def test_only_a_slow_valve_lowers_the_cascade_s_bandwidth():
    allowed = default_bandwidth(BASE, SUPPLY, 1e-3)
    fast, slow = (model_with(["valve_lag"], tau_valve=tau) for tau in (2e-3, 10e-3))
    assert cascade_bandwidth(BASE, SUPPLY, 1e-3) == allowed
    assert cascade_bandwidth(fast, SUPPLY, 1e-3) == pytest.approx(allowed, rel=1e-3)
    assert cascade_bandwidth(slow, SUPPLY, 1e-3) * 10e-3 == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(("lag", "most"), [(5e-3, 0.1e-3), (10e-3, 0.25e-3)])
def test_the_servo_follows_through_a_lag_it_knows(lag, most):
    """On a rig whose spool lags and slews no faster than half its full scale per lag."""
    known = model_with(["valve_lag"], tau_valve=lag, order_valve=0.0, slew_valve=0.5)
    servo = CONTROLLERS["servo"].build(known, Design(SUPPLY))
    plant = ServoPlant(TRUTH, Hidden(valve_lag=lag))
    track = Sine("sine", 0.25, 2.0, 0.05, 1.0, 0.5)
    found = loop.metrics(loop.run(servo, plant, track, SUPPLY, seed=1))
    assert found.rms < most


def test_refinement_never_worsens_and_repeats_exactly():
    design = Design(SUPPLY)
    found = []
    for _ in range(2):
        pid, trial = Pid(BASE, pid_gains(BASE, design), 1e-3), Trial(BASE, SUPPLY)
        before = trial.cost(pid)
        refine_gains(pid, ("proportional", "derivative"), trial, 8)
        assert trial.cost(pid) <= before
        found.append(pid.gains)
    assert found[0] == found[1]


def test_refining_the_bandwidth_keeps_the_pole_pattern():
    design = Design(SUPPLY)
    servo = CONTROLLERS["servo"].build(BASE, design)
    CONTROLLERS["servo"].refine(servo, BASE, design)
    w = servo.gains.damping / 2.0
    assert servo.gains.position == pytest.approx(w**2)
    assert servo.gains.integral == 0.0


@pytest.mark.parametrize(
    ("costs", "taken"),
    [((9, 7, 5, 4.0, 4.2, 11, 18), 1.45), ((9, 7, 5, 4.0, 4.5, 11, 18), 1.2), ((9, 8, 7, 6, 5, 4, 3), 2.1)],
    ids=["near equals", "one least", "the last"],
)
def test_of_bandwidths_that_cost_the_same_the_fastest_is_taken(costs, taken, monkeypatch):
    pid, trial = Pid(BASE, pid_gains(BASE, Design(SUPPLY)), 1e-3), Trial(BASE, SUPPLY)
    known = dict(zip(BANDWIDTH_FACTORS, costs, strict=True))

    def gains_at(factor):
        return replace(pid_gains(BASE, Design(SUPPLY)), proportional=factor)

    monkeypatch.setattr(trial, "cost", lambda controller: known[controller.gains.proportional])
    assert refine_bandwidth(pid, gains_at, trial) == taken
    assert pid.gains.proportional == taken


def test_the_model_plant_is_the_model():
    """One step equals the virtual rig's from the same state, up to the two integrators' errors."""
    own, other = ModelPlant(BASE), ServoPlant(TRUTH)
    for plant in (own, other):
        plant.reset(0.2, SUPPLY)
        for u in (3.0, 3.0, -1.0, 0.5) * 20:
            plant.step(u, 1e-3)
    assert own.array[0] == pytest.approx(other.array[0], abs=2e-6)
    assert own.measure()["p1"] == pytest.approx(other.state["p1"], rel=1e-3)


def test_a_delayed_model_plant_is_late_by_the_delay():
    prompt, late = ModelPlant(BASE), ModelPlant(BASE, delay=3e-3)
    for plant in (prompt, late):
        plant.reset(0.2, SUPPLY)
    for _ in range(3):
        late.step(5.0, 1e-3)
    for _ in range(10):
        prompt.step(5.0, 1e-3)
        late.step(5.0, 1e-3)
    # while it waits the rounded valve, closed, still leaks a little
    np.testing.assert_allclose(late.array, prompt.array, rtol=1e-5, atol=1e-9)


def test_nominal_model_holds_the_rig_numbers():
    plant, theta = nominal_model(TRUTH)
    known = dict(zip(plant.theta_names, theta, strict=True))
    assert known["A1"] == pytest.approx(TRUTH.area_1) and known["A2"] == pytest.approx(TRUTH.area_2)
    assert known["V01"] == pytest.approx(TRUTH.dead_volume_1)
    assert (known["Fc"], known["C"], known["n"]) == (TRUTH.friction.Fc, TRUTH.conductance, TRUTH.polytropic)
