"""Other starts of the relaxed fit, where the data's own guess ends badly."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from pneuid.estimation import fit as fitting
from pneuid.estimation.first_guess import BREAK_AWAY
from pneuid.estimation.stages import End, Relaxed
from pneuid.estimation.starts import from_near, softer
from pneuid.estimation.task import Task

GUESS = {"Fc": 10.0, "Fs": 15.0, "vs": 0.01, "sigma0": 4e5, "sigma1": 200.0}
FOUND = {"Fc": 9.0, "Fs": 20.0, "vs": 0.03, "sigma0": 1e5, "sigma1": 90.0}


class _Ends:
    """Relaxed fits with scripted costs in place of solved ones; keeps what each was started from."""

    def __init__(self, monkeypatch, *costs: float, near: bool = False) -> None:
        self.costs, self.asked, self.near = list(costs), [], near
        monkeypatch.setattr(fitting, "relaxed_fit", self.made)
        monkeypatch.setattr(Task, "guess", lambda _: GUESS)
        monkeypatch.setattr(fitting, "values_at", lambda *_: dict(FOUND))

    def made(self, *given):
        self.asked.append(dict(given[1]))
        return self.end(self.costs.pop(0))

    def end(self, cost: float):
        outcome = SimpleNamespace(cost=cost, penalty=0.0, status="done", X=None)
        return SimpleNamespace(relaxation=0.1 if self.near else 1.0), Relaxed(outcome, 0.1 if self.near else 2.0, cost)


PLANT = SimpleNamespace(law=SimpleNamespace(static=False), rig=SimpleNamespace(mass=1.0))
TASK = Task(PLANT, [], (), {}, None)


def _doubted(ends: _Ends, cost: float):
    return fitting._doubted(TASK, ends.end(cost))[1].loose_cost


def test_a_fit_that_ends_far_off_starts_softer_and_then_with_the_levels_found_there(monkeypatch):
    ends = _Ends(monkeypatch, 800.0, 700.0)
    assert _doubted(ends, 1000.0) == 700.0
    soft, levels = ends.asked
    assert soft == {"sigma0": pytest.approx(1.2e5), "sigma1": pytest.approx(120.0), "vs": pytest.approx(0.02)}
    assert levels["Fs"] == 20.0
    assert levels["sigma0"] == pytest.approx(20.0 / 4e-5), "of the level found, not of the first guess"


def test_a_softer_start_that_does_not_help_is_forgotten_and_the_last(monkeypatch):
    ends = _Ends(monkeypatch, 999.0)
    assert _doubted(ends, 1000.0) == 1000.0
    assert len(ends.asked) == 1


@pytest.mark.parametrize(("costs", "taken"), [((700.0, 650.0), 650.0), ((999.0, 700.0), 700.0), ((700.0, 699.0), 700.0)])
def test_a_fit_that_ends_near_starts_from_its_own_end_and_with_break_away_read_anew(monkeypatch, costs, taken):
    ends = _Ends(monkeypatch, *costs, near=True)
    assert _doubted(ends, 1000.0) == taken, "within three standard deviations two ends are one"
    own, anew = ends.asked
    assert own == FOUND
    assert anew == {**FOUND, **{name: GUESS[name] for name in BREAK_AWAY}}


def test_a_law_without_break_away_has_no_other_start_but_its_own_end():
    plant = SimpleNamespace(law=SimpleNamespace(static=True))
    assert [from_near({"Fc": 1.0}, {"Fc": 2.0}, turn) for turn in (0, 1)] == [{"Fc": 2.0}, {}]
    assert softer(plant, {"Fc": 1.0}) == {}


def test_the_exact_stage_is_spared_where_another_start_ended_no_better(monkeypatch):
    ends, tried = _Ends(monkeypatch, 998.0, 700.0, near=True), []
    monkeypatch.setattr(fitting, "_reread", lambda _task, found: found)
    monkeypatch.setattr(fitting, "_exact_end", lambda _problem, soft, _monitor: tried.append(soft.loose_cost))
    before = [End(*ends.end(1000.0))]
    start = {"Fc": 1.0}
    assert fitting._end(TASK, start, True, before).soft.loose_cost == 998.0
    assert tried == []
    fitting._end(TASK, start, True, before)
    assert tried == [700.0]
