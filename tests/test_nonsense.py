"""Ways to hand in nonsense, as one table: exit code 2, one line on stderr, no traceback, nothing written."""

from __future__ import annotations

import gzip
import json
import re
import shlex
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import RANGES, rig
from hypothesis import given, settings
from hypothesis import strategies as st
from test_commands import RIG, contents, run

from pneuid import api
from pneuid.errors import UserError
from pneuid.model import nominal_model
from pneuid.recording import Recording
from pneuid.rig import Rig

IDENTIFY = "pneuid.identify --rig rig.toml --data good.csv --out out"
COMPARE = "pneuid.compare model.json --data good.csv --out out"


@cache
def csv() -> str:
    """A run of plausible numbers; nothing here is ever fitted."""
    t = 0.001 * np.arange(60)
    columns = [t, np.sin(40 * t), 250 + 20 * np.sin(20 * t), 300 + 9 * np.cos(9 * t), 310 - 9 * np.cos(9 * t)]
    rows = "".join(",".join(f"{value:.5f}" for value in row) + "\n" for row in np.column_stack(columns))
    return f"t [s],u [V],x [mm],p1 [kPa],p2 [kPa]\n{rows}"


@cache
def model_json() -> str:
    return json.dumps(nominal_model(rig(), {}, RANGES).to_dict())


def row(number: int, text: str) -> bytes:
    """The run with the sample ``number`` (file row) replaced."""
    lines = csv().split("\n")
    lines[number - 1] = text
    return "\n".join(lines).encode()


def header(text: str) -> bytes:
    return csv().replace(csv().split("\n")[0], text).encode()


def line(old: str, new: str) -> bytes:
    """The rig file with a text in it replaced."""
    assert old in RIG
    return RIG.replace(old, new).encode()


def model(change: Callable[[dict[str, Any]], object]) -> bytes:
    content = json.loads(model_json())
    change(content)
    return json.dumps(content).encode()


RIGS: dict[str, bytes | None] = {
    "empty": b"",
    "a folder": None,
    "binary": bytes(range(256)),
    "UTF-16": RIG.encode("utf-16"),
    "JSON": b'{"kind": "servo"}',
    "half a line": b'kind = "servo',
    "a key twice": RIG.encode() + b'\n[supply]\npressure = "500 kPa"\n',
    "no kind": line('kind = "servo"\n', ""),
    "another kind": line('"servo"', '"hydraulic"'),
    "unknown table": RIG.encode() + b"\n[oil]\nviscosity = 1\n",
    "unknown key": line("stroke =", "strike ="),
    "no supply": line('[supply]\npressure = "600 kPa"\n', ""),
    "no mass": line('mass = "2.4 kg"', ""),
    "negative mass": line('"2.4 kg"', '"-2.4 kg"'),
    "no unit": line('"32 mm"', "32"),
    "wrong unit": line('"500 mm"', '"500 kPa"'),
    "unknown unit": line('"12 mm"', '"12 mmm"'),
    "decimal comma": line('"2.4 kg"', '"2,4 kg"'),
    "not a number": line('"32 mm"', '"nan mm"'),
    "rod above bore": line('"12 mm"', '"40 mm"'),
    "vacuum as supply": line('"600 kPa"', '"-50 kPa"'),
    "MPa for kPa": line('"600 kPa"', '"600 MPa"'),
    "critical ratio of 2": line("0.30", "2.0"),
    "full scale of zero": line('"10 V"', '"0 V"'),
    "conductance in litres": line("1.0e-8 m^3/(s*Pa)", "5 l"),
    "friction by hand": b'friction = "sticky"\n' + RIG.encode(),
    "effect that is none": b'base_effects = ["magic"]\n' + RIG.encode(),
    "convention": line('pressure = "gauge"', 'pressure = "relative"'),
    "noise of a stranger": RIG.encode() + b'\n[sensors]\nq = "1 mm"\n',
    "noise of zero": RIG.encode() + b'\n[sensors]\nx = "0 um"\n',
    "column of no signal": RIG.encode() + b'\n[columns]\nq = {column = "x"}\n',
    "one column for two": RIG.encode() + b'\n[columns]\np1 = {column = "a"}\np2 = {column = "a"}\n',
    "delimiter of two": RIG.encode() + b'\n[files]\ndelimiter = ";;"\n',
    "rows to skip below zero": RIG.encode() + b"\n[files]\nskip_rows = -1\n",
    "no header, no columns": RIG.encode() + b"\n[files]\nheader = false\n",
    "free in a run": RIG.encode() + b'\n[runs."good.csv"]\nfree = ["temperature"]\n',
    "free twice": RIG.encode() + b'\n[runs."good.csv"]\nfree = ["mass", "mass"]\n',
    "free, not a list": RIG.encode() + b'\n[runs."good.csv"]\nfree = "mass"\n',
    "runs as a number": b"runs = 3\n" + RIG.encode(),
}
"""Content of rig.toml."""

DATA: dict[str, bytes] = {
    "empty": b"",
    "only a header": csv().split("\n")[0].encode(),
    "one row": "\n".join(csv().split("\n")[:2]).encode(),
    "binary": bytes(range(256)) * 9,
    "UTF-16": csv().encode("utf-16"),
    "Latin-1": csv().replace("[kPa],p2", "[\xb5Pa],p2").encode("latin-1"),
    "gzip under the name of a CSV": gzip.compress(csv().encode()),
    "header twice": row(20, csv().split("\n")[0]),
    "no header": "\n".join(csv().split("\n")[1:]).encode(),
    "a column twice": header("t [s],u [V],x [mm],p1 [kPa],p1 [kPa]"),
    "capital letters": header("T [s],U [V],X [mm],P1 [kPa],P2 [kPa]"),
    "no unit": header("t [s],u [V],x,p1 [kPa],p2 [kPa]"),
    "volt for mm": header("t [s],u [V],x [V],p1 [kPa],p2 [kPa]"),
    "unknown unit": header("t [s],u [V],x [mm],p1 [kilos],p2 [kPa]"),
    "bar for kPa": header("t [s],u [V],x [m],p1 [bar],p2 [bar]"),
    "two signals short": header("t [s],u [V],x [mm],a [kPa],b [kPa]"),
    "semicolons": csv().replace(",", ";").encode(),
    "semicolons in one row": row(30, csv().split("\n")[29].replace(",", ";")),
    "decimal commas": csv().replace(",", ";").replace(".", ",").encode(),
    "a short row": row(30, "0.02849,1.0"),
    "a long row": row(30, csv().split("\n")[29] + ",7"),
    "an empty row": row(30, ""),
    "an empty cell": row(30, "0.028,,250,300,310"),
    "NaN": row(30, "0.028,nan,250,300,310"),
    "inf": row(30, "0.028,1,inf,300,310"),
    "a number without end": row(30, "0.028,1,1e999,300,310"),
    "a huge number": row(30, "0.028,1,1e200,300,310"),
    "text": row(30, "0.028,1,fault,300,310"),
    "a formula": row(30, "0.028,1,=A1+1,300,310"),
    "a date": row(30, "2026-03-01 12:00,1,250,300,310"),
    "hexadecimal": row(30, "0.028,1,0x1F,300,310"),
    "time back": row(30, "0.001,1,250,300,310"),
    "time twice": row(30, csv().split("\n")[28]),
    "outside the stroke": row(30, "0.028,1,900,300,310"),
    "below vacuum": row(30, "0.028,1,250,-300,310"),
    "an open quotation mark": row(30, '0.028,1,"250,300,310'),
    "no motion": re.sub(r"(?m)^(\d.*?,.*?),.*?,", r"\1,250,", csv()).encode(),
}
"""Content of good.csv."""

MODELS: dict[str, bytes] = {
    "empty": b"",
    "binary": bytes(range(256)),
    "a number": b"3",
    "null": b"null",
    "half": model_json()[:200].encode(),
    "a list for the rig": model(lambda m: m.update(rig=[])),
    "no rig": model(lambda m: m.pop("rig")),
    "a schema of text": model(lambda m: m.update(schema="one")),
    "parameters as text": model(lambda m: m.update(parameters="Fc")),
    "a parameter twice": model(lambda m: m["parameters"].append(m["parameters"][0])),
    "a parameter less": model(lambda m: m["parameters"].pop()),
    "a value of text": model(lambda m: m["parameters"][0].update(value="much")),
    "no value": model(lambda m: m["parameters"][0].pop("value")),
    "a value that is NaN": model(lambda m: m["parameters"][0].update(value=float("nan"))),
    "an effect that is none": model(lambda m: m.update(effects=["magic"])),
    "effects as a number": model(lambda m: m.update(effects=3)),
    "a law that is none": model(lambda m: m.update(friction="sticky")),
    "a fit of text": model(lambda m: m.update(fit="good")),
    "deeply nested": b"[" * 100_000,
}
"""Content of model.json."""

NAMES: dict[str, str] = {
    "an unknown ending": "pneuid.identify --rig rig.toml --data run.xlsx --out out",
    "a zip": "pneuid.identify --rig rig.toml --data run.zip --out out",
    "a compressed file": "pneuid.identify --rig rig.toml --data good.csv.gz --out out",
    "no ending": "pneuid.identify --rig rig.toml --data run --out out",
    "an empty name": "pneuid.identify --rig rig.toml --data '' --out out",
    "a name too long": f"pneuid.identify --rig rig.toml --data {'x' * 300}.csv --out out",
    "the rig as data": "pneuid.identify --rig rig.toml --data rig.toml --out out",
    "the data as rig": "pneuid.identify --rig good.csv --data good.csv --out out",
    "two line ends": "pneuid.identify --rig rig.toml --data 'a\nb.csv' --out out",
    "adding what there is not": f"{IDENTIFY} --add magic",
    "adding a spline of nothing": f"{IDENTIFY} --add 'spline:force()'",
    "adding and dropping at once": f"{IDENTIFY} --drop valve_lag",
    "an option twice without a value": "pneuid.identify --rig --rig rig.toml --data good.csv --out out",
    "no data after --data": "pneuid.identify --rig rig.toml --data --out out",
    "the same run twice": "pneuid.identify --rig rig.toml --data good.csv good.csv --out out",
    "out below a file": "pneuid.identify --rig rig.toml --data good.csv --out good.csv/out",
    "out where nothing can be made": "pneuid.identify --rig rig.toml --data good.csv --out /proc/nowhere/out",
    "a model that is a folder": "pneuid.compare folder --data good.csv --out out",
    "a friction law that is none": f"{IDENTIFY} --friction sticky",
    "a diagnosis that is a folder": f"{IDENTIFY} --diagnosis folder",
}

CASES = [
    *[pytest.param(IDENTIFY, "rig.toml", content, id=f"rig: {case}") for case, content in RIGS.items()],
    *[pytest.param(IDENTIFY, "good.csv", content, id=f"data: {case}") for case, content in DATA.items()],
    *[pytest.param(COMPARE, "model.json", content, id=f"model: {case}") for case, content in MODELS.items()],
    *[pytest.param(words, "good.csv", csv().encode(), id=f"words: {case}") for case, words in NAMES.items()],
]


@pytest.mark.parametrize(("words", "file", "content"), CASES)
def test_nonsense_is_refused_in_one_line(words, file, content, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    good = {
        "rig.toml": RIG,
        "good.csv": csv(),
        "model.json": model_json(),
        "run.zip": "PK",
        "run.xlsx": "PK",
        "run": csv(),
    }
    for name, text in {**good, "good.csv.gz": csv()}.items():
        Path(name).write_text(text, encoding="utf-8")
    Path("folder").mkdir()
    Path(file).unlink()
    if content is None:
        Path(file).mkdir()
    else:
        Path(file).write_bytes(content)
    before = contents(tmp_path)
    name, *rest = shlex.split(words)
    assert run(name, *rest) == 2
    shown = capsys.readouterr()
    assert not shown.out
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    assert contents(tmp_path) == before


# --- anything at all: a UserError of one line, or success ---

mutations = st.lists(
    st.tuples(st.integers(0, 10_000), st.integers(0, 3), st.binary(max_size=6)), min_size=1, max_size=4
)


def mutated(content: bytes, changes: list[tuple[int, int, bytes]]) -> bytes:
    for place, removed, added in changes:
        at = place % (len(content) + 1)
        content = content[:at] + added + content[at + removed :]
    return content


def usable_or_refused(read: Callable[[], object]) -> None:
    line = ""
    try:
        read()
    except UserError as error:
        line = str(error)
    assert "\n" not in line


@settings(max_examples=60)
@given(mutations | st.binary(max_size=300))
def test_a_damaged_csv_never_gives_a_traceback(tmp_path_factory, changes):
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    path.write_bytes(changes if isinstance(changes, bytes) else mutated(csv().encode(), changes))
    usable_or_refused(lambda: Recording.read(path, rig()))


@settings(max_examples=60)
@given(mutations | st.binary(max_size=300))
def test_a_damaged_rig_file_never_gives_a_traceback(tmp_path_factory, changes):
    path = tmp_path_factory.getbasetemp() / "damaged.toml"
    path.write_bytes(changes if isinstance(changes, bytes) else mutated(RIG.encode(), changes))
    usable_or_refused(lambda: Rig.from_toml(path))


@settings(max_examples=60)
@given(mutations | st.binary(max_size=300))
def test_a_damaged_model_never_gives_a_traceback(tmp_path_factory, changes):
    path = tmp_path_factory.getbasetemp() / "damaged.json"
    path.write_bytes(changes if isinstance(changes, bytes) else mutated(model_json().encode(), changes))
    usable_or_refused(lambda: api.load(path))
