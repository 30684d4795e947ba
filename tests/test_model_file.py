"""model.json, ladder.json and diagnosis.json: what is written is read back, and nonsense is refused in one line."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import RANGES, TRUTH, base_fit, rig, servo_run, train_runs

from pneuid.criticism.comparison.comparison import frozen
from pneuid.criticism.comparison.ladder import Rung, from_json, to_json
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.criticism.prediction.horizons import predict
from pneuid.errors import UserError
from pneuid.estimation.fit import fit
from pneuid.estimation.preparation import prepare
from pneuid.model import Model, file_sha256, load, model_of, nominal_model, renamed
from pneuid.plant import Plant


@cache
def exact_model() -> Model:
    """A model with standard errors and a parent."""
    runs = (servo_run("multisine", 5, 11), servo_run("multisine", 7, 12))
    return model_of(fit(Plant(rig(), "lugre"), runs), "monday", hold_out=[train_runs()[1]], parent="ab" * 32)


@cache
def relaxed_model() -> Model:
    """A model without standard errors."""
    return model_of(base_fit(), "relaxed")


def nominal() -> Model:
    """A model with an effect, made without a fit."""
    return nominal_model(rig(), {**TRUTH, "G_leak": 1e-11, "m_leak": 0.7, "F_g": -3.0}, RANGES, ["gravity", "leakage_internal"])


MODELS: dict[str, Callable[[], Model]] = {"exact": exact_model, "relaxed": relaxed_model, "nominal": nominal}


# --- round trip ---


@pytest.mark.parametrize("which", MODELS)
def test_a_model_comes_back_whole(which, tmp_path):
    model = MODELS[which]()
    path = tmp_path / "model.json"
    model.save(path)
    again = load(path)
    assert again == model
    assert again.to_dict() == model.to_dict()
    # numbers to the last bit, in the same order
    np.testing.assert_array_equal(again.theta(), model.theta())
    assert again.plant.theta_names == model.plant.theta_names
    assert [effect.name for effect in again.plant.effects] == list(model.effects)
    assert [item.name for item in tmp_path.iterdir()] == ["model.json"]
    assert file_sha256(path) == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_file_holds_what_the_contract_says():
    raw = exact_model().to_dict()
    assert {"schema", "name", "rig", "friction", "effects", "parameters", "fit", "data", "parent"} <= set(raw)
    assert raw["schema"] == 1 and raw["friction"] == "lugre" and raw["effects"] == []
    assert [item["name"] for item in raw["parameters"]] == list(TRUTH)
    for item in raw["parameters"]:
        assert set(item) == {"name", "unit", "value", "std", "lower", "upper", "start", "effect", "run", "verdict"}
        assert item["std"] > 0.0 and item["lower"] < item["value"] < item["upper"]
        assert item["verdict"] in ("well determined", "weakly determined", "on its bound", "not visible")
    assert set(raw["fit"]) == {"stage", "converged", "status", "cost_per_sample", "solver", "iterations", "seconds", "lacking"}
    assert raw["fit"]["stage"] == "exact" and raw["fit"]["solver"] == "ipopt"
    assert [item["role"] for item in raw["data"]] == ["train", "train", "hold_out"]
    assert all(len(item["sha256"]) == 64 and item["samples"] == 3000 for item in raw["data"])
    assert rig().from_dict(raw["rig"]) == rig()


def test_a_relaxed_model_has_no_standard_errors():
    assert relaxed_model().fit.stage == "relaxed"
    assert all(item.std is None for item in relaxed_model().parameters)


def test_effects_bring_their_parameters_into_the_file():
    model = nominal()
    assert model.effects == ("leakage_internal", "gravity")  # in port order, not as asked for
    owners = {item.name: item.effect for item in model.parameters}
    assert owners["G_leak"] == "leakage_internal" and owners["F_g"] == "gravity" and owners["Fc"] is None
    assert model.values["G_leak"] == 1e-11 and model.values["F_g"] == -3.0


def test_a_model_from_a_file_predicts_what_the_fitted_one_does(tmp_path):
    model = exact_model()
    model.save(tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    runs = [prepare(train_runs()[1], model.plant, model.noise)]
    one, other = (predict(frozen(item), runs)[0] for item in (model, again))
    np.testing.assert_array_equal(one.predicted, other.predicted)


def test_a_model_can_be_renamed_without_touching_the_other():
    model = relaxed_model()
    assert renamed(model, "tuesday").name == "tuesday" and model.name == "relaxed"


def test_a_model_that_cannot_be_written_leaves_the_old_file(tmp_path):
    path = tmp_path / "model.json"
    model = nominal()
    model.save(path)
    before = path.read_bytes()
    broken = copy.copy(model)
    object.__setattr__(broken, "noise", {"x": float("nan")})
    with pytest.raises(ValueError, match=r"nan|Out of range"):
        broken.save(path)
    assert path.read_bytes() == before


# --- nonsense ---


def _without(key: str) -> Callable[[dict], Any]:
    return lambda raw: {name: value for name, value in raw.items() if name != key}


def _with(path: str, value: Any) -> Callable[[dict], Any]:
    def change(raw: dict) -> dict:
        at: Any = raw
        *way, last = path.split(".")
        for key in way:
            at = at[int(key) if key.isdigit() else key]
        at[int(last) if last.isdigit() else last] = value
        return raw

    return change


NONSENSE: dict[str, Callable[[dict], Any]] = {
    "a list": lambda _: [1, 2],
    "a number": lambda _: 3,
    "null": lambda _: None,
    "empty": lambda _: {},
    "another schema": _with("schema", 2),
    "no schema": _without("schema"),
    "no rig": _without("rig"),
    "no parameters": _without("parameters"),
    "no ranges": _without("ranges"),
    "no fit": _without("fit"),
    "rig is text": _with("rig", "rig.toml"),
    "rig without a cylinder": _with("rig.cylinder", {}),
    "unknown friction": _with("friction", "glue"),
    "unknown effect": _with("effects", ["unknown_effect"]),
    "effects is text": _with("effects", "gravity"),
    "effects is a number": _with("effects", 5),
    "effect is a table": _with("effects", [{}]),
    "parameters is text": _with("parameters", "all of them"),
    "parameter is a number": _with("parameters.0", 7),
    "parameter with another key": _with("parameters.0.colour", "red"),
    "parameter missing": _with("parameters.0.name", "Fx"),
    "fit is null": _with("fit", None),
    "data is a number": _with("data", 4),
    "range is null": _with("ranges.x_low", None),
    "noise is text": _with("noise.x", "small"),
    "substeps is text": _with("substeps", "two"),
}
UNCHECKED: dict[str, Callable[[dict], Any]] = {
    "value is text": _with("parameters.0.value", "12 N"),
    "value is null": _with("parameters.0.value", None),
    "value is not a number": _with("parameters.0.value", float("nan")),
    "range is not a number": _with("ranges.x_low", float("nan")),
    "noise is negative": _with("noise.x", -1.0),
    "no substeps at all": _with("substeps", 0),
    "a parameter twice": lambda raw: {**raw, "parameters": [*raw["parameters"], raw["parameters"][0]]},
}


def _refuse(change: Callable[[dict], Any], tmp_path: Path) -> str:
    path = tmp_path / "model.json"
    raw = json.loads(json.dumps(relaxed_model().to_dict()))
    path.write_text(json.dumps(change(raw)), encoding="utf-8")
    with pytest.raises(UserError) as caught:
        load(path)
    return str(caught.value)


@pytest.mark.parametrize("how", NONSENSE)
def test_nonsense_is_refused_in_one_line(how, tmp_path):
    message = _refuse(NONSENSE[how], tmp_path)
    assert "\n" not in message and len(message) < 400
    if how not in ("unknown effect", "effects is text", "effect is a table"):
        assert "model.json" in message


@pytest.mark.parametrize("how", UNCHECKED)
def test_numbers_that_are_none_are_refused(how, tmp_path):
    assert "model.json" in _refuse(UNCHECKED[how], tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"{", "not JSON"), (b"", "not JSON"), (b"\xff\xfe\x00", "cannot read"), (b'{"schema": 1,\n "name" }', "line 2")],
)
def test_a_file_that_is_no_json_is_refused(content, words, tmp_path):
    path = tmp_path / "model.json"
    path.write_bytes(content)
    with pytest.raises(UserError, match=words) as caught:
        load(path)
    assert "\n" not in str(caught.value) and "model.json" in str(caught.value)


def test_a_file_that_is_not_there_or_a_folder_is_refused(tmp_path):
    for path, words in ((tmp_path / "none.json", "cannot read"), (tmp_path, "is a folder; name the model in it")):
        with pytest.raises(UserError, match=words) as caught:
            load(path)
        assert "\n" not in str(caught.value)


def test_the_unchanged_file_of_these_tests_is_accepted(tmp_path):
    """The negative control of the refusals."""
    path = tmp_path / "model.json"
    path.write_text(json.dumps(relaxed_model().to_dict()), encoding="utf-8")
    assert load(path) == relaxed_model()


# --- ladder and diagnosis ---

RUNGS = [
    Rung((), None, True, {"x": 1e-3}, {"x": 2e-3}, {"x": 2e-5}, 8),
    Rung(("gravity",), "gravity", False, {"x": 9e-4}, {"x": 1.9e-3}, {"x": 2e-5}, 9),
    Rung(("leakage_internal",), "leakage_internal", True, {"x": 3e-5}, {"x": 4e-5}, {"x": 2e-5}, 9),
]


def test_a_ladder_comes_back_whole():
    raw = json.loads(json.dumps(to_json(RUNGS)))
    assert from_json(raw, "ladder.json") == RUNGS
    assert set(raw[0]) == {"effects", "added", "accepted", "train", "hold_out", "noise_floor", "parameters"}
    assert from_json([], "ladder.json") == []


@pytest.mark.parametrize(
    "raw", [5, None, {"a": 1}, "ladder", [1], [{}], [{"effects": None}], [{"effects": [], "x": 1}]]
)
def test_a_ladder_of_nonsense_is_refused(raw):
    with pytest.raises(UserError, match=r"ladder\.json") as caught:
        from_json(raw, "ladder.json")
    assert "\n" not in str(caught.value)


def test_a_diagnosis_can_be_written_as_json():
    ranking = (
        Candidate("leakage_internal", "flow_1", 0.42, 0.31, 0.97, 1e-9, ("leakage_external_1",)),
        Candidate("gravity", "force", 1e-3),
    )
    unknown = Unknown("force", ("x", "v"), 4.1, "N")
    found = Diagnosis(
        "unknown", ("leakage_internal",), ranking, unknown, {"why": "?", "file": "n.csv"}, ("a sentence",)
    )
    raw = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert raw["schema"] == 1 and raw["verdict"] == "unknown" and raw["effects"] == ["leakage_internal"]
    assert raw["ranking"][0] == {
        "effect": "leakage_internal", "equation": "flow_1", "screen_gain": 0.42, "hold_out_error_ratio": 0.31,
        "excess_explained": 0.97, "p_value": 1e-9, "indistinguishable_from": ["leakage_external_1"],
    }  # fmt: skip
    assert raw["ranking"][1]["p_value"] is None and raw["ranking"][1]["indistinguishable_from"] == []
    promised = {"equation": "force", "depends_on": ["x", "v"], "rms": 4.1, "unit": "N", "formula": None}
    assert raw["unknown"] | promised == raw["unknown"]
    assert raw["sentences"] == ["a sentence"]
    assert Diagnosis("adequate", (), ()).to_dict()["unknown"] is None
