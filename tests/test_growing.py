"""The exact fit along windows that grow: what the windows cover, which start they choose, where they give up."""

from __future__ import annotations

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from pneuid.estimation import growing
from pneuid.estimation.growing import SAMPLES, grown
from pneuid.estimation.preparation import noise_of, prepare
from pneuid.estimation.solver import INTERRUPTED, Outcome
from pneuid.estimation.stages import exact_by_windows, exact_stage
from pneuid.estimation.task import Task, inside, relaxed_fit, values_at
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import ATMOSPHERE, NOTHING, random_servo, record_servo


class _Walks:
    """Windows' walks of scripted costs in place of solved ones."""

    def __init__(self, monkeypatch, cost) -> None:
        self.cost, self.cuts, self.started = cost, [], []
        monkeypatch.setattr(growing, "Chained", lambda _problem, cuts=(): SimpleNamespace(cuts=list(cuts)))
        monkeypatch.setattr(growing, "walked", self.walked)

    def walked(self, whole, X, _monitor, _settling):
        self.cuts.append(whole.cuts)
        self.started.append(X)
        return Outcome(X, self.cost(X, len(self.cuts)), 0.0, "", True, 1, 0.0)


def problem(samples: int = SAMPLES) -> SimpleNamespace:
    """Two stretches of 20 and 45 intervals."""
    return SimpleNamespace(stretches=np.array([0, 20]), nint=65, samples=samples)


def test_windows_double_up_to_the_whole_and_never_cross_a_stretch(monkeypatch):
    walks = _Walks(monkeypatch, lambda *_: 1.0)
    found = grown(problem(), ["a"], 2.0, None)
    assert found is not None and found.X == "a"
    assert walks.cuts[-1] == [], "one simulation per stretch at the end: the stretches begin anew without a cut"
    for cuts, length in zip(walks.cuts, (2, 4, 8, 16, 32), strict=False):
        ends = np.union1d(cuts, [-1, 19, 64])  # Chained ends a window with its stretch
        assert np.diff(ends).max() == length
        assert [i for i in cuts if i > 19] == list(range(19 + length, 64, length))
    assert len(walks.cuts) == 6


def test_the_first_windows_have_samples_enough(monkeypatch):
    walks = _Walks(monkeypatch, lambda *_: 1.0)
    grown(problem(samples=3), ["a"], 2.0, None)
    assert (walks.cuts[0][0] + 1) * 3 >= 2 * SAMPLES


def test_the_start_that_is_cheaper_in_short_windows_goes_on(monkeypatch):
    walks = _Walks(monkeypatch, lambda X, _: {"a": 1.5, "b": 1.0, "c": 9.0}[X])
    assert grown(problem(), ["a", "b", "c"], 2.0, None).X == "b"
    assert walks.started == ["a", "a", "b", "b", "c", *"b" * 4], "what ends above the limit is left at once"


@pytest.mark.parametrize("at", [1, 2, 3, 6])
def test_it_gives_up_where_a_length_ends_above_the_limit(monkeypatch, at):
    walks = _Walks(monkeypatch, lambda _, n: np.inf if n == at else 1.0)
    assert grown(problem(), ["a"], 2.0, None) is None
    assert len(walks.cuts) == at


def test_stopped_it_says_so(monkeypatch):
    stopped = Outcome(np.zeros(1), 1.0, 0.0, INTERRUPTED, False, 1, 0.0)
    monkeypatch.setattr(growing, "solve_chained", lambda *_: stopped)
    with pytest.raises(KeyboardInterrupt):
        growing.walked(SimpleNamespace(from_base=lambda X: X), np.zeros(1), None)


@pytest.fixture(scope="module")
def sticking():
    """A rig of 55 mm bore and 16 kg, its relaxed fit with a bristle thirty times too stiff and all but undamped."""
    drawn = random_servo(5825, 0.0)
    top, how = drawn.truth.supply - ATMOSPHERE, {"rate": drawn.rate, "sensors": drawn.sensors}
    plan = (("multisine", 0.6), ("slow", 0.8))
    rig = Rig.from_dict(tomllib.loads(drawn.rig_toml({f"r{i}.csv": share * top for i, (_, share) in enumerate(plan)})))
    records = [
        record_servo(drawn.truth, NOTHING, kind, 3.0, 430 + i, supply=share * top + ATMOSPHERE, **how)
        for i, (kind, share) in enumerate(plan)
    ]
    runs = [Recording.from_arrays(f"r{i}.csv", rig, **record) for i, record in enumerate(records)]
    plant = Plant(rig, "lugre")
    levels = noise_of(rig, runs)
    task = Task(plant, runs, tuple(prepare(run, plant, levels) for run in runs), {}, None)
    shooting, soft = relaxed_fit(task, {})
    values = values_at(shooting, soft.outcome.X)
    true = drawn.truth.friction
    bad = values | {"sigma0": 30 * true.sigma0, "sigma1": 0.02 * true.sigma1}
    X = np.concatenate([inside(shooting, bad), soft.outcome.X[shooting.nq :]])
    return task, shooting, Outcome(X, soft.outcome.cost, soft.outcome.penalty, "", True, 0, 0.0), true


def test_they_lead_from_a_break_away_that_is_far_off_to_the_right_one(sticking):
    task, shooting, soft, true = sticking
    starts = [soft.X, *task.fresh_starts(shooting, soft.X)]
    found = exact_by_windows(shooting, soft, starts, None)
    assert found is not None
    values = values_at(found.problem, found.outcome.X)
    for name, std in zip(found.problem.free, found.spread.std, strict=True):
        if hasattr(true, name):
            assert abs(values[name] - getattr(true, name)) < 4 * std, name


def test_straight_from_there_no_path_is_found(sticking):
    """What the windows are for; without this the test above would pass for any start."""
    _, shooting, soft, true = sticking
    found = exact_stage(shooting, soft, None)
    assert found is None or abs(values_at(found.problem, found.outcome.X)["sigma0"] / true.sigma0 - 1.0) > 0.1
