"""The grid: who computes, what is remembered, what the tables say, and the command."""

from __future__ import annotations

import json
import math
import os
import sys
from dataclasses import replace

import numpy as np
import pytest

from controllers import loop
from controllers.candidates import AWARE, CONSTANT, Identification, built_in, candidates_of, identifications
from controllers.conditions import AS_KNOWN, Condition
from controllers.figures import price_figure, save_figures
from controllers.grid import Candidate, Result, run_study
from controllers.nominal import nominal_model
from controllers.references import Sine, Steps
from controllers.scenario import Price, Recordings, Scenario, read_scenario
from controllers.study import main
from controllers.tables import by_condition, prices, rms, tables
from controllers.tuning import Design
from pneuid.errors import ComputationError, UserError
from pneuid.pool import InProcess, open_pool
from pneuid.resources import scenario_path
from pneuid.store import Store, key_of, numbers, plain
from pneuid.virtual_rig.friction import FRICTION_2011
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.truth import TruthServo

TRUTH = TruthServo()
FIVE_BAR = TRUTH.patm + 5e5
SINE = Sine("sine", 0.25, 0.4, 0.02, 1.0, 0.2)
STEPS = Steps("steps", 0.2, 1.0, (0.01,), 1.0, 0.4)
HEAVY = Condition("heavy", hidden=Hidden(load_mass=1.2))
SMALL = Scenario(
    "small", ("pid", "cascade"), (FIVE_BAR - 1e5, FIVE_BAR), (SINE,), Design(FIVE_BAR), refined=False,
    conditions=(AS_KNOWN, HEAVY),
)  # fmt: skip
BEFORE_AFTER = [
    Candidate("before", *nominal_model(TRUTH)),
    Candidate("after", *nominal_model(replace(TRUTH, polytropic=1.3))),
]
PID = replace(SMALL, controllers=("pid",), conditions=(AS_KNOWN,))


@pytest.fixture(scope="module")
def here():
    """The small study, computed in this process."""
    return run_study(SMALL, BEFORE_AFTER, TRUTH)


def said(results):
    """What may not depend on who computed it; the time a step took does."""
    fields = ("model", "controller", "condition", "supply", "reference", "seed", "gains", "signature")
    # as words, in which one nan is like another
    metrics = [repr(replace(own.metrics, step_median=0.0, step_99=0.0)) for own in results]
    return [[getattr(own, name) for name in fields] for own in results], metrics


# --- who computes ---


def test_every_combination_once_and_in_order(here):
    expected = [
        (model, controller, condition, supply)
        for model in ("before", "after")
        for controller in SMALL.controllers
        for condition in ("as known", "heavy")
        for supply in SMALL.supplies
    ]
    assert [(own.model, own.controller, own.condition, own.supply) for own in here] == expected
    assert len({own.signature for own in here}) == len(here)
    assert [own.run is not None for own in here] == [
        own.condition == "as known" and own.supply == FIVE_BAR for own in here
    ]


def test_two_processes_give_the_same_numbers(here):
    with open_pool(2) as pool:
        there = run_study(SMALL, BEFORE_AFTER, TRUTH, pool=pool)
    assert said(there) == said(here)


def test_a_dask_cluster_of_several_processes_gives_the_same_numbers(here):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    )
    with local as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            processes = set(client.run(os.getpid).values())
        with open_pool(scheduler=cluster.scheduler_address) as pool:
            there = run_study(SMALL, BEFORE_AFTER, TRUTH, pool=pool)
    assert said(there) == said(here)
    assert len(processes) == 2 and os.getpid() not in processes


def test_an_address_without_a_scheduler_is_named(monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr("pneuid.pool.CONNECTING", 0.2)
    with (
        pytest.raises(UserError, match=r"tcp://127.0.0.1:9: no Dask scheduler"),
        open_pool(scheduler="tcp://127.0.0.1:9"),
    ):
        pass


def test_without_the_extra_the_scheduler_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"pneuid\[cluster\]"), open_pool(scheduler="tcp://127.0.0.1:9"):
        pass


# --- what is remembered ---


class Killed(InProcess):
    """Is interrupted after so many results."""

    def __init__(self, after):
        self.left = after

    def each(self, function, items):
        for pair in super().each(function, items):
            if not self.left:
                raise KeyboardInterrupt
            self.left -= 1
            yield pair


def test_a_killed_study_goes_on_where_it_was(here, tmp_path):
    path = tmp_path / "done.jsonl"
    with pytest.raises(KeyboardInterrupt):
        run_study(SMALL, BEFORE_AFTER, TRUTH, pool=Killed(9), store=Store(path))
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) == 9  # four tunings and five loops
    path.write_text("\n".join(lines) + "\n" + lines[-1][: len(lines[-1]) // 2], encoding="utf-8")
    told = []
    again = run_study(SMALL, BEFORE_AFTER, TRUTH, store=Store(path), on_result=lambda *words: told.append(words))
    assert told[1][:2] == (5, 16) and told[-1][:2] == (16, 16)
    assert said(again) == said(here)
    known = Store(path)
    whole = run_study(SMALL, BEFORE_AFTER, TRUTH, pool=Killed(0), store=known)
    assert said(whole) == said(here)
    np.testing.assert_array_equal(whole[1].run.x, here[1].run.x)


@pytest.mark.parametrize(
    "changed",
    [
        replace(PID, seeds=(2,)),
        replace(PID, design=replace(PID.design, alpha=0.7)),
        replace(PID, references=(replace(SINE, amplitude=0.03),)),
        replace(PID, conditions=(HEAVY,)),
        replace(PID, sensors=replace(PID.sensors, x_noise=3e-6)),
    ],
    ids=["seed", "alpha", "reference", "condition", "noise"],
)
def test_another_study_is_never_taken_for_known(changed):
    store = Store()
    run_study(PID, BEFORE_AFTER[:1], TRUTH, store=store)
    with pytest.raises(KeyboardInterrupt):
        run_study(changed, BEFORE_AFTER[:1], TRUTH, pool=Killed(1), store=store)


def test_the_store_keeps_every_digit_and_what_is_no_number(tmp_path):
    metrics = loop.Metrics(0.1 + 0.2, 1 / 3, math.nan, math.nan, math.nan, 1e-300, 5e-6, 6e-6)
    Store(tmp_path / "s").put("a", plain(metrics))
    back = loop.Metrics(**numbers(Store(tmp_path / "s")["a"]))
    assert back.rms == metrics.rms and back.peak == metrics.peak and back.travel == 1e-300
    assert math.isnan(back.wander)
    assert key_of(0.1) != key_of(np.nextafter(0.1, 1.0))


# --- candidates ---


def test_constant_friction_is_given_to_the_controllers_that_use_friction_only():
    found = built_in(replace(TRUTH, friction=FRICTION_2011), FIVE_BAR)
    assert [own.label for own in found] == [AWARE, CONSTANT]
    assert found[0].controllers is None and set(found[1].controllers) == {"servo", "nmpc"}
    assert [own.label for own in built_in(TRUTH, FIVE_BAR)] == ["exact"]


def test_a_price_has_a_rig_and_two_models():
    price = Price("gravity", Condition("gravity", hidden=Hidden(gravity=20.0)))
    scenario = replace(PID, models="identified", prices=(price,), conditions=(price.condition,))
    having, lacking = identifications(scenario, TRUTH, NOTHING)
    assert (having.label, having.add, lacking.label, lacking.add) == (
        "with gravity",
        ("gravity",),
        "without gravity",
        (),
    )
    assert having.hidden.gravity == lacking.hidden.gravity == 20.0


class Fitted(InProcess):
    """Stands for the identification, which other tests are about."""

    def __init__(self):
        self.asked = []

    def each(self, _, items):
        from pneuid.model import nominal_model as stated

        for place, task in enumerate(items):
            assert isinstance(task, Identification)
            self.asked.append(task.label)
            ranges = {"p1_low": 1e5, "p1_high": 8e5, "p2_low": 1e5, "p2_high": 8e5, "x_low": 0.1, "x_high": 0.4}
            from controllers.measure import rig_of

            yield place, stated(rig_of(TRUTH, {}), {}, ranges, task.add)


def test_identified_models_are_saved_and_taken_again(tmp_path):
    scenario = replace(SMALL, models="identified", recordings=Recordings(1.0, 1))
    pool = Fitted()
    found = candidates_of(scenario, TRUTH, NOTHING, pool, Store(tmp_path / "s"), tmp_path)
    assert pool.asked == [AWARE, CONSTANT] and [own.label for own in found] == pool.asked
    assert len(list((tmp_path / "models").glob("*.json"))) == 2
    again = candidates_of(scenario, TRUTH, NOTHING, pool, Store(tmp_path / "s"), tmp_path)
    assert len(pool.asked) == 2
    np.testing.assert_array_equal(again[0].theta, found[0].theta)


# --- tables and figures ---


def result(model, controller, condition, supply, value, wander=math.nan):
    metrics = loop.Metrics(value, 2 * value, math.nan, math.nan, wander, 3.0, 1e-5, 2e-5)
    return Result(model, controller, condition, supply, "sine", 1, metrics, {}, "", None)


def test_prices_are_the_difference_of_two_models():
    found = [
        result("with gravity", "servo", "gravity", FIVE_BAR, 40e-6),
        result("without gravity", "servo", "gravity", FIVE_BAR, 100e-6),
    ]
    grid = prices(found, TRUTH.patm)
    assert grid.rows == (("gravity", "servo (LuGre + ESO)", "0.100", "0.040", "+60"),)
    assert [own.title for own in tables(found, FIVE_BAR, TRUTH.patm)] == [grid.title]
    assert "| gravity | servo (LuGre + ESO) | 0.100 | 0.040 | +60 |" in grid.markdown()
    drawn = price_figure(found, TRUTH.patm).axes[0]
    assert sorted(float(x) for own in drawn.lines if own.get_marker() == "o" for x in own.get_xdata()) == [0.04, 0.1]


def test_errors_over_loops_add_by_squares_and_a_diverged_loop_is_said():
    found = [result("m", "pid", "as known", FIVE_BAR, value) for value in (3e-3, 4e-3)]
    assert rms(found) == pytest.approx(math.sqrt(12.5))
    lost = replace(found[0], metrics=None, condition="wild")
    grid = by_condition([*found, lost], "", rms, 1)
    assert grid.rows == (("as known", "3.5"), ("wild", "diverged"))


def test_the_uniformity_names_the_worst_reference():
    found = [
        result("m", "nmpc", "as known", TRUTH.patm + bar * 1e5, value)
        for bar, value in ((3, 2e-5), (5, 1e-5), (7, 1.1e-5))
    ]
    _, uniform = tables(found, FIVE_BAR, TRUTH.patm)
    assert uniform.rows == (("NMPC (LuGre + ESO)", "0.020", "0.010", "0.011", "100"),)


def test_a_study_with_conditions_draws_its_maps(here, tmp_path):
    names = {path.name for path in save_figures(here, "small", TRUTH.patm, tmp_path)}
    assert names == {"errors.png", "tracking.png", "pressure.png", "conditions.png", "standstill.png"}
    assert all(1e4 < (tmp_path / name).stat().st_size < 2e5 for name in names)


# --- the command ---

TEXT = """
title = "small"
controllers = ["pid"]
supplies = ["5 bar"]
[design]
supply = "5 bar"
refine = false
[[references]]
name = "sine"
kind = "sine"
centre = "250 mm"
amplitude = "20 mm"
frequency = "1 Hz"
fade = "0.2 s"
duration = "0.4 s"
"""


def test_the_command_writes_its_study_once_and_resumes_it(tmp_path, capsys):
    path, out = tmp_path / "scenario.toml", tmp_path / "out"
    path.write_text(TEXT, encoding="utf-8")
    given = [str(path), "--out", str(out), "--workers", "1"]
    main(given)
    content = json.loads((out / "study.json").read_text(encoding="utf-8"))
    assert content["schema"] == 2 and len(content["results"]) == 1
    assert 0.0 < content["results"][0]["metrics"]["rms"] < 0.1
    assert (out / "errors.png").stat().st_size > 10_000
    assert "| PID + feed-forward |" in (out / "tables.md").read_text(encoding="utf-8")
    assert "closed loops" in capsys.readouterr().out
    with pytest.raises(UserError, match="--overwrite"):
        main(given)
    main([*given, "--resume"])
    assert "1 of 1 loops were known" in capsys.readouterr().err
    assert json.loads((out / "study.json").read_text(encoding="utf-8")) == content
    with pytest.raises(UserError, match="--out is missing"):
        main([str(path)])


@pytest.mark.parametrize(
    ("given", "what"),
    [
        (["--workers", "0"], "--workers 0"),
        (["--workers", "2", "--scheduler", "tcp://x:1"], "leave one out"),
        (["--chain", "--resume"], "leave one out"),
        (["--resume", "--overwrite"], "leave one out"),
    ],
)
def test_options_that_make_no_sense_are_refused(given, what, tmp_path):
    with pytest.raises(UserError, match=what):
        main(["--out", str(tmp_path / "none"), *given])
    assert not (tmp_path / "none").exists()


def test_a_rig_that_diverges_is_no_result_but_the_others_count(monkeypatch):
    real = loop.run

    def run(controller, plant, reference, supply, seed):
        if supply < FIVE_BAR:
            raise ComputationError("gone")
        return real(controller, plant, reference, supply, seed)

    monkeypatch.setattr("controllers.grid.loop.run", run)
    found = run_study(PID, BEFORE_AFTER[:1], TRUTH)
    assert [own.metrics is None for own in found] == [True, False]


def test_the_shipped_scenarios_are_read():
    for name in ("pressure_grid.toml", "disturbances.toml", "price_list.toml"):
        scenario, _, _ = read_scenario(scenario_path(name))
        assert scenario.title and scenario.references and len(scenario.supplies) >= 2, name
