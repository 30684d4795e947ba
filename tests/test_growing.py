"""The exact fit along windows that grow: what the windows cover, which of them merge, where they give up."""

from __future__ import annotations

import itertools
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pneuid.estimation import growing
from pneuid.estimation.growing import ACROSS, SAMPLES, Grown, agree, grown
from pneuid.estimation.preparation import noise_of, prepare
from pneuid.estimation.solver import INTERRUPTED, Outcome
from pneuid.estimation.stages import exact_by_windows, exact_stage
from pneuid.estimation.task import Task, inside, relaxed_fit, values_at
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import ATMOSPHERE, NOTHING, random_servo, record_servo


class _Windows:
    """Windows' walks of scripted costs in place of solved ones; ``bad``: what an interval costs simulated from before."""

    def __init__(self, monkeypatch, cost=lambda _: 1.0, bad=None) -> None:
        self.cost, self.bad, self.cuts = cost, dict(bad or {}), []
        monkeypatch.setattr(growing, "Chained", self.chained)
        monkeypatch.setattr(growing, "walked", self.walked)

    def chained(self, problem, cuts=()):
        starts = {int(first) for first in problem.stretches} | {cut + 1 for cut in cuts}
        costs = [0.0 if i in starts else self.bad.get(i, 0.0) for i in range(problem.nint)]
        return SimpleNamespace(cuts=list(cuts), from_base=lambda X: X, interval_costs=lambda _: np.array(costs))

    def walked(self, whole, X, _monitor, _settling):
        self.cuts.append(whole.cuts)
        return Outcome(X, self.cost(len(self.cuts)), 0.0, "", True, 1, 0.0)


def problem(samples: int = SAMPLES) -> SimpleNamespace:
    """Two stretches of 20 and 45 intervals."""
    return SimpleNamespace(stretches=np.array([0, 20]), nint=65, samples=samples, weighted=65 * samples)


def test_windows_double_where_the_simulation_stays_near_and_never_cross_a_stretch(monkeypatch):
    windows = _Windows(monkeypatch)
    found = grown(problem(), "a", 2.0, None)
    assert found.path is not None and found.path.X == "a" and found.costs == (1.0,) * 5
    assert windows.cuts[-1] == [], "one simulation per stretch at the end: the stretches begin anew without a cut"
    assert windows.cuts[0] == [1, 3, 5, 7, 9, 11, 13, 15, 17, *range(21, 64, 2)]
    for cuts, later in itertools.pairwise(windows.cuts):
        ends = np.union1d([-1, 19, 64], cuts)
        longest = np.diff(np.union1d([-1, 19, 64], later)).max()
        assert set(later) < set(cuts) and longest <= 2 * np.diff(ends).max(), "a window merges with one neighbour at a time"
    assert len(windows.cuts) == 6


def test_windows_apart_where_the_simulation_misses_wait_until_no_others_merge(monkeypatch):
    noise = 0.5 * SAMPLES  # of one interval
    windows = _Windows(monkeypatch, bad={30: 100 * ACROSS * noise, 8: 1e5 * ACROSS * noise})
    grown(problem(), "a", 2.0, None)
    waiting = [sorted({7, 29} & set(cuts)) for cuts in windows.cuts]
    assert waiting[:-2] == [[7, 29]] * (len(waiting) - 2) and waiting[-2:] == [[7], []]
    assert [cut for cut in windows.cuts[-3] if cut not in (7, 29)] == [], "all others have merged by then"


def test_of_a_path_that_no_longer_exists_all_cuts_go_at_last(monkeypatch):
    windows = _Windows(monkeypatch, bad={30: np.inf, 8: np.nan})
    assert grown(problem(), "a", 2.0, None).path is not None
    assert windows.cuts[-2] == [7, 29] and windows.cuts[-1] == []


def test_the_first_windows_have_samples_enough(monkeypatch):
    windows = _Windows(monkeypatch)
    grown(problem(samples=3), "a", 2.0, None)
    assert (windows.cuts[0][0] + 1) * 3 >= 2 * SAMPLES


@pytest.mark.parametrize(("at", "cost", "walks"), [(1, np.inf, 1), (3, 6.1, 3), (3, 5.9, 6), (6, 2.1, 6)])
def test_it_gives_up_where_windows_end_far_above_the_limit_or_the_path_above_it(monkeypatch, at, cost, walks):
    windows = _Windows(monkeypatch, lambda n: cost if n == at else 1.0)
    found = grown(problem(), "a", 2.0, None)
    assert (found.path is None) == (cost != 5.9)
    assert len(windows.cuts) == walks and len(found.costs) == min(walks, 5)


def test_without_slack_windows_that_cost_more_than_a_whole_path_may_are_the_last(monkeypatch):
    windows = _Windows(monkeypatch, lambda n: 2.1 if n == 3 else 1.0)
    assert grown(problem(), "a", 2.0, None, slack=1.0).path is None and len(windows.cuts) == 3
    windows = _Windows(monkeypatch, lambda n: 1.9 if n == 3 else 1.0)
    assert grown(problem(), "a", 2.0, None, slack=1.0).path is not None


def test_what_short_windows_show_is_kept_as_long_as_they_cost_little_more_than_the_shortest(monkeypatch):
    windows = _Windows(monkeypatch, lambda n: {1: 1.0, 2: 1.1, 3: 1.3, 4: 1.1, 5: 5.0}.get(n, 9.0))
    monkeypatch.setattr(growing, "walked", lambda whole, X, *_: replace(windows.walked(whole, X, None, None), X=X + 1))
    assert grown(problem(), 0, 2.0, None).held == 4
    windows = _Windows(monkeypatch, lambda n: {1: 1.0, 2: 1.1}.get(n, 9.0))
    monkeypatch.setattr(growing, "walked", lambda whole, X, *_: replace(windows.walked(whole, X, None, None), X=X + 1))
    assert grown(problem(), 0, 2.0, None).held == 2, "given up at the third"


PATH = Outcome(np.zeros(1), 1.0, 0.0, "", True, 1, 0.0)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ((100.0, 103.0, 130.0, 900.0), (101.0, 104.0, 128.0, 300.0), True),
        ((100.0, 103.0, 130.0), (101.0, 104.0, 160.0), False),
        ((100.0, 103.0, 130.0), (101.0, 103.0), False),
        ((100.0, 104.0, 104.0), (101.0, 103.0, 103.0), False),
        ((100.0, 104.0, np.inf), (101.0, 103.0, np.inf), False),
        ((100.0, 900.0, 130.0), (101.0, 104.0, 131.0), True),
        ((), (100.0, 130.0), False),
    ],
)
def test_two_starts_agree_where_windows_that_begin_to_cost_more_cost_the_same(one, other, same):
    assert agree(Grown(None, one), Grown(None, other)) is same
    assert agree(Grown(None, other), Grown(None, one)) is same
    assert not agree(Grown(PATH, one), Grown(None, other)), "a start that led to a path shows nothing lacking"


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
    (start,) = task.fresh_starts(shooting, soft.X)
    found, windows = exact_by_windows(shooting, soft, start, None)
    assert found is not None and windows.path is not None
    values = values_at(found.problem, found.outcome.X)
    for name, std in zip(found.problem.free, found.spread.std, strict=True):
        if hasattr(true, name):
            assert abs(values[name] - getattr(true, name)) < 4 * std, name


def test_straight_from_there_no_path_is_found(sticking):
    """What the windows are for; without this the test above would pass for any start."""
    _, shooting, soft, true = sticking
    found = exact_stage(shooting, soft, None)
    assert found is None or abs(values_at(found.problem, found.outcome.X)["sigma0"] / true.sigma0 - 1.0) > 0.1
