"""Leaks and a supply behind a restriction, against the integrals of their laws and against orifices."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import rig
from operating import at, plant_with
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from pneuid.effects import CATALOGUE
from pneuid.physics.gas import R_AIR, RHO_REFERENCE

T = 293.15
LEAKS = {1: "leakage_external_1", 2: "leakage_external_2"}


# --- leaks to the outside ---


@pytest.mark.parametrize("chamber", LEAKS)
@pytest.mark.parametrize("m", [0.5, 1.0])
def test_a_tank_blows_down_through_an_orifice_or_a_laminar_gap_as_their_integrals_say(chamber, m):
    """``p' = -k (p^2 - patm^2)^m`` at one temperature: a hyperbolic cosine (m = 1/2) or cotangent (m = 1)."""
    C, plant, patm, reference = 3e-10, plant_with(LEAKS[chamber]), rig().patm, 5e5
    assert rig().temperature == T
    name, t = f"p{chamber}", np.linspace(0, 3, 7)

    def rate(_, p):
        values = {f"C_leak_{chamber}": C, f"m_leak_{chamber}": m, "n": 1.0}
        return [float(at(plant, {name: p[0]}, values).explicit[1 + chamber])]

    found = solve_ivp(rate, (0.0, 3.0), [7e5], rtol=1e-9, t_eval=t).y[0]
    # nothing else flows: valve closed to 5e-7 of its opening, piston at rest
    V = rig().V01 + rig().A1 * 0.25 if chamber == 1 else rig().V02 + rig().A2 * 0.25
    k = R_AIR * T * C * RHO_REFERENCE / V
    by_root = patm * np.cosh(np.arccosh(7e5 / patm) - k * t)
    by_difference = patm / np.tanh(np.arctanh(patm / 7e5) + k * patm / reference * t)
    np.testing.assert_allclose(found, by_root if m == 0.5 else by_difference, rtol=2e-3)
    assert found[-1] < 0.9 * found[0]


@pytest.mark.parametrize("chamber", LEAKS)
def test_a_leak_takes_from_its_own_chamber_alone_and_nothing_at_atmospheric_pressure(chamber):
    plant, bare = plant_with(LEAKS[chamber]), plant_with()
    values = {f"C_leak_{chamber}": 3e-10}
    with_it, without = at(plant, values=values), at(bare)
    flows = [(float(with_it.mdot1), float(without.mdot1)), (float(with_it.mdot2), float(without.mdot2))]
    own, other = flows[chamber - 1], flows[2 - chamber]
    assert other[0] == other[1] and own[0] < own[1] - 1e-5
    calm = {f"p{chamber}": rig().patm}
    assert float(getattr(at(plant, calm, values), f"mdot{chamber}")) == float(getattr(at(bare, calm), f"mdot{chamber}"))
    # below atmospheric pressure it lets air in
    low = {f"p{chamber}": 0.9e5}
    assert float(getattr(at(plant, low, values), f"mdot{chamber}")) > float(getattr(at(bare, low), f"mdot{chamber}"))


# --- the form that a power stands for: a leak across the piston ---


def _orifice(p_from: np.ndarray, p_to: np.ndarray, b: float) -> np.ndarray:
    """Flow of an orifice over its conductance, ISO 6358-1:2013, eq. (1) and (2), of pressures in bar."""
    beyond = np.maximum(p_to / p_from - b, 0.0) / (1.0 - b)
    return p_from * np.sqrt(np.maximum(1.0 - beyond**2, 0.0))


def _missed(shape, flow: np.ndarray, start: float, low: float, high: float) -> float:
    """Share of a flow that its best fit by ``scale * shape(m)``, m within bounds, leaves."""

    def left(m: np.ndarray) -> np.ndarray:
        found = shape(float(m[0]))
        return flow - found * (flow @ found) / (found @ found)

    found = least_squares(left, [start], bounds=([low], [high]))
    return float(np.sqrt(np.mean(found.fun**2) / np.mean(flow**2)))


@pytest.mark.parametrize(("b", "power", "line"), [(0.15, 0.02, 0.25), (0.25, 0.03, 0.25), (0.5, 0.08, 0.30)])
def test_a_sharp_edged_leak_is_nearly_a_power_of_the_squared_pressures_and_no_straight_line(b, power, line):
    """As is a laminar gap of a compressible gas, exactly."""
    plant, bare = plant_with("leakage_internal"), plant_with()
    p1, p2 = np.meshgrid(np.linspace(1.5e5, 7.5e5, 9), np.linspace(1.6e5, 7.4e5, 9))
    p1, p2 = p1.ravel(), p2.ravel()

    def shown(m: float) -> np.ndarray:
        pairs = [{"p1": a, "p2": c} for a, c in zip(p1, p2, strict=True)]
        values = {"G_leak": 1e-9, "m_leak": m}
        return np.array([float(at(bare, pair).mdot1) - float(at(plant, pair, values).mdot1) for pair in pairs])

    own = plant.parameters[plant.parameter_names.index("m_leak")]
    sign, high, low = np.sign(p1 - p2), np.maximum(p1, p2) / 1e5, np.minimum(p1, p2) / 1e5
    edge = sign * _orifice(high, low, b)
    assert _missed(shown, edge, own.start, own.lower, own.upper) < power
    assert _missed(lambda _: p1 - p2, edge, own.start, own.lower, own.upper) > line
    assert _missed(shown, p1**2 - p2**2, own.start, own.lower, own.upper) < 0.01


# --- a supply behind a restriction ---


def _drop(power: float, chokes: float, r: float, tau: float, drawn, t: np.ndarray) -> np.ndarray:
    """Relative drop ``(N,)`` by the catalogue's law at times ``t`` s, with ``drawn(t)`` in choked flows of the open valve."""
    p = SimpleNamespace(r_supply=r, m_supply=power, q_supply=chokes, tau_supply=tau)

    def rate(now, q):
        scope = SimpleNamespace(p=p, state=SimpleNamespace(q_drop=q[0]), supply_flow=drawn(now), full_flow=1.0)
        target, lasts = CATALOGUE["supply_droop"].relaxations(scope)["q_drop"]
        return [float((target - q[0]) / lasts)]

    q = solve_ivp(rate, (0.0, t[-1]), [0.0], "LSODA", t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.01).y[0]
    return r * q


def _pulses(t: float) -> float:
    """Strokes and rests, the last of them beyond what the orifice passes."""
    return 0.0 if t % 0.7 > 0.4 else (0.12, 0.3, 0.55)[int(t / 0.7) % 3]


def test_a_tank_behind_an_orifice_sinks_and_fills_as_its_balance_of_mass_says():
    """``d' = k (Q - C psi(1 - d))`` of a tank at one temperature behind an orifice that chokes at ``C``."""
    chokes, b, k, t = 0.4, 0.3, 2.5, np.linspace(0.0, 2.1, 211)

    def rate(now, d):
        return [k * (_pulses(now) - chokes * float(_orifice(np.array(1.0), np.array(1.0 - max(d[0], 0.0)), b)))]

    tank = solve_ivp(rate, (0.0, t[-1]), [0.0], "LSODA", t_eval=t, rtol=1e-8, max_step=1e-3).y[0]
    r = (1.0 - b) / (np.sqrt(7.0) * chokes)
    found = _drop(2.0, chokes, r, r / k, _pulses, t)
    assert tank.max() > 0.25, "the last stroke empties it"
    assert np.abs(found - tank).max() < 0.01


def test_behind_a_regulator_the_drop_is_the_flow_drawn_through_a_first_order_lag():
    t = np.linspace(0.0, 0.4, 41)
    found = _drop(1.0, 0.3, 0.5, 0.1, _pulses, t)
    np.testing.assert_allclose(found, 0.5 * 0.12 * (1.0 - np.exp(-t / 0.1)), atol=1e-6)


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_the_steady_drop_grows_with_a_power_of_a_small_flow(power):
    ends = [_drop(power, 1.0, 0.5, 0.05, lambda _, q=q: q, np.array([0.0, 4.0]))[-1] for q in (0.2, 0.4)]
    assert np.log2(ends[1] / ends[0]) == pytest.approx(power, rel=0.04)
