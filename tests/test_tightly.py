"""Relaxed fits with tight defects from the start, from what was found and from typical seals."""

from __future__ import annotations

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest

from pneuid.estimation import fit as fitting
from pneuid.estimation import tightly as tight
from pneuid.estimation.shooting import LOOSE, TIGHT
from pneuid.estimation.solver import INTERRUPTED, Outcome
from pneuid.estimation.stages import Relaxed, tight_stage
from pneuid.estimation.starts import damped, seals
from pneuid.estimation.task import Task
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import ATMOSPHERE, NOTHING, random_servo, record_servo

FOUND = {"Fc": 9.0, "Fs": 20.0, "vs": 0.03, "sigma0": 1e5, "sigma1": 90.0}
SEAL = SimpleNamespace(law=SimpleNamespace(static=False), rig=SimpleNamespace(mass=4.0), effects=())


def _tightly(monkeypatch, found: float, *costs: float, relaxation: float = TIGHT, unsettled: tuple[float, ...] = ()):
    """What ``tightly`` keeps, by its cost, of ``found`` and scripted ends, some out of iterations; and the starts."""
    asked, coming = [], list(costs)

    def end(cost: float, relaxation: float = TIGHT, status: str = "done"):
        outcome = Outcome(np.zeros(1), cost, 0.0, status, cost not in unsettled, 1, 0.0)
        return SimpleNamespace(relaxation=relaxation, cost=cost), Relaxed(outcome, 0.1, None)

    def made(task, start, stage):
        assert task.known == {} and task.again and stage is tight_stage
        asked.append(dict(start))
        cost = coming.pop(0)
        return end(abs(cost), status=INTERRUPTED if cost < 0.0 else "done")

    monkeypatch.setenv("PNEUID_THREADS", "1")  # copies of this process would keep to themselves what they were asked
    monkeypatch.setattr(tight, "relaxed_fit", made)
    monkeypatch.setattr(tight, "values_at", lambda problem, _: FOUND | {"Fc": problem.cost})
    task = Task(SEAL, [], (), {"v": np.zeros(1)}, None)
    return tight.tightly(task, end(found, relaxation))[1].outcome, asked


def test_the_cheapest_of_the_found_and_typical_seals_is_read_anew_while_that_helps(monkeypatch):
    best, asked = _tightly(monkeypatch, 1000.0, 999.0, 900.0, 950.0, 980.0, 910.0, 800.0, 790.0, 788.0, 787.0)
    assert best.cost == 790.0, "within three standard deviations two ends are one"
    assert [start["Fc"] for start in asked] == [1000.0] * 5 + [900.0] * 2 + [790.0] * 2
    assert [start["sigma0"] for start in asked[1:3]] == [pytest.approx(1.1 * 1000.0 / way) for way in (50e-6, 20e-6)]
    assert [start["Fs"] for start in asked[3:5]] == [pytest.approx(1600.0)] * 2
    assert asked[6]["sigma1"] == pytest.approx(0.4 * np.sqrt(1e5 * 4.0)), "damped like a typical seal"


def test_a_fit_that_no_other_start_undercuts_stays_itself(monkeypatch):
    best, asked = _tightly(monkeypatch, 1000.0, *[999.0] * 5)
    assert best.cost == 1000.0 and len(asked) == 5


def test_loose_defects_are_believed_where_tight_ones_cost_more_from_the_same_values(monkeypatch):
    """And from a soft seal too: as a rule the model lacks something then, and other starts cost time alone."""
    best, asked = _tightly(monkeypatch, 1000.0, 9000.0, 8000.0, relaxation=LOOSE)
    assert best.cost == 1000.0 and len(asked) == 2
    assert asked[1] == seals(SEAL, FOUND | {"Fc": 1000.0})[0], "a soft seal, for what they found may be too stiff"
    best, asked = _tightly(monkeypatch, 1000.0, 600.0, *[700.0] * 4, *[600.0] * 2, relaxation=LOOSE)
    assert best.cost == 600.0 and len(asked) == 7


def test_what_runs_out_of_iterations_on_the_way_goes_on_from_where_it_came(monkeypatch):
    """Of the first starts, of which most lead nowhere, none does."""
    ends = (999.0, 900.0, *[950.0] * 3, 905.0, 700.0, *[699.0] * 3)
    best, asked = _tightly(monkeypatch, 1000.0, *ends, unsettled=(950.0, 905.0))
    assert [start["Fc"] for start in asked[5:]] == [900.0, 905.0, 900.0, 700.0, 700.0]
    assert best.cost == 700.0
    best, asked = _tightly(monkeypatch, 1000.0, 999.0, 900.0, *[950.0] * 3, 905.0, 910.0, 905.0, 910.0, unsettled=(905.0,))
    assert best.cost == 900.0 and len(asked) == 9, "it may lead to worse"
    best, _ = _tightly(monkeypatch, 1000.0, 999.0, 900.0, *[950.0] * 3, 905.0, -700.0, unsettled=(905.0,))
    assert (best.cost, best.status) == (900.0, INTERRUPTED)


def test_a_tight_fit_that_is_stopped_leaves_the_best_so_far_and_says_so(monkeypatch):
    best, asked = _tightly(monkeypatch, 1000.0, 999.0, 900.0, -500.0)
    assert (best.cost, best.status, len(asked)) == (900.0, INTERRUPTED, 3)
    best, asked = _tightly(monkeypatch, 1000.0, 800.0, -500.0, 700.0)
    assert (best.cost, best.status, len(asked)) == (800.0, INTERRUPTED, 2), "no other seal is tried after that"


def test_a_law_without_break_away_has_no_other_seal(monkeypatch):
    monkeypatch.setattr(SEAL.law, "static", True)
    assert _tightly(monkeypatch, 1000.0)[0].cost == 1000.0


def test_laws_of_break_away_keep_their_peak():
    effect = SimpleNamespace(break_away=lambda *_: {"Fs_p1": 1.0})
    plant = SimpleNamespace(law=SEAL.law, rig=SEAL.rig, effects=(effect,))
    found = seals(plant, FOUND)
    assert len(found) == 2 and all((one["Fs"], one["vs"]) == (FOUND["Fs"], FOUND["vs"]) for one in found)
    assert {name for one in found for name in one} == set(FOUND)
    assert all(set(one) == {"Fc", "sigma0"} for one in seals(SEAL, {"Fc": 9.0, "sigma0": 1e5})), "Dahl: no peak, no damping"
    assert damped(SEAL, {"Fc": 9.0, "sigma0": 1e5}) == {"Fc": 9.0, "sigma0": 1e5}


def test_a_rig_whose_loose_defects_take_up_the_break_away_is_identified():
    """23 mm bore at 700 Hz: loose defects lead far off, tight ones from a softer seal to the exact fit."""
    drawn = random_servo(8314, 0.0)
    top, how = drawn.truth.supply - ATMOSPHERE, {"rate": drawn.rate, "sensors": drawn.sensors}
    plan = (("multisine", 3 / 7), ("travel", 5 / 7), ("slow", 1.0))
    stand = Rig.from_dict(tomllib.loads(drawn.rig_toml({f"r{i}.csv": share * top for i, (_, share) in enumerate(plan)})))
    records = [
        record_servo(drawn.truth, NOTHING, kind, 6.0, 831400 + i, supply=share * top + ATMOSPHERE, **how)
        for i, (kind, share) in enumerate(plan)
    ]
    runs = [Recording.from_arrays(f"r{i}.csv", stand, **record) for i, record in enumerate(records)]
    found = fitting.fit(Plant(stand, "lugre"), runs)
    assert found.stage == "exact" and found.cost_per_sample < 1.03
