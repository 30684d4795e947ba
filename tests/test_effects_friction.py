"""Friction effects against closed forms, on the bench: the motion is imposed, so friction alone is seen."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, rig, step_function, values_of
from operating import at
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from pneuid import api
from pneuid.effect import Effect
from pneuid.effects import CATALOGUE, LAW_STEPS
from pneuid.errors import UserError
from pneuid.physics.friction import CARRIER_FREQUENCY, LAWS
from pneuid.plant import Plant

BASE = {"Fc": 12.0, "Fs": 20.0, "vs": 0.008, "sigma0": 4e5, "sigma1": 250.0, "sigma2": 45.0}


@cache
def plant_with(name: str, law: str = "lugre") -> Plant:
    return Plant(rig("bench"), law, [CATALOGUE[name]])


@cache
def _functions(plant: Plant) -> tuple[ca.Function, ca.Function]:
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    return step_function(plant), ca.Function("F", [s, w, theta], [plant.evaluate(s, w, theta).friction])


def moved(
    plant: Plant, v: np.ndarray, h: float, changes: dict[str, float], start: dict[str, float] | None = None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Friction force ``(N,)`` and states under the imposed speed ``v (N,)`` sampled every ``h`` s, linear between."""
    step, force = _functions(plant)
    theta = plant.theta(values_of(plant, BASE | changes), RANGES)
    given = {"v": v, "x": 0.25 + h * np.cumsum(v), "p1": 0 * v + 1.2e5, "p2": 0 * v + 1.2e5, "a": 0 * v}
    w = np.vstack([given[name] for name in plant.inputs])
    slope = np.diff(w, axis=1, append=w[:, -1:]) / h
    s0 = np.array([{own.name: own.initial for own in plant.effect_states}.get(name, 0.0) for name in plant.states])
    for name, value in (start or {}).items():
        s0[plant.states.index(name)] = value
    n = v.size - 1
    path = np.column_stack([s0, np.asarray(step.mapaccum(n)(s0, w[:, :n], slope[:, :n], h, theta))])
    found = np.asarray(force.map(v.size)(path, w, ca.repmat(ca.DM(theta), 1, v.size))).ravel()
    return found, dict(zip(plant.states, path, strict=True))


# --- friction along the stroke ---


@pytest.mark.parametrize(("height", "width", "place"), [(0.4, 0.05, 0.3), (1.5, 0.05, 0.62), (-0.3, 0.1, 0.5)])
def test_the_waves_follow_a_tight_ring_without_straining_their_priors(height, width, place):
    plant = plant_with("friction_position")
    waves = [item for item in plant.parameters if plant.owner[item.name] == "friction_position"]
    s = np.linspace(0.0, 1.0, 201)
    wanted = height * np.exp(-(((s - place) / width) ** 2))
    low, high = RANGES["x_low"], RANGES["x_high"]

    def factor(values: dict[str, float]) -> np.ndarray:
        theta = plant.theta(values_of(plant, BASE | values), RANGES)
        along = [plant.evaluate([0.0], [low + (high - low) * at, 0.05, 0.0, 1.2e5, 1.2e5], theta) for at in s]
        return np.array([float(one.coefficients.Fc) for one in along]) / BASE["Fc"] - 1.0

    columns = np.column_stack([factor({item.name: 0.1}) / 0.1 for item in waves])
    design = np.column_stack([np.ones(s.size), columns])
    _, *best = found = np.linalg.lstsq(design, wanted, rcond=None)[0]
    assert np.abs(design @ found - wanted).max() < 0.2 * abs(height)
    assert all(abs(value) < 3.0 * item.prior for value, item in zip(best, waves, strict=True))


# --- nonlinear viscous friction ---


@pytest.mark.parametrize("power", [0.4, 1.0, 2.0])
def test_viscous_force_grows_with_the_power_of_the_speed(power):
    plant = plant_with("friction_viscous_nonlinear")
    theta = plant.theta(values_of(plant, BASE | {"d_viscous": power, "v_knee": 1e-3}), RANGES)
    for v in (0.05, 0.1, 0.4, -0.4):
        at = plant.evaluate([0.0], [0.25, v, 0.0, 1.2e5, 1.2e5], theta)
        expected = 45.0 * v * (abs(v) / 0.1) ** (power - 1)
        # the rounding below 1 mm/s reaches a few times 1e-4 at 50 mm/s
        assert float(at.coefficients.sigma2) * v == pytest.approx(expected, rel=3e-4)


@pytest.mark.parametrize(("power", "knee"), [(0.4, 0.05), (1.0, 0.3), (2.5, 0.2)])
def test_below_the_knee_viscous_force_is_in_proportion_to_speed(power, knee):
    plant = plant_with("friction_viscous_nonlinear")
    theta = plant.theta(values_of(plant, BASE | {"d_viscous": power, "v_knee": knee}), RANGES)
    slope = {v: float(plant.evaluate([0.0], [0.25, v, 0.0, 1.2e5, 1.2e5], theta).coefficients.sigma2) for v in SPEEDS}
    assert slope[0.1] == pytest.approx(45.0) and slope[-0.1] == slope[0.1]
    assert slope[1e-3] == pytest.approx(slope[2e-3], rel=2e-3)
    assert slope[40.0] / slope[20.0] == pytest.approx(2.0 ** (power - 1.0), rel=1e-3)


def test_half_a_power_above_a_knee_is_nearly_the_film_of_eyring():
    """``F_v asinh(v/v_0)`` over speeds up to twice its own, within 1 % of the largest force."""
    v = np.linspace(0.0, 0.56, 200)
    asked = np.arcsinh(v / 0.278)

    def left(at):
        found = v * (v * v + at[1] ** 2) ** (0.5 * (at[0] - 1.0))
        return at[2] * found - asked

    assert np.max(np.abs(left(least_squares(left, [0.5, 0.3, 3.0]).x))) < 0.01 * asked[-1]


SPEEDS = (1e-3, 2e-3, 0.1, -0.1, 20.0, 40.0)


# --- dwell ---

DWELL = {"Fs_dwell": 15.0, "tau_dwell": 1.0, "m_dwell": 1.0, "slip_dwell": 5e-4, "creep_dwell": 2e-4, "wipe_dwell": 0.0}


def break_away(hold: float, changes: dict[str, float], age: float = 0.0) -> float:
    """Largest friction at the start of a 4 mm/s stroke after ``hold`` s at rest, from contacts of an ``age``."""
    h = 5e-4
    v = np.concatenate([np.zeros(round(hold / h)), np.linspace(0.0, 0.004, 20), np.full(100, 0.004)])
    return float(moved(plant_with("friction_dwell"), v, h, changes, {"age": age})[0].max())


@pytest.mark.parametrize("power", [1.0, 0.5])
def test_break_away_rises_with_a_power_of_the_time_at_rest_to_its_asymptote(power):
    # of what lasts a stroke wipes nothing out before its peak
    lasting = DWELL | {"m_dwell": power, "tau_dwell": 2.0, "slip_dwell": 5e-3}
    fresh, longest = break_away(0.0, lasting), break_away(0.0, lasting, age=1e3)
    without = break_away(0.0, DWELL | {"Fs_dwell": 0.0})
    assert without < fresh < without + (0.2 if power == 1.0 else 1.0)
    # a stroke at half the Stribeck velocity shows exp(-1/4) of the surplus
    assert 0.8 * 15.0 * np.exp(-0.25) < longest - without < 15.0 * np.exp(-0.25)
    at = np.array([0.25, 1.0, 2.5])
    rises = np.array([(break_away(hold, lasting) - without) / (longest - without) for hold in at])
    assert rises == pytest.approx(1 - np.exp(-((at / 2.0) ** power)), abs=0.03)
    short = break_away(1.0, lasting | {"slip_dwell": 2e-4})
    assert short < break_away(1.0, lasting) - 1.0, "a short slip distance wipes it out while it shows"


def test_sliding_wipes_the_age_out_over_the_slip_distance():
    h, speed = 1e-4, 0.2
    v = np.full(401, speed)
    age = moved(plant_with("friction_dwell"), v, h, DWELL | {"tau_dwell": 1e4, "slip_dwell": 2e-3}, {"age": 1.0})[1][
        "age"
    ]
    assert age[-1] == pytest.approx(np.exp(-speed * 400 * h / 2e-3), rel=1e-3)


@pytest.mark.parametrize("speed", [0.02, 0.5])
def test_fast_sliding_wipes_the_age_out_in_no_less_than_its_time(speed):
    h, D, time = 1e-4, 1e-5, 15e-3
    changes = DWELL | {"tau_dwell": 1e4, "slip_dwell": D, "wipe_dwell": time}
    age = moved(plant_with("friction_dwell"), np.full(401, speed), h, changes, {"age": 1.0})[1]["age"]
    assert age[-1] == pytest.approx(np.exp(-400 * h / (time + D / speed)), rel=2e-3)


def test_contacts_that_creep_age_and_those_that_slide_do_not():
    """At 1 mm/s, a fifth of the Stribeck velocity, a steady age would be D/|v| = 0.5 s."""
    h = 1e-3
    for speed, most in ((1e-3, 0.025), (1e-5, 3.0)):
        age = moved(plant_with("friction_dwell"), np.full(3001, speed), h, DWELL, {"age": 0.0})[1]["age"]
        assert 0.7 * most < age[-1] < most


def test_contacts_that_age_whatever_they_do_are_as_old_as_the_slip_over_the_speed():
    """The ageing law of rate-and-state friction."""
    always = DWELL | {"creep_dwell": 1.0}
    for speed in (1e-3, 1e-2):
        age = moved(plant_with("friction_dwell"), np.full(6001, speed), 1e-3, always, {"age": 0.0})[1]["age"]
        assert age[-1] == pytest.approx(DWELL["slip_dwell"] / speed, rel=0.02)


@pytest.mark.parametrize(("area", "largest"), [(8e-4, 160.0), (0.0, 200.0)])
def test_a_bench_that_states_no_bore_does_not_hold_the_rise_of_break_away(area, largest):
    """Of a friction of 50 N the rise of 30 N was held at 10."""
    stand = SimpleNamespace(A1=area, kind="bench")
    every = CATALOGUE["friction_dwell"].parameters(stand, LAWS["lugre"])  # type: ignore[arg-type]
    rise = next(one for one in every if one.name == "Fs_dwell")
    assert (rise.lower, rise.upper) == pytest.approx((0.0, largest))


# --- warming up ---


def test_friction_falls_by_the_power_it_dissipates():
    plant = plant_with("friction_warmup")
    h, v, tau, w = 1e-3, 0.2, 0.5, 0.05
    force, states = moved(plant, np.full(4001, v), h, {"w_warm": w, "tau_warm": tau})
    typical = 0.1 * max(3.0, 1e4 * plant.rig.A1)
    cold = 12.0 + 45.0 * v

    def warmth(_, q):
        return [(cold * np.exp(-w * q[0]) * v / typical - q[0]) / tau]

    expected = solve_ivp(warmth, (0.0, 4.0), [0.0], rtol=1e-9, t_eval=[1.0, 4.0]).y[0]
    assert states["fall"][[1000, 4000]] == pytest.approx((w + 0.01) * expected, rel=5e-3)
    assert force[-1] == pytest.approx(cold * np.exp(-w * expected[-1]), rel=1e-3)
    assert force[-1] < 0.9 * force[100]


@pytest.mark.parametrize("g", [0.5, 1.0, 2.5])
def test_viscous_friction_falls_as_many_times_as_fast_as_g_says(g):
    plant = plant_with("friction_warmup")
    theta = plant.theta(values_of(plant, BASE | {"w_warm": 0.4, "g_warm": g}), RANGES)
    warm = dict.fromkeys(plant.states, 0.0) | {"fall": 0.8 * (0.4 + 0.01)}
    k = plant.evaluate(list(warm.values()), [0.25, 0.05, 0.0, 1.2e5, 1.2e5], theta).coefficients
    fallen = [np.log(float(getattr(k, name)) / BASE[name]) for name in ("Fc", "Fs", "sigma2")]
    assert fallen == pytest.approx([-0.32, -0.32, -0.32 * g])


# --- frictional memory ---


def phase_of(signal: np.ndarray, t: np.ndarray, omega: float) -> float:
    return float(np.angle(np.sum((signal - signal.mean()) * np.exp(-1j * omega * t))))


FIRST_ORDER, PURE = {"order_L": 0.0, "swing_L": 0.0}, {"order_L": 0.5, "swing_L": 0.5}


def _late_by(hertz: float, tau: float, shape: dict[str, float]) -> float:
    """Phase of friction against that without a delay, in a small swing of speed around the Stribeck velocity, no reversal."""
    # the stiff bristle of a static law adds no delay
    plant = plant_with("friction_lag", "stribeck")
    h, omega = 1e-4, 2 * np.pi * hertz
    t = h * np.arange(round(3 * 2 * np.pi / omega / h) + 1)
    v = 0.008 + 0.001 * np.sin(omega * t)
    last = t >= t[-1] - 2 * np.pi / omega + h / 2
    forces = (moved(plant, v, h, {"tau_L": delay, "shrink_L": 1.0, "sigma2": 0.0} | shape)[0] for delay in (0.0, tau))
    without, late = (phase_of(force[last], t[last], omega) for force in forces)
    return late - without


def test_sliding_friction_answers_late_to_a_change_of_speed():
    omega, tau = 2 * np.pi * 4.0, 0.015
    # v - c (v - y) with y the plain lag of time constant T: (1 + (T - tau) s) / (1 + T s)
    T = np.hypot(tau, 2e-3)
    expected = np.angle((1 + 1j * omega * (T - tau)) / (1 + 1j * omega * T))
    assert _late_by(4.0, tau, FIRST_ORDER) == pytest.approx(expected, abs=0.01)
    assert expected == pytest.approx(-np.arctan(omega * tau), abs=0.01)


@pytest.mark.parametrize("hertz", [2.0, 6.0])
def test_of_second_order_it_answers_late_by_a_pure_delay(hertz):
    """Up to half a radian; at one radian the two lags are later by a tenth."""
    tau = 0.015
    assert _late_by(hertz, tau, PURE) == pytest.approx(-2 * np.pi * hertz * tau, rel=0.05)


def test_further_on_it_answers_as_textbooks_have_the_second_order():
    tau, damping = 0.015, np.sqrt(0.5)
    w = 2 * np.pi * 10.0 * tau / (2.0 * damping)  # over the natural frequency, of the same mean delay
    assert _late_by(10.0, tau, PURE) == pytest.approx(-np.arctan2(2.0 * damping * w, 1.0 - w * w), rel=0.03)


def test_a_film_carries_over_a_reversal():
    # fast one way, then at once fast the other way: |v| hardly changes, so neither does what the bristle levels off at
    plant = plant_with("friction_lag", "stribeck")
    h, tau, values = 1e-4, 0.03, {"sigma2": 0.0, "Fc": 12.0, "Fs": 20.0, "vs": 0.008}
    v = np.concatenate([np.full(4000, 0.1), np.full(400, -0.1)])
    force = moved(plant, v, h, values | {"tau_L": tau})[0]
    assert np.all(np.abs(force[3900:3999] - 12.0) < 0.05)
    # settled 5 ms after the reversal, long before a signed speed delayed by 30 ms would have passed the Stribeck bump
    assert np.all(np.abs(force[4060:] + 12.0) < 0.1)
    late = moved(plant, np.concatenate([np.full(4000, 0.1), np.full(3000, 1e-4)]), h, values | {"tau_L": tau})[0]
    assert late[4050] < 13.0, "the film is still there"
    assert late[-1] > 19.0, "it is squeezed out within a few delays"


@pytest.mark.parametrize(("v", "times"), [(0.2, 1.0), (-0.2, 1.0), (0.01, 7.0), (0.0, 7.0)])
def test_a_film_is_drawn_in_faster_than_it_is_squeezed_out(v, times):
    tau = 0.03
    pulled, decay = at(
        plant_with("friction_lag"), {"v": v, "v_drawn": 0.1, "v_lagged": 0.1}, {"tau_L": tau, "shrink_L": 7.0} | FIRST_ORDER
    ).relaxing[-2]
    assert 1.0 / float(decay) == pytest.approx(times * tau, rel=5e-3)
    assert float(pulled) / float(decay) == pytest.approx(abs(v), abs=2e-4)


# --- richer laws ---


@pytest.mark.parametrize("simple", LAWS)
@pytest.mark.parametrize("step", LAW_STEPS.values(), ids=lambda step: step.name)
def test_a_step_leads_to_its_law_or_is_refused(step: Effect, simple: str):
    if simple in step.laws or simple == step.richer_law:
        assert api.plant_of(rig(), [step.name], (), simple).law.name == step.richer_law
        assert api.plant_of(rig(), [step.name], (), simple).effects == ()
    else:
        with pytest.raises(UserError, match=f"'{step.name}' leads from"):
            api.plant_of(rig(), [step.name], (), simple)


@pytest.mark.parametrize("kind", ["servo", "bench"])
@pytest.mark.parametrize("step", LAW_STEPS.values(), ids=lambda step: step.name)
def test_a_step_starts_every_coefficient_that_the_simple_law_lacks(step: Effect, kind: str):
    stand = rig(kind)
    for simple in step.laws:
        plant, richer = Plant(stand, simple), Plant(stand, str(step.richer_law))
        values = values_of(plant)
        start = values | step.law_start(values, {}, stand)
        bounds = {item.name: item for item in richer.parameters}
        # the Stribeck velocity keeps its declared start
        assert set(richer.law.fitted) - set(start) <= {"vs"}
        for name in set(start) & set(bounds):
            assert bounds[name].lower <= start[name] <= bounds[name].upper, name


def test_the_screened_amplitudes_are_the_richer_laws_coefficients():
    stand = rig()
    soft = LAW_STEPS["law:lugre"]
    carrier = stand.mass * CARRIER_FREQUENCY**2
    start = soft.law_start({"Fc": 10.0}, {"compliance_lugre": 1 / 4e5 - 1 / carrier, "dFs_lugre": 6.0}, stand)
    assert start["sigma0"] == pytest.approx(4e5) and start["Fs"] == pytest.approx(16.0)
    # the screening form has that very stiffness
    plant = Plant(stand, "coulomb", [soft])
    theta = plant.theta(values_of(plant, {"compliance_lugre": 1 / 4e5 - 1 / carrier}), RANGES)
    at = plant.evaluate([0.2, 0.0, 2e5, 2e5, 0.0], [0.0, 7e5], theta)
    assert float(at.coefficients.sigma0) == pytest.approx(4e5)


def test_an_effect_that_a_law_cannot_show_is_refused():
    with pytest.raises(UserError, match=r"friction_lag.*lugre or stribeck"):
        api.plant_of(rig(friction="coulomb"), ["friction_lag"])
