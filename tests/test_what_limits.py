"""What the benchmark blames where little is explained, and which cases it asks about."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
what_limits = pytest.importorskip("what_limits", reason="the benchmarks are not beside the tests")

ROW = {"key": "a", "names": ["gravity"], "category": "bench", "error_before": 2.0, "explained": 0.5}


@pytest.mark.parametrize(
    ("training", "any_start", "all_runs", "cause"),
    [
        (0.95, 0.95, 0.97, "diagnosis"), (0.2, 0.95, 0.5, "choice"), (-3.0, 0.2, 0.99, "recordings"), (0.8, 0.85, 0.89, "form"),
    ],
)  # fmt: skip
def test_the_least_that_explains_enough_names_the_cause(training, any_start, all_runs, cause):
    assert what_limits.cause_of({"training": training, "any start": any_start, "all runs": all_runs}) == cause


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ({}, True), ({"explained": 0.92}, False), ({"error_before": 1.4}, False), ({"names": ["gravity", "backlash"]}, False),
        ({"category": "outside"}, False), ({"names": []}, False),
    ],
)  # fmt: skip
def test_only_single_effects_that_are_felt_and_little_explained_are_asked_about(change, asked, tmp_path):
    file = tmp_path / "results.jsonl"
    file.write_text(json.dumps(ROW | change) + "\n", encoding="utf-8")
    assert bool(what_limits.asking(file)) is asked
    failed = {name: value for name, value in ROW.items() if name not in {"error_before", "explained"}}
    file.write_text(json.dumps(failed) + "\n", encoding="utf-8")
    assert what_limits.asking(file) == []
