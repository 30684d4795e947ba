"""Effects of the sensors against filters written down independently."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from helpers import RANGES, march, rig, step_function, values_of
from hypothesis import given
from hypothesis import strategies as st
from operating import BENCH_POINT, at, plant_with
from scipy.integrate import solve_ivp
from scipy.signal import butter, lsim

from pneuid.estimation.settled import starting_states

H = 2.5e-4


def _filling(plant, values, count=240):
    """Time, states ``(ns, N)`` and shown outputs by signal over a command that opens and stays."""
    theta = plant.theta(values_of(plant, values), RANGES)
    known = {own.name: own.initial for own in plant.effect_states}
    start = np.array([{"x": 0.25, "v": 0.0, "p1": 3e5, "p2": 3e5, "z": 0.0, **known}[name] for name in plant.states])
    states = march(step_function(plant), start, np.array([3.0, 7e5]), np.zeros(2), H, count, theta)
    points = [dict(zip(plant.states, column, strict=True)) for column in states.T]
    stages = [at(plant, {**point, "u": 3.0, "psup": 7e5}, values) for point in points]
    shown = {name: np.array([float(item.outputs[name]) for item in stages]) for name in plant.outputs}
    return H * np.arange(count + 1), states, shown


@pytest.mark.parametrize("name", ["p1", "p2"])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("tau", [5e-4, 4e-3, 0.02])
def test_a_lagging_pressure_is_the_pressure_behind_two_lags_in_a_row(name, tau, share):
    plant = plant_with(f"sensor_lag_{name}")
    t, states, shown = _filling(plant, {f"tau_{name}": tau, f"order_{name}": share, f"swing_{name}": 0.0, f"tube_{name}": 0.0})
    p = states[plant.states.index(name)]
    T = np.hypot(tau, 1e-3)
    expected = p - p[0]
    for delay in (tau * (1.0 - share), tau * share):
        constant = np.hypot(delay, 1e-3)
        _, expected, _ = lsim(([constant - delay, 1.0], [constant, 1.0]), expected, t)
    moved = np.ptp(p)
    # from a rate of zero instead of the first rate: forgotten after a few time constants
    late = t > 6 * T
    if late.any():
        np.testing.assert_allclose(shown[name][late], (p[0] + expected)[late], atol=1e-3 * moved)
    assert np.abs(shown[name] - p)[4:].max() > 1e-3 * moved
    other = {"p1": "p2", "p2": "p1"}[name]
    np.testing.assert_array_equal(shown[other], states[plant.states.index(other)])


@pytest.mark.parametrize("name", ["p1", "p2"])
@pytest.mark.parametrize("damping", [0.5, 0.7071, 0.9])
def test_a_pressure_behind_a_filter_of_little_damping_is_that_of_one_of_second_order(name, damping):
    """Of the frequency with the same mean delay, ``2 D / omega``."""
    plant, tau = plant_with(f"sensor_lag_{name}"), 0.02
    given = {f"tau_{name}": tau, f"order_{name}": 0.5, f"swing_{name}": 1.0 - damping**2, f"tube_{name}": 0.0}
    t, states, shown = _filling(plant, given, count=600)
    p, omega = states[plant.states.index(name)], 2.0 * damping / tau
    _, expected, _ = lsim(([omega**2], [1.0, 2.0 * damping * omega, omega**2]), p - p[0], t)
    late = t > 3 * tau
    np.testing.assert_allclose(shown[name][late], (p[0] + expected)[late], atol=0.02 * np.abs(shown[name] - p).max())


@pytest.mark.parametrize("name", ["p1", "p2"])
def test_through_a_thin_tube_a_sealed_sensor_follows_the_faster_the_denser_the_air(name):
    """Laminar and isothermal: what flows goes with the difference of the squared pressures."""
    plant, tau = plant_with(f"sensor_lag_{name}"), 0.01
    given = {f"tau_{name}": tau, f"order_{name}": 0.0, f"swing_{name}": 0.0, f"tube_{name}": 1.0}
    t, states, shown = _filling(plant, given, count=800)
    p = states[plant.states.index(name)]
    found = solve_ivp(
        lambda now, ps: (np.interp(now, t, p) ** 2 - ps**2) / (2.0 * tau * 4e5), (0.0, t[-1]), [p[0]], t_eval=t, rtol=1e-9,
    )  # fmt: skip
    late = t > 6 * tau
    behind = np.abs(found.y[0] - p)[late].max()
    # while the air becomes denser the lag becomes shorter: without that it is twice as far off
    np.testing.assert_allclose(shown[name][late], found.y[0][late], atol=0.025 * behind)
    # a delay that is the same at all pressures is not within that
    steady = _filling(plant, given | {f"tube_{name}": 0.0}, count=800)[2]
    assert np.abs(steady[name] - found.y[0])[late].max() > 0.15 * behind


def test_skewed_channels_show_what_was_a_moment_ago():
    plant, ages = plant_with("channel_skew"), {"x": 2e-3, "p1": 1e-3, "p2": 2.5e-3}
    t, states, shown = _filling(plant, {"skew_x": 2e-3, "skew_p": 1e-3, "skew_p2": 1.5e-3})
    inner = slice(20, -20)
    for name, skew in ages.items():
        p = states[plant.states.index(name)]
        ago = np.interp(t - skew, t, p)
        # what is left of a series in the skew is its next term: the first order of a pressure, the second of the position
        order = 3 if name == "x" else 2
        slope = p
        for _ in range(order):
            slope = np.gradient(slope, t)
        left = skew**order / factorial(order) * np.abs(slope[inner]).max() + 1e-5 * np.ptp(p)
        assert np.abs(shown[name] - ago)[inner].max() < 2.0 * left
        assert np.abs(shown[name] - p)[inner].max() > 20.0 * left


@given(st.floats(-1e5, 1e5), st.sampled_from(["p1", "p2"]))
def test_an_offset_shifts_its_own_sensor_and_nothing_else(offset, name):
    with_it, without = at(plant_with(f"sensor_offset_{name}"), values={f"offset_{name}": offset}), at(plant_with())
    for signal in ("x", "p1", "p2"):
        expected = float(without.outputs[signal]) + (offset if signal == name else 0.0)
        assert float(with_it.outputs[signal]) == pytest.approx(expected, rel=1e-12)
    assert [float(item) for item in with_it.explicit] == [float(item) for item in without.explicit]


@pytest.mark.parametrize("name", ["p1", "p2"])
def test_on_a_bench_a_pressure_shown_too_high_leaves_the_force_of_the_true_one(name):
    bench, offset = rig("bench"), 5e3
    plant, true = plant_with(f"sensor_offset_{name}", on=bench), BENCH_POINT[name]
    shown = at(plant, {name: true + offset}, {f"offset_{name}": offset}).outputs["F"]
    assert float(shown) == pytest.approx(float(at(plant_with(on=bench)).outputs["F"]), rel=1e-9)


def test_a_force_offset_shifts_the_force():
    bench = rig("bench")
    with_it, without = at(plant_with("sensor_offset_F", on=bench), values={"offset_F": 3.0}), at(plant_with(on=bench))
    assert float(with_it.outputs["F"]) == pytest.approx(float(without.outputs["F"]) + 3.0, rel=1e-12)


def _reversal(plant, values, steps, after):
    """Force before a bench turns round at 20 mm/s, and over the steps ``after`` it as shown and as it acts."""
    theta, step = plant.theta(values_of(plant, values), RANGES), step_function(plant)
    w, speed = np.array([0.2, 0.02, 0.0, 4e5, 3e5]), np.array([0.02, 0, 0, 0, 0])
    start = np.array([_pushing() if name.startswith("push") else 0.0 for name in plant.states])
    there = march(step, start, w, speed, H, steps, theta)
    w[1] = -0.02
    back = march(step, there[:, -1], w, -speed, H, after, theta)
    shown, true = (
        np.array([
            float(at(plant, dict(zip(plant.states, state, strict=True)) | {"v": -0.02}, given).outputs["F"])
            for state in back.T
        ])
        for given in (values, {"tau_F": 0.0})
    )  # fmt: skip
    return there[plant.states.index("F_followed"), -1] - _pushing(), shown, true


@pytest.mark.parametrize("third", [0.0, 0.4])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5])
def test_a_lagging_force_follows_a_reversal_and_does_not_smooth_the_pressures(share, third):
    plant, tau = plant_with("sensor_lag_F", on=rig("bench")), 6e-3
    values = {"tau_F": tau, "order_F": share, "swing_F": 0.0, "third_F": third}
    before, shown, true = _reversal(plant, values, 400, 200)
    # the filters in a row over the whole record: what it was before the reversal, and what it is from then on
    t = H * np.arange(400 + true.size)
    delays = (tau * (1.0 - third) * (1.0 - share), tau * (1.0 - third) * share, tau * third)
    up, down = np.poly1d([1.0]), np.poly1d([1.0])
    for delay in delays:
        T = np.hypot(delay, 2e-3)
        up, down = up * np.poly1d([T - delay, 1.0]), down * np.poly1d([T, 1.0])
    whole = np.concatenate([np.full(400, before), true])
    _, expected, _ = lsim((up.coeffs, down.coeffs), whole - before, t)
    np.testing.assert_allclose(shown, before + expected[400:], atol=0.02 * np.ptp(true))
    # a jump of the measured pressure is passed on at once
    jump = [float(at(plant, {"p1": p1, "F_followed": 10.0}, values).outputs["F"]) for p1 in (4e5, 4.1e5)]
    assert jump[1] - jump[0] == pytest.approx(-1e4 * rig("bench").A1, rel=1e-9)


@pytest.mark.parametrize(("order", "shape"), [(2, (0.5, 0.5, 0.0)), (3, (0.5, 0.75, 0.5))])
def test_a_lagging_force_is_filtered_as_by_butterworth(order, shape):
    """Its step after a reversal against the filter of the same mean delay."""
    plant, tau = plant_with("sensor_lag_F", on=rig("bench")), 40e-3
    values = {"tau_F": tau} | dict(zip(("order_F", "swing_F", "third_F"), shape, strict=True))
    before, shown, true = _reversal(plant, values, 2000, 1500)
    numerator, denominator = butter(order, 1.0, analog=True)
    # slowed down to the mean delay, which the coefficient of s is over that of 1
    slower = tau / (denominator[-2] / denominator[-1])
    denominator = denominator * slower ** np.arange(order, -1, -1)
    _, expected, _ = lsim((numerator, denominator), true - before, H * np.arange(true.size))
    # what the shortest lag adds is of the size (2 ms / 10 ms)^2 of a stage
    np.testing.assert_allclose(shown, before + expected, atol=0.03 * np.ptp(shown))


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_lagging_force_is_late_by_its_delay_where_a_pressure_rises_evenly(share):
    plant, rate, values = plant_with("sensor_lag_F", on=rig("bench")), 5e4, {"tau_F": 6e-3, "order_F": share}
    theta, held = plant.theta(values_of(plant, values), RANGES), {"v": 0.0, "a": 0.0, "x": 0.2}
    start = [_pushing() if name.startswith("push") else 0.0 for name in plant.states]
    risen = march(step_function(plant), np.array(start), np.array([0.2, 0.0, 0.0, 4e5, 3e5]),
                  np.array([0, 0, 0, rate, 0]), H, 2000, theta)[:, -1]  # fmt: skip
    point = dict(zip(plant.states, risen, strict=True)) | held | {"p1": 4e5 + rate * 2000 * H}
    shown, acting = (float(at(plant, point, given).outputs["F"]) for given in (values, {"tau_F": 0.0}))
    assert shown - acting == pytest.approx(6e-3 * rate * rig("bench").A1, rel=0.01)


def test_filters_start_where_they_have_settled():
    """One behind the other: all on what acts at the first sample, other states at their own initial values."""
    plant = plant_with("sensor_lag_F", "friction_warmup", on=rig("bench"))
    point = BENCH_POINT | {"z": 1e-5}
    states = np.array([[point.get(name, 0.0)] for name in plant.states])
    theta = plant.theta(values_of(plant, {"tau_F": 5e-3, "order_F": 0.3}), RANGES)[:, None]
    own = starting_states(plant, states, np.array([[point[name]] for name in plant.inputs]), theta)
    found = dict(zip((state.name for state in plant.effect_states), own[:, 0], strict=True))
    acting = float(at(plant_with(on=rig("bench")), point).outputs["F"]) + _pushing()
    assert (found["F_between"], found["F_followed"]) == pytest.approx((acting, acting), rel=1e-9)
    assert (found["push_smooth"], found["push_smoother"]) == pytest.approx((_pushing(), _pushing()), rel=1e-9)
    others = [state for state in plant.effect_states if not state.settled]
    assert others and all(found[state.name] == state.initial for state in others)


def _pushing() -> float:
    bench = rig("bench")
    return (BENCH_POINT["p1"] - bench.patm) * bench.A1 - (BENCH_POINT["p2"] - bench.patm) * bench.A2
