"""The hidden-effects benchmark: rows of one kind are counted together, and its cases can be timed by the commands."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from pneuid.effects import CATALOGUE
from pneuid.recording import Recording
from pneuid.rig import Rig

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
hidden_counts = pytest.importorskip("hidden_counts", reason="the benchmarks are not beside the tests")
hidden_cases = pytest.importorskip("hidden_cases", reason="the benchmarks are not beside the tests")
diagnosis_time = pytest.importorskip("diagnosis_time", reason="the benchmarks are not beside the tests")


def row(category, names, verdict, effects, rig="random", unknown=None, explained=0.95):
    return {
        "category": category, "names": names, "verdict": verdict, "effects": effects, "rig": rig, "level": "drawn",
        "unknown": unknown, "explained": explained,
    }  # fmt: skip


def test_varied_cases_that_hide_nothing_are_counted_apart():
    rows = [
        row("varied", ["gravity"], "effect", ["gravity"]), row("varied", [], "adequate", []),
        row("varied", [], "effect", ["load_mass"], rig="random bench"), row("varied", ["load_mass"], "unknown", []),
    ]  # fmt: skip
    totals = [words for words in hidden_counts.table(rows).splitlines() if words.startswith("all of")]
    lines = {words[:30].strip(): words.split()[-6:] for words in totals}
    assert set(lines) == {"all of varied servo", "all of varied servo, null", "all of varied bench, null"}
    assert lines["all of varied servo"] == ["2", "1", "1", "0", "2", "0"]
    assert lines["all of varied bench, null"][-2:] == ["1", "0"]


@pytest.mark.parametrize(
    ("verdict", "equation", "depends_on", "either"),
    [("unknown", "valve", ["u"], True), ("effect", "force", ["x"], True), ("effect", "force", ["p1"], False)],
)
def test_outside_the_catalogue_the_verdict_or_the_function_counts(verdict, equation, depends_on, either):
    said = {"equation": equation, "depends_on": depends_on}
    marked = hidden_counts.marks(row("outside", ["cogging"], verdict, ["load_mass"], unknown=said))
    assert marked["either"] is either
    assert marked["unknown"] is (verdict == "unknown")


def test_a_case_can_be_written_for_the_commands_that_are_timed(tmp_path):
    case = diagnosis_time.Case("servo", "default", ("gravity",), "weak", 5)
    runs = diagnosis_time.written(case, tmp_path)
    assert len(runs) == 5 and len(set(runs)) == 5
    recording = Recording.read(tmp_path / runs[0], Rig.from_toml(tmp_path / "rig.toml"))
    assert recording.n >= 6000 and {"u", "x", "p1", "p2"} <= set(recording.recorded)


def test_pairs_are_drawn_anew_for_each_seed_from_effects_that_are_not_easily_confused():
    drawn = [hidden_cases.drawn_pairs(seed) for seed in range(40)]
    assert drawn[0] == hidden_cases.drawn_pairs(0) != drawn[1]
    pairs = {pair for each in drawn for pair in each}
    assert len(pairs) > 100 and not any(CATALOGUE[one].resembles(CATALOGUE[other]) for one, other in pairs)
    told = hidden_counts.marks(row("drawn pair", ["gravity", "valve_lag"], "effect", ["valve_lag"]))
    assert told == {"both": False, "one": True, "explained": True}
