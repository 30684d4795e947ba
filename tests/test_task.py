"""The time step of a relaxed fit: how many substeps a start may have, and when a solution gets finer ones."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import helpers
import numpy as np
import pytest

from pneuid.errors import UserError
from pneuid.estimation import fit as fitting
from pneuid.estimation import task as tasks
from pneuid.estimation.preparation import prepare
from pneuid.estimation.stages import DEFECT_GATE
from pneuid.estimation.task import Task
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.step import LARGEST_SUBSTEPS
from pneuid.virtual_rig import NOTHING, TruthServo, record_servo

TOO_WRONG = 2.0 * DEFECT_GATE


def _growing(costs, level, monkeypatch, hopeless=np.inf):
    """Substeps of the problems solved where every solution asks for one more, and the fit that was kept."""
    solved = []

    def problem(_, substeps):
        solved.append(substeps)
        return SimpleNamespace(
            substeps=substeps, samples=20, join=lambda q, _: q, split=lambda X: (X, X), evaluate_values=lambda X: (X, 1.0)
        )

    def stage(problem, *_):
        outcome = SimpleNamespace(X=problem.substeps, cost=costs[problem.substeps - 1], penalty=0.0, status="Settled")
        return SimpleNamespace(outcome=outcome, level=level)

    monkeypatch.setattr(tasks, "values_at", lambda _, X: {"sigma1": X})
    monkeypatch.setattr(tasks, "inside", lambda _, values: values["sigma1"])
    task = SimpleNamespace(
        guess={"sigma1": 0}, monitor=None, loosely=None, hopeless=hopeless, problem=problem, finest=LARGEST_SUBSTEPS,
        substeps=lambda values: min(values["sigma1"] + 1, len(costs)), nodes=lambda *_: None,
    )  # fmt: skip
    kept, _ = tasks.relaxed_fit(task, {}, stage)
    return solved, kept.substeps


@pytest.mark.parametrize(
    ("costs", "level", "solved"),
    [
        ((900.0, 500.0, 499.0, 498.0), TOO_WRONG, [1, 2, 3]),
        ((900.0, 500.0, 499.0, 498.0), 0.5 * DEFECT_GATE, [1, 2, 3, 4]),
        ((900.0, 500.0, 450.0, 400.0), TOO_WRONG, [1, 2, 3, 4]),
        ((900.0, 950.0, 450.0), TOO_WRONG, [1, 2]),
    ],
    ids=["no longer helped", "near enough for the exact stage", "still helped", "made worse"],
)
def test_a_model_that_is_too_wrong_gets_finer_steps_only_while_they_help(costs, level, solved, monkeypatch):
    assert _growing(costs, level, monkeypatch) == (solved, solved[-1])


@pytest.mark.parametrize(("hopeless", "solved"), [(np.inf, [1, 2]), (30.0, [1]), (300.0, [1, 2])])
def test_a_solution_that_costs_too_much_is_not_solved_again_with_finer_steps(hopeless, solved, monkeypatch):
    assert _growing((220.0, 220.0), 0.0, monkeypatch, hopeless) == (solved, solved[-1])


@pytest.mark.parametrize(
    ("runs_away", "begun"),
    [
        ((), ("given", 3)),
        ((("given", 3),), ("guess", 2)),
        ((("given", 3), ("guess", 2)), ("given", 40)),
        ((("given", 3), ("guess", 2), ("given", 40)), ("given", 40)),
    ],
)
def test_a_fit_begins_where_its_states_do_not_run_away(runs_away, begun, monkeypatch):
    """Values of a model that lacked an end cushion ran away when read anew, and the fit from there was not a number."""

    def problem(values, substeps):
        gone = (values["from"], substeps) in runs_away
        return SimpleNamespace(
            samples=20, substeps=substeps, join=lambda q, _: q, evaluate_values=lambda X: (X, np.nan if gone else 1.0)
        )

    task = SimpleNamespace(
        guess={"from": "guess"}, finest=40, problem=problem, nodes=lambda *_: None,
        substeps=lambda values: {"given": 3, "guess": 2}[values["from"]],
    )  # fmt: skip
    monkeypatch.setattr(tasks, "inside", lambda _, values: values["from"])
    found, X = tasks._begun(task, {"from": "given"})
    assert (X, found.substeps) == begun


def test_a_start_too_stiff_for_the_samples_is_no_slow_recording_where_a_model_was_fitted_before(monkeypatch):
    """A memory of pre-sliding at its typical size asked for 55 substeps of a recording that the base model had followed."""
    run = SimpleNamespace(data=np.full((1, 9), 2e-3))
    plant = SimpleNamespace(theta=lambda *_: None)
    monkeypatch.setattr(Task, "ranges", {})
    monkeypatch.setattr("pneuid.estimation.task.substeps_needed", lambda *_: 55)
    first = Task(plant, [], (run,), {}, None)
    with pytest.raises(UserError, match="500 Hz is too low"):
        first.substeps({})
    assert replace(first, again=True).substeps({}) == LARGEST_SUBSTEPS
    monkeypatch.setattr("pneuid.estimation.task.substeps_needed", lambda *_: 3)
    assert replace(first, again=True).substeps({}) == first.substeps({}) == 3


@pytest.mark.parametrize("way", ["near", "sharper"])
def test_the_step_of_a_refit_gets_at_most_twice_as_fine_as_what_it_starts_from(way, monkeypatch):
    """A friction that stiffened from 7 to 40 substeps took minutes, and led nowhere."""
    steps = []

    def solved(task, *_):
        monkeypatch.setattr("pneuid.estimation.task.substeps_needed", lambda *_: 40)
        steps.append(task.substeps({}))
        raise InterruptedError

    monkeypatch.setattr("pneuid.estimation.task.substeps_needed", lambda *_: 7)
    monkeypatch.setattr(Task, "ranges", {})
    monkeypatch.setattr(Task, "guess", {})
    monkeypatch.setattr(fitting, "begin_fit", lambda *_: None)
    monkeypatch.setattr(fitting, "relaxed_fit", solved)
    monkeypatch.setattr(fitting, "tightly", solved)
    run = SimpleNamespace(data=np.full((1, 9), 1e-3), recording=None)
    plant = SimpleNamespace(theta=lambda *_: None)
    found = SimpleNamespace(
        plant=plant, runs=(run,), problem=SimpleNamespace(substeps=7), relaxed=None, defect_level=1.0, loose=None
    )
    with pytest.raises(InterruptedError):
        fitting.near(plant, (run,), {}, {}) if way == "near" else fitting.sharper(found)
    assert steps == [14]


def test_runs_that_were_only_prepared_are_not_known_to_be_fast_enough(monkeypatch):
    """A bench's joint fit prepares its runs itself, and is the first one to them."""
    recording = Recording.from_arrays("s5.csv", helpers.rig(), **record_servo(TruthServo(), NOTHING, "multisine", 1.0, 5))
    plant = Plant(helpers.rig(), "lugre")
    levels = {"x": 2e-5, "p1": 500.0, "p2": 500.0}
    monkeypatch.setattr("pneuid.estimation.task.substeps_needed", lambda *_: 55)
    with pytest.raises(UserError, match="1000 Hz is too low"):
        fitting.fit(plant, [recording], None, levels, exact=False, prepared=[prepare(recording, plant, levels)])
