"""What the virtual rig hides: absent at zero, of the right sign, within the balances, fine enough in its step."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import (
    ATMOSPHERE,
    BENCH_EFFECTS,
    HIDDEN_EFFECTS,
    IDEAL_SENSORS,
    NOTHING,
    OUTSIDE_EFFECTS,
    Excitation,
    Hidden,
    Motion,
    ServoPlant,
    TruthBench,
    TruthServo,
    preset,
    random_bench,
    random_servo,
    reciprocation,
    record_bench,
    record_servo,
    run_open_loop,
    sine,
    strokes,
)
from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.kernel import advance
from pneuid.virtual_rig.kernel.valve import metered
from pneuid.virtual_rig.packing import pack
from pneuid.virtual_rig.sensors import averaged, delayed
from pneuid.virtual_rig.servo import rest_state

RIG, BENCH = TruthServo(), TruthBench()
SERVO_NAMES = sorted({*HIDDEN_EFFECTS, *OUTSIDE_EFFECTS})
SENSOR_NAMES = [name for name in SERVO_NAMES if name.startswith(("sensor", "encoder", "channel"))]
PLANT_NAMES = [name for name in SERVO_NAMES if name not in SENSOR_NAMES]


def _quick(t, stroke, top_speed, rng):
    """Half a second that moves to the cap's end, rests and turns."""
    s = np.clip((t - 0.02) / 0.25, 0.0, 1.0) - np.clip((t - 0.32) / 0.15, 0.0, 1.0) * 0.6
    return stroke * (0.26 - 0.25 * s), -0.25 * stroke * np.gradient(s, t)


def _middle(t, stroke, top_speed, rng):
    """The same around the middle."""
    x, v = _quick(t, stroke, top_speed, rng)
    return x + 0.4 * stroke, v


QUICK, MIDDLE = Excitation("quick", _quick, dither=0.01), Excitation("middle", _middle, dither=0.01)


def _open_loop(hidden, step=20e-6, seconds=0.3, x0=0.2):
    t = np.arange(round(seconds * 1000)) * 1e-3
    u = 1.5 * np.sin(2.0 * np.pi * 5.0 * t) * (t < 0.22) + 0.3
    return run_open_loop(RIG, hidden, u, 1e-3, x0=x0, step=step, supply=7e5 + ATMOSPHERE)


@pytest.mark.parametrize("name", SERVO_NAMES)
def test_a_preset_shows_in_the_record_and_zero_is_exactly_absent(name):
    supply = 7e5 + ATMOSPHERE
    plain, zero, hidden = (
        record_servo(
            RIG, what, MIDDLE if name == "scored_bore" else QUICK, 0.5, 1, supply=supply, sensors=IDEAL_SENSORS
        )
        for what in (NOTHING, Hidden(**{name: 0.0}), preset(name))
    )
    assert all(np.array_equal(plain[key], zero[key]) for key in plain)
    size = {"x": 20e-6, "p1": 500.0, "p2": 500.0}
    assert max(np.max(np.abs(plain[key] - hidden[key])) / size[key] for key in size) > 1.0  # of the sensors' noise


@pytest.mark.parametrize("name", PLANT_NAMES)
def test_halving_the_step_changes_less_than_a_tenth_of_the_noise(name):
    x0 = 0.03 if name == "end_cushion" else 0.2
    coarse, fine = (_open_loop(preset(name), step, x0=x0) for step in (20e-6, 10e-6))
    for signal, noise in (("x", 20e-6), ("p1", 500.0), ("p2", 500.0)):
        assert np.max(np.abs(coarse[signal] - fine[signal])) < 0.1 * noise, signal


# --- signs and balances, one mechanism after the other ---


def _run(hidden, u, seconds, x0=0.2, **start):
    """A whole state history under a constant command; ``start`` overrides states by their layout name."""
    par = pack(RIG, hidden)
    y = rest_state(par, x0, RIG.supply)
    for name, value in start.items():
        y[getattr(at, name)] = value
    history = [y.copy()]
    for _ in range(round(seconds * 1000)):
        advance(y, u, u, RIG.supply, 1e-3, 50, par)
        history.append(y.copy())
    return np.array(history), par


def test_hysteresis_leaves_the_spool_behind_where_it_came_from():
    hidden = preset("valve_hysteresis")
    after = {sign: _run(hidden, 0.0, 0.5, PLAY_0=sign, PLAY_1=sign, PLAY_2=sign)[0] for sign in (1.0, -1.0)}
    assert after[1.0][-1, at.X] - 0.2 > 1e-3 > -1e-3 > after[-1.0][-1, at.X] - 0.2
    plays = after[1.0][-1, at.PLAY_0 : at.PLAY_2 + 1]
    assert np.dot((0.40, 0.35, 0.25), plays) == pytest.approx(hidden.valve_hysteresis, rel=1e-9)


def test_line_carries_sound_at_its_speed_and_keeps_the_gas():
    hidden = Hidden(line_delay=1.5)
    history, par = _run(hidden, 10.0, 0.03)
    plain, _ = _run(NOTHING, 10.0, 0.03)
    rise, plain_rise = history[:, at.P1] - history[0, at.P1], plain[:, at.P1] - plain[0, at.P1]
    late = np.argmax(rise > 2e3) - np.argmax(plain_rise > 2e3)
    assert 2 <= late <= 9  # ms; 1.5 m at 343 m/s are 4.4 ms
    closed, par = _run(hidden, 0.0, 0.4, LINE_A1=6e5, LINE_MA1=1e-3)
    tube = par[at.S_LINE_AREA] * par[at.S_LINE_LENGTH]
    sound = 1.4 * par[at.GAS_RT]
    mass = (
        closed[:, at.LINE_A1] * (0.25 * tube + par[at.S_PORT_VOLUME]) / sound
        + closed[:, at.LINE_B1] * 0.5 * tube / sound
    )
    entered = np.concatenate(([0.0], np.cumsum(0.5e-3 * (closed[1:, at.LINE_MB1] + closed[:-1, at.LINE_MB1]))))
    assert np.max(np.abs(mass + entered - mass[0])) < 2e-3 * mass[0]  # trapezoids of a 1 kHz record
    assert abs(closed[-1, at.LINE_MA1]) < 0.2e-3  # turbulent friction stills it


def test_pocket_and_main_volume_together_are_the_dead_volume():
    par, plain = pack(RIG, Hidden(dead_volume=1.5)), pack(RIG, NOTHING)
    assert par[at.DEAD_1] / plain[at.DEAD_1] == pytest.approx(2.0)  # two thirds of 1.5
    assert par[at.DEAD_2] / plain[at.DEAD_2] == pytest.approx(1.8)
    history, par = _run(Hidden(dead_volume=1.5), 0.0, 0.4, POCKET_1=4e5, P1=5e5)
    assert history[-1, at.POCKET_1] == pytest.approx(history[-1, at.P1], rel=1e-4)
    pocket = 0.5 * RIG.dead_volume_1
    volume = par[at.DEAD_1] + par[at.AREA_1] * history[:, at.X]
    mass_like = history[:, at.P1] * volume + history[:, at.POCKET_1] * pocket
    moved = np.ptp(history[:, at.X]) * par[at.AREA_1] * 5e5 * 1.2
    assert np.ptp(mass_like) <= moved + 1e-6


def test_cushion_brakes_by_trapped_gas_and_gives_it_back():
    hidden = preset("end_cushion")
    braked, par = _run(hidden, -3.0, 0.7, x0=0.06)
    free, _ = _run(NOTHING, -3.0, 0.7, x0=0.06)
    assert np.min(braked[:, at.V]) >= np.min(free[:, at.V])
    reach = hidden.end_cushion * RIG.stroke
    inside = braked[:, at.X] < reach
    assert np.max(braked[inside, at.CUSHION_1] - braked[inside, at.P1]) > 3e4
    assert np.array_equal(braked[~inside, at.CUSHION_1], braked[~inside, at.P1])
    y = braked[-1].copy()
    y[at.P1], y[at.P2] = 6e5, 2e5
    for _ in range(400):
        advance(y, 5.0, 5.0, RIG.supply, 1e-3, 50, par)
    assert y[at.X] > reach and y[at.CUSHION_1] == y[at.P1]


def test_a_backlash_load_keeps_momentum_through_the_impact():
    hidden = Hidden(backlash=1e-3)
    frictionless = replace(RIG, friction=replace(RIG.friction, Fc=0.06, Fs=0.06, sigma1=0.0, sigma2=0.0))
    par = pack(frictionless, hidden)
    y = rest_state(par, 0.25, RIG.supply)
    y[at.LOAD_V] = 0.1
    masses = par[at.MASS], par[at.S_LOAD_MASS]
    assert sum(masses) == pytest.approx(RIG.mass)
    energy = 0.5 * masses[1] * y[at.LOAD_V] ** 2
    speeds = []
    for _ in range(8):  # the gap is crossed in 5 ms, the contact lasts some 3
        advance(y, 0.0, 0.0, RIG.supply, 1e-3, 100, par)
        speeds.append((y[at.V], y[at.LOAD_V]))
    assert abs(speeds[3][0]) < 1e-3  # not touched yet
    assert y[at.V] > 0.1  # the light rod is struck by the heavy load
    assert masses[0] * y[at.V] + masses[1] * y[at.LOAD_V] == pytest.approx(0.1 * masses[1], rel=0.03)
    assert 0.5 * (masses[0] * y[at.V] ** 2 + masses[1] * y[at.LOAD_V] ** 2) < energy


def test_bracket_yields_against_the_force():
    soft = preset("mounting_compliance")
    history, _ = _run(soft.also(Hidden(gravity=20.0)), 0.0, 0.5)
    assert (
        -20.0 * soft.mounting_compliance < history[-1, at.BODY_X] < -0.6 * 20.0 * soft.mounting_compliance
    )  # it hardens


def test_the_critical_ratio_of_a_valve_falls_as_it_opens():
    hidden = Hidden(valve_critical_ratio=0.2)
    par = pack(RIG, hidden)
    flow = {
        opening: metered(opening, par[at.CRITICAL], par[at.PSI_PATCH], 7e5, 3.9e5, 293.15, 293.15, par) / opening
        for opening in (0.02, 0.5, 1.0)
    }
    assert par[at.CRITICAL] == pytest.approx(0.5)
    assert flow[0.02] > flow[0.5] > flow[1.0], "at a ratio of 0.557 a closed edge with 0.55 is all but choked"
    plain = pack(RIG, NOTHING)
    shares = [metered(o, plain[at.CRITICAL], plain[at.PSI_PATCH], 7e5, 3.9e5, 293.15, 293.15, plain) / o for o in (0.02, 1.0)]
    assert shares[0] == pytest.approx(shares[1], rel=1e-12)


def test_valve_and_gas_effects_have_the_expected_sign():
    speed = {
        name: _run(preset(name), 3.0, 0.3)[0][-1, at.X] for name in ("exhaust_restriction", "valve_critical_ratio")
    }
    plain = _run(NOTHING, 3.0, 0.3)[0]
    assert speed["exhaust_restriction"] < plain[-1, at.X] < speed["valve_critical_ratio"]
    still = _run(preset("valve_null_leakage"), 0.0, 4.0)[0]
    # filling equals choked venting where r = psi(r), r = p / supply: 0.757 at b = 0.3
    # at 0.03 opening the chamber is still on its way there, and the piston yields
    assert still[0, at.P1] + 2e4 < still[-1, at.P1] < 0.76 * RIG.supply
    mixed = _run(preset("inlet_mixing"), 3.0, 0.01)[0]
    # the chamber that is charged follows a larger exponent, the one that is vented a smaller one
    assert mixed[-1, at.P1] > plain[10, at.P1] and mixed[-1, at.P2] > plain[10, at.P2]
    held = _run(preset("valve_flow_force"), 3.0, 0.3)[0]
    assert held[-1, at.X] < plain[-1, at.X], "jets close the spool"
    curved = {share: _run(Hidden(valve_curve=share), 3.0, 0.3)[0][-1, at.X] for share in (-0.3, 0.3)}
    assert curved[0.3] < plain[-1, at.X] < curved[-0.3], "holes open slowly from their edge, fast from their middle"
    for name, p, side in (("side_volume_1", at.P1, at.SIDE_1), ("side_volume_2", at.P2, at.SIDE_2)):
        beside = _run(preset(name), 3.0, 0.3)[0]
        rising = np.sign(beside[20, p] - beside[0, p])
        assert rising * (beside[20, p] - beside[20, side]) > 100.0, "the volume is behind its chamber"
        assert rising * (beside[20, p] - plain[20, p]) < 0.0, "and takes some of its air"
    warm = _run(preset("supply_heating"), 3.0, 0.3)[0]
    assert 0.0 < warm[-1, at.WARMING] < 45.0 and warm[-1, at.X] > plain[-1, at.X]


def test_leaks_outside_the_catalogue_open_where_they_should():
    high, low = ({"P1": p, "P2": p * RIG.area_1 / RIG.area_2} for p in (6e5, 3.5e5))
    relief = preset("relief_leak")
    assert _run(relief, 0.0, 0.1, **high)[0][-1, at.P1] < 6e5 - 5e3
    assert np.array_equal(_run(relief, 0.0, 0.1, **low)[0], _run(NOTHING, 0.0, 0.1, **low)[0])
    scored = preset("scored_bore")
    assert np.array_equal(_run(scored, 0.0, 0.1, x0=0.2)[0], _run(NOTHING, 0.0, 0.1, x0=0.2)[0])
    assert not np.array_equal(_run(scored, 0.0, 0.1, x0=0.31)[0], _run(NOTHING, 0.0, 0.1, x0=0.31)[0])


# --- friction and loads, where they are seen directly: on the bench ---

P1, P2 = ATMOSPHERE + 3e5, ATMOSPHERE + 4e5


def _force(motion, hidden=NOTHING, step=10e-6):
    return record_bench(BENCH, P1, P2, motion, hidden, sensors=IDEAL_SENSORS, step=step, with_truth=True)


BENCH_NAMES = sorted({*BENCH_EFFECTS, *(name for name, item in OUTSIDE_EFFECTS.items() if "bench" in item.rigs)})


@pytest.mark.parametrize("name", BENCH_NAMES)
def test_bench_effects_show_and_converge(name):
    hidden = BENCH_EFFECTS[name]["strong"] if name in BENCH_EFFECTS else preset(name)
    motion = strokes(speeds=(0.0008, 0.2), longest=0.3, dwell=0.3)
    seen, finer, plain = _force(motion, hidden), _force(motion, hidden, 5e-6), _force(motion)
    if not name.startswith("sensor_offset_p"):
        assert np.max(np.abs(seen["F"] - plain["F"])) > 0.2  # N, the sensor's noise
    assert np.max(np.abs(seen["F"] - finer["F"])) < 0.02
    if name.startswith("friction") or name in ("rod_seal_clamp", "drag_chain"):
        assert np.array_equal(seen["x"], plain["x"])


def _break_away(hidden, dwell):
    """Largest friction of the second of two slow strokes in one direction, ``dwell`` seconds apart."""
    first = strokes(speeds=(0.002,), longest=0.4, dwell=dwell)
    run = _force(first, hidden)
    late = first.t > 2.0 * dwell + 0.4
    return np.max(np.abs(run["true_friction"][late & (first.v < 0.0)]))


def test_break_away_grows_with_rest():
    hidden = Hidden(friction_dwell=1.0)
    short, long, plain = _break_away(hidden, 0.1), _break_away(hidden, 1.0), _break_away(NOTHING, 1.0)
    assert plain < short < long
    assert _break_away(NOTHING, 0.1) == pytest.approx(plain, abs=0.05)


def test_friction_falls_with_work_and_no_further_than_declared():
    motion = sine(amplitude=0.1, frequency=1.0, cycles=10)
    cold, warm = _force(motion), _force(motion, Hidden(friction_warmup=0.4))
    dissipated = {
        run: np.cumsum(np.abs(what["true_friction"] * motion.v)) for run, what in (("cold", cold), ("warm", warm))
    }
    share = dissipated["warm"] / np.maximum(dissipated["cold"], 1e-12)
    assert share[50] > 0.95 and 0.36 < share[-1] < 0.9  # viscous friction falls to 0.6 squared


def test_frictional_lag_raises_accelerating_over_decelerating_friction():
    motion = sine(amplitude=0.005, frequency=0.1, cycles=2, rate=500.0)
    speed = (motion.v > 0.5e-3) & (motion.v < 2e-3) & (motion.t > 5.0)
    surplus = {}
    for name, hidden in (("plain", NOTHING), ("lag", Hidden(friction_lag=0.03))):
        force = _force(motion, hidden, 50e-6)["true_friction"]
        surplus[name] = np.mean(force[speed & (motion.a > 0.0)]) - np.mean(force[speed & (motion.a < 0.0)])
    assert surplus["lag"] > surplus["plain"] + 0.5  # N; Hess and Soom 1990


def test_maxwell_elements_close_minor_loops_and_slide_as_before():
    motion = reciprocation()
    plain, memory = _force(motion), _force(motion, Hidden(friction_presliding_memory=0.9))
    sliding = np.abs(motion.v) > 0.4e-3
    last = np.flatnonzero(sliding)[-20]
    assert memory["true_friction"][last] == pytest.approx(plain["true_friction"][last], rel=0.05)
    t = np.arange(4001) * 2.5e-4  # up 20 um, a minor loop of 6 um, and on: the loop must close
    x = np.interp(t, [0.0, 0.3, 0.45, 0.6, 1.0], [0.0, 20e-6, 14e-6, 20e-6, 24e-6])
    v = np.gradient(x, t)
    run = _force(Motion(t, 0.25 + x, v, np.zeros_like(t)), Hidden(friction_presliding_memory=1.0))
    before, after = run["true_friction"][1190], run["true_friction"][2390]
    assert after == pytest.approx(before, abs=0.05)


def test_forces_along_the_way():
    motion = sine(amplitude=0.1, frequency=0.5, cycles=1)
    difference = {name: _force(motion, preset(name))["F"] - _force(motion)["F"] for name in ("cogging", "drag_chain")}
    assert np.max(np.abs(difference["cogging"])) == pytest.approx(9.0, rel=1e-6)
    place = (motion.x / BENCH.stroke - 0.5) * motion.v
    assert np.allclose(difference["drag_chain"], preset("drag_chain").drag_chain * place, atol=1e-9)
    detent = _force(motion, preset("magnetic_detent"))["F"] - _force(motion)["F"]
    assert detent[np.argmin(np.abs(motion.x - 0.26))] > 0.0 > detent[np.argmin(np.abs(motion.x - 0.24))]


# --- sensors, rigs ---


def test_averages_and_delays():
    ramp = np.arange(200.0)
    assert averaged(ramp, 7.3)[30:] == pytest.approx(ramp[30:] - 7.3, abs=1e-6)
    assert delayed(ramp, 2.5)[5:] == pytest.approx(ramp[5:] - 2.5)
    constant = np.full(50, 3.0)
    assert averaged(constant, 4.2) == pytest.approx(constant)
    assert averaged(ramp, 0.0) is ramp and delayed(ramp, 0.0) is ramp


@pytest.mark.parametrize("name", sorted({*SENSOR_NAMES} - {"sensor_offset_p1", "sensor_offset_p2"}))
def test_a_control_loop_has_no_sensors_with_a_past(name):
    with pytest.raises(ValueError, match=name):
        ServoPlant(RIG, preset(name))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_rigs_come_with_rig_files_that_read(seed):
    servo, bench = random_servo(seed), random_bench(seed)
    assert servo == random_servo(seed) != random_servo(seed + 1)
    truth = servo.truth
    assert 0.010 <= truth.bore <= 0.2 and 0.1 <= truth.mass <= 100.0 and 100.0 <= servo.rate <= 10e3
    assert 0.2 <= truth.top_speed <= 1.6
    assert 0.0199 < truth.friction.Fc / (6e5 * truth.area_1) < 0.151
    supply = truth.supply - ATMOSPHERE
    rig = Rig.from_dict(tomllib.loads(servo.rig_toml({"run.csv": 0.8 * supply})))
    record = record_servo(truth, seed=seed, duration=0.3, rate=servo.rate, sensors=servo.sensors)
    assert Recording.from_arrays("run.csv", rig, **record).n == record["t"].size
    stand = Rig.from_dict(tomllib.loads(bench.rig_toml("coulomb")))
    record = record_bench(bench.truth, P1, P2, sine(cycles=1), sensors=bench.sensors)
    assert Recording.from_arrays("bench.csv", stand, **record).n == record["t"].size
    assert random_servo(seed, 0.03).sheet.mass != 1.0 == servo.sheet.mass


def test_shares_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="shares"):
        Hidden(friction_presliding_memory=1.2)
    with pytest.raises(ValueError, match="backlash"):
        Hidden(backlash=-1e-3)
