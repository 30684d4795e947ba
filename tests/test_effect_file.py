"""A user's own effect file: what the docs show works, is kept with its hash, and a slip is one clear line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import rig

from pneuid import api
from pneuid.errors import UserError
from pneuid.model import load, model_of
from pneuid.recording import Recording
from pneuid.virtual_rig import ATMOSPHERE, Friction, Hidden, TruthBench, record_bench, strokes

DOC = Path(__file__).parents[1] / "docs" / "own_effect.md"
STAND = {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}}


def shown() -> str:
    """The code block of the docs."""
    return re.findall(r"```python\n(.*?)```", DOC.read_text(encoding="utf-8"), re.DOTALL)[0]


@pytest.fixture
def drag(tmp_path):
    path = tmp_path / "drag.py"
    path.write_text(shown(), encoding="utf-8")
    return path


def test_the_docs_show_an_effect_in_twelve_lines():
    assert len(shown().strip().splitlines()) <= 12


def test_the_effect_of_the_docs_is_found_on_a_rig_that_has_it(drag, tmp_path):
    stand, hidden = rig("bench", STAND), Hidden(drag_chain=60.0)
    motion = strokes(speeds=(0.05, 0.02), longest=0.8, dwell=0.1)
    record = record_bench(TruthBench(friction=Friction()), 3e5 + ATMOSPHERE, 2e5 + ATMOSPHERE, motion, hidden, 3)
    run = Recording.from_arrays("b.csv", stand, **record)
    found = api.fit(stand, [run], add=["drag_of_chain"], effect_files=[drag])
    # the virtual rig's chain: force against extension, 60 N s/m times the distance from mid-stroke in strokes
    mine = next(item for item in found.parameters if item.name == "c_chain")
    assert mine.effect == "drag_of_chain" and mine.std is not None
    x = run.signals["x"] / 0.5 - 0.5
    if np.ptp(x) > 0.2:
        assert abs(mine.value) == pytest.approx(60.0, rel=0.25)
    path = tmp_path / "model.json"
    found.save(path)
    raw = json.loads(path.read_text(encoding="utf-8"))
    assert raw["effect_files"][0]["file"] == "drag.py" and raw["effect_files"][0]["effects"] == ["drag_of_chain"]
    again = api.load(path, [drag])
    np.testing.assert_array_equal(again.simulate(run)["F"], found.simulate(run)["F"])
    with pytest.raises(UserError, match=r"--effect-file drag\.py"):
        api.load(path)
    drag.write_text(shown() + "\n# changed\n", encoding="utf-8")
    with pytest.raises(UserError, match="not the file the model was fitted with"):
        load(path, api.own_of([drag]))


def test_a_plain_model_names_no_file():
    assert model_of.__doc__
    assert api.plant_of(rig()).effects == ()


SLIPS = {
    "no such file": (None, "cannot read the effect file"),
    "syntax": ("class X(:\n", "line 1"),
    "raises": ("x = 1\ny = x / 0\n", "line 2: ZeroDivisionError"),
    "leaves": ("import sys\nsys.exit(3)\n", "line 2: SystemExit"),
    "no effect": ("x = 1\n", "holds no effect"),
    "no name": ("from pneuid.effect import Effect\nclass X(Effect):\n    equation = 'force'\n", "name is missing"),
    "taken": (None, "the name is taken"),
    "no port": (None, "enters no equation"),
    "no parameters": (None, "declares no parameters"),
    "equation": (None, "choose one of valve"),
    "misspelt signal": (None, "line 11: AttributeError"),
    "not off": (None, "does not vanish at its off-values"),
}
CHANGES = {
    "taken": ('"drag_of_chain"', '"gravity"'), "no port": ("def force", "def forces"),
    "no parameters": ("def parameters", "def parameter"), "equation": (', "force"', ', "mass"'),
    "misspelt signal": ("scope.v", "scope.speed"), "not off": ("return force -", "return 2 * force -"),
}  # fmt: skip


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_one_line(slip, tmp_path):
    path = tmp_path / "own.py"
    source, words = SLIPS[slip]
    if slip in CHANGES:
        source = shown().replace(*CHANGES[slip])
    if source is not None:
        path.write_text(source, encoding="utf-8")
    with pytest.raises(UserError, match=re.escape(words)) as caught:
        api.plant_of(rig(), ["drag_of_chain"], effect_files=[path])
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
