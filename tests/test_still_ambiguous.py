"""Which cases the benchmark asks again, and that their recordings can stand beside each other."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pneuid.recording import Recording

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
still_ambiguous = pytest.importorskip("still_ambiguous", reason="the benchmarks are not beside the tests")

ROW = {"key": "a", "names": ["gravity"], "category": "within", "verdict": "ambiguous"}


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ({}, True), ({"verdict": "effect"}, False), ({"names": ["gravity", "backlash"]}, False),
        ({"category": "outside"}, False), ({"category": "varied"}, False),
    ],
)  # fmt: skip
def test_ambiguous_cases_with_one_effect_on_a_rig_that_no_seed_draws_are_asked_again(change, asked, tmp_path):
    file = tmp_path / "results.jsonl"
    file.write_text(json.dumps(ROW | change) + "\n", encoding="utf-8")
    assert bool(still_ambiguous.asking(file)) is asked


def test_recordings_of_both_seeds_have_names_of_their_own():
    runs = [Recording(name, None, "", np.arange(3.0), {}, {}) for name in ("run_1.csv", "run_2.csv")]
    names = {run.name for run in (*runs, *still_ambiguous.renamed(runs))}
    assert len(names) == 4
