"""Where a fit of friction laws starts: the bristle at the measured pressures, read again at the laws found."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from types import SimpleNamespace

import helpers
import numpy as np
import pytest

from controllers.measure import rig_of
from controllers.nominal import nominal_model
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.estimation import fit as fitting
from pneuid.estimation import reread, sliding
from pneuid.estimation.first_guess import first_guess, first_nodes, follows_state, motions
from pneuid.estimation.preparation import data_ranges, noise_of, prepare
from pneuid.estimation.shooting import TIGHT, Shooting, relaxed_smoothing
from pneuid.estimation.sliding import sliding_laws
from pneuid.estimation.solver import INTERRUPTED
from pneuid.estimation.starts import from_sliding
from pneuid.estimation.task import Task
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import ATMOSPHERE, TruthBench, record_bench, record_servo
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.truth import TruthServo

TRUTH = replace(TruthServo(), friction=FRICTION_2011)


@pytest.mark.parametrize("excitation", ["slow", "multisine"])
def test_the_first_bristle_is_that_of_the_measured_pressures(excitation):
    """At the true laws it is off by the noise of the force alone, in a stick and while sliding; clipped at the static force
    of zero gauge, or with its viscous friction, it would be off by 6 to 9 um."""
    rig = rig_of(TRUTH, {"run.csv": 7.0})
    record = record_servo(TRUTH, excitation=excitation, duration=2.0, seed=3, supply=7e5 + ATMOSPHERE, with_truth=True)
    run = Recording.from_arrays("run.csv", rig, **{name: record[name] for name in ("t", "u", "x", "p1", "p2")})
    known, theta = nominal_model(TRUTH)
    values = dict(zip(known.theta_names, theta, strict=True))
    plant = Plant(rig, "lugre", effects_by_name(["friction_pressure"]))
    ready = prepare(run, plant, noise_of(rig, [run]))
    z = first_nodes(plant, [ready], [ready.motion], {name: values[name] for name in plant.parameter_names}, 1)[-1]
    assert np.sqrt(np.mean((z - record["true_z"]) ** 2)) < 3e-6
    assert np.std(record["true_z"]) > 1e-5


@pytest.mark.parametrize(("effects", "follows"), [((), False), (("gravity",), False), (("friction_pressure",), True)])
def test_only_friction_that_follows_the_state_is_read_again(effects, follows):
    assert follows_state(Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(effects))) is follows


REMEMBERING = [name for name, effect in CATALOGUE.items() if effect.states and "servo" in effect.rigs]


@functools.cache
def stored_run() -> tuple[Rig, Recording]:
    rig = rig_of(TruthServo(), {"run.csv": 7.0})
    record = record_servo(TruthServo(), excitation="travel", duration=3.0, seed=3, supply=7e5 + ATMOSPHERE)
    return rig, Recording.from_arrays("run.csv", rig, **{name: record[name] for name in ("t", "u", "x", "p1", "p2")})


@pytest.mark.parametrize("name", REMEMBERING)
def test_the_first_nodes_of_an_effect_s_own_states_lie_on_one_path(name):
    """What an interval makes of such a state is what the next one starts from, to a few of its scales.

    An element that holds on below a deflection lets go or not depending on its own state: followed along the initial value
    it stretched to a hundred millimetres, its defects were 1500 scales, and no refit came back from there.
    """
    rig, run = stored_run()
    plant = Plant(rig, "lugre", effects_by_name([name]))
    known, theta = nominal_model(TruthServo())
    true = dict(zip(known.theta_names, theta, strict=True))
    typical = {
        item.name: float(np.clip(item.off + 3.0 * item.scale, item.lower, item.upper))
        for item in CATALOGUE[name].parameters(rig, plant.law) if item.off is not None
    }  # fmt: skip
    values = plant.starts() | {key: true[key] for key in plant.parameter_names if key in true} | typical
    ready = prepare(run, plant, noise_of(rig, [run]))
    problem = Shooting(plant, [ready], plant.parameter_names, values, data_ranges([run], plant), 2)
    problem.set_smoothing(relaxed_smoothing(plant))
    nodes = first_nodes(plant, [ready], [ready.motion], values, problem.samples)
    q = problem.scaling.to_q(np.array([values[key] for key in problem.free]))
    end, _ = problem.evaluate_values(problem.join(q, nodes))
    jumps = end[:, problem.linked] - nodes[:, problem.linked + 1]
    rows = [plant.states.index(state.name) for state in plant.effect_states]
    scales = np.array([state.scale for state in plant.effect_states])
    assert np.any(np.ptp(nodes[rows], axis=1) > 0.5 * scales), "it moves at all"
    assert np.all(np.sqrt(np.mean(jumps[rows] ** 2, axis=1)) < 3.0 * scales)


def test_what_swings_with_little_damping_does_not_build_up_along_the_measurements():
    """One step a sample made kilometres of the recoil of a mount at 200 rad/s."""
    rig, run = stored_run()
    plant = Plant(rig, "lugre", effects_by_name(["mounting_compliance"]))
    known, theta = nominal_model(TruthServo())
    true = dict(zip(known.theta_names, theta, strict=True))
    values = plant.starts() | {key: true[key] for key in plant.parameter_names if key in true}
    ready = prepare(run, plant, noise_of(rig, [run]))
    for w in (60.0, 200.0, 500.0):
        own = first_nodes(plant, [ready], [ready.motion], values | {"w_mount": w, "zeta_mount": 0.05}, 20)
        assert np.abs(own[plant.states.index("recoil")]).max() < 0.1


@dataclass
class Stub:
    """A relaxed fit that ended so: its cost, the level of its defects, its relaxation and status."""

    loose_cost: float
    level: float = 2.0
    relaxation: float = TIGHT
    status: str = "Solve_Succeeded"
    X: float = 0.0

    @property
    def outcome(self):
        return self


@pytest.mark.parametrize(
    ("ends", "taken", "tried"),
    [
        ([100.0, 50.0, 49.9], 50.0, 2),  # no longer coming down
        ([100.0, 90.0, 80.0, 70.0], 80.0, 2),  # not for ever
        ([Stub(100.0, level=0.1), 50.0], 100.0, 0),  # near already
        ([100.0, Stub(120.0, level=0.1), 50.0], 120.0, 1),  # near enough for the exact stage, which will judge it
        ([100.0, Stub(90.0, status=INTERRUPTED), 50.0], 90.0, 1),
    ],
)
def test_the_bristle_is_read_again_while_that_helps(ends, taken, tried, monkeypatch):
    plant = Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(["friction_pressure"]))
    ends = [end if isinstance(end, Stub) else Stub(end) for end in ends]
    first, later = ends[0], iter(ends[1:])
    asked = []

    def relaxed(_task, start):
        asked.append(start)
        end = next(later)
        return end, end

    monkeypatch.setattr(reread, "relaxed_fit", relaxed)
    monkeypatch.setattr(reread, "values_at", lambda problem, _X: {"Fc": problem.loose_cost})
    _, soft = reread.reread(Task(plant, [], (), {}, None), (first, first))
    assert soft.loose_cost == taken
    assert asked == [{"Fc": end.loose_cost} for end in ends[:tried]]


def test_laws_of_sliding_friction_are_read_off_the_data():
    """Far enough for a fit to find break-away from them: within a tenth of the rig's, which the estimator does not know."""
    known, theta = nominal_model(TRUTH)
    values = dict(zip(known.theta_names, theta, strict=True))
    plant = Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(["friction_pressure"]))
    runs = []
    for i, (excitation, bar) in enumerate((("slow", 3.0), ("multisine", 3.0), ("slow", 7.0), ("multisine", 7.0))):
        rig = rig_of(TRUTH, {f"{i}.csv": bar})
        record = record_servo(TRUTH, excitation=excitation, duration=3.0, seed=20 + i, supply=bar * 1e5 + ATMOSPHERE)
        run = Recording.from_arrays(f"{i}.csv", rig, **{name: record[name] for name in ("t", "u", "x", "p1", "p2")})
        runs.append(prepare(run, plant, noise_of(rig, [run])))
    guess = first_guess(plant, runs, motions(runs))
    found = sliding_laws(plant, runs, guess)
    for name in ("Fc", "sigma2", "k1", "k2", "k7", "k8"):
        assert found[name] == pytest.approx(values[name], rel=0.1), name
    assert {name for name in guess if found[name] != guess[name]} == {"Fc", "sigma2", "k1", "k2", "k7", "k8"}


def test_laws_of_sliding_friction_are_read_on_a_bench_too():
    """There speed and pressures are inputs; 2 to 150 mm/s under four pressure pairs."""
    truth, runs = TruthBench(), []
    plant = Plant(helpers.rig("bench"), "lugre", effects_by_name(["friction_pressure"]))
    for j, (p1, p2) in enumerate(((0.0, 0.0), (2e5, 2e5), (4e5, 4e5), (4e5, 1e5))):
        made = record_bench(truth, ATMOSPHERE + p1, ATMOSPHERE + p2, "sine", seed=j)
        run = Recording.from_arrays(f"{j}.csv", plant.rig, **made)
        runs.append(prepare(run, plant, noise_of(plant.rig, [run])))
    found = sliding_laws(plant, runs, first_guess(plant, runs, motions(runs)))
    seal = truth.friction
    for name, law in (("k1", "Fc_ps"), ("k7", "sigma2_ps"), ("k8", "sigma2_dp")):
        assert found[name] == pytest.approx(getattr(seal, law), rel=0.3), name


def test_break_away_starts_as_a_high_narrow_peak_that_follows_the_laws_of_sliding():
    plant = Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(["friction_pressure", "gravity"]))
    slid = dict.fromkeys(plant.parameter_names, 1.0) | {"Fc": 4.0, "k1": 5.0, "k2": -6.0}
    usual, start = from_sliding(plant, slid)
    assert usual == slid
    assert {name: start[name] for name in start if start[name] != slid[name]} == {
        "Fs": 12.0, "vs": 3e-3, "k3": 15.0, "k4": -18.0, "k5": 0.0, "k6": 0.0,
    }  # fmt: skip
    simple = Plant(rig_of(TRUTH, {}), "coulomb", effects_by_name(["friction_pressure"]))
    assert from_sliding(simple, dict.fromkeys(simple.parameter_names, 1.0)) == [], "no break-away"
    assert from_sliding(Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(["gravity"])), slid) == []


@pytest.mark.parametrize(
    ("effects", "costs"), [(["friction_pressure"], (9.0, 5.0)), (["friction_pressure"], (5.0, 9.0)), (["gravity"], ())]
)
def test_a_fit_with_laws_of_break_away_starts_from_those_of_sliding_under_what_is_given(effects, costs, monkeypatch):
    plant, asked, coming = Plant(rig_of(TRUTH, {}), "lugre", effects_by_name(effects)), [], iter(costs)
    guess = dict.fromkeys(plant.parameter_names, 1.0)

    def made(_, start):
        asked.append(start)
        return next(coming), SimpleNamespace(outcome=SimpleNamespace(status="done"))

    monkeypatch.setattr(sliding, "first_guess", lambda *_: guess)
    monkeypatch.setattr(sliding, "sliding_laws", lambda *_: guess | {"Fc": 4.0})
    monkeypatch.setattr(fitting, "relaxed_fit", made)
    monkeypatch.setattr(fitting, "_cheaper", lambda one, other: one[0] < other[0])
    found = fitting._by_sliding(Task(plant, [], (), {}, None), {"sigma2": 7.0})
    assert len(asked) == len(costs) and [one for one, _ in found] == sorted(costs), "the cheapest first"
    assert [(one["sigma2"], one["Fs"], one["vs"]) for one in asked] == [(7.0, 1.0, 1.0), (7.0, 12.0, 3e-3)][: len(costs)]
