"""A zero reading as evidence: what it rules out, what it shows, and what a diagnosis then names."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import rig
from trials import score, stub, walking

from pneuid import api
from pneuid.criticism.decision import ascent, walk
from pneuid.criticism.decision.verdict import diagnose
from pneuid.criticism.decision.zeros import Zeros, shifted
from pneuid.criticism.next_experiment.proposal import propose
from pneuid.effects import CATALOGUE, LAW_STEPS, effects_by_name
from pneuid.estimation.fit import fit
from pneuid.model import model_of
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import (
    BENCH_SENSORS,
    Hidden,
    TruthBench,
    TruthServo,
    record_bench,
    record_zero,
    strokes,
)
from pneuid.zero_reading import Zero, ZeroReading

KNOWN = CATALOGUE | LAW_STEPS
SHIFTS = ("sensor_offset_F", "sensor_offset_p1", "sensor_offset_p2")
HIDDEN = {"gravity": 3.0, "sensor_offset_F": -3.0, "sensor_offset_p1": 4e3, "sensor_offset_p2": -5e3}
"""Each moves the force by about 3 N at a bore of 32 mm."""

FEW = {name: KNOWN[name] for name in ("load_mass", "friction_pressure", "friction_direction", "load_spring", *HIDDEN)}
"""Candidates of the diagnoses here: the four constants, and what a bench confuses them with."""

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})

TRUTH = TruthBench(friction=TruthServo().friction)
"""Its friction depends on no pressure, as the base model's."""

MOTIONS = (
    (strokes((0.002, 0.05, 0.15), longest=0.5, dwell=0.2), 3e5, 2e5),
    (strokes((0.001, 0.03), longest=0.4, dwell=0.1), 1e5, 5e5),
    (strokes((0.01, 0.1), longest=0.5, dwell=0.4), 5e5, 1e5),
    (strokes((0.005, 0.02, 0.08), longest=0.5, dwell=0.3), 2e5, 4e5),
)  # fmt: skip


@cache
def runs_of(hidden):
    """Three training runs and a held-out one of a bench."""
    patm = TRUTH.patm
    records = [record_bench(TRUTH, p1 + patm, p2 + patm, motion, hidden, seed=i) for i, (motion, p1, p2) in enumerate(MOTIONS)]
    return [Recording.from_arrays(f"run_{i}.csv", STAND, **record) for i, record in enumerate(records)]


@cache
def fitted(hidden, *names):
    return fit(Plant(STAND, "lugre", effects_by_name(list(names))), runs_of(hidden)[:3], exact=False)


def read(hidden, *signals):
    shown = record_zero(hidden, TRUTH.patm, BENCH_SENSORS, seed=3)
    return ZeroReading.from_arrays("zero.csv", STAND, **{name: shown[name] for name in signals or ("p1", "p2", "F")})


def test_the_shifts_of_the_catalogue_are_known_by_what_they_declare():
    assert {name: shifted(effect) for name, effect in CATALOGUE.items() if shifted(effect)} == {
        "sensor_offset_p1": "p1", "sensor_offset_p2": "p2", "sensor_offset_F": "F",
    }  # fmt: skip


def test_without_a_reading_nothing_is_ruled_out_or_shown():
    found = fitted(Hidden(sensor_offset_F=-3.0), "sensor_offset_F")
    effect, without = CATALOGUE["sensor_offset_F"], Zeros()
    assert without.left(KNOWN) == KNOWN and without.said(KNOWN, found, {}) == []
    assert not without.confirms(found, effect) and not without.contradicts(found, effect) and not without.deny(found)


@pytest.mark.parametrize("name", HIDDEN)
def test_a_reading_leaves_the_shift_that_is_there_and_no_other(name):
    zeros = Zeros(read(Hidden(**{name: HIDDEN[name]})))
    assert set(KNOWN) - set(zeros.left(KNOWN)) == set(SHIFTS) - {name}


def test_a_sensor_that_was_not_read_is_neither_ruled_out_nor_shown():
    hidden = Hidden(sensor_offset_F=-3.0)
    zeros = Zeros(read(hidden, "p1"))
    assert set(KNOWN) - set(zeros.left(KNOWN)) == {"sensor_offset_p1"}
    assert not zeros.confirms(fitted(hidden, "sensor_offset_F"), CATALOGUE["sensor_offset_F"])


@pytest.mark.parametrize(("share", "agrees"), [(1.0, True), (0.8, True), (0.5, False), (-1.0, False)])
def test_a_fit_agrees_with_a_reading_within_a_quarter_of_the_shift(share, agrees):
    found, effect = fitted(Hidden(sensor_offset_F=-3.0), "sensor_offset_F"), CATALOGUE["sensor_offset_F"]
    zeros = Zeros(ZeroReading("zero.csv", {"F": Zero(share * found.values["offset_F"], 0.02)}))
    assert zeros.confirms(found, effect) is agrees and zeros.contradicts(found, effect) is not agrees
    assert zeros.deny(found) is not agrees
    told = (found, {}) if agrees else (fitted(Hidden(sensor_offset_F=-3.0)), {"sensor_offset_F": found})
    said = " ".join(zeros.said(KNOWN, *told))
    assert ("shows what these runs ask for" in said) is agrees and ("take it off in rig.toml" in said) is not agrees


def test_the_proposal_is_a_reading_where_no_recording_helps():
    """A load, and the zeros of three sensors, are one force on a bench; seconds at rest tell them."""
    hidden, names = Hidden(gravity=3.0), list(HIDDEN)
    found = propose([fitted(hidden, name) for name in names], [CATALOGUE[name] for name in names])
    assert found is not None and found.command is None and found.power > 0.99
    assert set(found.read) == {"F", "p1", "p2"} and found.rivals == tuple((name,) for name in names)
    assert "both chambers vented, nothing pulling on the force sensor" in found.why and "none for gravity" in found.why


def test_a_shift_below_what_a_reading_resolves_is_not_asked_for():
    hidden, names = Hidden(gravity=3.0), ["gravity", "sensor_offset_F"]
    fits = [fitted(hidden, name) for name in names]
    blind = [replace(one, noise={**one.noise, "F": 10.0}) for one in fits]
    found = propose(blind, [CATALOGUE[name] for name in names])
    assert found is not None and found.read == () and found.power == 0.0 and "act alike" in found.why


@pytest.mark.slow
def test_without_a_reading_the_constant_forces_are_one_group():
    runs = runs_of(Hidden(gravity=3.0))
    before = diagnose(fit(api.plant_of(STAND), runs[:3]), runs[3:], FEW).diagnosis
    assert before.verdict == "ambiguous" and set(HIDDEN) <= set(before.effects)


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_a_reading_turns_the_group_into_the_one_that_is_there(name):
    hidden = Hidden(**{name: HIDDEN[name]})
    runs = runs_of(hidden)
    base = fit(api.plant_of(STAND), runs[:3])
    after = diagnose(base, runs[3:], FEW, zeros=Zeros(read(hidden))).diagnosis
    assert (after.verdict, after.effects) == ("effect", (name,))
    assert any("zero reading zero.csv: p1 " in sentence for sentence in after.sentences)


def test_a_zero_that_is_next_to_nothing_beside_what_is_asked_for_need_not_be_taken_off():
    found, name = fitted(Hidden(sensor_offset_F=-3.0), "sensor_offset_F"), "sensor_offset_F"
    zeros = Zeros(ZeroReading("zero.csv", {"F": Zero(0.1 * found.values["offset_F"], 0.02)}))
    said = " ".join(zeros.said(KNOWN, fitted(Hidden(sensor_offset_F=-3.0)), {name: found}))
    assert "sensor_offset_F ruled out: these runs ask for -2.98 N" in said and "take it off" not in said


def test_a_shift_that_the_model_has_already_is_told_to_be_wrong():
    """Of a group the user took one that was not it; the reading came later."""
    found, name = fitted(Hidden(gravity=3.0), "sensor_offset_p1"), "sensor_offset_p1"
    said = " ".join(Zeros(read(Hidden(gravity=3.0))).said(KNOWN, found, {name: found}))
    assert f"{name} is" in said and "--drop" in said and f"{name} ruled out" not in said
    assert "sensor_offset_p2, sensor_offset_F ruled out: the sensor shows none" in said


@pytest.mark.slow
def test_a_small_zero_error_is_not_taken_for_the_weight_that_is_missing():
    """The force sensor is off by a tenth of what the runs ask for: it is not what they lack, and the user is told."""
    hidden = Hidden(gravity=3.0, sensor_offset_F=0.3)
    runs = runs_of(hidden)
    base = fit(api.plant_of(STAND), runs[:3])
    after = diagnose(base, runs[3:], FEW, zeros=Zeros(read(hidden))).diagnosis
    assert (after.verdict, after.effects) == ("effect", ("gravity",))
    assert any("sensor_offset_F ruled out" in sentence for sentence in after.sentences)


@pytest.mark.slow
def test_a_reading_does_not_make_a_shift_of_what_is_none():
    """Friction by direction, with all zeros right: it stays what is named, and no shift stands beside it."""
    hidden = Hidden(friction_direction=0.2)
    runs = runs_of(hidden)
    base = fit(api.plant_of(STAND), runs[:3])
    after = diagnose(base, runs[3:], FEW, zeros=Zeros(read(hidden))).diagnosis
    assert "friction_direction" in after.effects and not set(after.effects) & set(SHIFTS)
    assert np.isfinite(after.ranking[0].screen_gain)


# --- in a walk ---


class _Says(Zeros):
    """Shows one effect and contradicts another, whatever a fit asks for."""

    def confirms(self, _fit, effect):
        return effect.name == "sensor_offset_F"

    def contradicts(self, _fit, effect):
        return effect.name == "sensor_offset_p1"


def _walk(monkeypatch, zeros):
    """A walk beside which constants are alike, and trials with each of them, the load first."""
    monkeypatch.setattr(ascent, "better_without", lambda *_: None)
    going = walking()
    going.zeros = zeros
    monkeypatch.setattr(going, "_alike", lambda _, tried: tried)
    monkeypatch.setattr(going, "rung", lambda trial, _: trial.added)
    monkeypatch.setattr(going, "_record", lambda *_, **__: None)
    return going, [(score(name, 900.0), stub(1.0, 20_000.0, name)) for name in HIDDEN]


@pytest.mark.parametrize(
    ("zeros", "named", "rivals"), [(Zeros(), "gravity", SHIFTS), (_Says(), "sensor_offset_F", ())], ids=["nothing", "shown"]
)
def test_of_a_group_the_one_that_is_shown_is_accepted_and_has_no_rivals(zeros, named, rivals, monkeypatch):
    going, tried = _walk(monkeypatch, zeros)
    assert going._take(tried[0], tried)
    assert going.named == [named] and going.ambiguous == {named: rivals} and going.current.added == named
    assert going.rungs[-1] == named and sorted(going.rungs) == sorted(HIDDEN)


def test_what_is_contradicted_is_tried_in_vain_and_remembered(monkeypatch):
    going, tried = _walk(monkeypatch, _Says())
    monkeypatch.setattr(ascent, "same_floor", lambda *same: same)
    left = going._by_one_floor(tried)
    assert [one.effect.name for one, _ in left] == [name for name in HIDDEN if name != "sensor_offset_p1"]
    assert going.refused == {"sensor_offset_p1": {one.effect.name: trial.fit for one, trial in tried}["sensor_offset_p1"]}


def test_a_walk_on_all_runs_knows_the_reading_and_what_it_refused(monkeypatch):
    going, _ = _walk(monkeypatch, _Says())
    going.refused = {"sensor_offset_p1": object()}
    made = {}

    def on_all(*_, **given):
        made.update(given)
        return SimpleNamespace(rounds=list, moved=[], named=[], suspected=lambda _: None)

    monkeypatch.setattr(walk, "WalkOnAll", on_all)
    monkeypatch.setattr(going, "_on_all", lambda fit: fit)
    going.judge = SimpleNamespace(trial=lambda fit: fit)
    going._by_all_runs("said")
    assert made["zeros"] is going.zeros and made["refused"] is going.refused


def test_a_notebook_hands_the_reading_to_the_diagnosis(monkeypatch):
    class Stopped(Exception):
        pass

    def stop(*given):
        raise Stopped(given[-1])

    found, zero = fitted(Hidden(gravity=3.0), "gravity"), read(Hidden(gravity=3.0))
    model = api.IdentifiedModel(model_of(found, "stand", (), None), found)
    monkeypatch.setattr(api.verdict, "diagnose", stop)
    monkeypatch.setattr(api, "completed", lambda fit, _: fit)
    with pytest.raises(Stopped) as stopped:
        model.diagnose(runs_of(Hidden(gravity=3.0))[:3], runs_of(Hidden(gravity=3.0))[3:], zero=zero)
    assert stopped.value.args == (Zeros(zero),)
