"""Tubes between valve and chambers against closed forms and an independent integrator (scipy)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import RANGES, march, rig, step_function, values_of
from hypothesis import given
from hypothesis import strategies as st
from operating import SERVO_POINT, at, followed, plant_with
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.signal import lti

from pneuid.physics.gas import RHO_REFERENCE
from pneuid.physics.lag import stiffly, vanishing_lag


@given(st.floats(0.0, 0.2), st.floats(1e-4, 1e-2))
def test_a_vanishing_lag_is_late_by_its_delay(delay, shortest):
    weight, time_constant = (float(item) for item in vanishing_lag(delay, shortest))
    assert weight * time_constant == pytest.approx(delay, rel=1e-12, abs=1e-18)
    assert 0.0 <= weight <= 1.0 and time_constant >= shortest
    if delay > 10 * shortest:
        assert weight > 0.99 and time_constant == pytest.approx(delay, rel=0.01)


@pytest.mark.parametrize("damping", [0.2, 0.7, 2.0])
def test_a_line_answers_as_textbooks_have_the_second_order_and_loses_nothing(damping):
    plant, T, h = plant_with("line_delay"), 20e-3, 5e-5
    alone = {"tau_line": T, "damping_line": damping, "surge_line": 0.0}
    t, arriving = followed(plant, lambda _: 6.0, alone, 0.5, h)
    valve, expected = at(plant_with(), {"u": 6.0}), lti(1.0, [T * T, 2.0 * damping * T, 1.0]).step(T=t)[1]
    for name, flow in (("mdot1", float(valve.mdot1)), ("mdot2", float(valve.mdot2))):
        # what the shortest time adds is of the size (1 ms / 20 ms)^2
        np.testing.assert_allclose(arriving[name] / flow, expected, atol=0.01)
    assert h * np.sum(1.0 - arriving["mdot1"] / float(valve.mdot1)) == pytest.approx(2.0 * damping * T, rel=0.02)


def test_a_line_of_little_damping_is_near_to_a_wave_that_comes_late_and_unchanged():
    plant, T, h = plant_with("line_delay"), 20e-3, 1e-4
    alone = {"tau_line": T, "damping_line": np.sqrt(0.5), "surge_line": 0.0}
    t, arriving = followed(plant, lambda _: 6.0, alone, 0.3, h)
    for name in ("mdot1", "mdot2"):
        share = np.diff(arriving[name], prepend=0.0) / arriving[name][-1]
        late = float(share @ t)
        assert late == pytest.approx(np.sqrt(2.0) * T, rel=0.02)
        # the second moment of the impulse response about its mean: none in a pure delay
        assert abs(float(share @ (t - late) ** 2)) < 0.03 * T**2


@pytest.mark.parametrize(("p1", "u"), [(1.2e5, 10.0), (5.0e5, 3.0), (5.0e5, -10.0)])
@pytest.mark.parametrize("longer", [1.0, 2.0])
def test_a_line_is_a_volume_and_the_inertia_of_its_air(p1, u, longer):
    """Against a section of tube without resistance: the pressure at the port and the flow out of it, integrated apart."""
    length, area, c, patm, supply = 4.0, 2e-5, 340.0, rig().patm, SERVO_POINT["psup"]
    full, opening = rig().conductance * RHO_REFERENCE * supply, abs(u) / rig().full_scale

    def valve(port):
        up, down = (supply, port) if u > 0 else (port, patm)
        beyond = max(down / up - rig().critical_ratio, 0.0) / (1.0 - rig().critical_ratio)
        return np.sign(u) * opening * full * up / supply * np.sqrt(max(1.0 - beyond**2, 0.0))

    def tube(_, y):
        port, q = y
        return [c**2 / (area * length) * (valve(port) - q), area / length * (port - p1)]

    ratio = np.sqrt(longer)  # of this tube to the mean of both
    surge, point = c * full / (area * supply), {"p1": p1, "psup": supply}
    shape = {"tau_line": length / c / ratio, "damping_line": 0.0, "lengths_line": longer, "surge_line": surge}
    shape["C"] = rig().conductance
    t, arriving = followed(plant_with("line_delay"), lambda _: u, shape, 0.08, 2e-5, point)
    expected = solve_ivp(tube, (0.0, t[-1]), [p1, 0.0], t_eval=t, rtol=1e-8, max_step=1e-4).y[1]
    # 1 ms, the shortest time, against the 12 ms of the tube
    np.testing.assert_allclose(arriving["mdot1"], expected, atol=0.03 * np.abs(expected).max())


@pytest.mark.parametrize("damping", [0.1, 2.0])
def test_a_short_line_is_late_by_twice_its_time_whatever_its_damping(damping):
    h, short = 2e-5, 1e-4
    values = {"tau_line": short, "damping_line": damping, "surge_line": 0.0}
    _, arriving = followed(plant_with("line_delay"), lambda _: 6.0, values, 0.05, h)
    assert h * np.sum(1.0 - arriving["mdot1"] / arriving["mdot1"][-1]) == pytest.approx(2.0 * short, rel=0.03)


@pytest.mark.parametrize("ratio", [0.5, 3.0])
def test_tubes_of_unlike_length_are_late_in_their_proportion(ratio):
    h, values = 5e-5, {"tau_line": 10e-3, "damping_line": 1.0, "surge_line": 0.0, "lengths_line": ratio}
    _, arriving = followed(plant_with("line_delay"), lambda _: 6.0, values, 0.3, h)
    late = [h * float(np.sum(1.0 - arriving[name] / arriving[name][-1])) for name in ("mdot1", "mdot2")]
    assert late[0] / late[1] == pytest.approx(ratio, rel=0.02)
    assert np.sqrt(late[0] * late[1]) == pytest.approx(20e-3, rel=0.02)


def test_a_line_of_much_damping_is_stable_at_a_step_of_its_time():
    values = {"tau_line": 1e-3, "damping_line": 4.0, "surge_line": 0.0}
    _, arriving = followed(plant_with("line_delay"), lambda _: 6.0, values, 0.1, 1e-3)
    flow = float(at(plant_with(), {"u": 6.0}).mdot1)
    assert np.all(np.diff(arriving["mdot1"]) > -1e-9 * flow) and arriving["mdot1"][-1] == pytest.approx(flow, rel=1e-3)


def test_a_stage_that_is_followed_stiffly_moves_as_fast_at_first():
    target, T = stiffly((3.0, 0.2), 1.0, 7.0)
    assert (target - 1.0) / T == pytest.approx((3.0 - 1.0) / 0.2) and pytest.approx(0.2 / 8.0) == T
    assert stiffly((3.0, 0.2), 1.0, -5.0) == (3.0, 0.2)


@pytest.mark.parametrize("b", [0.15, 0.3, 0.55])
@pytest.mark.parametrize("u", [10.0, 4.0, -10.0])
@pytest.mark.parametrize("r", [0.2, 4.0, 20.0])
@pytest.mark.parametrize(("p1", "p2"), [(1.2e5, 5.8e5), (2.5e5, 3.0e5), (5.8e5, 1.2e5), (6.5e5, 1.02e5)])
def test_valve_and_tube_let_the_same_flow_through(p1, p2, r, u, b):
    """Independent of the closed form: the pressure at the port is searched."""
    patm, supply, pressures = rig().patm, SERVO_POINT["psup"], {"p1": p1, "p2": p2}
    valve = replace(rig(), critical_ratio=b)
    with_it = at(plant_with("line_delay", on=valve), {"u": u} | pressures, {"r_line": r})
    without = at(plant_with(on=valve), {"u": u} | pressures)
    opening = abs(u) / rig().full_scale

    def edge(up, down):
        ratio = down / up
        return opening * up * np.sqrt(1 - max(ratio - b, 0.0) ** 2 / (1 - b) ** 2)

    for name, p, filling in (("mdot1", p1, u > 0), ("mdot2", p2, u < 0)):
        if filling:
            port = brentq(lambda q, p=p: edge(supply, q) ** 2 - (q**2 - p**2) / r, p, supply)
            expected = edge(supply, port) / edge(supply, p)
        else:
            port = brentq(lambda q, p=p: edge(q, patm) ** 2 - (p**2 - q**2) / r, patm, p)
            expected = edge(port, patm) / edge(p, patm)
        assert float(getattr(with_it, name)) / float(getattr(without, name)) == pytest.approx(expected, rel=4e-3), name


@pytest.mark.parametrize(("tau", "k"), [(0.5e-3, 0.5), (1e-3, 0.7), (1e-3, 1.0), (3e-3, 1.0)])
def test_a_chamber_that_a_tube_has_filled_is_quiet(tau, k):
    """At the time step that a record of 1 kHz gets, where the valve's curve is steep."""
    plant = plant_with("line_delay")
    own = {"tau_line": tau, "damping_line": 0.7, "surge_line": k, "lengths_line": 1.0, "r_line": 0.0}
    psup = SERVO_POINT["psup"]
    start = SERVO_POINT | dict.fromkeys((own.name for own in plant.effect_states), 0.0)
    start |= {"x": 0.02, "p1": psup - 2e3, "p2": rig().patm}
    theta = plant.theta(values_of(plant, own), RANGES, mass_run=1e9)
    state = np.array([start[name] for name in plant.states])
    found = march(step_function(plant), state, np.array([10.0, psup]), np.zeros(2), 0.5e-3, 1200, theta)
    # sensors of pressure have 200 to 500 Pa of noise
    assert np.ptp(found[plant.states.index("p1"), -400:]) < 250.0


@pytest.mark.parametrize("name", ["line_delay", "exhaust_restriction"])
@pytest.mark.parametrize("u", [10.0, -4.0])
def test_what_stands_in_series_with_the_valve_knows_its_fitted_critical_ratio(name, u):
    own, point = {"r_line": 4.0} if name == "line_delay" else {"r_exhaust": 2.0}, {"u": u, "p1": 5e5, "p2": 4e5}
    fitted = at(plant_with(name, "valve_critical_ratio"), point, {**own, "critical_ratio": 0.5, "ratio_slope": 0.0})
    stated = at(plant_with(name, on=replace(rig(), critical_ratio=0.5)), point, own)
    for flow in ("mdot1", "mdot2"):
        assert float(getattr(fitted, flow)) == pytest.approx(float(getattr(stated, flow)), rel=1e-9)


@pytest.mark.parametrize("u", [6.0, -6.0])
def test_a_supply_is_drawn_what_arrives_behind_the_tube(u):
    plant, own = plant_with("supply_droop", "line_delay"), {"r_line": 3.0, "r_supply": 0.0}
    point = {"u": u, "p1": 5e5, "p2": 5e5}
    tube = at(plant_with("line_delay"), point, {"r_line": 3.0})
    # q_drop follows the flow drawn, in flows through the fully open valve
    source, decay = at(plant, point, own).relaxing[1]
    plain = at(plant_with("supply_droop"), point, {"r_supply": 0.0}).relaxing[1]
    free = at(plant_with(), point)
    arriving = max(float(tube.mdot1), float(tube.mdot2)) / max(float(free.mdot1), float(free.mdot2))
    assert float(source) / float(decay) == pytest.approx(arriving * float(plain[0]) / float(plain[1]), rel=1e-3)


def test_a_tube_leaves_a_choked_edge_alone_when_it_fills_and_takes_its_share_when_it_vents():
    pressures = {"u": 10.0, "p1": rig().patm, "p2": 6e5}
    with_it, without = at(plant_with("line_delay"), pressures, {"r_line": 0.05}), at(plant_with(), pressures)
    assert float(with_it.mdot1) == pytest.approx(float(without.mdot1), rel=1e-4)
    assert float(with_it.mdot2) == pytest.approx(float(without.mdot2) / np.sqrt(1.05), rel=1e-4)


