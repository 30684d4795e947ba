"""Real measurements beside their published figures; skipped where the data, which are not shipped, are absent."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import pytest
from real_data import EMPS, EMPS_DIRECTION, relative_error

import pneuid
from pneuid import api
from pneuid.criticism.decision.exchange import exchanged
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.trial import judge_of
from pneuid.effects import CATALOGUE
from pneuid.estimation.preparation import prepare
from pneuid.resources import scenario_path

REPOSITORY = Path(__file__).parents[1]
DATA = Path(os.environ.get("PNEUID_REAL_DATA") or REPOSITORY.parent / "shared" / "data" / "real")
EMPS_FILE = DATA / "emps" / "DATA_EMPS.mat"
ZILLEN = DATA / "zillen_pneumatic_friction" / "friction"

needs_emps = pytest.mark.skipif(
    not EMPS_FILE.exists(), reason=f"{EMPS_FILE} is not here; scenarios/real/README.md says where it comes from"
)
needs_zillen = pytest.mark.skipif(
    not ZILLEN.exists(), reason=f"{ZILLEN} is not here; scenarios/real/README.md says where it comes from"
)


@cache
def emps_run() -> tuple[pneuid.Rig, pneuid.Recording]:
    """The axis and its one run."""
    rig = pneuid.Rig.from_toml(scenario_path("real/emps/rig.toml"))
    return rig, pneuid.Recording.read(EMPS_FILE, rig)


@cache
def emps_model(*effects: str) -> api.IdentifiedModel:
    """EMPS fitted with Coulomb friction and ``effects``."""
    rig, run = emps_run()
    return pneuid.fit(rig, [run], add=effects)


def error_of(model: api.IdentifiedModel) -> float:
    """The published metric, relative."""
    _, run = emps_run()
    return relative_error(run.signals["F"], model.simulate(run)["F"], run.rate)


@needs_emps
def test_emps_gives_the_published_parameters():
    model = emps_model("load_mass", "gravity")
    assert model.content.friction == "coulomb"
    for name, published in EMPS.items():
        assert model.values[name] == pytest.approx(published, rel=0.01), name


@needs_emps
def test_emps_leaves_the_published_error():
    assert 0.039 < error_of(emps_model("load_mass", "gravity")) < 0.044  # 4.08 % by Janot, Gautier, Brunot 2019


@needs_emps
@pytest.mark.slow
def test_emps_lacks_friction_that_depends_on_direction():
    _, run = emps_run()
    found = emps_model("load_mass", "gravity").diagnose([run])
    assert found.verdict in ("effect", "ambiguous", "unknown")
    assert "friction_direction" in found.effects


@needs_emps
def test_emps_by_direction_gives_the_published_viscous_friction():
    model = emps_model("load_mass", "friction_direction")
    middle, half = model.values["sigma2"], model.values["sigma2_d"]
    assert middle + half == pytest.approx(EMPS_DIRECTION["Fv+"], rel=0.01)
    assert middle - half == pytest.approx(EMPS_DIRECTION["Fv-"], rel=0.01)
    assert error_of(model) < error_of(emps_model("load_mass", "gravity"))


@needs_zillen
@pytest.mark.slow
def test_the_seal_of_zillen_lacks_friction_that_depends_on_pressure():
    rig = pneuid.Rig.from_toml(scenario_path("real/zillen/rig.toml"))
    runs = {bar: pneuid.Recording.read(ZILLEN / f"O-ring_{bar}bar.csv", rig) for bar in (1, 3, 5, 7)}
    held = runs.pop(1)
    # what is said after all rounds, a quarter of an hour on one core, is that of benchmarks/real_data.py
    verdict = api.diagnose(pneuid.fit(rig, list(runs.values())), list(runs.values()), [held], minutes=3.0)
    assert "friction_pressure" in verdict.diagnosis.effects
    accepted = [rung.hold_out["F"] for rung in verdict.rungs if rung.accepted]
    assert len(accepted) > 1
    assert accepted[-1] < accepted[0]


@needs_zillen
@pytest.mark.slow
def test_no_warmth_takes_the_place_of_the_pressure_of_zillens_seal():
    """By a level read off the run held out it predicts that one, at another pressure, better: a rival, and no more."""
    rig = pneuid.Rig.from_toml(scenario_path("real/zillen/rig.toml"))
    train = [pneuid.Recording.read(ZILLEN / f"O-ring_{bar}bar.csv", rig) for bar in (3, 5, 7)]
    held = pneuid.Recording.read(ZILLEN / "O-ring_1bar.csv", rig)
    fitted = pneuid.fit(rig, train, add=["friction_pressure", "friction_presliding_memory"]).fitted
    judge, refitter = judge_of(fitted, [prepare(held, fitted.plant, fitted.noise)]), Refitter(list(CATALOGUE))
    without = judge.trial(refitter.without(fitted, "friction_pressure"))
    candidates = [CATALOGUE[name] for name in ("friction_pressure", "friction_warmup")]
    found = exchanged("friction_pressure", without, judge.trial(fitted), judge, refitter, candidates, lambda _: None)
    assert found.taking is None
    assert [score.effect.name for score, _ in found.rivals] == ["friction_warmup"]
