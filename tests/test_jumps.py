"""Effects that act in jerks promise something at a sizable step, and nothing does where nothing hides."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers import base_fit, scores

from pneuid.criticism.decision.acceptance import LEAST_DROP
from pneuid.criticism.decision.rounds import OVERTAKES
from pneuid.criticism.screening import jumps as screening_jumps
from pneuid.criticism.screening.batches import Batch
from pneuid.criticism.screening.fitted import Fitted
from pneuid.criticism.screening.jumps import Jump, jumped
from pneuid.criticism.screening.scores import screen
from pneuid.effects import CATALOGUE
from pneuid.plant import Plant

NAMES = ("backlash", "friction_lag", "friction_direction", "gravity", "load_mass")
TYPICAL = 3.0


def sizes() -> dict[str, dict[str, float]]:
    """Values at three times the scale of every amplitude of some effects on the force, upwards."""
    fit = base_fit()
    return {
        name: {
            item.name: min(item.off + TYPICAL * item.scale, item.upper)
            for item in CATALOGUE[name].parameters(fit.plant.rig, fit.plant.law)
            if item.off is not None
        }
        for name in NAMES
    }


@cache
def jumps(hidden: str = "", seed: int = 1) -> dict[str, Jump]:
    return jumped(base_fit(hidden, seed), scores(hidden, seed), sizes(), list(CATALOGUE))


def at_zero(seed: int) -> dict[str, float]:
    return {score.effect.name: score.drop for score in scores("backlash", seed)}


def test_play_promises_enough_at_a_step_to_overtake_what_it_does_at_zero():
    at_a_step = jumps("backlash", 2)
    assert at_a_step["backlash"].drop > max(LEAST_DROP, OVERTAKES * at_zero(2)["backlash"])
    assert max(at_a_step.values(), key=lambda jump: jump.drop) is at_a_step["backlash"]


@pytest.mark.parametrize("seed", [1, 2])
def test_play_promises_most_at_zero_or_at_a_step(seed):
    """The first model without play has two optima; how sums are rounded decides which, and which way play shows there."""
    best = max(jumps("backlash", seed)["backlash"].drop, at_zero(seed)["backlash"])
    others = [drop for name, drop in at_zero(seed).items() if name != "backlash"]
    others += [jump.drop for name, jump in jumps("backlash", seed).items() if name != "backlash"]
    assert best > OVERTAKES * max(others)


def test_where_nothing_hides_no_step_promises_anything():
    assert set(jumps()) == set(NAMES)
    # four steps each of five effects, half a chi-square of one degree: above 10 once in 10^4
    assert max(jump.drop for jump in jumps().values()) < 10.0


def test_a_step_of_either_sign_is_tried():
    up = sizes()
    down = {name: {key: -value for key, value in found.items()} for name, found in up.items()}
    hidden = "friction_direction"
    there = jumped(base_fit(hidden), scores(hidden), {hidden: up[hidden]}, list(CATALOGUE))[hidden]
    back = jumped(base_fit(hidden), scores(hidden), {hidden: down[hidden]}, list(CATALOGUE))[hidden]
    assert there.drop > 500.0
    assert there.drop == pytest.approx(back.drop, rel=1e-9) and there.start == pytest.approx(back.start)


def test_what_has_no_state_is_looked_at_at_five_typical_sizes_too(monkeypatch):
    """At a thousandth of its size what it promises still grows with the step."""
    monkeypatch.setattr(screening_jumps, "NOTHING", 0.0)
    monkeypatch.setattr(screening_jumps, "HARDLY", 0.0)
    tiny = {key: 1e-3 * value for key, value in sizes()["gravity"].items()}
    found = jumped(base_fit("gravity"), scores("gravity"), {"gravity": tiny}, list(CATALOGUE))["gravity"]
    assert {key: abs(value) / tiny[key] for key, value in found.start.items()} == pytest.approx(dict.fromkeys(tiny, 5.0))


@pytest.mark.parametrize(
    ("name", "near", "reach"), [("gravity", 20.0, 5.0), ("friction_lag", 20.0, 1.0), ("friction_lag", 10.0, 5.0)]
)
def test_further_out_goes_what_has_no_state_or_promises_next_to_nothing(name, near, reach, monkeypatch):
    """Whatever the data say: each step promises what the case says, the far one most."""

    def promised(*asked):
        far = asked[-1] == screening_jumps.LEAPS
        return Jump(30.0, {"reach": 5.0}) if far else Jump(near, {"reach": 1.0})

    monkeypatch.setattr(screening_jumps, "_best_step", promised)
    monkeypatch.setattr(screening_jumps, "NOTHING", 15.0)
    monkeypatch.setattr(screening_jumps, "HARDLY", 0.0)
    found = jumped(base_fit("gravity"), scores("gravity"), {name: sizes()[name]}, list(CATALOGUE))[name]
    assert found.start == {"reach": reach}


def test_the_drop_is_that_of_the_best_multiple_up_to_twice():
    """Against a grid of multiples of the quadratic model."""
    fit = base_fit("gravity")
    found = jumped(fit, scores("gravity"), {"gravity": sizes()["gravity"]}, list(CATALOGUE))["gravity"]
    fitted = Fitted(fit)
    order = list(CATALOGUE)
    effects = sorted([*fit.plant.effects, CATALOGUE["gravity"]], key=lambda effect: order.index(effect.name))
    plant = Plant(fit.plant.rig, fit.plant.law.name, effects)
    run, off = fitted.runner(plant), plant.starts() | fitted.values
    moved = fitted.response(run, plant, fitted.nodes, off | found.start)
    change = moved - fitted.response(run, plant, fitted.nodes, off | dict.fromkeys(found.start, 0.0))
    cross = fitted.cross(change[:, None])[:, 0]
    follow = fitted.solver.solve(cross)
    best = max(
        (
            -(m * (change @ fitted.residual - follow @ fitted.gradient) + 0.5 * m**2 * (change @ change - cross @ follow))
            for m in np.linspace(0.0, 2.0, 2001)
        ),
    )
    assert found.drop == pytest.approx(best, rel=1e-3)


@pytest.mark.parametrize("far", [1e200, np.inf, np.nan])
def test_a_step_that_runs_away_promises_nothing_and_warns_nobody(far, monkeypatch):
    found, usual = scores(), Batch.change
    monkeypatch.setattr(Batch, "change", lambda *how: usual(*how) + np.where(np.arange(len(how[0].before)) < 9, far, 0.0))
    assert all(jump.drop == 0.0 for jump in jumped(base_fit(), found, sizes(), list(CATALOGUE)).values())
    assert all(score.drop == 0.0 for score in screen(base_fit(), [CATALOGUE[name] for name in NAMES], list(CATALOGUE)))
