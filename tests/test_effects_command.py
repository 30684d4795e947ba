"""``python -m pneuid.effects``, the signatures behind its pictures, and the page of the catalogue."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from helpers import rig

from pneuid.criticism.screening.signature import Signature, signature, typical_value
from pneuid.effects import CATALOGUE, GROUPS, group_of
from pneuid.effects.__main__ import demonstration_rig, main
from pneuid.errors import UserError
from pneuid.physics.friction import LAWS
from pneuid.report.signature_figure import signature_figure
from pneuid.report.style import png

MAKE_PAGE = Path(__file__).resolve().parents[1] / "docs" / "make_catalogue.py"


@pytest.fixture(scope="module")
def offset() -> Signature:
    return signature(CATALOGUE["valve_offset"], rig())


def test_the_list_holds_every_effect_once_and_in_its_group(capsys):
    main([])
    shown = capsys.readouterr().out
    lines = [line.split("│")[1].strip() for line in shown.splitlines() if line.startswith("│")]
    names = [name for name in lines if name]
    assert sorted(names) == sorted(CATALOGUE)
    places = {group: next(i for i, line in enumerate(shown.splitlines()) if line.strip() == group) for group in GROUPS}
    assert sorted(places.values()) == [places[group] for group in GROUPS]
    assert [group_of(CATALOGUE[name]) for name in names] == sorted(
        (group_of(CATALOGUE[name]) for name in names), key=GROUPS.index
    )


@pytest.mark.parametrize(
    ("name", "group"),
    [("valve_critical_ratio", "valve"), ("leakage_external_2", "pneumatics"), ("channel_skew", "sensor"),
     ("friction_position", "friction"), ("gravity", "mechanics"), ("dead_volume", "pneumatics")],
)  # fmt: skip
def test_effects_stand_in_the_group_of_their_part_of_the_drive(name, group):
    assert group_of(CATALOGUE[name]) == group


def test_a_picture_needs_a_name_and_a_free_folder(tmp_path, capsys):
    with pytest.raises(UserError, match="name the effect"):
        main(["--out", str(tmp_path / "new")])
    with pytest.raises(UserError, match="glue"):
        main(["glue", "--out", str(tmp_path / "new")])
    assert not (tmp_path / "new").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "kept.txt").write_text("kept")
    with pytest.raises(UserError, match="--overwrite"):
        main(["sensor_offset_F", "--out", str(tmp_path / "full")])
    main(["sensor_offset_F", "--out", str(tmp_path / "full"), "--overwrite"])
    assert (tmp_path / "full" / "sensor_offset_F.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "full" / "kept.txt").read_text() == "kept"
    assert "sensor_offset_F.png" in capsys.readouterr().out


def test_a_signature_is_the_difference_that_the_effect_makes(offset):
    assert offset.values == {"offset_valve": 0.02}
    assert set(offset.without) == set(offset.with_it) == {"x", "p1", "p2"}
    # a valve that is not closed at null moves the piston, far above the sensors' noise
    assert offset.contrast > 10.0
    assert offset.t[0] == 0.0 and np.allclose(np.diff(offset.t), 1e-3)
    assert offset.command[0] == "u" and offset.command[1].shape == offset.t.shape
    for y in (*offset.without.values(), *offset.with_it.values()):
        assert y.shape == offset.t.shape and np.all(np.isfinite(y))


def test_its_picture_is_drawn_and_is_the_same_every_time(offset):
    one, other = (png(signature_figure(offset, rig().patm)) for _ in range(2))
    assert one == other and len(one) > 10_000


def test_a_signature_on_the_wrong_kind_of_rig_is_refused():
    with pytest.raises(ValueError, match="bench"):
        signature(CATALOGUE["valve_offset"], rig("bench"))


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_has_a_rig_to_be_shown_on_and_typical_values_inside_its_bounds(name):
    effect = CATALOGUE[name]
    shown_on = demonstration_rig(effect)
    assert shown_on.kind in effect.rigs
    for item in effect.parameters(shown_on, LAWS[effect.laws[0]]):
        value = typical_value(item)
        assert item.lower <= value <= item.upper and (item.off is None or value != item.off)


def test_the_page_of_the_catalogue_is_up_to_date():
    spec = importlib.util.spec_from_file_location("make_catalogue", MAKE_PAGE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    written = MAKE_PAGE.with_name("catalogue.md").read_text(encoding="utf-8")
    assert written == module.page(), "run python docs/make_catalogue.py"


def test_names_alone_are_for_scripts(capsys):
    main(["--names"])
    assert capsys.readouterr().out.split() == list(CATALOGUE)
    with pytest.raises(UserError, match="--names lists the catalogue"):
        main(["gravity", "--names"])
