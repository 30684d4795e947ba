"""What a notebook user types and sees: results show themselves, become tables, and carry units."""

from __future__ import annotations

import dataclasses
import json
import re
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from helpers import base_fit, held_runs, train_runs

import pneuid
from pneuid import api
from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.model import model_of
from pneuid.units import parse_quantity

SHOWN = ("model", "comparison", "diagnosis")


@cache
def model() -> pneuid.IdentifiedModel:
    found = base_fit()
    return pneuid.IdentifiedModel(model_of(found, "monday <b>1</b>"), found)


@cache
def comparison() -> Comparison:
    return model().compare(train_runs()[:1], held_runs()[:1])


def diagnosis() -> Diagnosis:
    first = Candidate("leakage_internal", "flow_1", 0.42, 0.31, 0.97, 1e-9, ("heat_transfer",))
    second = Candidate("valve_lag", "valve", 0.01)
    rest = Unknown("force", ("x",), 4.1, "N")
    return Diagnosis("effect", ("leakage_internal",), (first, second), rest, None, ("one effect explains it <almost>",))


def result(name: str) -> pneuid.IdentifiedModel | Comparison | Diagnosis:
    return {"model": model, "comparison": comparison, "diagnosis": diagnosis}[name]()


# --- every result ---


@pytest.mark.parametrize("name", SHOWN)
def test_a_result_shows_itself_in_a_notebook(name):
    shown = result(name)._repr_html_()
    assert shown.startswith("<p>")
    assert shown.count("<table") == 1
    tags = set(re.findall(r"</?([a-z]+)", shown))
    assert tags <= {"p", "table", "thead", "tbody", "tr", "th", "td"}, "text of the user's got in as markup"
    for row in result(name).to_pandas().index:
        assert str(row if isinstance(row, str) else row[-1]) in shown


@pytest.mark.parametrize("name", SHOWN)
def test_a_result_is_a_table_with_a_unit_in_every_row(name):
    frame = result(name).to_pandas()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame) > 0
    assert frame.index.is_unique
    for unit in frame["unit"]:
        parse_quantity(f"1 {unit}" if unit != "1" else "1", unit)


# --- each one ---


def test_the_table_of_a_model_holds_its_values():
    frame = model().to_pandas()
    assert frame["value"].to_dict() == pytest.approx(model().values)
    assert frame["std"].isna().all(), "a relaxed fit has no standard errors"
    assert (frame["lower"] <= frame["value"]).all()
    assert (frame["value"] <= frame["upper"]).all()


def test_the_name_of_a_model_is_escaped():
    assert "monday &lt;b&gt;1&lt;/b&gt;" in model()._repr_html_()


def test_the_table_of_a_comparison_has_both_roles():
    frame = comparison().to_pandas()
    assert set(frame.index) == {(role, signal) for role in ("train", "hold_out") for signal in ("x", "p1", "p2")}
    assert np.allclose(frame["ratio"], frame["rmse"] / frame["noise_floor"])
    assert frame.loc[("train", "x"), "rmse"] == comparison().train["x"].rmse


def test_a_comparison_without_held_out_runs_is_shown():
    bare = dataclasses.replace(comparison(), hold_out={}, where=())
    assert list(bare.to_pandas().index.get_level_values("role").unique()) == ["train"]
    assert "<table" in bare._repr_html_()


def test_the_table_of_a_diagnosis_says_what_is_named():
    frame = diagnosis().to_pandas()
    assert frame["named"].to_dict() == {"leakage_internal": True, "valve_lag": False}
    assert np.isnan(frame.loc["valve_lag", "excess_explained"])
    assert "verdict effect: leakage_internal" in diagnosis()._repr_html_()


def test_an_adequate_diagnosis_is_shown():
    empty = Diagnosis("adequate", (), ())
    assert len(empty.to_pandas()) == 0
    assert "verdict adequate" in empty._repr_html_()


def test_a_free_run_has_the_length_of_its_recording():
    run = train_runs()[0]
    found = model().simulate(run)
    assert {name: values.shape for name, values in found.items()} == dict.fromkeys(("x", "p1", "p2"), (run.n,))
    assert np.ptp(found["x"]) > 0.0


def test_a_saved_model_comes_back(tmp_path):
    model().save(tmp_path / "model.json")
    again = pneuid.load(tmp_path / "model.json")
    pd.testing.assert_frame_equal(again.to_pandas(), model().to_pandas())
    assert json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))["schema"] == 1


def test_an_unknown_effect_is_one_clear_line():
    run = train_runs()[0]
    with pytest.raises(pneuid.UserError, match="leak") as caught:
        pneuid.fit(model().content.rig, [run], add=["leek_internal"])
    assert "\n" not in str(caught.value)


def test_a_model_from_a_file_that_lacks_something_is_fitted_again_by_the_way_that_showed_it(monkeypatch):
    monkeypatch.setattr(api, "estimate", lambda *_args, exact: exact)
    for lacking in (True, False):
        content = SimpleNamespace(plant=None, noise={}, fit=SimpleNamespace(lacking=lacking))
        assert api.refitted(SimpleNamespace(fitted=None, content=content, values={}), []) is lacking
