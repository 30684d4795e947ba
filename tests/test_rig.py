"""Contract of rig.toml: what is read, in which unit and reference, and every way to get it wrong."""

from __future__ import annotations

import copy
import json
import math
import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pneuid.errors import UserError
from pneuid.rig import Rig, RunSettings
from pneuid.units import factor_and_offset, quantity, to_display

SERVO = """
kind = "servo"
base_effects = []
friction = "lugre"
[conventions]
pressure = "gauge"
[cylinder]
bore = "32 mm"
rod = "12 mm"
stroke = "500 mm"
dead_volume_1 = "12 cm^3"
dead_volume_2 = "14 cm^3"
[load]
mass = "2.4 kg"
incline = "90 deg"
[valve]
conductance = "1.2e-8 m^3/(s*Pa)"
critical_ratio = 0.30
full_scale = "10 V"
null = "5 V"
[supply]
pressure = "600 kPa"
[ambient]
pressure = "0.1 MPa"
temperature = "20 degC"
[sensors]
x = "20 um"
p1 = "0.5 kPa"
F = "0.2 N"
[runs."monday_3.csv"]
supply = "3 bar"
mass = "4.0 kg"
free = ["supply"]
"""

BENCH = """
kind = "bench"
friction = "coulomb"
[load]
mass = "90 kg"
[columns]
t = {column = "t", unit = "s"}
x = {column = "qm", unit = "m", gain = "-1"}
F = {column = "vir", unit = "V", gain = "35.1507 N/V", offset = "0 N"}
"""


def read(text: str, folder: Path) -> Rig:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return Rig.from_toml(path)


def as_dict(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)


def changed(text: str, key: str, value: Any) -> dict[str, Any]:
    """The rig with one dotted key set (or removed, when ``value`` is ...)."""
    raw = as_dict(text)
    table, parts = raw, key.split("/")
    for part in parts[:-1]:
        table = table.setdefault(part, {})
    if value is ...:
        del table[parts[-1]]
    else:
        table[parts[-1]] = value
    return raw


def test_servo_rig_is_si_and_absolute_inside(tmp_path: Path) -> None:
    rig = read(SERVO, tmp_path)
    assert (rig.kind, rig.friction, rig.pressure_convention, rig.input_hold) == ("servo", "lugre", "gauge", "linear")
    assert pytest.approx(math.pi / 4 * 0.032**2) == rig.A1
    assert pytest.approx(math.pi / 4 * (0.032**2 - 0.012**2)) == rig.A2
    assert (rig.stroke, rig.mass, rig.null, rig.full_scale) == pytest.approx((0.5, 2.4, 5.0, 10.0))
    assert (rig.V01, rig.V02, rig.conductance) == pytest.approx((12e-6, 14e-6, 1.2e-8), rel=1e-12)
    assert rig.incline == pytest.approx(math.pi / 2)
    assert rig.critical_ratio == 0.3
    assert rig.patm == pytest.approx(1e5)
    assert rig.supply == pytest.approx(7e5)
    assert rig.temperature == pytest.approx(293.15)
    assert rig.noise == pytest.approx({"x": 20e-6, "p1": 500.0, "F": 0.2})


def test_run_settings_follow_the_file_name_and_the_pressure_convention(tmp_path: Path) -> None:
    rig = read(SERVO, tmp_path)
    for name in ("monday_3.csv", "data/monday_3.csv"):
        run = rig.run(name)
        assert run.supply == pytest.approx(4e5)
        assert (run.mass, run.free) == (4.0, ("supply",))
    assert rig.run("tuesday.csv") == RunSettings()


def test_absolute_convention_adds_nothing() -> None:
    raw = changed(SERVO, "conventions/pressure", "abs")
    assert Rig.from_dict(raw).supply == pytest.approx(6e5)
    assert Rig.from_dict(raw).run("monday_3.csv").supply == pytest.approx(3e5)


def test_bench_needs_only_a_mass(tmp_path: Path) -> None:
    rig = Rig.from_dict({"kind": "bench", "load": {"mass": "1 kg"}})
    assert (rig.A1, rig.A2, rig.patm, rig.temperature, rig.friction) == (0.0, 0.0, 101325.0, 293.15, "lugre")
    assert all(math.isnan(value) for value in (rig.stroke, rig.V01, rig.supply, rig.conductance, rig.null))
    columns = read(BENCH, tmp_path).columns
    assert columns["F"].factor_and_offset("V", "here") == pytest.approx((35.1507, 0.0))
    assert columns["x"].factor_and_offset("mm", "here") == pytest.approx((-1e-3, 0.0))


def test_gain_applies_to_the_raw_number_in_its_unit() -> None:
    raw = changed(BENCH, "columns/F", {"column": 3, "unit": "mV", "gain": "2 kN/V", "offset": "-5 N"})
    factor, offset = Rig.from_dict(raw).columns["F"].factor_and_offset("mV", "here")
    assert factor * 100.0 + offset == pytest.approx(2000.0 * 0.1 - 5.0)


def test_rods_on_both_sides_and_rodless() -> None:
    raw = changed(SERVO, "cylinder/rod", ...)
    raw["cylinder"] |= {"rod_1": "12 mm", "rod_2": "16 mm"}
    rig = Rig.from_dict(raw)
    assert pytest.approx(math.pi / 4 * (0.032**2 - 0.012**2)) == rig.A1
    assert pytest.approx(math.pi / 4 * (0.032**2 - 0.016**2)) == rig.A2
    raw["cylinder"] |= {"rod_1": "0 mm", "rod_2": "0 mm"}
    assert Rig.from_dict(raw).A1 == Rig.from_dict(raw).A2
    del raw["cylinder"]["rod_1"]
    assert Rig.from_dict(raw).A1 == Rig.from_dict(raw).A2


@pytest.mark.parametrize("text", [SERVO, BENCH])
def test_round_trip_through_json_and_pickle_is_exact(text: str) -> None:
    raw = as_dict(text)
    rig = Rig.from_dict(copy.deepcopy(raw))
    assert rig.to_dict() == raw
    again = Rig.from_dict(json.loads(json.dumps(rig.to_dict())))
    assert again == rig
    assert pickle.loads(pickle.dumps(rig)) == rig
    rig.to_dict()["load"]["mass"] = "9 kg"
    assert rig.to_dict() == raw


def test_tuples_become_lists_as_in_json() -> None:
    rig = Rig.from_dict({"kind": "bench", "load": {"mass": "1 kg"}, "base_effects": ("gravity",)})
    assert rig.base_effects == ("gravity",)
    assert json.loads(json.dumps(rig.to_dict())) == rig.to_dict()


def test_rig_is_frozen() -> None:
    rig = Rig.from_dict(as_dict(BENCH))
    with pytest.raises(AttributeError):
        rig.mass = 3.0  # type: ignore[misc]


# key (tables split by /), value (... removes it), what the one line must say
BAD_SERVO = [
    ("kind", "servro", ["kind", "'servro'", "did you mean 'servo'"]),
    ("kind", ..., ["kind", "missing", "servo", "bench"]),
    ("frction", "lugre", ["frction", "unknown key", "did you mean 'friction'"]),
    ("friction", "LuGre", ["friction", "'LuGre'", "lugre", "coulomb"]),
    ("friction", 3, ["friction", "3"]),
    ("mass", "2 kg", ["mass", "unknown key", "[load]"]),
    ("load", ..., ["load", "missing"]),
    ("load", "2 kg", ["load", "'2 kg'", "[load]"]),
    ("load/mass", ..., ["load.mass", "missing"]),
    ("load/mas", "2 kg", ["load.mas:", "unknown key", "did you mean 'mass'"]),
    ("load/mass", 2.4, ["load.mass", "2.4", "unit"]),
    ("load/mass", "2.4", ["load.mass", "'2.4'", "unit"]),
    ("load/mass", "2.4 mm", ["load.mass", "'mm'", "kg"]),
    ("load/mass", "2.4 kilo", ["load.mass", "'kilo'"]),
    ("load/mass", "2,4 kg", ["load.mass", "'2,4 kg'", "point"]),
    ("load/mass", "heavy", ["load.mass", "'heavy'"]),
    ("load/mass", "nan kg", ["load.mass", "finite"]),
    ("load/mass", "1e999 kg", ["load.mass", "finite"]),
    ("load/mass", "0 kg", ["load.mass", "'0 kg'", "(0, "]),
    ("load/mass", "-2 kg", ["load.mass", "'-2 kg'"]),
    ("load/mass", "2 k\ng", ["load.mass", "unit"]),
    ("load/mass", True, ["load.mass", "True"]),
    ("load/incline", "100 deg", ["load.incline", "[-90, 90] deg"]),
    ("cylinder/bore", "32 m m", ["cylinder.bore", "'m m'"]),
    ("cylinder/bore", ..., ["cylinder.bore", "missing", "servo"]),
    ("cylinder/rod", ..., ["cylinder.rod", "missing"]),
    ("cylinder/rod", "32 mm", ["cylinder.rod", "32 mm", "bore"]),
    ("cylinder/rod_2", "12 mm", ["cylinder.rod", "rod_1"]),
    ("cylinder/stroke", ..., ["cylinder.stroke", "missing", "500 mm"]),
    ("cylinder/dead_volume_1", "0 cm^3", ["cylinder.dead_volume_1", "'0 cm^3'"]),
    ("cylinder/dead_volume_2", ..., ["cylinder.dead_volume_2", "missing"]),
    ("conventions/pressure", "relative", ["conventions.pressure", "'relative'", "gauge"]),
    ("conventions", ..., ["conventions.pressure", "missing"]),
    ("conventions/input_hold", "cubic", ["conventions.input_hold", "'cubic'", "zero-order"]),
    ("valve", ..., ["valve", "missing"]),
    ("valve/conductance", "1.2e-8 m^3/s", ["valve.conductance", "'m^3/s'"]),
    ("valve/critical_ratio", 1.0, ["valve.critical_ratio", "1.0", "[0, 1)"]),
    ("valve/critical_ratio", "0.3", ["valve.critical_ratio", "'0.3'", "plain number"]),
    ("valve/critical_ratio", float("nan"), ["valve.critical_ratio", "nan"]),
    ("valve/full_scale", "-10 V", ["valve.full_scale", "'-10 V'"]),
    ("valve/null", 0, ["valve.null", '"0 V"']),
    ("supply/pressure", 377.6, ["supply.pressure", '"377.6 UNIT"', "kPa, bar or psi"]),
    ("supply/pressure", "377.6", ["supply.pressure", '"377.6 UNIT"', "kPa, bar or psi"]),
    ("supply/pressure", "377.6 UNIT", ["supply.pressure", "'UNIT' is not a unit"]),
    ("supply", ..., ["supply", "missing"]),
    ("supply/pressure", "-2 bar", ["supply.pressure", "ambient"]),
    ("supply/pressure", "600 MPa", ["supply.pressure", "'600 MPa'"]),
    ("supply/pressure", "0.6 mPa", ["supply.pressure", "ambient"]),
    ("ambient/pressure", "0 kPa", ["ambient.pressure", "'0 kPa'"]),
    ("ambient/temperature", "-300 degC", ["ambient.temperature", "'-300 degC'", "K"]),
    ("sensors/q1", "1 Pa", ["sensors.q1", "unknown signal", "p1"]),
    ("sensors/p1", "1 mm", ["sensors.p1", "'mm'"]),
    ("sensors/x", "0 um", ["sensors.x", "'0 um'"]),
    ("sensors/x", 3, ["sensors.x", "3"]),
    ("base_effects", "gravity", ["base_effects", "'gravity'"]),
    ("base_effects", ["gravity", "gravity"], ["base_effects", "'gravity'", "twice"]),
    ("base_effects", [3], ["base_effects.0", "3"]),
    ("runs/monday_3.csv/supply", "3 kg", ['runs."monday_3.csv".supply', "'kg'"]),
    ("runs/monday_3.csv/supply", "-1 bar", ['runs."monday_3.csv".supply', "ambient"]),
    ("runs/monday_3.csv/mass", "-1 kg", ['runs."monday_3.csv".mass', "'-1 kg'"]),
    ("runs/monday_3.csv/free", "supply", ['runs."monday_3.csv".free', "'supply'"]),
    ("runs/monday_3.csv/suply", "1 bar", ['runs."monday_3.csv".suply', "did you mean 'supply'"]),
    ("files/delimiter", "ab", ["files.delimiter", "'ab'", "whitespace"]),
    ("files/delimiter", " ", ["files.delimiter", "whitespace"]),
    ("files/decimal", ",", ["files", "decimal", 'write for example delimiter = ";"']),
    ("files/decimal", ";", ["files.decimal", "';'"]),
    ("files/units", "ms", ["files.units", "'ms'", "true or false"]),
    ("files/encoding", "utf-16", ["files.encoding", "'utf-16'", "cp1252"]),
    ("files/encoding", "base64", ["files.encoding", "'base64'"]),
    ("files/encoding", "\0", ["files.encoding"]),
    ("files/header", "no", ["files.header", "'no'"]),
    ("files/skip_rows", -1, ["files.skip_rows", "-1"]),
    ("files/skip_rows", 1.5, ["files.skip_rows", "1.5"]),
    ("files/header", False, ["columns", "missing"]),
    ("columns/y", {"column": 1}, ["columns.y", "unknown signal"]),
    ("columns/F", {"column": 1}, ["columns.F", "servo"]),
    ("columns/x", {"unit": "mm"}, ["columns.x.column", "missing"]),
    ("columns/x", {"column": 0}, ["columns.x.column", "0"]),
    ("columns/x", {"column": 2, "unit": "bar"}, ["columns.x", "'bar'"]),
    ("columns/x", {"column": 2, "unit": "V", "gain": "3 N/V"}, ["columns.x", "'3 N/V'", "x in m"]),
    ("columns/x", {"column": 2, "unit": "volts?", "gain": "3 m/V"}, ["columns.x", "'volts?'"]),
    ("columns/x", {"column": 2, "unit": "mm", "gain": [1]}, ["columns.x.gain", "[1]"]),
    ("columns/x", {"column": 2, "unit": "mm", "gain": "0"}, ["columns.x.gain", "'0'"]),
    ("columns/x", {"column": 2, "unit": "degC", "gain": "1 mm/K"}, ["columns.x", "'degC'"]),
    ("columns/x", {"column": 2, "unit": "mm", "offset": "3 N"}, ["columns.x.offset", "'N'"]),
    ("columns/x", {"column": 2, "unit": "mm", "gian": "3"}, ["columns.x.gian", "did you mean 'gain'"]),
    ("columns", {"p1": {"column": "p", "unit": "bar"}, "p2": {"column": "p"}}, ["columns.p2.column", "'p'", "p1"]),
    ("columns", 3, ["columns", "3"]),
]


@pytest.mark.parametrize(("key", "value", "said"), BAD_SERVO)
def test_nonsense_is_refused_in_one_line_that_names_it(key: str, value: Any, said: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        Rig.from_dict(changed(SERVO, key, value), where="my_rig.toml")
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("my_rig.toml: ")
    for words in said:
        assert words in line


BAD_BENCH = [
    ("cylinder/bore", "25 mm", ["conventions.pressure", "missing"]),
    ("supply/pressure", "6 bar", ["conventions.pressure", "missing"]),
    ("cylinder/rod", "12 mm", ["cylinder.bore", "missing"]),
    ("cylinder/rod_1", "12 mm", ["cylinder.rod_2", "missing"]),
    ("runs/a.csv/supply", "5 bar", ['runs."a.csv".supply', "bench"]),
    ("runs/a.csv/free", ["supply"], ['runs."a.csv".supply', "bench"]),
    ("columns/u", {"column": 9, "unit": "V"}, ["columns.u", "bench"]),
    ("files/header", False, ["columns.t.column", "'t'", "number"]),
]


@pytest.mark.parametrize(("key", "value", "said"), BAD_BENCH)
def test_nonsense_on_a_bench(key: str, value: Any, said: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        Rig.from_dict(changed(BENCH, key, value), where="bench.toml")
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("bench.toml: ")
    assert all(words in line for words in said), line


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"kind = servo", "not valid TOML"),
        (b'kind = "servo"\nkind = "bench"', "not valid TOML"),
        (b"kind = \xff\xfe", "UTF-8"),
        (b"\x00\x01\x02\x03", "not valid TOML"),
        (b"", "missing"),
    ],
)
def test_files_that_are_no_rig(content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(content)
    with pytest.raises(UserError) as caught:
        Rig.from_toml(path)
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    assert said in line


def test_absent_file_folder_and_no_table(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(UserError, match="cannot read"):
            Rig.from_toml(path)
    with pytest.raises(UserError, match="not a table"):
        Rig.from_dict([1, 2], where="model.json: rig")  # type: ignore[arg-type]


def test_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b"\xef\xbb\xbf" + BENCH.encode())
    assert Rig.from_toml(path).mass == 90.0


UNITS = [("mm", "m"), ("um", "m"), ("kPa", "Pa"), ("bar", "Pa"), ("cm^3", "m^3"), ("ms", "s"), ("degC", "K"),
         ("deg", "rad"), ("kgf", "N"), ("dm^3/(s*bar)", "m^3/(s*Pa)"), ("m^3/(s*Pa)", "m^3/(s*Pa)")]  # fmt: skip


@given(value=st.floats(-1e9, 1e9, allow_subnormal=False), units=st.sampled_from(UNITS))
def test_quantity_and_display_are_inverse(value: float, units: tuple[str, str]) -> None:
    unit, si = units
    back = to_display(quantity(f"{value!r} {unit}", si, "here"), si, unit)
    # Two roundings, and for degC the cancellation of 273.15.
    assert back == pytest.approx(value, rel=1e-12, abs=1e-12 * (300 if unit == "degC" else 1))


@given(text=st.text(max_size=30))
def test_no_text_makes_quantity_fail_otherwise_than_with_one_line(text: str) -> None:
    problem = ""
    try:
        assert math.isfinite(quantity(text, "m", "here"))
    except UserError as error:
        problem = str(error)
    assert len(problem.splitlines()) <= 1


def test_units_are_written_in_several_ways() -> None:
    assert quantity("32mm", "m", "here") == quantity(" 32 mm ", "m", "here") == pytest.approx(0.032)
    assert quantity("3 µm", "m", "here") == quantity("3 μm", "m", "here") == pytest.approx(3e-6)
    assert factor_and_offset("degC", "K", "here") == pytest.approx((1.0, 273.15))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=5,
)


@given(key=st.sampled_from(sorted({case[0] for case in BAD_SERVO})), value=JSON)
def test_no_value_of_any_key_fails_otherwise_than_with_one_line(key: str, value: Any) -> None:
    problem = ""
    try:
        Rig.from_dict(changed(SERVO, key, value))
    except UserError as error:
        problem = str(error)
    assert "\n" not in problem
