"""Pneumatic effects against closed forms, balances, and rig files that say the same."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import TRUTH, rig
from hypothesis import given
from hypothesis import strategies as st
from operating import SERVO_POINT, at, plant_with
from scipy.optimize import brentq

from pneuid.physics.chamber import pressure_rate, temperature_pressure_rate, temperature_relaxation, wall_area
from pneuid.physics.gas import CV_AIR, GAMMA_AIR, R_AIR, RHO_REFERENCE, T_REFERENCE

T = 293.15


# --- dead volume ---


@given(st.floats(-8e-6, 5e-5), st.floats(-9e-6, 5e-5), st.floats(0.02, 0.48), st.floats(-8.0, 8.0))
def test_dead_volumes_are_those_of_a_rig_file_that_says_so(d1, d2, x, u):
    other = rig(changes={"cylinder": {"dead_volume_1": f"{12e-6 + d1!r} m^3", "dead_volume_2": f"{14e-6 + d2!r} m^3"}})
    point = {"x": x, "u": u, "v": 0.2}
    freed = at(plant_with("dead_volume"), point, {"dV01": d1, "dV02": d2})
    np.testing.assert_allclose(
        [float(item) for item in freed.explicit],
        [float(item) for item in at(plant_with(on=other), point).explicit],
        rtol=1e-12,
    )


# --- heat transfer ---

gas_states = st.tuples(
    st.floats(-60.0, 60.0), st.floats(1e5, 9e5), st.floats(1e-5, 5e-4), st.floats(-5e-4, 5e-4), st.floats(-5e-3, 5e-3),
    st.floats(0.0, 20.0),
)  # fmt: skip


def _rates(gas: tuple[float, ...]) -> tuple[float, float]:
    """Pressure and temperature rate of the full energy balance."""
    excess, p, V, V_rate, mdot, wall = gas
    filling, emptying = max(mdot, 0.0), max(-mdot, 0.0)
    source, decay = temperature_relaxation(excess, p, V, V_rate, filling, emptying, wall, T)
    p_rate = pressure_rate(p, V, V_rate, mdot, GAMMA_AIR, T) + temperature_pressure_rate(excess, V, emptying, wall)
    return p_rate, float(source - decay * excess)


@given(gas_states)
def test_the_full_energy_balance_keeps_mass_and_energy(gas):
    excess, p, V, V_rate, mdot, wall = gas
    p_rate, T_rate = _rates(gas)
    absolute = T + excess
    m = p * V / (R_AIR * absolute)
    # ideal gas: d ln p + d ln V - d ln T = d ln m
    terms = [p_rate / p, V_rate / V, -T_rate / absolute, -mdot / m]
    assert sum(terms) == pytest.approx(0.0, abs=1e-9 * max(map(abs, terms)) + 1e-12)
    # first law of the open system: air enters at T, leaves as it is
    inner = CV_AIR * (mdot * absolute + m * T_rate)
    enthalpy = GAMMA_AIR * CV_AIR * mdot * (T if mdot > 0 else absolute)
    balance = [inner, -enthalpy, p * V_rate, wall * excess]
    assert sum(balance) == pytest.approx(0.0, abs=1e-9 * max(map(abs, balance)) + 1e-12)


@given(gas_states)
def test_a_perfect_wall_makes_it_isothermal_and_none_adiabatic(gas):
    _, p, V, V_rate, mdot, _ = gas
    wall = 1e9
    filling, emptying = max(mdot, 0.0), max(-mdot, 0.0)
    source, decay = temperature_relaxation(0.0, p, V, V_rate, filling, emptying, wall, T)
    rate, _ = _rates((float(source / decay), p, V, V_rate, mdot, wall))
    terms = (R_AIR * T * mdot / V, p * V_rate / V)
    assert rate == pytest.approx(pressure_rate(p, V, V_rate, mdot, 1.0, T), abs=1e-6 * max(map(abs, terms)) + 1e-9)
    # without a wall a closed chamber keeps T V^(gamma-1) and p V^gamma
    cold, T_rate = _rates((0.0, p, V, V_rate, 0.0, 0.0))
    assert cold / p == pytest.approx(-GAMMA_AIR * V_rate / V, rel=1e-12)
    assert T_rate / T == pytest.approx(-(GAMMA_AIR - 1.0) * V_rate / V, rel=1e-12)


@pytest.mark.parametrize(("stir", "dense"), [(0.01, 0.0), (8.0, 0.8)])
def test_the_effect_is_that_energy_balance_at_full_weight(stir, dense):
    plant = plant_with("heat_transfer")
    choked = float(at(plant_with(), {"u": 10.0, "p1": rig().patm}).mdot1)  # at the rig's nominal supply
    for u, v in ((4.0, 0.3), (-4.0, -0.3), (0.0, 0.2)):
        point = {"u": u, "v": v, "theta_1": 12.0, "theta_2": -9.0}
        values = {"heat_weight": 1.0, "h_wall": 70.0, "h_stir": stir, "h_dense": dense, "n": GAMMA_AIR}
        stages = at(plant, point, values)
        A1, A2 = rig().A1, rig().A2
        for i, (p, V, V_rate, A, mdot, excess) in enumerate((
            (4e5, rig().V01 + A1 * 0.25, A1 * v, A1, float(stages.mdot1), 12.0),
            (3e5, rig().V02 + A2 * 0.25, -A2 * v, A2, float(stages.mdot2), -9.0),
        )):  # fmt: skip
            moved = (abs(mdot) + abs(V_rate) * p / (R_AIR * T)) / choked
            h = 70.0 * (1.0 + stir * moved) * (p / 4e5) ** dense
            p_rate, T_rate = _rates((excess, p, V, V_rate, mdot, h * float(wall_area(V, A))))
            source, decay = stages.relaxing[1 + i]
            # the sign of the flow is rounded over a millionth of the full flow
            assert float(stages.explicit[2 + i]) == pytest.approx(p_rate, rel=1e-3)
            assert float(source) - float(decay) * excess == pytest.approx(T_rate, rel=1e-3, abs=1e-3)


def test_the_wall_of_a_cylinder_is_ends_and_mantle():
    bore, length = 0.032, 0.3
    A = np.pi / 4 * bore**2
    assert float(wall_area(A * length, A)) == pytest.approx(2 * A + np.pi * bore * length, rel=1e-12)


# --- inlet mixing ---


@pytest.mark.parametrize("u", [7.0, -7.0])
@pytest.mark.parametrize("v", [0.0, 0.3])
@pytest.mark.parametrize("q", [1e-3, 0.2])
def test_air_that_enters_and_air_that_leaves_have_exponents_of_their_own(u, v, q):
    d, n = 0.15, 1.2
    stages = at(plant_with("inlet_mixing"), {"u": u, "v": v}, {"mixing": d, "mixing_flow": q, "n": n})
    choked = float(at(plant_with(), {"u": 10.0, "p1": rig().patm}).mdot1)  # at the rig's nominal supply
    for number, (p, V, V_rate, mdot) in enumerate(
        (
            (SERVO_POINT["p1"], rig().V01 + rig().A1 * 0.25, rig().A1 * v, float(stages.mdot1)),
            (SERVO_POINT["p2"], rig().V02 + rig().A2 * (rig().stroke - 0.25), -rig().A2 * v, float(stages.mdot2)),
        )
    ):
        of_flow = n + d * mdot / np.hypot(mdot, q * choked)
        expected = (of_flow * R_AIR * T * mdot - n * p * V_rate) / V
        assert float(stages.explicit[2 + number]) == pytest.approx(expected, rel=1e-6)
    assert float(stages.mdot1) * float(stages.mdot2) < 0, "one fills while the other empties"


def test_mixing_adds_nothing_where_nothing_flows():
    still = {"p1": rig().patm, "p2": rig().patm, "psup": rig().patm}
    plain, mixed = at(plant_with(), still), at(plant_with("inlet_mixing"), still, {"mixing": 0.3})
    for number in (2, 3):
        assert float(mixed.explicit[number]) == pytest.approx(float(plain.explicit[number]), abs=1e-6)


# --- exhaust, null leakage, critical ratio ---


def in_series(s: float, p: float, r: float, b: float, patm: float) -> float:
    """Share of its flow that an edge of opening ``s`` keeps with a silencer behind it, the pressure between by bisection."""

    def flow(up: float, down: float) -> float:
        return up * np.sqrt(1.0 - (max(down / up - b, 0.0) / (1.0 - b)) ** 2)

    between = brentq(lambda back: s * flow(p, back) - flow(back, patm) / np.sqrt(r), patm * (1 + 1e-12), p)
    return flow(p, between) / flow(p, patm)


@given(st.floats(0.05, 1.0), st.floats(1.3e5, 9e5), st.floats(0.05, 3.0), st.sampled_from([-1.0, 1.0]))
def test_behind_a_silencer_the_exhaust_edge_meets_the_pressure_that_builds_up(s, p, r, side):
    point, plant = {"u": 10.0 * side * s, "p2" if side > 0 else "p1": p}, plant_with("exhaust_restriction")
    source, decay = at(plant, point, {"r_exhaust": r}).relaxing[1]
    filled = {**point, "back_pressure": float(source) / float(decay)}
    with_it, without = at(plant, filled, {"r_exhaust": r}), at(plant_with(), point)
    filling, venting = ("mdot1", "mdot2") if side > 0 else ("mdot2", "mdot1")
    assert float(getattr(with_it, filling)) == pytest.approx(float(getattr(without, filling)), rel=1e-9)
    share = float(getattr(with_it, venting)) / float(getattr(without, venting))
    assert share == pytest.approx(in_series(s, p, r, rig().critical_ratio, rig().patm), rel=0.08)


def test_a_silencer_of_some_volume_builds_its_pressure_up_within_its_time_constant():
    tau, values = 20e-3, {"r_exhaust": 1.0, "tau_exhaust": 20e-3}
    plant, point = plant_with("exhaust_restriction"), {"u": 5.0, "p2": 4e5}
    bare = float(at(plant_with(), point).mdot2)
    source, decay = map(float, at(plant, point, values).relaxing[1])
    assert 1.0 / decay == pytest.approx(tau, rel=0.01)
    aim = source / decay
    shares = [float(at(plant, {**point, "back_pressure": part * aim}, values).mdot2) / bare for part in (0.0, 0.5, 1.0)]
    # an empty silencer takes what the edge lets through, but for the little that the shortest lag passes at once
    assert shares[0] > 0.99 and shares[0] > shares[1] > shares[2]
    assert shares[2] == pytest.approx(in_series(0.5, 4e5, 1.0, rig().critical_ratio, rig().patm), rel=0.08)


@pytest.mark.parametrize("u", [0.5, -0.5])
def test_an_exhaust_edge_that_stays_choked_does_not_feel_the_silencer(u):
    venting, point = "mdot2" if u > 0 else "mdot1", {"u": u, "p1": 8e5, "p2": 8e5}
    with_it, without = at(plant_with("exhaust_restriction"), point, {"r_exhaust": 0.5}), at(plant_with(), point)
    assert float(getattr(with_it, venting)) == pytest.approx(float(getattr(without, venting)), rel=1e-3)


def test_null_leakage_feeds_and_vents_both_chambers_at_null_and_fades_with_the_opening():
    plant, bare = plant_with("valve_null_leakage"), plant_with()
    values = {"null_leak": 0.01, "null_width": 0.05, "null_cover": 0.1}
    vented, charged = {"p1": 1.02e5, "p2": 6.9e5}, {"p1": 6.9e5, "p2": 1.02e5}
    for point, sign in ((vented, 1.0), (charged, -1.0)):
        stages = at(plant, point, values)
        assert sign * float(stages.mdot1) > 1e-6
        assert sign * float(stages.mdot2) < -1e-6
    full = TRUTH["C"] * RHO_REFERENCE * np.sqrt(T_REFERENCE / T)
    # choked both ways: 1 % of the full flow in, 1 % of the full flow out
    found = float(at(plant, {"p1": 2.2e5, "psup": 8e5}, values).mdot1)
    assert found == pytest.approx(0.01 * full * (8e5 - 2.2e5) * 1.0, rel=0.05)
    for s in (0.05, 0.5):
        edges, plain = at(plant, {"u": 10 * s}, values).edges, at(bare, {"u": 10 * s}).edges
        extra = [getattr(edges, n) - getattr(plain, n) for n in ("supply_1", "supply_2", "exhaust_1", "exhaust_2")]
        open_edge, covered = (0.01 / (1 + (s / width) ** 2) for width in (0.05, 0.1))
        np.testing.assert_allclose([float(item) for item in extra], [open_edge, covered, covered, open_edge], rtol=1e-3)


def test_the_edges_of_the_supply_may_leak_more_than_those_of_the_exhaust():
    plant, bare = plant_with("valve_null_leakage"), plant_with()
    edges, plain = at(plant, values={"null_leak": 0.01, "null_skew": 0.4}).edges, at(bare).edges
    extra = [float(getattr(edges, n) - getattr(plain, n)) for n in ("supply_1", "supply_2", "exhaust_1", "exhaust_2")]
    np.testing.assert_allclose(extra, [0.014, 0.014, 0.006, 0.006], rtol=1e-6)


@given(st.floats(0.05, 0.7), st.floats(1.1e5, 6.9e5), st.floats(1.1e5, 6.9e5), st.floats(-10.0, 10.0))
def test_the_critical_ratio_is_that_of_a_rig_file_that_says_so(b, p1, p2, u):
    point = {"p1": p1, "p2": p2, "u": u}
    other = at(plant_with(on=rig(changes={"valve": {"critical_ratio": b}})), point)
    freed = at(plant_with("valve_critical_ratio"), point, {"critical_ratio": b})
    assert float(freed.mdot1) == pytest.approx(float(other.mdot1), rel=1e-9, abs=1e-15)
    assert float(freed.mdot2) == pytest.approx(float(other.mdot2), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("u", [1.0, 5.0, 10.0, -2.5])
@pytest.mark.parametrize("slope", [-0.8, 0.5])
def test_a_ratio_that_slopes_is_that_of_a_rig_file_for_the_opening(slope, u):
    point = {"p1": 5.2e5, "p2": 4.1e5, "u": u}
    b = rig().critical_ratio + 0.1 * (1.0 + slope * (1.0 - 2.0 * abs(u) / 10.0))
    other = at(plant_with(on=rig(changes={"valve": {"critical_ratio": b}})), point)
    freed = at(
        plant_with("valve_critical_ratio"), point, {"critical_ratio": rig().critical_ratio + 0.1, "ratio_slope": slope}
    )
    for flow in ("mdot1", "mdot2"):
        assert float(getattr(freed, flow)) == pytest.approx(float(getattr(other, flow)), rel=1e-6)


def test_a_larger_subsonic_index_lets_less_through_near_the_supply_and_as_much_when_choked():
    plant = plant_with("valve_critical_ratio")
    near, choked = ({"p1": p1, "p2": 1.1e5, "psup": 7e5, "u": 5.0} for p1 in (6.5e5, 1.5e5))
    less, plain = (float(at(plant, near, {"subsonic_index": m}).mdot1) for m in (0.6, 0.5))
    assert less < 0.95 * plain
    same, usual = (float(at(plant, choked, {"subsonic_index": m}).mdot1) for m in (0.6, 0.5))
    assert same == pytest.approx(usual, rel=1e-12)


def test_air_is_accounted_for_between_supply_chambers_and_exhaust():
    """Every effect that only moves openings keeps supply = chambers + exhaust."""
    names = ("valve_asymmetry", "valve_null_leakage", "exhaust_restriction", "valve_critical_ratio")
    plant = plant_with(*names)
    values = {"asymmetry": 0.2, "null_leak": 0.02, "r_exhaust": 0.7, "critical_ratio": 0.45}
    for u in (-7.0, 0.0, 0.3, 9.0):
        stages = at(plant, {"u": u}, values)
        exhausted = sum(
            float(opening) * C_flow(p) for opening, p in ((stages.edges.exhaust_1, 4e5), (stages.edges.exhaust_2, 3e5))
        )
        supplied = sum(
            float(opening) * C_flow(SERVO_POINT["psup"], p)
            for opening, p in ((stages.edges.supply_1, 4e5), (stages.edges.supply_2, 3e5))
        )
        assert float(stages.mdot1) + float(stages.mdot2) == pytest.approx(supplied - exhausted, rel=1e-9, abs=1e-12)


def C_flow(p_up: float, p_down: float = 101325.0, b: float = 0.45) -> float:
    """ISO 6358-1 eq. (1), (2), written down again."""
    r = p_down / p_up
    psi = 1.0 if r <= b else np.sqrt(1 - ((r - b) / (1 - b)) ** 2)
    return TRUTH["C"] * RHO_REFERENCE * p_up * np.sqrt(T_REFERENCE / T) * psi


# --- forces on the spool ---

ports = st.tuples(st.floats(1.2e5, 6.5e5), st.floats(1.2e5, 6.5e5), st.floats(0.1, 1.0), st.sampled_from([-1.0, 1.0]))


@given(ports, st.floats(0.0, 0.5), st.floats(0.6, 1.6), st.floats(-0.8, 0.8))
def test_jets_draw_the_spool_back_by_the_drops_over_the_edges_that_are_open(point, f, e, a):
    p1, p2, s, side = point
    psup, patm = SERVO_POINT["psup"], rig().patm
    filled, vented = (p1, p2) if side > 0 else (p2, p1)
    drop = max((1.0 + a) * (psup - filled) + (1.0 - a) * (vented - patm), 0.0)
    values = {"flow_force": f, "flow_force_power": e, "flow_force_edges": a}
    found = at(plant_with("valve_flow_force"), {"p1": p1, "p2": p2, "u": 10.0 * side * s}, values)
    # the sides of a rounded sign: 0.02 of full scale beside s
    assert float(found.opening) == pytest.approx(side * s / (1.0 + f * (drop / 4e5) ** e), rel=0.03)


@given(ports, st.floats(-0.05, 0.05))
def test_the_ports_pressures_push_the_spool_as_an_offset_that_follows_them(point, k):
    p1, p2, s, side = point
    u = 10.0 * side * s
    pushed = at(plant_with("valve_flow_force"), {"p1": p1, "p2": p2, "u": u}, {"port_push": k})
    offset = at(plant_with("valve_offset"), {"p1": p1, "p2": p2, "u": u}, {"offset_valve": k * (p1 - p2) / 4e5})
    assert float(pushed.opening) == pytest.approx(float(offset.opening), abs=1e-12)


# --- a volume behind a restriction ---


@pytest.mark.parametrize("chamber", [1, 2])
@given(st.floats(1.2e5, 8e5), st.floats(-8e4, 8e4), st.floats(0.005, 1.0), st.floats(0.0, 1.0))
def test_what_a_side_volume_gains_is_lost_to_its_chamber_alone(chamber, p, gap, tau, orifice):
    name, V = f"side_volume_{chamber}", 2e-5
    values = {f"V_side_{chamber}": V, f"tau_side_{chamber}": tau, f"side_orifice_{chamber}": orifice}
    point = {f"p{chamber}": p, f"side_gap_{chamber}": gap}
    plant = plant_with(name)
    with_it, without = at(plant, point, values), at(plant_with(), point)
    drawn = [float(getattr(without, flow)) - float(getattr(with_it, flow)) for flow in ("mdot1", "mdot2")]
    source, decay = (float(item) for item in with_it.relaxing[1])
    # the gap is what the chamber has risen more than the volume behind it
    chambers_rate = float(with_it.explicit[plant.states.index(f"p{chamber}")])
    side_rate = chambers_rate - (source - decay * gap)
    assert drawn[chamber - 1] == pytest.approx(V * side_rate / (R_AIR * T), rel=1e-9, abs=1e-15)
    assert drawn[2 - chamber] == 0.0


def test_behind_a_capillary_flow_goes_with_the_squares_behind_an_orifice_with_the_roots():
    plant = plant_with("side_volume_1")

    def drawn(p: float, gap: float, orifice: float) -> float:
        values = {"V_side_1": 2e-5, "tau_side_1": 0.1, "side_orifice_1": orifice}
        point = {"p1": p, "side_gap_1": gap}
        return float(at(plant_with(), point).mdot1) - float(at(plant, point, values).mdot1)

    squares = [p**2 - (p - gap) ** 2 for p, gap in ((6e5, 1e5), (3e5, 5e4))]
    assert drawn(6e5, 1e5, 0.0) / drawn(3e5, 5e4, 0.0) == pytest.approx(squares[0] / squares[1], rel=1e-9)
    assert drawn(6e5, 2e5, 1.0) / drawn(6e5, 5e4, 1.0) == pytest.approx(2.0, rel=0.12)
    assert drawn(8e5, 1e5, 1.0) / drawn(2.75e5, 1e5, 1.0) == pytest.approx(np.sqrt(7.5 / 2.25), rel=1e-6)
