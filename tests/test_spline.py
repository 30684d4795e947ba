"""Splines and formulas: the basis, names, the fit, the file, the simulation and the controllers."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, rig, servo_run, values_of
from operating import at
from scipy.interpolate import BSpline

from controllers.control_model import ControlModel
from controllers.model_plant import ModelPlant
from pneuid import api
from pneuid.criticism.unknown import distil
from pneuid.effects import effects_by_name
from pneuid.effects._spline import EARLY, KNOTS, SIGNALS_OF, Term, basis, curve
from pneuid.errors import UserError
from pneuid.estimation.curves import curves_of
from pneuid.estimation.fit import fit
from pneuid.model import load, model_of
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.report.shape_figure import shape_figure
from pneuid.virtual_rig import ATMOSPHERE, Friction, Hidden, TruthBench, record_bench, sine

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})
NAMES = [f"spline:{equation}({signal})" for equation, signals in SIGNALS_OF.items() for signal in signals]
NAMES += ["spline:force(x*p1)", "spline:force(x*p2)"]


def test_the_basis_is_scipys():
    knots, s = 9, np.linspace(0.0, 1.0, 50, endpoint=False)
    width = 1.0 / (knots - 3)
    t = width * np.arange(-3, knots + 1)
    expected = BSpline.design_matrix(s, t, 3).toarray()
    np.testing.assert_allclose(np.array(basis(s, knots)).T, expected, atol=1e-12)


def test_the_knots_of_a_drop_from_the_supply_reach_what_one_supply_pressure_leaves():
    """A servo at 7 bar whose chambers stay between 2.5 and 5 bar."""
    data = {"p1_low": 2.5e5, "p1_high": 5e5, "p2_low": 3e5, "p2_high": 4.5e5, "x_low": 0.0, "x_high": 0.4}
    every = np.linspace(3.01e5, 5.5e5, 20)
    value = curve(Term("flow_1", "psup-p1"), np.arange(10.0), {**data, "patm": 1e5, "supply_nominal": 8e5}, every)
    assert np.all(np.diff(value) > 0.0) and np.ptp(value) > 2.0


@pytest.mark.parametrize("name", NAMES)
def test_every_spline_stands_in_a_plant_and_vanishes_when_off(name):
    kind = "bench" if "sensor_F" in name else "servo"
    effect = effects_by_name([name])[0]
    plant, base = Plant(rig(kind), "lugre", [effect]), Plant(rig(kind), "lugre")
    rng = np.random.default_rng(1)
    s = np.array([0.31, 0.05, 4e5, 3e5, 1e-5]) if kind == "servo" else np.array([1e-5])
    w = np.array([1.5, 7e5]) if kind == "servo" else np.array([0.31, 0.05, 0.3, 4e5, 3e5])
    off, on = values_of(plant), values_of(plant)
    on |= {item: 5.0 * effect.term.size(rig()) * rng.uniform(0.5, 1.0) * (1 + k) for k, item in enumerate(effect.amplitudes)}

    def shown(of: Plant, values: dict[str, float]) -> np.ndarray:
        state, given = ca.SX.sym("s", len(of.states)), ca.SX.sym("w", w.size)
        at = of.evaluate(state, given, of.theta(values, RANGES))
        every = ca.vertcat(*at.explicit, *at.relaxing[0], *at.outputs.values())
        return np.asarray(ca.Function("f", [state, given], [every])([*s, *since[: len(of.states) - s.size]], w)).ravel()

    since = [2.5]
    np.testing.assert_array_equal(shown(plant, off), shown(base, values_of(base)))
    assert np.any(shown(plant, on) != shown(plant, off))


def test_a_function_of_time_counts_from_where_the_recording_began():
    effect = effects_by_name(["spline:force(t)"])[0]
    plant = Plant(rig(), "lugre", [effect])
    values = {name: float(j) for j, name in enumerate(effect.amplitudes)}
    (clock,) = plant.effect_states
    forces = [float(at(plant, {clock.name: t}, values).explicit[1]) for t in (0.0, 1.0, 4.0, 60.0)]
    # the splines add up to 1, so that amplitudes in a line are a line over the range, from -1 of a step before it
    place = [t / (t + EARLY) * (KNOTS - 3) + 1.0 for t in (0.0, 1.0, 4.0, 60.0)]
    assert (np.array(forces) - forces[0]) * rig().mass == pytest.approx(np.array(place) - place[0], abs=1e-9)
    source, decay = at(plant, {clock.name: 5.0}, values).relaxing[1]
    assert float(source) - float(decay) * 5.0 == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(("signal", "opens"), [("u", True), ("dp", True), ("p1", False), ("psup", False), ("x", False)])
def test_a_pressure_difference_opens_a_valve_without_a_command_and_what_changes_its_gain_does_not(signal, opens):
    effect = effects_by_name([f"spline:valve({signal})"])[0]
    plant = Plant(rig(), "lugre", [effect])
    values = dict.fromkeys(effect.amplitudes, 0.05) | {effect.amplitudes[-1]: 0.2}
    assert (abs(float(at(plant, {"u": 0.0}, values).opening)) > 1e-3) is opens


@pytest.mark.parametrize("chamber", ["1", "2"])
@pytest.mark.parametrize("kind", ["spline:flow_{0}(psup-p{0})", "formula:flow_{0}(power(psup-p{0},1e5,0.5))"])
def test_a_leak_from_the_supply_follows_the_difference_of_both_pressures_alone(kind, chamber):
    effect, pressure = effects_by_name([kind.format(chamber)])[0], f"p{chamber}"
    assert effect.term.depends_on == ("psup", pressure)
    with_it, without = Plant(rig(), "lugre", [effect]), Plant(rig(), "lugre")
    values = {name: 1e-5 * (1 + k) for k, name in enumerate(effect.amplitudes)}

    def flow(supply: float, p: float) -> float:
        points = (at(plant, {"u": 0.0, "psup": supply, pressure: p}, own) for plant, own in ((with_it, values), (without, {})))
        found, still = (float(getattr(point, f"mdot{chamber}")) for point in points)
        return found - still

    assert flow(6e5, 4e5) == pytest.approx(flow(5e5, 3e5), rel=1e-9)
    assert abs(flow(6e5, 4e5) - flow(6e5, 3e5)) > 1e-6


def test_a_formula_over_a_difference_reads_as_one():
    words = distil._text(Term("flow_1", "psup-p1"), "power", np.array([1e5, 0.5]), np.array([2e-5]))
    assert "(((psup-p1) - 100 kPa)/100 kPa)^0.5" in words


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("spline:force", "write spline:EQUATION"), ("spline:forces(x)", "no equation 'forces'"),
        ("spline:force(y)", "choose one of x"), ("spline:force(x,3)", "choose 5 to 64"),
        ("spline:force(x*u)", "cannot stand here"), ("spline:sensor_x(x*dp)", "cannot stand here"),
        ("spline:sensor_F(x)", "cannot show on a servo rig"), ("formula:force(x)", "write formula:EQUATION"),
        ("formula:force(wave(x,1))", "no shape 'wave'"), ("formula:force(bump(x,1))", "needs 2 numbers"),
        ("formula:force(period(x,0))", "must be positive"), ("formula:forces(period(x,1))", "no equation"),
    ],
)  # fmt: skip
def test_a_wrong_name_is_one_line(name, words):
    with pytest.raises(UserError, match=words.replace("(", r"\(")) as caught:
        api.plant_of(rig(), [name])
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_a_name_has_one_form_and_travels_to_other_processes():
    plant = api.plant_of(rig(), ["spline:force(x,10)", "spline:force( x )"])
    assert [effect.name for effect in plant.effects] == ["spline:force(x)"]
    assert api.plant_of(rig(), ["spline:force(x)", "gravity"], ["spline:force(x,10)"]).effects[0].name == "gravity"
    for name in ("spline:force(x)", "formula:force(period(x,0.025))"):
        effect = effects_by_name([name])[0]
        assert pickle.loads(pickle.dumps(effect)) is effect


@pytest.fixture(scope="module")
def spring() -> tuple[api.IdentifiedModel, Recording, float]:
    """A bench that pulls a hardening spring, fitted with an unknown force over x."""
    motion = sine(amplitude=0.09, frequency=0.5, cycles=2)
    record = record_bench(
        TruthBench(friction=Friction()), 3e5 + ATMOSPHERE, 2e5 + ATMOSPHERE, motion, Hidden(load_spring=60.0), 3
    )
    run = Recording.from_arrays("b.csv", STAND, **record)
    before = api.fit(STAND, [run])
    after = api.fit(STAND, [run], add=["spline:force(x,6)"])
    return after, run, before.content.fit.cost_per_sample


def test_an_unknown_force_is_fitted_with_its_band(spring):
    model, _, before = spring
    assert model.content.fit.cost_per_sample < 0.2 * before
    shape = model.content.curves[0]
    assert shape.effect == "spline:force(x,6)" and shape.unit == "N" and not shape.provisional
    value, std = np.array(shape.value), np.array(shape.std)
    # 60 N/m over 0.18 m, and the spring hardens; against extension
    assert np.ptp(value) == pytest.approx(60.0 * 0.18, rel=0.2) and value[0] > value[-1]
    assert np.all(std > 0.0) and np.median(std) < 0.1 * np.ptp(value)
    effect = effects_by_name([shape.effect])[0]
    part = [model.values[name] for name in effect.amplitudes]
    again = curve(Term("force", "x", knots=6), part, {**model.content.ranges, "patm": STAND.patm}, np.array(shape.at))
    np.testing.assert_allclose(again, value, rtol=1e-9, atol=1e-9)
    assert shape_figure(shape, STAND.patm).axes[0].get_xlabel().startswith("x")


def test_it_is_saved_loaded_and_simulated(spring, tmp_path):
    model, run, _ = spring
    model.save(tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    assert again.curves == model.content.curves and again.effects == ("spline:force(x,6)",)
    force = api.load(tmp_path / "model.json").simulate(run)["F"]
    np.testing.assert_array_equal(force, model.simulate(run)["F"])
    assert np.sqrt(np.mean((force - run.signals["F"]) ** 2)) < 1.0


def test_controllers_play_a_model_with_a_spline():
    plant = api.plant_of(rig(), ["spline:force(x)", "spline:flow_1(psup*u)"])
    values = values_of(plant) | {"spline_force_x_5": 15.0}
    played = ModelPlant(ControlModel(plant, plant.theta(values, RANGES)))
    played.reset(0.25)
    for _ in range(20):
        played.step(1.0, 1e-3)
    assert np.all(np.isfinite(played.array)) and played.array[0] != 0.25


@pytest.mark.slow
def test_a_relaxed_fit_gives_a_provisional_band():
    run = servo_run("multisine", 5, 11)
    found = fit(api.plant_of(rig(), ["spline:force(x,6)"]), [run], exact=False)
    shape = curves_of(found)[0]
    assert shape.provisional and model_of(found, "m").curves[0] == shape
    # nothing hides: the shape is flat within its band
    assert np.mean(np.abs(np.array(shape.value) - np.mean(shape.value)) < 3.0 * np.array(shape.std)) > 0.9
