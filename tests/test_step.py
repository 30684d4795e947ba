"""The time step: its order against an independent stiff solver, its exact limits, its stability limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, TRUTH, march, rig, step_function, values_of
from scipy.integrate import solve_ivp

from pneuid.effect import Effect, Parameter, State
from pneuid.effects import CATALOGUE
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant
from pneuid.step import (
    BRISTLE_LIMIT,
    CHAMBER_LIMIT,
    DAMPING_LIMIT,
    fastest_rates,
    stable_upper_bounds,
    substeps_needed,
)

SUPPLY = 7.01325e5


def contract_rates(command: Callable[[float], float]) -> Callable[[float, np.ndarray], list[float]]:
    """The contract's equations of the default servo rig in plain numpy, without smoothing; states x, v, p1, p2, z."""
    A1, A2 = np.pi / 4 * 0.032**2, np.pi / 4 * (0.032**2 - 0.012**2)
    R, T, patm, b, edge = 287.05, 293.15, 101325.0, 0.30, 0.999

    def flow(p_from: float, p_to: float) -> float:
        up, down = max(p_from, p_to), min(p_from, p_to)
        ratio = down / up
        if ratio <= b:
            psi = 1.0
        elif ratio < edge:
            psi = np.sqrt(1.0 - ((ratio - b) / (1.0 - b)) ** 2)
        else:
            psi = np.sqrt(1.0 - ((edge - b) / (1.0 - b)) ** 2) * (1.0 - ratio) / (1.0 - edge)
        return float(np.sign(p_from - p_to) * TRUTH["C"] * 1.185 * up * psi)

    def rates(t: float, s: np.ndarray) -> list[float]:
        x, v, p1, p2, z = s
        opening = np.clip(command(t) / 10.0, -1.0, 1.0)
        fill, drain = max(opening, 0.0), max(-opening, 0.0)
        mdot1 = fill * flow(SUPPLY, p1) - drain * flow(p1, patm)
        mdot2 = drain * flow(SUPPLY, p2) - fill * flow(p2, patm)
        g = TRUTH["Fc"] + (TRUTH["Fs"] - TRUTH["Fc"]) * np.exp(-((v / TRUTH["vs"]) ** 2))
        dz = v - TRUTH["sigma0"] * abs(v) / g * z
        friction = TRUTH["sigma0"] * z + TRUTH["sigma1"] * dz + TRUTH["sigma2"] * v
        V1, V2 = 12e-6 + A1 * x, 14e-6 + A2 * (0.5 - x)
        n = TRUTH["n"]
        dp1 = n / V1 * (R * T * mdot1 - p1 * A1 * v)
        dp2 = n / V2 * (R * T * mdot2 + p2 * A2 * v)
        return [v, ((p1 - patm) * A1 - (p2 - patm) * A2 - friction) / 2.4, dp1, dp2, dz]

    return rates


def _reference(
    start: np.ndarray, u: float, u_rate: float, seconds: float, method: Literal["Radau", "LSODA"]
) -> np.ndarray:
    found = solve_ivp(
        contract_rates(lambda t: u + u_rate * t), (0.0, seconds), start, method,
        rtol=1e-11, atol=[1e-14, 1e-13, 1e-5, 1e-5, 1e-16], max_step=2e-4,
    )  # fmt: skip
    assert found.success
    return found.y[:, -1]


def _stepped(start: np.ndarray, u: float, u_rate: float, seconds: float, h: float) -> np.ndarray:
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    w, slope = np.array([u, SUPPLY]), np.array([u_rate, 0.0])
    return march(step_function(plant), start, w, slope, h, round(seconds / h), theta)[:, -1]


SLIDING = np.array([0.2, 0.15, 4.5e5, 3.2e5, 12.0 / 4e5])
CREEPING = np.array([0.2, 0.012, 4.3e5, 4.7e5, 15.0 / 4e5])


@pytest.mark.parametrize(
    ("start", "u", "u_rate", "seconds"),
    [
        pytest.param(SLIDING, 3.0, -40.0, 0.05, id="sliding"),
        pytest.param(CREEPING, 1.0, 30.0, 0.02, id="on the Stribeck slope"),
    ],
)
@pytest.mark.parametrize("method", ["Radau", "LSODA"])
def test_the_error_against_a_stiff_solver_falls_with_the_square_of_the_step(start, u, u_rate, seconds, method):
    exact = _reference(start, u, u_rate, seconds, method)
    assert exact[0] - start[0] > 1e-4  # it did move
    steps = np.array([2.5e-4, 1.25e-4, 6.25e-5])
    scale = np.array([1e-4, 1e-2, 1e3, 1e3, 1e-5])
    errors = np.array([np.abs(_stepped(start, u, u_rate, seconds, h) - exact) / scale for h in steps])
    # measured at the largest step: 0.5 um, 20 um/s, 3 Pa after 50 ms; the sensors see 20 um and 500 Pa
    assert np.all(errors[0] < [1e-2, 1e-2, 1e-2, 1e-2, 1e-2])
    order = np.polyfit(np.log(steps), np.log(np.linalg.norm(errors, axis=1)), 1)[0]
    # two; the band is wide because three steps of a stiff problem are not yet the asymptote
    assert 1.7 < order < 2.5


def test_reversal_and_sticking_converge_to_the_stiff_solution():
    # through v = 0 the kink of |v| costs the order, not the convergence
    start, u, u_rate, seconds = np.array([0.25, 0.05, 4.0e5, 4.4e5, 3e-5]), 0.5, -60.0, 0.04
    exact = _reference(start, u, u_rate, seconds, "LSODA")
    assert exact[1] < 0.0  # it did turn
    errors = [abs(_stepped(start, u, u_rate, seconds, h)[0] - exact[0]) for h in (2.5e-4, 2.5e-5)]
    # 20 um is the sensor; the finest step is left with the smoothing of |v|
    assert errors[0] < 2e-6 and errors[1] < 5e-8


# --- exact limits of the exponential part ---


def _lone_bristle(v: float, h: float, z: float = 0.0) -> float:
    """Bristle on a bench after one step of ``h`` at a constant speed."""
    plant = Plant(rig("bench"), "lugre")
    w = np.array([0.25, v, 0.0, plant.rig.patm, plant.rig.patm])
    theta = plant.theta(values_of(plant), RANGES)
    return float(march(step_function(plant), np.array([z]), w, np.zeros(5), h, 1, theta)[0, -1])


@pytest.mark.parametrize("v", [-0.3, -0.004, 1e-4, 0.05, 1.5])
@pytest.mark.parametrize("h", [1e-5, 1e-3, 0.1])
def test_at_constant_speed_one_step_of_any_length_is_exact(v, h):
    g = TRUTH["Fc"] + (TRUTH["Fs"] - TRUTH["Fc"]) * np.exp(-((v / TRUTH["vs"]) ** 2))
    decay = TRUTH["sigma0"] * v**2 / np.hypot(v, FINE.speed) / g
    start = -2e-5
    exact = v / decay + (start - v / decay) * np.exp(-decay * h)
    assert _lone_bristle(v, h, start) == pytest.approx(exact, rel=1e-10, abs=1e-18)


def test_at_rest_the_bristle_stays():
    # the smoothing's decay at rest is sigma0 1e-6/Fs = 2 % a second: a sample leaves all but 2e-5 of it
    assert _lone_bristle(0.0, 1e-3, 3e-5) == pytest.approx(3e-5, rel=2.1e-5)
    assert _lone_bristle(0.0, 1e-3, 0.0) == 0.0


@pytest.mark.parametrize("width", [0.0, 1e-12])
def test_without_any_decay_the_step_is_the_plain_integral(width):
    plant = Plant(rig("bench"), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    theta[plant.theta_names.index("smooth_speed")] = width
    theta[plant.theta_names.index("sigma0")] = 1e-12
    w = np.array([0.25, 0.02, 0.0, plant.rig.patm, plant.rig.patm])
    end = march(step_function(plant), np.zeros(1), w, np.zeros(5), 1e-3, 1, theta)[0, -1]
    assert end == pytest.approx(2e-5, rel=1e-9)


class _FollowedSpeed(Effect):
    """A state that follows the speed, and a force that it makes."""

    name = "followed_speed"
    states = (State("v_followed", "m/s", 0.0, 0.1, 0.1),)

    def parameters(self, rig, law):  # noqa: ARG002 - the signature of the contract
        return (Parameter("tau_followed", "tau", "s", 1e-3, 1.0, 0.03, 1.0, "this test", positive=True),)

    def relaxations(self, scope):
        return {"v_followed": (scope.v, scope.p.tau_followed)}


@pytest.mark.parametrize("h", [1e-4, 5e-3, 0.2])
def test_the_state_of_an_effect_relaxes_exactly(h):
    plant = Plant(rig("bench"), "lugre", [_FollowedSpeed()])
    theta = plant.theta(values_of(plant, {"tau_followed": 0.03}), RANGES)
    w = np.array([0.25, 0.04, 0.0, plant.rig.patm, plant.rig.patm])
    path = march(step_function(plant), np.zeros(2), w, np.zeros(5), h, 10, theta)
    exact = 0.04 * -np.expm1(-h * np.arange(11) / 0.03)
    np.testing.assert_allclose(path[plant.states.index("v_followed")], exact, rtol=1e-12)


def test_the_input_runs_linearly_within_the_step():
    # a valve that opens linearly passes the square of the time; one midpoint step takes that exactly
    plant = Plant(rig("servo", {"load": {"mass": "1e6 kg"}}), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    start = np.array([0.25, 0.0, 1.5e5, 1.5e5, 0.0])
    h, rate = 1e-3, 100.0
    end = march(step_function(plant), start, np.array([0.0, SUPPLY]), np.array([rate, 0.0]), h, 1, theta)[:, -1]
    stand = plant.rig
    inflow = TRUTH["C"] * 1.185 * SUPPLY * 0.5 * (rate / 10.0) * h**2
    gained = TRUTH["n"] * 287.05 * 293.15 * inflow / (stand.V01 + stand.A1 * 0.25)
    # the smooth zero of the opening adds 5e-7 over the step, of 5e-2 on average
    assert end[2] - start[2] == pytest.approx(gained, rel=1e-4)


def test_a_piston_inside_the_end_stop_comes_back_and_volumes_stay_positive():
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    start = np.array([0.4995, 0.3, 3e5, 3e5, 3e-5])
    path = march(step_function(plant), start, np.array([0.0, SUPPLY]), np.zeros(2), 1.25e-4, 1600, theta)
    assert np.all(np.isfinite(path))
    assert 0.5 < path[0].max() < 0.503
    assert path[0, -1] <= 0.5 + 1e-4
    # a trial point far outside is still a number
    start = np.array([0.9, 0.0, 3e5, 3e5, 0.0])
    far = march(step_function(plant), start, np.array([0.0, SUPPLY]), np.zeros(2), 1.25e-4, 2, theta)
    assert np.all(np.isfinite(far))


# --- stability limits ---


def test_the_limits_are_those_of_bristle_damping_and_chamber():
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    rates = fastest_rates(plant, theta)
    assert rates["bristle"] == pytest.approx(np.sqrt(4e5 / 2.4))
    assert rates["damping"] == pytest.approx((250.0 + 45.0) / 2.4)
    # the slope of the flow in its patch, into the smaller volume at the ends of the data
    slope = np.sqrt(1 - ((0.999 - 0.3) / 0.7) ** 2) / 1e-3
    stand = plant.rig
    volume = min(stand.V01 + stand.A1 * RANGES["x_low"], stand.V02 + stand.A2 * (0.5 - RANGES["x_high"]))
    assert rates["chamber"] == pytest.approx(1.2 * 287.05 * 293.15 * 1.2e-8 * 1.185 * slope / volume)


def test_the_chamber_limit_is_the_plants_own_fastest_eigenvalue():
    """The rate claimed is the eigenvalue of the pressure in its laminar patch, by CasADi's derivative."""
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    s = ca.SX.sym("s", 5)
    # chamber 2 is the smaller one at the ends of these data
    rate = plant.evaluate(ca.vertsplit(s), [-10.0, SUPPLY], theta.tolist()).explicit[3]
    slope = ca.Function("slope", [s], [ca.jacobian(rate, s[3])])
    found = -float(slope([RANGES["x_high"], 0.0, 2e5, SUPPLY * (1 - 1e-4), 0.0]))
    assert found == pytest.approx(fastest_rates(plant, theta)["chamber"], rel=2e-3)


@pytest.mark.parametrize("sigma0", [1e5, 4e5, 3e6, 2e7])
def test_the_substeps_asked_for_are_stable_and_few(sigma0):
    plant = Plant(rig(), "lugre")
    # at rest under a load that the bristle carries, where its natural frequency is not damped by sliding
    theta = plant.theta(values_of(plant, {"sigma0": sigma0, "sigma1": 0.0}), RANGES)
    need = substeps_needed(plant, theta, 1e-3)
    p1 = plant.rig.patm + ((3e5 - plant.rig.patm) * plant.rig.A2 + 5.0) / plant.rig.A1
    start = np.array([0.2, 0.0, p1, 3e5, 0.0])
    path = march(step_function(plant), start, np.array([0.0, SUPPLY]), np.zeros(2), 1e-3 / need, 2000 * need, theta)
    # a suddenly loaded spring swings to twice its static deflection, not beyond
    assert np.all(np.isfinite(path))
    assert np.abs(path[4]).max() < 2.5 * 5.0 / sigma0
    # and one substep less would break a limit
    rates, longer = fastest_rates(plant, theta), 1e-3 / max(need - 1, 1)
    limits = {"bristle": BRISTLE_LIMIT, "damping": DAMPING_LIMIT, "chamber": CHAMBER_LIMIT}
    assert need == 2 or max(longer * rates[name] / limit for name, limit in limits.items()) > 1.0


def test_a_step_beyond_the_limit_rings():
    """The negative control: the limit is there for a reason."""
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant, {"sigma0": 3e6, "sigma1": 0.0}), RANGES)
    p1 = plant.rig.patm + ((3e5 - plant.rig.patm) * plant.rig.A2 + 5.0) / plant.rig.A1
    start = np.array([0.2, 0.0, p1, 3e5, 0.0])
    h = 2.5 / np.sqrt(3e6 / 2.4)
    path = march(step_function(plant), start, np.array([0.0, SUPPLY]), np.zeros(2), h, 400, theta)
    # friction keeps it finite: it rings at three times the static deflection for ever
    assert np.abs(path[4, -100:]).max() > 2.5 * 5.0 / 3e6


def test_bounds_of_the_search_are_what_the_step_can_carry():
    plant = Plant(rig(), "lugre")
    theta = plant.theta(values_of(plant), RANGES)
    bounds = stable_upper_bounds(plant, theta, 1e-3, 2)
    h = 0.5e-3
    assert bounds["sigma0"] == pytest.approx(2.4 * (1.25 * BRISTLE_LIMIT / h) ** 2)
    assert bounds["sigma1"] == pytest.approx(1.2 * DAMPING_LIMIT * 2.4 / h)
    # twice the substeps carry four times the stiffness
    assert stable_upper_bounds(plant, theta, 1e-3, 4)["sigma0"] == pytest.approx(4 * bounds["sigma0"])


def test_a_lighter_load_needs_more_substeps_and_a_bench_needs_one():
    heavy = Plant(rig(), "lugre", [CATALOGUE["load_mass"]])
    needs = [substeps_needed(heavy, heavy.theta(values_of(heavy, {"mass": mass}), RANGES), 2e-3) for mass in (2.4, 0.1)]
    assert needs[1] > needs[0]
    bench = Plant(rig("bench"), "lugre")
    assert substeps_needed(bench, bench.theta(values_of(bench), RANGES), 1e-3) == 1
    # a step is as long at 2 kHz as at 1 kHz
    assert [substeps_needed(heavy, heavy.theta(values_of(heavy), RANGES), dt) for dt in (1e-3, 5e-4)] == [2, 1]
    assert fastest_rates(bench, bench.theta(values_of(bench), RANGES)) == {}
    assert stable_upper_bounds(bench, bench.theta(values_of(bench), RANGES), 1e-3, 1) == {}


def test_static_laws_are_bounded_by_their_carrier():
    plant = Plant(rig(), "coulomb")
    theta = plant.theta(values_of(plant), RANGES)
    assert fastest_rates(plant, theta)["bristle"] == pytest.approx(1e3)
    assert stable_upper_bounds(plant, theta, 1e-3, 2) == {}
