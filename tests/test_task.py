"""The relaxed fit and its time step: finer ones while the model can still follow, or they help."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from pneuid.estimation import task as tasks
from pneuid.estimation.stages import DEFECT_GATE

TOO_WRONG = 2.0 * DEFECT_GATE


def _growing(costs, level, monkeypatch):
    """Substeps of the problems solved where every solution asks for one more, and the fit that was kept."""
    solved = []

    def problem(_, substeps):
        solved.append(substeps)
        return SimpleNamespace(substeps=substeps, samples=20, join=lambda q, _: q, split=lambda X: (X, X))

    def stage(problem, *_):
        outcome = SimpleNamespace(X=problem.substeps, cost=costs[problem.substeps - 1], penalty=0.0, status="Settled")
        return SimpleNamespace(outcome=outcome, level=level)

    monkeypatch.setattr(tasks, "values_at", lambda _, X: {"sigma1": X})
    monkeypatch.setattr(tasks, "inside", lambda _, values: values["sigma1"])
    task = SimpleNamespace(
        guess={"sigma1": 0}, monitor=None, loosely=None, hopeless=float("inf"), problem=problem,
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
