"""Leaks and a supply behind an orifice, against the integrals of their laws and against orifices."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import rig
from operating import at, plant_with
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, least_squares

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


# --- forms that a power stands for: a leak across the piston, a supply behind an orifice ---


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


@pytest.mark.parametrize("ratio", [0.25, 0.5, 0.9])
def test_the_drop_of_a_supply_behind_an_orifice_is_nearly_a_power_of_the_flow_and_no_straight_line(ratio):
    """Steady flows up to a ``ratio`` of the orifice's choked flow; the exponent's bounds are the catalogue's."""
    flow = np.linspace(0.02, ratio, 60)
    drop = np.array([brentq(lambda d, q=q: float(_orifice(np.array(1.0), np.array(1.0 - d), 0.3)) - q, 0.0, 0.7) for q in flow])
    plant = plant_with("supply_droop")
    own = plant.parameters[plant.parameter_names.index("m_supply")]
    by_power = _missed(lambda m: flow**m, drop, own.start, own.lower, own.upper)
    by_line = _missed(lambda _: flow, drop, own.start, own.lower, own.upper)
    assert by_power < 0.07 and by_line > 0.2
