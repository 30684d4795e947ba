"""The commands as a user meets them: help, refusals, the files written, ctrl-C."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from helpers import RANGES, rig

from pneuid import api, compare, diagnose, identify
from pneuid.effects import CATALOGUE
from pneuid.model import nominal_model
from pneuid.rig import Rig
from pneuid.terminal import command_line, next_folder, run_command, write_json
from pneuid.virtual_rig import ATMOSPHERE, HIDDEN_EFFECTS, TruthServo, record_servo, write_csv

REPOSITORY = Path(__file__).parents[1]
COMMANDS = ("pneuid.identify", "pneuid.compare", "pneuid.diagnose", "pneuid.effects.__main__", "controllers.study")
SI_UNITS = {
    "Fc": "N", "Fs": "N", "vs": "m/s", "sigma0": "N/m", "sigma1": "N*s/m", "sigma2": "N*s/m", "n": "1",
    "C": "m^3/(s*Pa)",
}  # fmt: skip
OUTPUTS = {"x": "m", "p1": "Pa", "p2": "Pa"}
VERDICTS = {"well determined", "weakly determined", "on its bound", "not visible"}

RIG = """kind = "servo"
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
[valve]
conductance = "1.0e-8 m^3/(s*Pa)"
critical_ratio = 0.30
full_scale = "10 V"
[supply]
pressure = "600 kPa"
[runs."train_2.csv"]
supply = "400 kPa"
"""


def command(name: str) -> Callable[..., None]:
    """``main`` of a module."""
    return importlib.import_module(name).main


def run(name: str, *words: str | Path) -> int:
    """The exit code of a command played in this process."""
    try:
        run_command(command(name), [str(word) for word in words])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def plain_json(path: Path) -> Any:
    """Content of a file that holds JSON in the strict sense: no NaN, no Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{path}: {constant}")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def record(path: Path, excitation: str = "multisine", seed: int = 1, bar: float = 6.0, seconds: float = 1.5) -> None:
    """A run of the virtual rig with a leaking piston."""
    leaking = HIDDEN_EFFECTS["leakage_internal"]["strong"]
    write_csv(path, record_servo(TruthServo(), leaking, excitation, seconds, seed, supply=bar * 1e5 + ATMOSPHERE))


# --- help ---


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_well_and_shows_an_example(name, capsys):
    assert run(name, "--help") == 0
    shown = capsys.readouterr()
    called = name.removesuffix(".__main__")
    assert f"usage: python -m {called}" in shown.out
    assert f"  python -m {called}" in shown.out.split("example")[1]
    assert not shown.err


def test_the_catalogue_is_listed(capsys):
    assert run("pneuid.effects.__main__") == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in CATALOGUE)
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_is_shown_in_full(name, capsys):
    assert run("pneuid.effects.__main__", name) == 0
    shown = capsys.readouterr().out
    for words in ("revealed by:", "easily confused with:", "source:", "parameter"):
        assert words in shown
    assert max(map(len, shown.splitlines())) <= 80


def test_importing_the_package_imports_no_command_and_no_screen():
    program = (
        "import sys, pneuid; unwanted = {'matplotlib', 'rich', 'pneuid.identify', 'pneuid.compare', 'pneuid.diagnose', "
        "'pneuid.story', 'pneuid.terminal', 'pneuid.report', 'pneuid.virtual_rig', 'controllers', 'argparse'}; "
        "print(sorted((unwanted - before) & set(sys.modules)))"
    )
    program = "import sys; before = set(sys.modules); " + program
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=REPOSITORY)
    assert done.stdout.strip() in ("[]", "['argparse']")  # argparse comes with libraries


# --- refusals ---


@pytest.fixture(scope="module")
def shelf(tmp_path_factory) -> Path:
    """Rigs, models and recordings, usable and not."""
    folder = tmp_path_factory.mktemp("shelf")
    (folder / "rig.toml").write_text(RIG)
    (folder / "rig_unknown_law.toml").write_text('friction = "glue"\n' + RIG)
    (folder / "rig_typo.toml").write_text(RIG.replace("bore =", "boar ="))
    (folder / "rig_unit.toml").write_text(RIG.replace('"32 mm"', '"32 kg"'))
    bench = 'kind = "bench"\n[load]\nmass = "1 kg"\n'
    (folder / "bench.toml").write_text(bench)
    (folder / "bench.csv").write_text(
        "t [s],x [mm],F [N]\n" + "".join(f"{0.01 * i:.2f},{i:d},{i % 7:d}\n" for i in range(60))
    )
    record(folder / "good.csv", seconds=0.2)
    (folder / "other").mkdir()
    lines = (folder / "good.csv").read_text().splitlines()
    (folder / "other" / "good.csv").write_text("\n".join(lines) + "\n")
    worse = {
        "cell": [*lines[:100], lines[100].replace(lines[100].split(",")[2], "n.a."), *lines[101:]],
        "short": [*lines[:50], "0.049,1.0", *lines[51:]],
        "no_unit": [lines[0].replace("p2 [kPa]", "p2"), *lines[1:]],
        "wrong_unit": [lines[0].replace("p2 [kPa]", "p2 [kN]"), *lines[1:]],
        "missing": [",".join(line.split(",")[:4]) for line in lines],
        "time": [*lines[:80], lines[70], *lines[81:]],
        "few": lines[:10],
        "empty": [],
    }
    for name, content in worse.items():
        (folder / f"{name}.csv").write_text("".join(f"{line}\n" for line in content))
    model = nominal_model(rig(), {}, RANGES)
    model.save(folder / "model.json")
    content = model.to_dict()
    changed = {
        "other_schema": {**content, "schema": 99},
        "no_parameters": {**content, "parameters": []},
        "no_fit": {key: value for key, value in content.items() if key != "fit"},
        "strange_effect": {**content, "effects": ["glue"]},
        "list": [1, 2],
    }
    for name, other in changed.items():
        (folder / f"{name}.json").write_text(json.dumps(other))
    (folder / "broken.json").write_text('{"schema": 1,\n "name": ')
    (folder / "file").write_text("not a folder")
    (folder / "full").mkdir()
    (folder / "full" / "model.json").write_text("kept")
    (folder / "bad_scenario.toml").write_text('title = "half a scenario"\nunheard = 1\n')
    return folder


FIT = "pneuid.identify --rig rig.toml --data good.csv"
OUT = "--out out"
REFUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "no rig file": (f"pneuid.identify --rig nowhere.toml --data good.csv {OUT}", ("nowhere.toml",)),
    "no data file": (f"pneuid.identify --rig rig.toml --data nowhere.csv {OUT}", ("nowhere.csv",)),
    "no held-out file": (f"{FIT} --hold-out nowhere.csv {OUT}", ("nowhere.csv",)),
    "unknown effect": (f"{FIT} --add glue {OUT}", ("glue", "python -m pneuid.effects lists it")),
    "effect not in the model": (f"{FIT} --drop gravity {OUT}", ("gravity", "cannot be dropped")),
    "effect of the other rig": (
        f"pneuid.identify --rig bench.toml --data bench.csv --add leakage_internal {OUT}",
        ("leakage_internal", "bench", "servo"),
    ),
    "rig and from": (f"pneuid.identify --rig rig.toml --from model.json --data good.csv {OUT}", ("--rig", "--from")),
    "data without rig": (f"pneuid.identify --data good.csv {OUT}", ("--data", "--rig", "--from")),
    "rig without data": (f"pneuid.identify --rig rig.toml {OUT}", ("--data", "--rig")),
    "no out": (FIT, ("--out",)),
    "out holds results": (f"{FIT} --out full", ("full", "--overwrite")),
    "out is a file": (f"{FIT} --out file", ("file", "folder")),
    "out is below a file": (f"{FIT} --out file/below", ("file",)),
    "no zero file": (f"pneuid.diagnose model.json --data good.csv --zero nowhere.csv {OUT}", ("nowhere.csv",)),
    "a run as zero reading": (
        f"pneuid.diagnose model.json --data good.csv --zero good.csv {OUT}", ("good.csv", "column p1", "vented")
    ),
    "named twice": (f"{FIT} other/good.csv {OUT}", ("good.csv", "twice")),
    "held out twice": (f"{FIT} --hold-out good.csv {OUT}", ("good.csv", "twice")),
    "bad cell": (f"pneuid.identify --rig rig.toml --data cell.csv {OUT}", ("cell.csv", "101", "x", "n.a.")),
    "short row": (f"pneuid.identify --rig rig.toml --data short.csv {OUT}", ("short.csv", "51")),
    "no unit": (f"pneuid.identify --rig rig.toml --data no_unit.csv {OUT}", ("no_unit.csv", "p2", "unit")),
    "wrong unit": (f"pneuid.identify --rig rig.toml --data wrong_unit.csv {OUT}", ("wrong_unit.csv", "p2", "kN")),
    "no column": (f"pneuid.identify --rig rig.toml --data missing.csv {OUT}", ("missing.csv", "p2", "missing")),
    "time runs back": (f"pneuid.identify --rig rig.toml --data time.csv {OUT}", ("time.csv", "81", "t", "runs back")),
    "few samples": (f"pneuid.identify --rig rig.toml --data few.csv {OUT}", ("few.csv", "samples")),
    "empty file": (f"pneuid.identify --rig rig.toml --data empty.csv {OUT}", ("empty.csv",)),
    "a folder as data": (f"pneuid.identify --rig rig.toml --data other {OUT}", ("other",)),
    "typo in the rig": (f"pneuid.identify --rig rig_typo.toml --data good.csv {OUT}", ("rig_typo.toml", "boar")),
    "unit in the rig": (f"pneuid.identify --rig rig_unit.toml --data good.csv {OUT}", ("rig_unit.toml", "bore", "kg")),
    "law in the rig": (f"pneuid.identify --rig rig_unknown_law.toml --data good.csv {OUT}", ("friction", "glue")),
    "law": (f"{FIT} --friction glue {OUT}", ("--friction", "glue", "stribeck")),
    "unknown option": (f"{FIT} --glue {OUT}", ("--glue",)),
    "no diagnosis": (f"{FIT} --diagnosis nowhere.json {OUT}", ("nowhere.json",)),
    "broken diagnosis": (f"{FIT} --diagnosis broken.json {OUT}", ("broken.json",)),
    "no such diagnosis": (f"{FIT} --diagnosis model.json {OUT}", ("model.json", "diagnosis")),
    "from nowhere": (f"pneuid.identify --from nowhere.json --data good.csv {OUT}", ("nowhere.json",)),
    "from a broken file": (f"pneuid.identify --from broken.json --data good.csv {OUT}", ("broken.json", "line 2")),
    "from another schema": (f"pneuid.identify --from other_schema.json --data good.csv {OUT}", ("schema",)),
    "compare a broken file": (f"pneuid.compare broken.json --data good.csv {OUT}", ("broken.json", "line 2")),
    "compare another schema": (f"pneuid.compare other_schema.json --data good.csv {OUT}", ("schema",)),
    "compare a list": (f"pneuid.compare list.json --data good.csv {OUT}", ("list.json", "schema")),
    "compare half a file": (f"pneuid.compare no_fit.json --data good.csv {OUT}", ("no_fit.json", "fit")),
    "compare no parameters": (f"pneuid.compare no_parameters.json --data good.csv {OUT}", ("parameters", "Fc")),
    "compare a strange effect": (f"pneuid.compare strange_effect.json --data good.csv {OUT}", ("glue",)),
    "compare a csv": (f"pneuid.compare good.csv --data good.csv {OUT}", ("good.csv", "line 1")),
    "compare without data": (f"pneuid.compare model.json {OUT}", ("MODEL", "--data")),
    "compare without model": (f"pneuid.compare --data good.csv {OUT}", ("MODEL", "--data")),
    "compare with a bad cell": (f"pneuid.compare model.json --data cell.csv {OUT}", ("cell.csv", "101", "x")),
    "compare into results": ("pneuid.compare model.json --data good.csv --out full", ("full", "--overwrite")),
    "diagnose a broken file": (f"pneuid.diagnose broken.json --data good.csv {OUT}", ("broken.json",)),
    "diagnose without data": (f"pneuid.diagnose model.json {OUT}", ("MODEL", "--data")),
    "diagnose twice": (f"pneuid.diagnose model.json --data good.csv --hold-out other/good.csv {OUT}", ("twice",)),
    "diagnose into results": ("pneuid.diagnose model.json --data good.csv --out full", ("full", "--overwrite")),
    "diagnose with no workers": (f"pneuid.diagnose --workers 0 {OUT}", ("--workers 0",)),
    "diagnose here and there": (f"pneuid.diagnose --workers 2 --scheduler tcp://x:1 {OUT}", ("leave one out",)),
    "diagnose on and anew": (f"pneuid.diagnose --resume --overwrite {OUT}", ("--resume", "leave one out")),
    "diagnose on no cluster": (f"pneuid.diagnose --scheduler nowhere {OUT}", ("--scheduler nowhere",)),
    "no such effect": ("pneuid.effects.__main__ glue", ("glue", "python -m pneuid.effects lists it")),
    "no workers": (f"controllers.study --workers 0 {OUT}", ("--workers 0",)),
    "some workers": (f"controllers.study --workers some {OUT}", ("--workers", "some")),
    "no scenario": (f"controllers.study nowhere.toml {OUT}", ("nowhere.toml",)),
    "bad scenario": (f"controllers.study bad_scenario.toml {OUT}", ("bad_scenario.toml",)),
    "chain without scenario": (f"controllers.study nowhere.toml --chain {OUT}", ("nowhere.toml",)),
    "chain of a bad scenario": (f"controllers.study bad_scenario.toml --chain {OUT}", ("bad_scenario.toml",)),
    "chain into results": ("controllers.study --chain --out full", ("full", "--overwrite")),
}


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_in_one_line_and_nothing_is_written(case, shelf, monkeypatch, capsys):
    line, expected = REFUSED[case]
    monkeypatch.chdir(shelf)
    before = contents(shelf)
    name, *words = shlex.split(line)
    assert run(name, *words) == 2
    shown = capsys.readouterr()
    assert not shown.out
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    for fragment in expected:
        assert fragment in shown.err
    assert contents(shelf) == before


def test_exit_codes_reach_the_shell(shelf):
    words = [sys.executable, "-m", "pneuid.identify", "--rig", "nowhere.toml", "--data", "good.csv", "--out", "out"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=shelf, env=environment())
    assert done.returncode == 2
    assert done.stderr.startswith("error: nowhere.toml")
    assert done.stderr.count("\n") == 1
    assert not (shelf / "out").exists()


def environment() -> dict[str, str]:
    """The environment of a command that runs elsewhere than in the repository."""
    return {**os.environ, "PYTHONPATH": str(REPOSITORY)}


# --- ctrl-C ---


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT cannot be sent to one process on Windows")
def test_ctrl_c_during_a_fit_leaves_nothing_or_the_best_so_far_labelled_so(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    record(tmp_path / "train_1.csv", seconds=6.0)
    words = [sys.executable, "-m", "pneuid.identify", "--rig", "rig.toml", "--data", "train_1.csv", "--out", "out"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=environment(),
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509 - a test started in the background ignores it
    ) as process:  # fmt: skip
        assert "fitting" in process.stderr.readline()
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == "" and err.splitlines()[-1] == "interrupted"
    left = sorted(path.name for path in (tmp_path / "out").iterdir())
    # how far it got in 0.3 s is the machine's affair; before the solver has a point there is nothing to keep
    if "best so far" not in err:
        assert err == "interrupted\n" and left == []
    else:
        assert left == ["model.json"]
        kept = plain_json(tmp_path / "out" / "model.json")["fit"]
        assert kept["status"].startswith("interrupted, best so far") and kept["converged"] is False


def test_ctrl_c_inside_the_solver_is_not_lost(monkeypatch, tmp_path, capsys):
    """An exception that the solver swallowed is raised again before anything is written."""

    def swallow(_: object) -> None:
        solver = {"__name__": "pneuid.estimation.solver", "signal": signal}
        exec("signal.raise_signal(signal.SIGINT)", solver)  # noqa: S102 - a frame of the solver's
        write_json(tmp_path / "model.json", {})

    with pytest.raises(SystemExit) as stop:
        run_command(swallow)
    assert stop.value.code == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert not list(tmp_path.iterdir())


def test_ctrl_c_that_a_library_turned_into_its_own_error_is_still_one(capsys):
    def convert(_: object) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise NotImplementedError("Wrong number or type of arguments for function 'Function_call'.")

    with pytest.raises(SystemExit) as stop:
        run_command(convert)
    assert stop.value.code == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_an_error_without_ctrl_c_is_no_interrupt():
    def fail(_: object) -> None:
        raise NotImplementedError("a mistake of ours")

    with pytest.raises(NotImplementedError):
        run_command(fail)


# --- what comes next ---


def test_a_command_line_can_be_pasted():
    line = command_line("pneuid.diagnose", Path("my fit/model.json"), data=["a b.csv", "c.csv"], hold_out=[], out=["d"])
    assert line == "python -m pneuid.diagnose 'my fit/model.json' --data 'a b.csv' c.csv --out d"
    assert command_line("pneuid.identify", from_=["m.json"]) == "python -m pneuid.identify --from m.json"


def test_the_next_folder_holds_nothing(tmp_path):
    assert next_folder(tmp_path / "fit", "fit_better") == tmp_path / "fit_better"
    (tmp_path / "fit_better").mkdir()
    assert next_folder(tmp_path / "fit", "fit_better") == tmp_path / "fit_better_2"


# --- the files written ---


@dataclass(frozen=True)
class Story:
    """A folder with the results of identify, compare, diagnose and identify again, and what each printed."""

    folder: Path
    printed: dict[str, str]


REJECTED = {
    "effects": ["valve_dead_zone"], "added": "valve_dead_zone", "accepted": False, "train": {"x": 1e-3, "p1": 1e3, "p2": 1e3},
    "hold_out": {"x": 1e-3, "p1": 1e3, "p2": 1e3}, "noise_floor": {"x": 1e-5, "p1": 5e2, "p2": 5e2}, "parameters": 9,
}  # fmt: skip


@pytest.fixture(scope="module")
def story(tmp_path_factory) -> Story:
    """The commands one after the other, each as the one before it proposes."""
    folder = tmp_path_factory.mktemp("story")
    (folder / "rig.toml").write_text(RIG)
    record(folder / "train_1.csv", "multisine", 1)
    record(folder / "train_2.csv", "steps", 2, bar=4.0)
    record(folder / "held.csv", "multisine", 3)
    printed: dict[str, str] = {}

    def play(label: str, line: str) -> None:
        name, *words = shlex.split(line.removeprefix("python -m "))
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
            code = run(name, *words)
        assert code == 0, err.getvalue()
        printed[label] = out.getvalue()

    with contextlib.chdir(folder):
        play("fit", "pneuid.identify --rig rig.toml --data train_1.csv train_2.csv --hold-out held.csv --out fit")
        Path("compared").mkdir()
        Path("compared/metrics.json").write_text("old")
        play("compare", "pneuid.compare fit/model.json --data held.csv --out compared --overwrite")
        play("diagnose", following(printed["fit"]))
        diagnosis = plain_json(folder / "fit_diagnosed" / "diagnosis.json")
        diagnosis["rungs"].append(REJECTED)
        (folder / "fit_diagnosed" / "diagnosis.json").write_text(json.dumps(diagnosis))
        play("better", following(printed["diagnose"]))
    return Story(folder, printed)


def following(printed: str) -> str:
    """The command that a summary proposes."""
    return next(line for line in printed.splitlines() if line.startswith("next: ")).removeprefix("next: ")


def numbers(values: Iterable[Any]) -> bool:
    """All finite numbers (or null, where a simulation diverged)."""
    return all(
        value is None or (isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value))
        for value in values
    )


def number(value: Any) -> bool:
    return value is not None and numbers([value])


@pytest.mark.parametrize("result", ["fit", "fit_better"])
def test_identify_leaves_its_files(result, story):
    names = {path.name for path in (story.folder / result).iterdir()}
    assert names == {"model.json", "metrics.json", "ladder.json", "report.html", "figures"}


@pytest.mark.parametrize("result", ["fit", "fit_better", "compared", "fit_diagnosed"])
def test_the_report_is_one_file_of_its_own(result, story):
    page = (story.folder / result / "report.html").read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>")
    for outside in ('src="http', "src='http", '<link rel="stylesheet"', "<script src"):
        assert outside not in page


@pytest.mark.parametrize(("result", "effects"), [("fit", []), ("fit_better", ["leakage_internal"])])
def test_model_json_is_as_the_contract_says(result, effects, story):
    model = plain_json(story.folder / result / "model.json")
    assert model["schema"] == 1
    assert model["name"] == result
    assert model["rig"]["cylinder"]["bore"] == "32 mm"
    assert model["friction"] == "lugre"
    assert model["effects"] == effects
    units = {item["name"]: item["unit"] for item in model["parameters"]}
    assert SI_UNITS.items() <= units.items()
    for item in model["parameters"]:
        assert set(item) == {"name", "unit", "value", "std", "lower", "upper", "start", "effect", "run", "verdict"}
        assert all(number(item[key]) for key in ("value", "lower", "upper", "start"))
        assert item["lower"] <= item["value"] <= item["upper"]
        assert item["effect"] in [None, *effects]
        assert item["run"] is None
        assert item["verdict"] in VERDICTS
        assert item["std"] is None if model["fit"]["stage"] == "relaxed" else number(item["std"])
    fit = model["fit"]
    assert set(fit) == {"stage", "converged", "status", "cost_per_sample", "solver", "iterations", "seconds", "lacking"}
    assert fit["stage"] in ("exact", "relaxed")
    assert isinstance(fit["converged"], bool)
    assert isinstance(fit["status"], str)
    assert fit["solver"] == "ipopt"
    assert isinstance(fit["iterations"], int)
    assert number(fit["cost_per_sample"])
    assert number(fit["seconds"])
    roles = {Path(item["file"]).name: item["role"] for item in model["data"]}
    assert roles == {"train_1.csv": "train", "train_2.csv": "train", "held.csv": "hold_out"}
    for item in model["data"]:
        assert set(item) == {"file", "sha256", "samples", "role"}
        assert item["samples"] == 1500
        content = (story.folder / Path(item["file"]).name).read_bytes()
        assert item["sha256"] == hashlib.sha256(content).hexdigest()


def test_a_model_names_its_parent(story):
    parent = hashlib.sha256((story.folder / "fit" / "model.json").read_bytes()).hexdigest()
    assert plain_json(story.folder / "fit" / "model.json")["parent"] is None
    assert plain_json(story.folder / "fit_better" / "model.json")["parent"] == parent


@pytest.mark.parametrize("result", ["fit", "fit_better", "compared"])
def test_metrics_json_is_as_the_contract_says(result, story):
    metrics = plain_json(story.folder / result / "metrics.json")
    assert {"schema", "signals", "hold_out", "where", "defects"} <= set(metrics)
    assert metrics["schema"] == 1
    assert set(metrics["hold_out"]) == (set() if result == "compared" else set(OUTPUTS))
    for role in ("signals", "hold_out"):
        for name, item in metrics[role].items():
            assert {"unit", "rmse", "free_run_rmse", "fit_percent", "noise_floor"} <= set(item)
            assert item["unit"] == OUTPUTS[name]
            assert numbers(value for key, value in item.items() if key != "unit")
            assert number(item["rmse"])
            assert number(item["noise_floor"])
    assert set(metrics["signals"]) == set(OUTPUTS)
    for region in metrics["where"]:
        assert set(region) == {"signal", "share", "samples", "region"}
        assert region["signal"] in OUTPUTS
        assert 0.0 <= region["share"] <= 1.0
        assert 0.0 <= region["samples"] <= 1.0
        assert region["region"]
    for defect in metrics["defects"]:
        assert {"equation", "unit", "rms", "expected_rms"} <= set(defect)
        assert numbers(defect[key] for key in ("rms", "expected_rms"))
    assert metrics["signals"]["x"]["noise_floor"] < 1e-3  # metres
    assert 50.0 < metrics["signals"]["p1"]["noise_floor"] < 5e3  # pascal


def test_diagnosis_json_is_as_the_contract_says(story):
    found = plain_json(story.folder / "fit_diagnosed" / "diagnosis.json")
    assert {"schema", "verdict", "effects", "ranking", "unknown", "next_experiment"} <= set(found)
    assert found["schema"] == 1
    assert found["verdict"] == "effect"
    assert found["effects"] == ["leakage_internal"]
    for item in found["ranking"]:
        keys = {"effect", "equation", "screen_gain", "hold_out_error_ratio", "excess_explained", "p_value"}
        assert set(item) == keys | {"indistinguishable_from"}
        assert item["effect"] in CATALOGUE
        assert item["equation"] == CATALOGUE[item["effect"]].equation
        assert number(item["screen_gain"])
        assert numbers(item[key] for key in keys - {"effect", "equation"})
        assert set(item["indistinguishable_from"]) <= set(CATALOGUE)
    first = found["ranking"][0]
    assert first["effect"] == "leakage_internal"
    assert first["hold_out_error_ratio"] < 1.0
    assert 0.0 < first["excess_explained"] <= 1.0
    if found["unknown"] is not None:
        assert {"equation", "depends_on", "rms", "unit", "formula"} <= set(found["unknown"])
        assert number(found["unknown"]["rms"])
        assert isinstance(found["unknown"]["depends_on"], list)
    assert found["next_experiment"] is None or {"why", "file", "power"} <= set(found["next_experiment"])


def test_the_ladder_is_copied_and_appended_to(story):
    before = plain_json(story.folder / "fit" / "ladder.json")
    after = plain_json(story.folder / "fit_better" / "ladder.json")
    assert [rung["added"] for rung in before] == [None]
    assert after[: len(before)] == before
    assert after[-1]["added"] == "leakage_internal"
    assert after[-1]["accepted"]
    assert after[-1]["effects"] == ["leakage_internal"]
    tried = plain_json(story.folder / "fit_diagnosed" / "diagnosis.json")["rungs"]
    assert after[1:-1] == [rung for rung in tried if not rung["accepted"]]
    assert after[-2] == REJECTED
    for rung in after:
        assert set(rung) == {"effects", "added", "accepted", "train", "hold_out", "noise_floor", "parameters"}
        assert isinstance(rung["accepted"], bool)
        assert isinstance(rung["parameters"], int)
        for role in ("train", "hold_out", "noise_floor"):
            assert set(rung[role]) == set(OUTPUTS)
            assert numbers(rung[role].values())
    for name in OUTPUTS:
        assert after[-1]["hold_out"][name] < before[0]["hold_out"][name]


def test_each_command_says_where_its_report_is_and_what_comes_next(story):
    for label, folder in (
        ("fit", "fit"),
        ("compare", "compared"),
        ("diagnose", "fit_diagnosed"),
        ("better", "fit_better"),
    ):
        lines = story.printed[label].splitlines()
        assert lines[-2] == f"report: {Path(folder) / 'report.html'}"
        assert lines[-1].startswith("next: python -m pneuid.")
    assert "--hold-out held.csv" in following(story.printed["fit"])
    assert "--data train_1.csv train_2.csv --hold-out held.csv" in following(story.printed["compare"])
    assert following(story.printed["better"]).endswith("--out fit_better_diagnosed")


def test_every_command_that_is_proposed_is_understood(story, monkeypatch):
    monkeypatch.chdir(story.folder)
    parsers = {"pneuid.identify": identify.parser, "pneuid.compare": compare.parser, "pneuid.diagnose": diagnose.parser}
    for printed in story.printed.values():
        name, *words = shlex.split(following(printed).removeprefix("python -m "))
        given = parsers[name]().parse_args(words)
        assert not Path(given.out).exists() or given.out in ("fit_diagnosed", "fit_better")
        assert all(Path(path).exists() for path in [*given.data, *given.hold_out])


def test_a_dropped_base_effect_stays_dropped(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG.replace("[conv", 'base_effects = ["gravity"]\n[conv', 1))
    stated = Rig.from_toml(tmp_path / "rig.toml")
    without = nominal_model(stated, {}, RANGES)
    assert without.effects == ()
    parent = api.IdentifiedModel(without)
    assert identify._dropped_before(parent, []) == ["gravity"]
    assert identify._dropped_before(parent, ["gravity"]) == []
    assert identify._dropped_before(None, []) == []
