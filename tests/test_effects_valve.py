"""Effects of the valve against closed forms and an ideal play operator."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import rig
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from operating import at, followed, plant_with
from scipy.signal import lti

PLAY = {"play": 0.02, "play_spread": 0.0, "play_soft": 0.0}
PROMPT = 50.0  # full scales a spool has to be behind to move at its fastest: never


def _opening(plant, values, command, seconds, h=2e-4):
    """Times and opening (N,) over a command relative to full scale."""
    t, found = followed(plant, lambda now: 10.0 * command(now), values, seconds, h)
    return t, found["opening"]


# --- offset and asymmetry ---


@given(st.floats(-0.3, 0.3), st.floats(-9.0, 9.0))
def test_an_offset_is_a_null_shift_in_the_rig_file(offset, u):
    other = rig(changes={"valve": {"null": f"{-10.0 * offset!r} V"}})
    freed, said = at(plant_with("valve_offset"), {"u": u}, {"offset_valve": offset}), at(plant_with(on=other), {"u": u})
    assert float(freed.opening) == pytest.approx(float(said.opening), abs=1e-12)
    assert float(freed.mdot1) == pytest.approx(float(said.mdot1), rel=1e-9, abs=1e-12)


def _shares(values, u, name="valve_asymmetry"):
    """Flows into both chambers with an effect of the edges, over those of edges in proportion to the command."""
    with_it, without = at(plant_with(name), {"u": u}, values), at(plant_with(), {"u": u})
    return [float(getattr(with_it, flow)) / float(getattr(without, flow)) for flow in ("mdot1", "mdot2")]


@given(st.floats(-0.7, 0.7), st.floats(0.5, 15.0))
def test_the_two_sides_pass_flows_in_the_ratio_of_their_conductances_up_to_full_opening(a, u):
    for sign in (1.0, -1.0):
        # the closed edge is open by half the smoothing width, 5e-7
        assert _shares({"asymmetry": a}, sign * u) == pytest.approx([1 + sign * a] * 2, abs=1e-4)


@given(st.lists(st.floats(0.5, 1.5), min_size=4, max_size=4), st.floats(0.5, 9.0))
def test_any_four_edges_have_a_side_a_supply_and_a_port_that_set_them_apart(edges, u):
    """Three numbers and the common conductance are four conductances, unless both sides are alike."""
    supply_1, exhaust_2, supply_2, exhaust_1 = edges
    mean = sum(edges) / 4.0
    a = (supply_1 + exhaust_2 - supply_2 - exhaust_1) / (4.0 * mean)
    assume(abs(a) > 0.02)
    e = (supply_1 - exhaust_2 + supply_2 - exhaust_1) / (4.0 * mean) / a
    t = (supply_1 - exhaust_2 - supply_2 + exhaust_1) / (4.0 * mean) / a
    values = {"asymmetry": a, "asymmetry_supply": e, "asymmetry_port": t}
    for sign, *open_edges in ((1.0, supply_1, exhaust_2), (-1.0, exhaust_1, supply_2)):
        assert _shares(values, sign * u) == pytest.approx([edge / mean for edge in open_edges], abs=1e-4)


@given(st.floats(-0.4, 0.4), st.floats(-1.0, 1.0), st.floats(0.5, 9.9))
def test_the_edges_of_either_side_bend_by_a_share_of_their_own(c, m, u):
    """All as far open at full command as without it."""
    shut = 1.0 - 0.1 * u
    for sign, bend in ((1.0, 1.0 - c * (1.0 + m) * shut), (-1.0, 1.0 + c * (1.0 - m) * shut)):
        assert _shares({"asymmetry_curve": c, "asymmetry_bent": m}, sign * u) == pytest.approx([bend] * 2, rel=0.01)


# --- curve ---


@given(st.floats(-0.4, 0.4), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.5, 9.5))
def test_a_curve_bends_both_sides_alike_supply_and_exhaust_by_their_shares(c, e, q, u):
    values = {"curve": c, "curve_supply": e, "curve_shape": q}
    short = 1.0 - u / 10.0
    bend = c * short * (1.0 + q * (1.0 - 2.0 * short))
    supply, exhaust = 1.0 - (1.0 + e) * bend, 1.0 - (1.0 - e) * bend
    # the opening is rounded over 0.01 of full scale, and the closed edge open by half the smoothing width
    assert _shares(values, u, "valve_curve") == pytest.approx([supply, exhaust], abs=3e-3)
    assert _shares(values, -u, "valve_curve") == pytest.approx([exhaust, supply], abs=3e-3)


@given(st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.sampled_from([-14.0, -10.0, 10.0, 14.0]))
def test_a_curve_ends_at_full_opening(c, e, q, u):
    values = {"curve": c, "curve_supply": e, "curve_shape": q}
    assert _shares(values, u, "valve_curve") == pytest.approx([1.0, 1.0], abs=1e-3)


# --- dead zone ---


@given(st.floats(0.01, 0.2), st.floats(-0.5, 0.5), st.floats(-9.9, 9.9))
def test_within_its_laps_the_valve_opens_nothing_and_beyond_what_is_left(d, skew, u):
    sharp = {"dead_zone": d, "lap_skew": skew, "lap_edge": 1e-3}
    above, below, s = d * (1.0 + skew), d * (1.0 - skew), 0.1 * u
    expected = (1.0 - d) * (max(s - above, 0.0) / (1.0 - above) - max(-s - below, 0.0) / (1.0 - below))
    plant = plant_with("valve_dead_zone")
    assert float(at(plant, {"u": u}, sharp).opening) == pytest.approx(expected, abs=1.2e-3 * d)
    # both sides are open as far at full command
    full = [float(at(plant, {"u": command}, sharp).opening) for command in (10.0, -10.0)]
    assert full == pytest.approx([1.0 - d, d - 1.0], abs=1.2e-3 * d)


@given(st.floats(0.01, 0.2), st.lists(st.floats(0.6, 1.4), min_size=4, max_size=4), st.floats(-10.0, 10.0))
def test_each_edge_opens_past_its_own_lap_and_all_as_far_at_full_command(d, laps, u):
    """Three numbers and the mean are four laps."""
    supply_1, exhaust_2, supply_2, exhaust_1 = (lap * d * 4.0 / sum(laps) for lap in laps)
    shares = {
        "lap_skew": (supply_1 + exhaust_2 - supply_2 - exhaust_1) / (4.0 * d),
        "lap_supply": (supply_1 - exhaust_2 + supply_2 - exhaust_1) / (4.0 * d),
        "lap_port": (supply_1 - exhaust_2 - supply_2 + exhaust_1) / (4.0 * d),
    }
    s = 0.1 * u
    edges = at(plant_with("valve_dead_zone"), {"u": u}, {"dead_zone": d, "lap_edge": 1e-3, **shares}).edges
    for name, towards, lap in (
        ("supply_1", s, supply_1), ("exhaust_2", s, exhaust_2), ("supply_2", -s, supply_2), ("exhaust_1", -s, exhaust_1)
    ):  # fmt: skip
        expected = (1.0 - d) * max(towards - lap, 0.0) / (1.0 - lap)
        assert float(getattr(edges, name)) == pytest.approx(expected, abs=2e-3 * d + 2e-6)


@given(st.floats(0.01, 0.2), st.floats(0.05, 0.5))
def test_a_rounded_lap_opens_early_and_loses_nothing_far_beyond(d, edge):
    plant, rounded = plant_with("valve_dead_zone"), {"dead_zone": d, "lap_skew": 0.0, "lap_edge": edge}
    assert float(at(plant, {"u": 10.0 * d}, rounded).opening) == pytest.approx(0.5 * edge * d, rel=0.2)
    assert float(at(plant, {"u": 0.0}, rounded).opening) == pytest.approx(0.0, abs=1e-15)
    far = 0.25 * (edge * d) ** 2 * (1.0 / (0.9 - d) - 1.0 / (0.9 + d))
    assert float(at(plant, {"u": 9.0}, rounded).opening) == pytest.approx(0.9 - d + far, abs=0.2 * far + 1e-6)


@given(st.floats(-0.5, 0.5), st.floats(1e-3, 1.0), st.floats(-9.9, 9.9))
def test_without_a_lap_its_shapes_mean_nothing(skew, edge, u):
    shapes = {"dead_zone": 0.0, "lap_skew": skew, "lap_edge": edge}
    assert float(at(plant_with("valve_dead_zone"), {"u": u}, shapes).opening) == pytest.approx(0.1 * u, abs=1e-12)


# --- lag ---


def test_the_spool_answers_a_step_by_the_exponential_of_its_time_constant():
    tau, shortest = 8e-3, 1e-3
    own = {"tau_valve": tau, "order_valve": 0.0, "swing_valve": 0.0, "slew_valve": PROMPT}
    t, found = _opening(plant_with("valve_lag"), own, lambda _: 0.4, 0.05)
    T = np.hypot(tau, shortest)
    # the limit of its speed is felt by (0.4 / 50)^2 / 2
    np.testing.assert_allclose(found, 0.4 * (1 - tau / T * np.exp(-t / T)), rtol=1e-4, atol=1e-12)
    assert found[np.searchsorted(t, tau)] / 0.4 == pytest.approx(1 - np.exp(-1), abs=0.01)


def test_a_spool_of_second_order_sets_out_gently_and_is_later_by_no_more():
    tau = 40e-3
    own = {"tau_valve": tau, "order_valve": 0.5, "swing_valve": 0.0, "slew_valve": PROMPT}
    t, found = _opening(plant_with("valve_lag"), own, lambda _: 0.4, 0.3)
    T = 0.5 * tau
    # two equal lags; what the shortest lag adds is of the size (1 ms / 20 ms)^2
    np.testing.assert_allclose(found, 0.4 * (1 - (1 + t / T) * np.exp(-t / T)), atol=0.4 * 4e-3)
    assert found[np.searchsorted(t, 1e-3)] < 0.01 * 0.4


@pytest.mark.parametrize("damping", [0.5, 0.7, 0.9])
def test_a_spool_of_little_damping_swings_as_one_of_second_order_and_is_later_by_no_more(damping):
    """Against the step response that textbooks give, of the frequency with the same mean delay ``2 D / omega``."""
    tau = 40e-3
    own = {"tau_valve": tau, "order_valve": 0.5, "swing_valve": 1.0 - damping**2, "slew_valve": PROMPT}
    t, found = _opening(plant_with("valve_lag"), own, lambda _: 0.4, 0.3)
    omega = 2.0 * damping / tau
    expected = lti(omega**2, [1.0, 2.0 * damping * omega, omega**2]).step(T=t)[1]
    np.testing.assert_allclose(found, 0.4 * expected, atol=0.4 * 8e-3)


@pytest.mark.parametrize("command", [-0.9, 0.5])
def test_far_behind_a_spool_moves_at_its_fastest_and_near_by_as_if_it_had_no_limit(command):
    tau, slew = 40e-3, 0.05
    plant = plant_with("valve_lag")
    own = {"tau_valve": tau, "order_valve": 0.0, "swing_valve": 0.0, "slew_valve": slew}
    t, found = _opening(plant, own, lambda _: command, 0.6)
    rate = np.gradient(found, t)
    far = (np.abs(command - found) > 4.0 * slew) & (t > 4e-3)
    np.testing.assert_allclose(rate[far], np.sign(command) * slew / tau, rtol=0.05)
    near = (np.abs(command - found) < 0.2 * slew) & (np.abs(command - found) > 0.01 * slew)
    np.testing.assert_allclose(rate[near], (command - found)[near] / tau, rtol=0.05)


@pytest.mark.parametrize("command", [-0.6, 0.6])
def test_a_spool_moves_quicker_with_its_return_spring_than_against_it(command):
    tau, spring = 40e-3, 0.4
    own = {"tau_valve": tau, "order_valve": 0.0, "swing_valve": 0.0, "slew_valve": PROMPT, "spring_valve": spring}
    t, found = _opening(plant_with("valve_lag"), own, lambda _: command, 0.3)
    # the last hundredth of full scale is passed at a speed between the two
    expected = command * (1 - np.exp(-t / (tau * np.exp(-np.sign(command) * spring))))
    np.testing.assert_allclose(found, expected, atol=0.008)


@pytest.mark.parametrize("tau", [2e-4, 3e-3, 0.03])
def test_a_ramp_arrives_late_by_the_delay_however_short(tau):
    t, found = _opening(plant_with("valve_lag"), {"tau_valve": tau}, lambda now: 0.5 * now, 12 * max(tau, 2e-3), 1e-4)
    # the held command of one integration step adds h/2
    assert 0.5 * t[-1] - found[-1] == pytest.approx(0.5 * tau, abs=0.5 * 1e-4)


@pytest.mark.parametrize("swing", [0.2, 0.5])
@pytest.mark.parametrize("tau", [1e-3, 3e-3, 10e-3])
def test_a_swinging_spool_is_late_by_its_delay_however_short(tau, swing):
    own = {"tau_valve": tau, "order_valve": 0.5, "swing_valve": swing, "slew_valve": PROMPT}
    t, found = _opening(plant_with("valve_lag"), own, lambda now: 0.5 * now, 20 * max(tau, 2e-3), 2e-5)
    # the held command of one integration step adds h/2
    assert 0.5 * t[-1] - found[-1] == pytest.approx(0.5 * tau, rel=0.01, abs=0.5 * 2e-5)


def test_without_delay_the_command_passes_whatever_the_spool_state_is():
    assert float(at(plant_with("valve_lag"), {"u": 3.0, "spool": -0.8}, {"tau_valve": 0.0}).opening) == 0.3


# --- hysteresis ---


def _ideal_play(command: np.ndarray, half_width: float) -> np.ndarray:
    """Play operator from rest at zero: carried along at either end of the play."""
    found, y = np.empty_like(command), 0.0
    for i, s in enumerate(command):
        y = min(max(y, s - half_width), s + half_width)
        found[i] = y
    return found


def _held(place: float) -> dict[str, float]:
    return {"spool_play_narrow": place, "spool_play_wide": place}


def _triangle(size: float, period: float):
    return lambda now: size * (2 / np.pi) * float(np.arcsin(np.sin(2 * np.pi * now / period)))


@pytest.mark.parametrize("spread", [0.0, 0.3, 0.8])
def test_the_opening_follows_the_mean_of_two_ideal_play_operators(spread):
    command = _triangle(0.1, 1.0)
    t, found = _opening(plant_with("valve_hysteresis"), PLAY | {"play_spread": spread}, command, 2.5, 5e-4)
    commanded = np.array([command(float(now)) for now in t])
    ideal = 0.5 * sum(_ideal_play(commanded, 0.02 * (1.0 + way * spread)) for way in (-1.0, 1.0))
    # the shortest play that is followed (0.005), the rounding of the catch and its millisecond
    assert np.abs(found - ideal).max() < 0.1 * 0.02
    width = np.interp(0.0, *_branch(found, t, command, 1.0)) - np.interp(0.0, *_branch(found, t, command, -1.0))
    assert abs(width) == pytest.approx(2 * 0.02, rel=0.05)


def _branch(found, t, command, way):
    """Command against opening on the rising or the falling branch of the last cycle, sorted by command."""
    s = np.array([command(float(now)) for now in t])
    rising = np.gradient(s, t) * way > 0
    chosen = rising & (t > 1.3) & (t < 2.2) & (np.abs(s) < 0.05)
    order = np.argsort(s[chosen])
    return s[chosen][order], found[chosen][order]


UNIT, SHARE = st.floats(0.0, 1.0), st.floats(-0.5, 0.5)
SOFT = {"play": 0.02, "play_spread": 0.3, "play_soft": 1.0, "play_way": 3.0}


def _dahl(command: np.ndarray, half_width: float, way: float) -> np.ndarray:
    """What Dahl's friction holds back of the command, exact from one sample to the next, at rest at first."""
    found, held = np.empty_like(command), 0.0
    for i, moved in enumerate(np.diff(command, prepend=command[0])):
        to = np.sign(moved) * half_width
        held = to + (held - to) * np.exp(-abs(moved) / (way * half_width))
        found[i] = held
    return found


@pytest.mark.parametrize("size", [0.1, 0.015])
def test_a_soft_hysteresis_is_held_back_by_dahl_s_friction(size):
    command = _triangle(size, 1.0)
    t, found = _opening(plant_with("valve_hysteresis"), SOFT, command, 2.5, 2.5e-4)
    commanded = np.array([command(float(now)) for now in t])
    ideal = commanded - _dahl(commanded, 0.02, 3.0)
    # the way is longer by 3 % for what is followed while the amplitude is off (0.005)
    assert np.abs(found - ideal).max() < 0.03 * 0.02


def test_a_soft_hysteresis_keeps_what_it_holds_back_while_the_command_rests():
    t, found = _opening(plant_with("valve_hysteresis"), SOFT, lambda now: min(0.3 * now, 0.3), 6.0, 1e-3)
    stopped, last = found[np.searchsorted(t, 1.05)], found[-1]
    assert 0.3 - stopped == pytest.approx(0.02, rel=0.01) and last == pytest.approx(stopped, abs=1e-3 * 0.02)


def test_a_soft_hysteresis_holds_back_as_much_in_slow_motion():
    """A hundredth of the command within a second, the slow small triangles that reveal it."""
    command = _triangle(0.01, 4.0)
    own = SOFT | {"play": 0.002, "play_way": 0.5}
    t, found = _opening(plant_with("valve_hysteresis"), own, command, 8.0, 1e-3)
    commanded = np.array([command(float(now)) for now in t])
    rising = np.gradient(commanded, t) > 0
    late = (t > 4.0) & (np.abs(commanded) < 2e-3)
    held = [float((commanded - found)[late & way].mean()) for way in (rising, ~rising)]
    assert held[0] == pytest.approx(0.002, rel=0.1) and held[1] == pytest.approx(-0.002, rel=0.1)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 0.3), SHARE, SHARE, SHARE, st.floats(0.01, 1.0), st.floats(-2.0, 2.0))
def test_no_edge_of_an_overlapped_spool_opens_less_than_nothing(d, skew, supply, port, edge, u):
    own = {"dead_zone": d, "lap_skew": skew, "lap_supply": supply, "lap_port": port, "lap_edge": edge}
    edges = at(plant_with("valve_dead_zone"), {"u": u}, own).edges
    assert min(float(of) for of in (edges.supply_1, edges.supply_2, edges.exhaust_1, edges.exhaust_2)) >= 0.0


@pytest.mark.parametrize("values", ["PLAY", "SOFT"])
def test_the_loop_does_not_depend_on_the_rate(values):
    plant, values = plant_with("valve_hysteresis"), {"PLAY": PLAY, "SOFT": SOFT}[values]
    _, quick = _opening(plant, values, _triangle(0.1, 0.5), 1.0, 5e-4)
    _, slow = _opening(plant, values, _triangle(0.1, 2.0), 4.0, 5e-4)
    assert np.abs(quick - slow[::4]).max() < 0.1 * 0.02


def test_at_rest_nothing_drifts_and_jitter_within_the_play_passes_nothing():
    plant = plant_with("valve_hysteresis")
    for inside in (-0.019, 0.0, 0.013, 0.02):
        source, decay = at(plant, {"u": 1.0, **_held(0.1 + inside)}, PLAY).relaxing[1]
        assert float(source) - float(decay) * (0.1 + inside) == pytest.approx(0.0, abs=1e-12)
    seen = [float(at(plant, {"u": 10 * s, **_held(0.1)}, PLAY).opening) for s in np.linspace(0.085, 0.115, 7)]
    # what is left of the jitter is the ratio of the amplitude to the play that is followed
    assert np.ptp(seen) < 0.031 * 0.03


@given(st.floats(0.0, 0.3), st.floats(0.0, 0.9), st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), UNIT, UNIT)
def test_the_spool_is_never_further_from_the_command_than_the_play(play, spread, s, y, soft, z):
    values = {"play": play, "play_spread": spread, "play_soft": soft}
    opening = float(at(plant_with("valve_hysteresis"), {"u": 10 * s, **_held(y), "spool_stiction": 2 * z - 1}, values).opening)
    assert abs(opening - s) <= 1.021 * play + 1e-12
