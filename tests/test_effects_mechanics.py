"""Mechanical effects against closed forms and an independent integrator (scipy), and what their states may not do."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, march, rig, step_function, values_of
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.signal import step as step_response

from pneuid.effect import INTEGRATION_TIME, integrated
from pneuid.effects import CATALOGUE
from pneuid.effects.backlash import _DAMPING
from pneuid.physics.gas import R_AIR, RHO_REFERENCE
from pneuid.physics.motion import end_stop_force
from pneuid.plant import Plant
from pneuid.step import fastest_rates

# friction next to nothing, so that the mechanics stand alone
FREE = {"Fc": 1e-2, "Fs": 1e-2, "sigma0": 1e3, "sigma1": 0.0, "sigma2": 1e-3, "C": 1e-12}
WIDE = RANGES | {"p1_low": 1e5, "p1_high": 9e5, "p2_low": 1e5, "p2_high": 9e5, "x_low": 0.02, "x_high": 0.48}


def plant_with(name: str) -> Plant:
    return Plant(rig(), "lugre", [CATALOGUE[name]])


def rates(plant: Plant, state: dict[str, float], changes: dict[str, float], u: float = 0.0) -> dict[str, float]:
    """Rates of all states and ``mdot1``, ``mdot2`` at one state (the rest of it in balance at atmosphere)."""
    theta = plant.theta(values_of(plant, changes), WIDE)
    known = {"x": 0.25, "p1": plant.rig.patm, "p2": plant.rig.patm} | state
    s = np.array([known.get(name, 0.0) for name in plant.states])
    at = plant.evaluate(s, np.array([u, 7e5]), theta)
    found = dict(zip(plant.states, [float(item) for item in at.explicit], strict=False))
    for i, (source, decay) in enumerate(at.relaxing):
        name = plant.states[plant.explicit_count + i]
        found[name] = float(source - decay * s[plant.explicit_count + i])
    return found | {"mdot1": float(at.mdot1), "mdot2": float(at.mdot2)}


def test_a_spring_pulls_in_proportion_to_the_distance_from_its_free_position():
    plant = plant_with("load_spring")
    on = {"k_spring": 200.0, "x_free": 0.1}
    for x in (0.05, 0.1, 0.4):
        pull = rates(plant, {"x": x}, on)["v"] - rates(plant, {"x": x}, {"k_spring": 0.0})["v"]
        assert pull * plant.rig.mass == pytest.approx(-200.0 * (x - 0.1), abs=1e-9)


@pytest.mark.parametrize(("bend", "hard"), [(0.0, 0.4), (0.3, 0.0), (-0.2, -0.5)])
def test_a_spring_that_hardens_pulls_by_the_square_and_the_cube_of_the_way_from_the_middle(bend, hard):
    plant = plant_with("load_spring")
    low, high = WIDE["x_low"], WIDE["x_high"]
    half, middle = 0.5 * (high - low), 0.5 * (low + high)
    on = {"k_spring": 200.0, "x_free": 0.1, "bend_spring": bend, "hard_spring": hard}
    for y in (-1.0, -0.3, 0.0, 0.5, 1.0):
        x = middle + y * half
        pull = rates(plant, {"x": x}, on)["v"] - rates(plant, {"x": x}, {"k_spring": 0.0})["v"]
        expected = -200.0 * (x - 0.1 + half * (bend * y**2 + hard * y**3))
        assert pull * plant.rig.mass == pytest.approx(expected, abs=1e-8)


def test_a_load_on_a_spring_swings_at_its_natural_frequency():
    plant = plant_with("load_spring")
    # pressures follow the motion: their stiffness is taken out by a huge dead volume and no air in the chambers
    theta = plant.theta(values_of(plant, FREE | {"k_spring": 2400.0, "x_free": 0.25}), WIDE)
    theta[plant.theta_names.index("V01")] = theta[plant.theta_names.index("V02")] = 1e3
    patm = plant.rig.patm
    start = np.array([0.26, 0.0, patm, patm, 0.0])
    h, period = 2e-4, 2 * np.pi / np.sqrt(2400.0 / plant.rig.mass)
    path = march(step_function(plant), start, np.array([0.0, 7e5]), np.zeros(2), h, round(2.2 * period / h), theta)
    crossings = np.flatnonzero((path[0, :-1] > 0.25) & (path[0, 1:] <= 0.25)) * h
    assert np.diff(crossings)[0] == pytest.approx(period, rel=5e-3)


# --- states that do not relax ---


def test_an_integrated_state_is_second_order_accurate():
    # s' = cos t carried by the exponential midpoint rule
    def error(h: float) -> float:
        s, t = 0.0, 0.0
        for _ in range(round(0.5 / h)):
            target, tau = integrated(s, np.cos(t))
            middle = s + (target - s) * -np.expm1(-0.5 * h / tau)
            target, tau = integrated(middle, np.cos(t + 0.5 * h))
            s, t = s + (target - s) * -np.expm1(-h / tau), t + h
        return abs(s - np.sin(0.5))

    assert error(1e-3) < 0.5 * (1e-3 / INTEGRATION_TIME) ** 2
    assert error(2.5e-4) == pytest.approx(error(5e-4) / 4, rel=0.1)


# --- backlash ---

PLAY, SHARE = 1e-3, 0.6
PUSH = 12.0
MASS = rig().mass


def crossing(force: float) -> float:
    """Duration [s] of a free crossing of the play under a constant force on the rod, with friction's part taken off."""
    return float(np.sqrt(2 * PLAY * (1 - SHARE) * MASS / (force - FREE["Fc"])))


# the path of damping ratio 0.7 is nearest to a free crossing where its time constant is 0.44 of that one's duration
RECOIL = FREE | {"b_play": PLAY * SHARE, "T_crossing": 0.44 * crossing(PUSH) * np.sqrt(PUSH / MASS)}


def test_the_damping_ratio_is_that_of_the_path_nearest_to_a_free_crossing():
    """A crossing of duration 1 under a constant force, 0.065 of the play off (rms over three such durations)."""
    t = np.linspace(0.0, 3.0, 1501)
    free = np.minimum(t**2, 1.0)

    def off(damping: float) -> float:
        paths = (step_response(([w * w], [1.0, 2.0 * damping * w, w * w]), T=t)[1] for w in np.linspace(1.5, 4.0, 51))
        return min(float(np.sqrt(np.mean((path - free) ** 2))) for path in paths)

    assert off(_DAMPING) < min(off(0.8 * _DAMPING), off(1.25 * _DAMPING))
    assert off(_DAMPING) == pytest.approx(0.065, abs=0.002)


def recoiling(force: float, seconds: float, h: float = 2e-4) -> tuple[Plant, np.ndarray, np.ndarray]:
    """Plant, times and states of a load pushed by a constant force that touched the rod's other side before."""
    plant = plant_with("backlash")
    theta = plant.theta(values_of(plant, RECOIL), WIDE)
    theta[plant.theta_names.index("V01")] = theta[plant.theta_names.index("V02")] = 1e3
    patm = plant.rig.patm
    start = np.array([0.1, 0.0, patm + force / plant.rig.A1, patm, 0.0, -1.0, 0.0])
    count = round(seconds / h)
    path = march(step_function(plant), start, np.array([0.0, 7e5]), np.zeros(2), h, count, theta)
    return plant, h * np.arange(count + 1), path


def test_the_rod_runs_ahead_of_a_rigid_load_by_the_play_and_keeps_the_momentum():
    plant, t, path = recoiling(PUSH, 0.1)
    pushed = (PUSH - FREE["Fc"]) / plant.rig.mass
    ahead = path[0] - 0.1 - 0.5 * pushed * t**2
    # what is left is friction's build-up over the first 10 um, and its viscous part
    assert ahead[-1] == pytest.approx(PLAY * SHARE, abs=1e-5)
    np.testing.assert_allclose(ahead, 0.5 * PLAY * SHARE * (path[5] + 1.0), atol=1e-5)
    assert path[1, -1] == pytest.approx(pushed * t[-1], rel=2e-3)


@pytest.mark.parametrize("force", [PUSH / 4, PUSH, 3 * PUSH])
def test_the_recoil_is_that_of_two_masses_and_a_dead_zone(force):
    """With one time constant at all forces: the harder the push, the sooner the load is met."""
    plant, t, path = recoiling(force, 0.15)
    m = plant.rig.mass

    def two_masses(_, y):
        x, v, xl, vl = y
        depth = max(x - xl - PLAY / 2, 0.0) - max(xl - x - PLAY / 2, 0.0)
        # a contact of 1000 rad/s that hardly bounces
        push = SHARE * m * (1e6 * depth + (1200.0 * (v - vl) if depth else 0.0))
        return [v, (force - FREE["Fc"] - push) / ((1 - SHARE) * m), vl, push / (SHARE * m)]

    # at first the load lies on the side it was pulled from
    found = solve_ivp(two_masses, (0.0, t[-1]), [0.1, 0.0, 0.1 + PLAY / 2, 0.0], max_step=1e-4, rtol=1e-6, t_eval=t)
    rigid = 0.1 + 0.5 * (force - FREE["Fc"]) / m * t**2
    ahead, expected = path[0] - rigid, found.y[0] - rigid
    # the same distance in the end, in about the same time
    assert ahead[-1] == pytest.approx(expected[-1], rel=0.05)
    early = t < 2.0 * crossing(force)
    assert np.abs(ahead - expected).max() < 0.25 * PLAY * SHARE
    assert np.sqrt(np.mean((ahead - expected)[early] ** 2)) < 0.12 * PLAY * SHARE


def test_a_load_that_is_not_pushed_stays_on_its_side():
    plant = plant_with("backlash")
    found = rates(plant, {"side": 0.7, "side_rate": 0.0}, RECOIL)
    assert found["side_rate"] == 0.0 and found["v"] == pytest.approx(0.0, abs=1e-12)


def test_play_that_vanishes_is_a_rigid_load_whatever_its_states():
    plant = plant_with("backlash")
    off = rates(plant, {"p1": 2e5, "side": -0.7, "side_rate": 50.0}, FREE | {"b_play": 0.0})
    assert off["v"] == pytest.approx((2e5 - plant.rig.patm) * plant.rig.A1 / plant.rig.mass, rel=1e-9)


# --- mounting compliance ---


def test_a_body_on_its_mount_moves_like_two_coupled_masses():
    plant = plant_with("mounting_compliance")
    mu, w, zeta = 0.4, 60.0, 0.1
    theta = plant.theta(values_of(plant, FREE | {"mu_mount": mu, "w_mount": w, "zeta_mount": zeta}), WIDE)
    theta[plant.theta_names.index("V01")] = theta[plant.theta_names.index("V02")] = 1e3
    patm, m = plant.rig.patm, plant.rig.mass
    push = 1e4 * plant.rig.A1
    start = np.array([0.1, 0.0, patm + 1e4, patm, 0.0, 0.0, 0.0])
    h, count = 2.5e-4, 1000
    path = march(step_function(plant), start, np.array([0.0, 7e5]), np.zeros(2), h, count, theta)
    body = m / mu

    def coupled(_t, y):
        _, V, Y, W = y
        driving = push - FREE["Fc"] - FREE["sigma2"] * V
        return [V, driving / m, W, -driving / body - w * w * Y - 2 * zeta * w * W]

    found = solve_ivp(coupled, (0, h * count), [0.1, 0, 0, 0], rtol=1e-9, atol=1e-12, t_eval=h * np.arange(count + 1))
    relative = found.y[0] - found.y[2]
    assert np.ptp(found.y[2]) > 5e-4
    # what is left is the bristle's build-up of 10 mN over its first 10 um
    np.testing.assert_allclose(path[0], relative, atol=1e-5)
    np.testing.assert_allclose(mu * path[plant.states.index("recoil")], found.y[2], atol=5e-6)
    for read, seen in ((0.0, relative), (1.0, found.y[0])):
        theta[plant.theta_names.index("read_mount")] = read
        shown = [float(plant.evaluate(s, (0.0, 7e5), theta).outputs["x"]) for s in path.T[::100]]
        np.testing.assert_allclose(shown, seen[::100], atol=1e-5)


def test_a_piston_pressed_on_an_end_does_not_push_the_body_off_its_mount():
    plant = plant_with("mounting_compliance")
    push = 4e5 * plant.rig.A2
    # the end stop carries what presses: 1 MN/m
    held = brentq(lambda x: float(end_stop_force(x, 0.0, plant.rig.stroke)) + push, -2e-3, 0.0)
    state = {"x": held, "p1": plant.rig.patm, "p2": 4e5 + plant.rig.patm, "v": 0.0}
    found = rates(plant, state, {"mu_mount": 0.3, "w_mount": 120.0})
    assert abs(found["recoil_speed"]) < 1e-3 * push / plant.rig.mass


def test_an_oscillating_mount_asks_for_its_own_step():
    plant = plant_with("mounting_compliance")
    soft = {"sigma0": 1e3, "sigma1": 1.0, "mu_mount": 0.4, "w_mount": 500.0}
    theta = plant.theta(values_of(plant, soft), WIDE)
    assert fastest_rates(plant, theta)["bristle"] == pytest.approx(500.0, rel=0.2)


# --- end cushion ---


_CUSHION = plant_with("end_cushion")
_CLEARANCE = 1.0e-3
_SHUT = {
    "cushion_1": 0.8, "cushion_2": 0.6, "L_cushion": 0.03, "rest_cushion": _CLEARANCE, "taper_cushion": 0.0,
    "tau_needle_1": 0.1, "tau_needle_2": 0.1,
}  # fmt: skip
_NO_CUSHION = {"cushion_1": 0.0, "cushion_2": 0.0}


@settings(max_examples=40, deadline=None)
@given(
    some.floats(0.05, 0.9), some.floats(-2e5, 8e5), some.floats(-1.0, 1.0), some.floats(-10.0, 10.0), some.floats(0.02, 1.0),
)  # fmt: skip
def test_a_shut_cushion_keeps_the_mass_of_its_air(share, over, v, u, tau):
    """Ring and rest of the chamber together gain what flows through the port, and nothing else."""
    plant, rig_ = _CUSHION, _CUSHION.rig
    state = {"x": 0.001, "p1": 5e5, "p2": 5e5, "v": v, "dp_ring_1": over}
    on = {"cushion_1": share, "cushion_2": 0.0, "L_cushion": 0.03, "rest_cushion": _CLEARANCE, "tau_needle_1": tau, "n": 1.25}
    found = rates(plant, state, on, u)
    V, growth = rig_.V01 + rig_.A1 * 0.001, rig_.A1 * v
    ring = share * rig_.A1 * (0.001 + _CLEARANCE)
    stored = (V - ring) * found["p1"] + ring * (found["p1"] + found["dp_ring_1"])
    pushed = ((1.0 - share) * 5e5 + share * (5e5 + over)) * growth
    entered = R_AIR * rig_.temperature * found["mdot1"]
    # 1 mm from the end a cushion of 30 mm is shut but for 0.2 %
    assert stored == pytest.approx(1.25 * (entered - pushed), rel=5e-3, abs=5e-3 * (abs(entered) + abs(pushed)) + 1e-9)


def test_a_cushion_brakes_with_a_pressure_that_no_sensor_sees():
    state = {"x": 0.499, "p1": 5e5, "p2": 5e5, "v": 0.4}
    free, braked = (rates(_CUSHION, state | {"dp_ring_2": over}, _SHUT) for over in (0.0, 3e5))
    assert (free["v"] - braked["v"]) * _CUSHION.rig.mass == pytest.approx(0.6 * _CUSHION.rig.A2 * 3e5, rel=1e-6)
    # u > 0 empties chamber 2, of which a part is left; the ring is compressed
    with_it, without = (rates(_CUSHION, state | {"dp_ring_2": 2e4}, change, 8.0) for change in (_SHUT, _NO_CUSHION))
    assert with_it["p2"] < without["p2"] and with_it["dp_ring_2"] > 1e6


def test_in_the_middle_a_cushion_does_nothing():
    middle = {"x": 0.25, "p1": 5e5, "p2": 5e5, "v": 0.3}
    for state, u in ((middle, -5.0), (middle, 5.0)):
        on, off = (rates(_CUSHION, state, change, u) for change in (_SHUT, _NO_CUSHION))
        assert on["p1"] == pytest.approx(off["p1"], rel=1e-3)
    # an overpressure is gone as soon as the passage is open
    assert rates(_CUSHION, middle | {"dp_ring_1": 1e5}, _SHUT)["dp_ring_1"] < -4e7


def test_a_check_valve_lets_air_in_within_its_time_and_out_through_the_needle_alone():
    still = {"x": 0.02, "p1": 5e5, "p2": 5e5, "v": 0.0}
    slow = _SHUT | {"tau_needle_1": 200.0}
    for tau in (1e-3, 1e-2):
        sucked, pressed = (
            rates(_CUSHION, still | {"dp_ring_1": over}, slow | {"tau_check": tau}, 0.0)["dp_ring_1"] for over in (-5e4, 5e4)
        )
        assert sucked == pytest.approx(5e4 / tau, rel=0.02)
        assert -1e-2 * sucked < pressed < 0.0


def test_a_spigot_that_tapers_closes_the_orifice_as_it_goes_in():
    """Three times as narrow at the end as at the entry, in proportion to the way between."""
    drained = []
    for x in (0.0, 0.015):
        state = {"x": x, "p1": 2e5, "p2": 2e5, "v": 0.0, "dp_ring_1": 6e5}
        plain, tapered = (rates(_CUSHION, state, _SHUT | {"taper_cushion": k}, 0.0)["dp_ring_1"] for k in (0.0, 2.0))
        drained.append(tapered / plain)
    assert drained == pytest.approx([1.0 / 3.0, 2.0 / 3.0], rel=0.01)


@pytest.mark.parametrize("over", [1e2, 5e4, 5e6])
def test_a_needle_drains_a_ring_like_an_orifice(over):
    """``n R T m / V`` with the standard's flow, of a ring two thirds into its cushion."""
    tau, p = 0.5, 5e5
    part = over / (p + over)
    ratio = 1.0 - part
    flow = 1.0 if ratio < 0.3 else np.sqrt(1.0 - ((ratio - 0.3) / 0.7) ** 2)
    if part < 0.01:
        flow = np.sqrt(1.0 - (0.69 / 0.7) ** 2) * part / 0.01
    state = {"x": 0.02, "p1": p, "p2": p, "v": 0.0, "dp_ring_1": over}
    on = _SHUT | {"cushion_1": 0.01, "tau_needle_1": tau}
    found = rates(_CUSHION, state, on, 0.0)
    assert found["dp_ring_1"] == pytest.approx(-(p + over) * flow / tau * 31.0 / 21.0, rel=0.02)


@pytest.mark.parametrize("x", [0.001, 0.005, 0.015])
def test_a_needle_is_the_same_orifice_however_much_of_the_chamber_the_ring_is(x):
    """The mass that leaves the ring in choked flow, over its pressure, gives the conductance of the time constant."""
    tau, share, p, over, n = 0.2, 0.8, 2e5, 6e5, 1.25
    rig_ = _CUSHION.rig
    on = _SHUT | {"cushion_1": share, "tau_needle_1": tau, "n": n}
    found = rates(_CUSHION, {"x": x, "p1": p, "p2": p, "v": 0.0, "dp_ring_1": over}, on, 0.0)
    ring = share * rig_.A1 * (x + _CLEARANCE)
    left = -ring * (found["p1"] + found["dp_ring_1"]) / (n * R_AIR * rig_.temperature)
    conductance = share * rig_.A1 * (0.03 + _CLEARANCE) / (n * R_AIR * rig_.temperature * RHO_REFERENCE * tau)
    assert left == pytest.approx(conductance * RHO_REFERENCE * (p + over), rel=0.01)


# --- what a plant says of itself ---


def test_the_stages_tell_the_moving_mass():
    plant = Plant(rig(), "lugre", [CATALOGUE["load_mass"]])
    theta = plant.theta(values_of(plant, {"mass": 5.0}), WIDE, mass_run=3.0)
    s, w = ca.SX.sym("s", 5), ca.SX.sym("w", 2)
    assert float(plant.evaluate(s, w, theta).mass) == pytest.approx(5.0 + 3.0 - plant.rig.mass)
