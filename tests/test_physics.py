"""The base balances: limits, symmetries and textbook laws of gas, valve, chamber, friction and motion."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, TRUTH, march, rig, step_function, values_of
from hypothesis import given
from hypothesis import strategies as st

from pneuid.api import plant_of
from pneuid.errors import UserError
from pneuid.physics.chamber import pressure_rate
from pneuid.physics.friction import (
    LAWS,
    Coefficients,
    bristle_decay,
    friction_force,
    steady_bristle_force,
    steady_force,
)
from pneuid.physics.gas import R_AIR, RHO_REFERENCE, T_REFERENCE
from pneuid.physics.motion import end_stop_force, pressure_force
from pneuid.physics.smoothing import COARSE, FINE, absolute, positive_part, sign
from pneuid.physics.valve import edges, flow_function, mass_flow, relative_command
from pneuid.plant import Plant

critical = st.floats(0.05, 0.8)
pressures = st.floats(5e4, 1.2e6)
K = Coefficients(**{name: TRUTH[name] for name in ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")})


# --- smoothing ---


@given(st.floats(-10.0, 10.0), st.sampled_from([1e-6, 1e-4, 1e-2]))
def test_smooth_stand_ins_are_within_their_width(a, width):
    assert abs(a) <= float(absolute(a, width)) <= abs(a) + width
    rounding = 1e-15 * abs(a)
    assert max(a, 0.0) - rounding <= float(positive_part(a, width)) <= max(a, 0.0) + 0.5 * width + rounding
    assert float(sign(a, width)) == pytest.approx(-float(sign(-a, width)), abs=1e-15)
    assert abs(float(sign(a, width))) <= 1.0
    if abs(a) > 100 * width:
        assert float(sign(a, width)) == pytest.approx(np.sign(a), abs=1e-4)


# --- valve ---


@given(critical, st.floats(0.0, 1.0))
def test_flow_function_is_one_when_choked_and_the_standards_ellipse_above(b, ratio):
    found = float(flow_function(ratio, b, FINE.laminar))
    if ratio <= b:
        assert found == 1.0
    elif ratio < 1.0 - FINE.laminar:
        assert found == pytest.approx(np.sqrt(1.0 - ((ratio - b) / (1.0 - b)) ** 2), rel=1e-9)
    assert 0.0 <= found <= 1.0


@given(critical, st.floats(0.0, 1.0), st.floats(0.4, 0.7))
def test_the_subsonic_index_bends_the_flow_function_below_choked_flow_alone(b, ratio, m):
    """ISO 6358-1:2013: ``(1 - ((r - b) / (1 - b))^2)^m``."""
    found, ellipse = (float(flow_function(ratio, b, FINE.laminar, index)) for index in (m, 0.5))
    if ratio <= b:
        assert found == 1.0
    elif ratio < 1.0 - FINE.laminar:
        assert found == pytest.approx(ellipse ** (2.0 * m), rel=1e-9)
    assert 0.0 <= found <= 1.0


@given(critical, st.sampled_from([FINE.laminar, COARSE.laminar]))
def test_flow_function_vanishes_at_equal_pressures_and_joins_its_patch(b, laminar):
    edge = 1.0 - laminar
    assert float(flow_function(1.0, b, laminar)) == 0.0
    below, above = (float(flow_function(edge + shift, b, laminar)) for shift in (-1e-12, 1e-12))
    # the slope next to the patch is some hundreds per unit of ratio: 1e-12 away means 1e-9
    assert below == pytest.approx(above, abs=1e-8)
    assert above == pytest.approx(np.sqrt(1.0 - ((edge - b) / (1.0 - b)) ** 2), abs=1e-8)
    # the patch is a straight line
    assert float(flow_function(1.0 - 0.5 * laminar, b, laminar)) == pytest.approx(0.5 * above, rel=1e-6)


@pytest.mark.parametrize("b", [0.1, 0.3, 0.55])
def test_flow_function_falls_with_the_ratio_and_its_slope_stays_finite(b):
    r = ca.SX.sym("r")
    slope = ca.Function("slope", [r], [ca.jacobian(flow_function(r, b, FINE.laminar), r)])
    ratios = np.concatenate([np.linspace(0.0, 1.0, 2001), [b, 1.0 - FINE.laminar, 1.0 - 0.5 * FINE.laminar]])
    found = np.asarray(slope(ratios[None])).ravel()
    assert np.all(np.isfinite(found)) and np.all(found <= 0.0)
    assert np.all(found[ratios < b] == 0.0)


@given(pressures, pressures, critical, st.floats(1e-10, 1e-7))
def test_mass_flow_turns_its_sign_with_the_pressures(one, other, b, C):
    there = float(mass_flow(one, other, C, b, T_REFERENCE, FINE.laminar))
    back = float(mass_flow(other, one, C, b, T_REFERENCE, FINE.laminar))
    assert there == -back
    assert np.sign(there) == np.sign(one - other)


def test_choked_flow_is_that_of_the_standard():
    # 1e-8 m^3/(s Pa) at 7 bar absolute: C rho0 p = 8.295 g/s at the reference temperature (ISO 6358-1, eq. 1)
    assert float(mass_flow(7e5, 1e5, 1e-8, 0.3, T_REFERENCE, FINE.laminar)) == pytest.approx(8.295e-3, rel=1e-12)
    # hotter air is thinner: the root of the temperatures
    hot = float(mass_flow(7e5, 1e5, 1e-8, 0.3, 4 * T_REFERENCE, FINE.laminar))
    assert hot == pytest.approx(0.5 * 8.295e-3, rel=1e-12)
    # at the critical ratio it is choked still, and a lower back pressure changes nothing
    assert float(mass_flow(7e5, 2.1e5, 1e-8, 0.3, T_REFERENCE, FINE.laminar)) == pytest.approx(8.295e-3, rel=1e-12)


def test_the_spool_opens_one_edge_at_a_time_and_no_more_than_fully():
    u = np.linspace(-14.0, 16.0, 301)
    one, other = (np.asarray(ca.DM(side)).ravel() for side in edges(ca.DM(relative_command(u, 1.0, 10.0)), FINE))
    np.testing.assert_allclose(one, np.clip((u - 1.0) / 10.0, 0.0, 1.0), atol=FINE.opening)
    np.testing.assert_allclose(other, np.clip(-(u - 1.0) / 10.0, 0.0, 1.0), atol=FINE.opening)


# --- chamber ---


@given(pressures, st.floats(1e-6, 1e-3), st.floats(-1e-3, 1e-3), st.sampled_from([1.0, 1.2, 1.4]))
def test_a_closed_chamber_keeps_p_V_to_the_n(p, V, V_rate, n):
    rate = pressure_rate(p, V, V_rate, 0.0, n, T_REFERENCE)
    # d ln(p V^n)/dt = 0
    assert rate / p + n * V_rate / V == pytest.approx(0.0, abs=1e-12 * (abs(n * V_rate / V) + 1e-300))


def test_filling_a_rigid_chamber_at_constant_temperature_is_the_ideal_gas_law():
    mdot, V, seconds = 2e-3, 1e-4, 0.05
    gained = pressure_rate(1e5, V, 0.0, mdot, 1.0, 300.0) * seconds
    assert gained == pytest.approx(mdot * seconds * R_AIR * 300.0 / V, rel=1e-12)


def test_the_reference_density_is_that_of_the_standard_within_its_humidity():
    # dry air at 100 kPa and 293.15 K; the standard's 65 % humidity makes it 0.3 % lighter
    assert pytest.approx(1e5 / (R_AIR * T_REFERENCE), rel=5e-3) == RHO_REFERENCE


def _closed_valve(n: float, h: float, seconds: float = 0.2) -> tuple[float, float, np.ndarray]:
    """Relative change of p V^n in both chambers of a thrown piston with a closed valve, and the path."""
    stand = rig()
    plant = Plant(stand, "lugre")
    theta = plant.theta(values_of(plant, {"n": n}), RANGES)
    # no opening is smoothed open: the rest of the smoothing would leak 1e-7 of a full opening
    theta[plant.theta_names.index("smooth_opening")] = 0.0
    start = np.array([0.25, 0.8, 4e5, 4e5, 0.0])
    w, slope = np.array([1e-12, 7e5]), np.zeros(2)
    path = march(step_function(plant), start, w, slope, h, round(seconds / h), theta)
    V1, V2 = stand.V01 + stand.A1 * path[0], stand.V02 + stand.A2 * (stand.stroke - path[0])
    kept = [path[2] * V1**n, path[3] * V2**n]
    changes = [float(np.max(np.abs(value / value[0] - 1.0))) for value in kept]
    return changes[0], changes[1], path


@pytest.mark.parametrize("n", [1.0, 1.2, 1.4])
def test_a_thrown_piston_with_a_closed_valve_keeps_p_V_to_the_n_through_the_step(n):
    one, other, path = _closed_valve(n, 0.2e-3)
    assert np.ptp(path[0]) > 0.02  # it did move, and pressures with it
    assert np.ptp(path[2]) > 2e4
    assert max(one, other) < 2e-6
    # second order: a step twice as long costs about four times as much
    coarse = max(_closed_valve(n, 0.4e-3)[:2])
    assert 3.0 < coarse / max(one, other) < 5.0


# --- friction ---


@given(st.floats(1e-4, 1.0), st.sampled_from([-1.0, 1.0]))
def test_steady_sliding_is_the_stribeck_curve(speed, way):
    v = way * speed
    g = 12.0 + 8.0 * np.exp(-((v / 0.008) ** 2))
    assert float(steady_force(K, v, 0.0)) == pytest.approx(np.sign(v) * g + 45.0 * v, rel=1e-12)
    # the bristle that no longer moves carries just that
    z = v / float(bristle_decay(K, v, 0.0))
    assert float(friction_force(K, z, 0.0, v)) == pytest.approx(float(steady_force(K, v, 0.0)), rel=1e-12)


def test_the_stribeck_curve_runs_from_static_to_coulomb():
    assert float(steady_bristle_force(K, 0.0)) == 20.0
    assert float(steady_bristle_force(K, 0.2)) == pytest.approx(12.0, rel=1e-12)
    assert float(steady_bristle_force(K, 0.008)) == pytest.approx(12.0 + 8.0 / np.e, rel=1e-12)


def _bench() -> tuple[Plant, np.ndarray, ca.Function, ca.Function]:
    """Bench plant, theta at the truth, its step, and its friction force ``(s, w, theta)``."""
    plant = Plant(rig("bench"), "lugre")
    s, w, theta = (ca.SX.sym(name, n) for name, n in (("s", 1), ("w", 5), ("theta", len(plant.theta_names))))
    force = ca.Function("force", [s, w, theta], [plant.evaluate(s, w, theta).friction])
    return plant, plant.theta(values_of(plant), RANGES), step_function(plant), force


@pytest.mark.parametrize("v", [-0.1, -0.01, -2e-3, 5e-4, 8e-3, 0.05])
def test_imposed_motion_settles_at_the_steady_force(v):
    plant, theta, step, force = _bench()
    w = np.array([0.25, v, 0.0, plant.rig.patm, plant.rig.patm])
    # twenty times the deflection at which the bristle breaks away: 2e-9 of the start is left
    h = 1e-3 * 1e-3 / abs(v)
    path = march(step, np.zeros(1), w, np.zeros(5), h, 1000, theta)
    found = float(force(path[:, -1], w, theta))
    # |v| is rounded by (1 um/s)^2 / 2 |v|
    assert found == pytest.approx(float(steady_force(K, v, FINE.speed)), rel=1e-6 + (FINE.speed / v) ** 2)
    # the bristle never carries more than the static force
    assert np.max(np.abs(path[0])) <= 20.0 / TRUTH["sigma0"] * (1 + 1e-9)


@pytest.mark.parametrize("held", [0.3, 0.95])
def test_a_bristle_at_rest_keeps_its_force(held):
    plant, theta, step, _ = _bench()
    w, z = np.array([0.25, 0.0, 0.0, plant.rig.patm, plant.rig.patm]), held * 20.0 / TRUTH["sigma0"]
    path = march(step, np.array([z]), w, np.zeros(5), 1e-2, 1000, theta)
    np.testing.assert_allclose(path[0], z, rtol=1e-8)


def test_the_first_micrometre_is_a_spring_of_stiffness_sigma0():
    plant, theta, step, force = _bench()
    v, h, count = 1e-5, 1e-4, 500  # half a micrometre at 10 um/s
    w = np.array([0.25, v, 0.0, plant.rig.patm, plant.rig.patm])
    path = march(step, np.zeros(1), w, np.zeros(5), h, count, theta)
    forces = np.array([float(force(path[:, k], w, theta)) for k in range(count + 1)])
    travel = v * h * np.arange(count + 1)
    slope = np.polyfit(travel[:100], forces[:100], 1)[0]
    # dF/dx = sigma0 (1 - sigma0 z/g) - sigma1 ... : 0.2 % softer on average over the first 0.1 um
    assert slope == pytest.approx(TRUTH["sigma0"], rel=5e-3)


def test_a_law_fits_what_it_names_and_derives_the_rest():
    values = {name: TRUTH[name] for name in ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")}
    found = {
        law.name: law.coefficients({name: values[name] for name in law.fitted}, 7e6, 300.0) for law in LAWS.values()
    }
    assert found["lugre"] == K
    dahl, stribeck, coulomb = found["dahl"], found["stribeck"], found["coulomb"]
    assert (dahl.Fs, dahl.sigma0, dahl.sigma1, dahl.sigma2) == (12.0, 4e5, 0.0, 45.0)
    assert (stribeck.Fs, stribeck.vs, stribeck.sigma0, stribeck.sigma1) == (20.0, 0.008, 7e6, 300.0)
    assert (coulomb.Fs, coulomb.sigma0, coulomb.sigma1) == (12.0, 7e6, 300.0)
    assert set(LAWS) == {"lugre", "dahl", "stribeck", "coulomb"}


# --- motion ---


@given(st.floats(0.0, 0.5), st.floats(-3.0, 3.0))
def test_end_stops_are_exactly_absent_inside_the_stroke(x, v):
    assert float(end_stop_force(x, v, 0.5)) == 0.0


@given(st.floats(1e-6, 5e-3), st.floats(-1.0, 1.0))
def test_end_stops_push_back_alike_at_both_ends(depth, v):
    at_cap, at_rod = float(end_stop_force(-depth, -v, 0.5)), float(end_stop_force(0.5 + depth, v, 0.5))
    assert at_rod == pytest.approx(-at_cap, rel=1e-6, abs=1e-9)
    if v >= 0.0:
        assert at_rod > 0.0  # against +x
    # damping takes energy out of whatever motion there is
    assert v * (at_rod - float(end_stop_force(0.5 + depth, 0.0, 0.5))) >= 0.0


def test_pressure_force_is_the_gauge_pressures_on_their_areas():
    assert float(pressure_force(4e5, 2e5, 8e-4, 7e-4, 1e5)) == pytest.approx(3e5 * 8e-4 - 1e5 * 7e-4)


# --- static laws on a servo rig: they stick ---


def _pushed(
    law: str, newton: float, seconds: float, held: float | None = None, mass: str = "2.4 kg"
) -> tuple[Plant, np.ndarray]:
    """Piston at rest with a closed valve, isobaric (large dead volumes), pushed by a net force.

    The bristle carries ``held`` newton at the start, the push itself unless said otherwise.
    """
    stand = rig("servo", {"load": {"mass": mass}, "cylinder": {"dead_volume_1": "10 m^3", "dead_volume_2": "10 m^3"}})
    plant = Plant(stand, law)
    theta = plant.theta(values_of(plant), RANGES)
    p2 = 3e5
    p1 = stand.patm + ((p2 - stand.patm) * stand.A2 + newton) / stand.A1
    stiffness = theta[plant.theta_names.index("carrier_stiffness" if plant.law.static else "sigma0")]
    h = 0.25e-3
    start = np.array([0.2, 0.0, p1, p2, (newton if held is None else held) / stiffness])
    return plant, march(step_function(plant), start, np.array([0.0, 7e5]), np.zeros(2), h, round(seconds / h), theta)


STATIC_FORCE = {"coulomb": 12.0, "stribeck": 20.0, "dahl": 12.0, "lugre": 20.0}


@pytest.mark.parametrize("law", STATIC_FORCE)
@pytest.mark.parametrize("share", [-0.9, -0.5, 0.3, 0.9])
def test_every_law_sticks_under_a_push_below_its_static_force(law, share):
    seconds = 1.0
    _, path = _pushed(law, share * STATIC_FORCE[law], seconds)
    # a loaded bristle holds: it must not creep by the rounding of |v|, a micrometre a second
    assert abs(path[0, -1] - 0.2) <= 1e-12 * seconds
    assert np.max(np.abs(path[1])) < 1e-11


@pytest.mark.parametrize("law", STATIC_FORCE)
def test_every_law_breaks_away_above_its_static_force(law):
    holds = STATIC_FORCE[law]
    _, path = _pushed(law, 1.1 * holds, 0.5, held=0.9 * holds)
    assert path[0, -1] - 0.2 > 1e-3


def test_a_sliding_piston_reaches_the_speed_at_which_viscous_friction_takes_the_rest():
    push = 30.0
    _, path = _pushed("coulomb", push, 0.35, held=0.0, mass="0.5 kg")
    # m dv/dt = push - Fc - sigma2 v from rest: time constant 11 ms, then (30 - 12)/45 m/s
    assert path[1, -1] == pytest.approx((push - 12.0) / 45.0, rel=1e-3)


def test_a_weight_on_an_incline_pulls_back():
    stand = rig("servo", {"load": {"incline": "90 deg"}})
    plant = Plant(stand, "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    p1 = stand.patm + (3e5 - stand.patm) * stand.A2 / stand.A1
    at = plant.evaluate([0.2, 0.0, p1, 3e5, 0.0], [0.0, 7e5], theta)
    assert float(at.explicit[1]) == pytest.approx(-9.80665, rel=1e-9)


def test_a_run_with_a_payload_of_its_own_accelerates_less():
    plant = Plant(rig(), "lugre")
    point = [0.2, 0.0, 5e5, 1.2e5, 0.0], [0.0, 7e5]
    light, heavy = (
        float(plant.evaluate(*point, plant.theta(values_of(plant), RANGES, mass_run=mass)).explicit[1])
        for mass in (None, 4.8)
    )
    assert light == pytest.approx(2.0 * heavy, rel=1e-9)


def test_an_unknown_friction_law_is_refused():
    with pytest.raises(UserError, match="stribeck"):
        plant_of(rig(), friction="glue")
