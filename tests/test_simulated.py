"""Parameters of a bench's wrong model: those whose simulation follows whole runs best."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import base_fit, rig

from pneuid.criticism.refitting.trial import judge_of
from pneuid.effects import CATALOGUE
from pneuid.estimation import fit as stages_in_order
from pneuid.estimation.chained import Chained
from pneuid.estimation.fit import Fit, Interrupted, fit
from pneuid.estimation.preparation import prepare
from pneuid.estimation.solution import Solution
from pneuid.estimation.stages import finely
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import ATMOSPHERE, Friction, Hidden, Motion, TruthBench, record_bench, sine, strokes

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa", "F": "0.2 N"}})
FRICTION = Friction(Fc=16.0, Fs=25.0, vs=0.02, sigma0=1e6)
FAST = sine(amplitude=0.06, frequency=0.8, cycles=3)
SLOW = strokes((2e-3, 0.01, 0.05, 0.2), longest=0.6, dwell=0.2)


def recorded(hidden: Hidden, seed: int, motion: Motion = FAST) -> Recording:
    """One motion at one pair of pressures."""
    made = record_bench(TruthBench(friction=FRICTION), 4e5 + ATMOSPHERE, 2e5 + ATMOSPHERE, motion, hidden, seed)
    return Recording.from_arrays(f"b{seed}.csv", STAND, **made)


@cache
def lagging(seed: int = 1) -> Fit:
    """The base model of a bench whose force sensor averages over 20 ms."""
    return fit(Plant(STAND, "lugre"), [recorded(Hidden(sensor_lag_F=10e-3), seed)], exact=False)


def _simulated_cost(found: Fit, values: dict[str, float]) -> float:
    """Half the sum of squares that a simulation by these parameters leaves, from the relaxed starts."""
    problem = found.problem
    fine = finely(problem, found.relaxed.X, problem.substeps)
    whole = Chained(fine)
    X = whole.from_base(found.relaxed.X)
    X[: problem.nq] = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    return whole.evaluate_values(X)[1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_simulated_follows_the_run_better_than_what_jumps(seed):
    found = lagging(seed)
    assert found.stage == "relaxed" and found.simulated is not None and found.spread is None
    assert found.values == dict(found.simulated.values) and "simulation follows whole runs best" in found.status
    assert found.simulated.cost < _simulated_cost(found, found.relaxed_values)
    assert found.cost_per_sample == pytest.approx(2 * found.simulated.cost / found.problem.weighted)


@pytest.mark.parametrize("seed", [1, 2])
def test_beside_an_effect_in_another_form_it_predicts_other_runs_better(seed):
    """A sensor that averages over 20 ms, fitted as lags in a row; the bristle may jump by a newton, five times the noise."""
    hidden = Hidden(sensor_lag_F=10e-3)
    every = [recorded(hidden, 10 * seed + k, motion) for k, motion in enumerate((FAST, SLOW, FAST, SLOW))]
    found = fit(Plant(STAND, "lugre", [CATALOGUE["sensor_lag_F"]]), every[:2], {"tau_F": 5e-3}, exact=False)
    judge = judge_of(found, [prepare(run, found.plant, found.noise) for run in every[2:]])
    jumping = replace(found, values=found.values | found.relaxed_values)
    now, before = (judge.trial(one).whole - 1.0 for one in (found, jumping))
    assert now < 0.5 * before
    stiffness = [abs(values["sigma0"] / FRICTION.sigma0 - 1.0) for values in (found.values, found.relaxed_values)]
    assert stiffness[0] < 0.1 < stiffness[1]


def test_covariance_and_starts_belong_to_its_parameters_and_runs():
    found = lagging()
    assert found.simulated is not None
    nq, ns = found.problem.nq, len(found.plant.states)
    covariance = np.array(found.simulated.covariance)
    assert covariance.shape == (nq, nq) and np.all(np.linalg.eigvalsh(covariance) > -1e-9 * covariance.max())
    assert np.array(found.simulated.starts).shape == (ns, 1)


def test_another_process_gets_the_same():
    found = lagging()
    again = Solution.from_dict(json.loads(json.dumps(Solution.of(found).to_dict()))).fit(found.plant, found.runs, found.noise)
    assert again.simulated == found.simulated and again.values == found.values and again.status == found.status
    assert again.relaxed_values == found.relaxed_values


def test_an_exact_fit_and_a_servo_rig_have_none():
    bench = fit(Plant(STAND, "lugre"), [recorded(Hidden(), 1)])
    assert bench.stage == "exact" and bench.simulated is None
    servo = base_fit("leakage_internal")
    assert servo.stage == "relaxed" and servo.simulated is None and servo.values == servo.relaxed_values


def test_where_the_simulation_is_stopped_the_relaxed_fit_is_the_best_so_far(monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(stages_in_order, "simulated", stopped)
    with pytest.raises(Interrupted) as caught:
        fit(Plant(STAND, "lugre"), [recorded(Hidden(sensor_lag_F=10e-3), 1)], exact=False)
    best = caught.value.best
    assert best.simulated is None and best.values == best.relaxed_values and best.status.startswith("interrupted")
