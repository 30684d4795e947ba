"""Refits of a diagnosis: the same from one process and from two, none made twice, rebuilt from plain numbers."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from pneuid.criticism.refitting import refitter as refitting
from pneuid.criticism.refitting.refits import Asked, Standing, refit
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.effects import CATALOGUE, LAW_STEPS
from pneuid.estimation.fit import Fit, comparable_costs
from pneuid.estimation.solution import Solution
from pneuid.estimation.task import inside
from pneuid.pool import open_pool
from pneuid.store import Store
from tests.helpers import base_fit

ORDER = tuple(CATALOGUE | LAW_STEPS)
ASKED = (
    Asked(CATALOGUE["leakage_internal"], {"G_leak": 1e-10}, 0.1, thorough=False),
    Asked(CATALOGUE["gravity"], {"F_g": 1.0}, 0.1, thorough=False),
)


def _all(refitter: Refitter, base: Fit) -> list[Fit]:
    return [make() for _, make in refitter.each(base, ASKED)]


def test_a_fit_is_rebuilt_from_its_numbers():
    base = base_fit("leakage_internal")
    content = json.loads(json.dumps(Solution.of(base).to_dict()))
    again = Solution.from_dict(content).fit(base.plant, base.runs, base.noise)
    assert again.values == base.relaxed_values
    assert (again.loose_cost, again.defect_level, again.status) == (base.loose_cost, base.defect_level, base.status)
    assert np.array_equal(again.relaxed.X, base.relaxed.X)
    assert again.problem.evaluate_values(again.relaxed.X)[1] == base.problem.evaluate_values(base.relaxed.X)[1]


def test_a_diverged_fit_is_kept_and_rebuilt_as_one(tmp_path):
    """A refit of a diagnosis that ended at infinity was more than the file of what is done already could hold."""
    base = base_fit("leakage_internal")
    sound = Solution.of(base)
    X = np.nan, -np.inf, *sound.X[2:]
    diverged = replace(sound, cost=np.inf, penalty=np.nan, level=np.inf, loose_cost=np.nan, X=X)
    Store(tmp_path / "done.jsonl").put("key", diverged.to_dict())
    again = Solution.from_dict(Store(tmp_path / "done.jsonl")["key"])
    for item in fields(Solution):
        np.testing.assert_equal(getattr(again, item.name), getattr(diverged, item.name))
    assert comparable_costs(again.fit(base.plant, base.runs, base.noise), base)[0] == np.inf


def test_two_processes_find_what_one_finds_and_what_is_kept_is_not_made_again(tmp_path, monkeypatch):
    base = base_fit("leakage_internal")
    here = _all(Refitter(ORDER, store=Store(tmp_path / "here.jsonl")), base)
    with open_pool(2) as pool:
        there = _all(Refitter(ORDER, pool=pool, store=Store(tmp_path / "there.jsonl")), base)
    for one, other in zip(here, there, strict=True):
        assert one.values == other.values
        assert one.loose_cost == other.loose_cost
    for name in ("here", "there"):
        monkeypatch.setattr("pneuid.criticism.refitting.refitter.refit", _forbidden)
        again = _all(Refitter(ORDER, store=Store(tmp_path / f"{name}.jsonl")), base)
        assert [fit.values for fit in again] == [fit.values for fit in here]


def _forbidden(*_: object) -> Fit:
    raise AssertionError("made again")


OTHERWISE = {
    "effect": CATALOGUE["gravity"], "start": {"G_leak": 2e-10}, "gain": 0.2, "thorough": True, "way": 1.0, "anew": True,
    "cold": True,
}  # fmt: skip
"""Another value of everything that can be asked."""


@pytest.mark.parametrize("change", [*(item.name for item in fields(Asked)), "base"])
def test_what_decides_a_refit_is_in_its_key(change):
    standing, other = (Standing.of(base_fit("leakage_internal", seed)) for seed in (1, 2))
    refitter = Refitter(ORDER)
    asked = replace(ASKED[0], **{change: OTHERWISE[change]}) if change in OTHERWISE else ASKED[0]
    assert refitter._key(standing, ASKED[0]) == refitter._key(standing, ASKED[0])
    assert refitter._key(other if change == "base" else standing, asked) != refitter._key(standing, ASKED[0])


def test_another_process_is_asked_for_the_same(monkeypatch):
    base, seen = base_fit("leakage_internal"), []
    monkeypatch.setattr(refitting, "refit", lambda _standing, asked, order: seen.append((asked, order)) or base)
    asked = Asked(**OTHERWISE)
    refitting._made(Refitter(ORDER)._task(Standing.of(base), asked))
    ((given, order),) = seen
    assert order == ORDER and given.effect.name == asked.effect.name
    assert replace(given, effect=asked.effect) == asked


def test_a_refit_lowers_the_cost_by_what_is_missing_and_not_by_what_is_not():
    base = base_fit("leakage_internal")
    leak, weight = (refit(Standing.of(base), asked, ORDER) for asked in ASKED)
    assert base.loose_cost - leak.loose_cost > 5 * max(base.loose_cost - weight.loose_cost, 1.0)


def test_the_model_without_an_effect_is_not_lost_where_loose_defects_lead_astray_from_an_exact_fit(monkeypatch):
    base = base_fit()
    relaxed = refit(Standing.of(base), ASKED[1], ORDER)
    exact = Refitter(ORDER).completed(relaxed)
    assert exact.exact is not None
    dear = 3.0 * base.relaxed_cost
    astray = replace(Solution.of(base), cost=dear, loose_cost=dear).fit(base.plant, base.runs, base.noise)
    monkeypatch.setattr("pneuid.criticism.refitting.refits._warm", lambda *_: astray)
    assert Refitter(ORDER).without(relaxed, "gravity") is astray
    found = Refitter(ORDER).without(exact, "gravity")
    assert found.plant.effects == () and found.loose_cost < 1.01 * base.loose_cost


def test_break_away_is_read_anew_where_that_costs_clearly_less():
    """A fit of the right model that was held at a stiff, undamped bristle; one at its end stays as it is."""
    base = base_fit("")
    values = base.values | {"sigma0": 20 * base.values["sigma0"], "sigma1": 0.05 * base.values["sigma1"]}
    X = base.relaxed.X.copy()
    X[: base.problem.nq] = inside(base.problem, values)
    cost = 5 * base.relaxed_cost
    stuck = replace(base, relaxed=replace(base.relaxed, X=X, cost=cost, penalty=0.0), values=values, exact=None)
    again = Refitter(ORDER).sharper(stuck)
    assert again is not stuck and again.relaxed_cost < 1.2 * base.relaxed_cost
    assert again.values["sigma0"] < 3 * base.values["sigma0"]
    assert again.plant is base.plant
    cheap = replace(stuck, relaxed=replace(stuck.relaxed, cost=0.5 * again.relaxed_cost))
    assert Refitter(ORDER).sharper(cheap) is cheap


def test_where_an_exact_fit_leads_nowhere_is_found_out_once(monkeypatch):
    asked = []
    monkeypatch.setattr(refitting, "completed", lambda fit, _: asked.append(fit) or fit)
    refitter, fits = Refitter(ORDER), [replace(base_fit("leakage_internal")) for _ in range(2)]
    assert [refitter.completed(fits[i]) is fits[i] for i in (0, 1, 0)] == [True] * 3
    assert [fit is one for fit, one in zip(asked, fits, strict=True)] == [True, True]
