"""What terminal and report say of a verdict, in words."""

from __future__ import annotations

import dataclasses

import pytest

from pneuid.criticism.decision.diagnosis import NOT_SHOWN, NOTHING_MISSING, Diagnosis
from pneuid.report import decision_sections
from pneuid.report.html import Items, Paragraph
from pneuid.report.summary import verdict_lines

DIAGNOSIS = Diagnosis(
    "effect", ("leakage_internal",), (), next_experiment={"why": "a dwell under load tells them apart", "file": "next.csv"},
    sentences=("held-out error: 113 times the noise floor before, 1.0 after",),
)  # fmt: skip


def test_what_is_missing_beside_rivals_stands_apart():
    found = Diagnosis("ambiguous", ("gravity", "sensor_offset_F", "load_mass"), (), beside=("load_mass",))
    assert verdict_lines(found)[0].endswith("one of gravity, sensor_offset_F (these data cannot tell which); and load_mass")
    words = str(decision_sections.diagnosis_verdict(found).parts[0])
    assert "cannot tell apart: gravity, sensor_offset_F. Missing whichever it is: load_mass." in words
    assert found.to_dict()["beside"] == ["load_mass"]


def test_two_doubts_are_told_as_two():
    found = Diagnosis(
        "ambiguous", ("gravity", "sensor_offset_F", "friction_pressure", "friction_warmup"), (),
        one_of=(("gravity", "sensor_offset_F"), ("friction_pressure", "friction_warmup")),
    )  # fmt: skip
    one, other = "one of gravity, sensor_offset_F", "one of friction_pressure, friction_warmup"
    assert verdict_lines(found)[0].endswith(f"{one}; and {other} (these data cannot tell which)")
    words = str(decision_sections.diagnosis_verdict(found).parts[0])
    assert "cannot tell apart: gravity, sensor_offset_F; nor friction_pressure, friction_warmup." in words
    assert found.to_dict()["one_of"] == [["gravity", "sensor_offset_F"], ["friction_pressure", "friction_warmup"]]


def test_what_was_found_beside_something_unknown_is_told_at_once():
    unknown = "verdict: unknown - something is missing that the catalogue does not hold"
    assert verdict_lines(Diagnosis("unknown", ("gravity",), ()))[0] == f"{unknown}; found beside it: gravity"
    assert verdict_lines(Diagnosis("unknown", (), ()))[0] == unknown


@pytest.mark.parametrize("verdict", ["adequate", "effect", "ambiguous", "unknown"])
def test_every_verdict_has_its_words(verdict):
    found = dataclasses.replace(
        DIAGNOSIS, verdict=verdict, effects=("gravity", "a{b}"), unknown=None, next_experiment=None
    )
    section = decision_sections.diagnosis_verdict(found)
    words = section.parts[0].text
    assert ("gravity, a{b}" in words) == (verdict in {"effect", "ambiguous"})
    assert section.parts[0].kind == "warning"


def test_a_model_is_called_good_only_where_noise_alone_is_left():
    quiet = dataclasses.replace(
        DIAGNOSIS, verdict="adequate", effects=(), unknown=None, sentences=("held-out error: 1.02 floors", NOTHING_MISSING)
    )
    assert decision_sections.diagnosis_verdict(quiet).parts[0].kind == "good"
    assert verdict_lines(quiet)[:2] == [f"verdict: adequate - {NOTHING_MISSING}", "held-out error: 1.02 floors"]
    excused = dataclasses.replace(quiet, sentences=("held-out error: 12 floors",))
    assert decision_sections.diagnosis_verdict(excused).parts[0].text.startswith("These runs do not show")
    assert verdict_lines(excused)[0] == f"verdict: adequate - {NOT_SHOWN}"


def test_a_name_at_the_start_of_a_sentence_keeps_its_letters():
    named = dataclasses.replace(DIAGNOSIS, sentences=("friction_pressure: 99 % explained", "what remains is noise"))
    found = next(part for part in decision_sections.diagnosis_verdict(named).parts[2:] if isinstance(part, Items))
    assert found.texts == ("friction_pressure: 99 % explained.", "What remains is noise.")


def test_the_terminal_tells_the_next_experiment():
    assert verdict_lines(DIAGNOSIS)[-1] == "next experiment: a dwell under load tells them apart"
    assert not any("next experiment" in line for line in verdict_lines(dataclasses.replace(DIAGNOSIS, next_experiment=None)))


def test_a_chance_of_nothing_is_not_told():
    alike = {"why": "gravity and sensor_offset_F act alike", "file": None, "power": 0.0}
    section = decision_sections.diagnosis_verdict(dataclasses.replace(DIAGNOSIS, next_experiment=alike))
    words = " ".join(part.text for part in section.parts if isinstance(part, Paragraph))
    assert "act alike" in words and "Chance" not in words and "Command file" not in words
