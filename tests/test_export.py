"""The exported C: that it compiles at its strictest, commands what Python commands, and solves what a reference solves."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import helpers
import numpy as np
import pytest
from reference_qp import reference
from test_controllers_qp import problem

from controllers import qp
from controllers.base import Measurement
from controllers.control_model import ControlModel
from controllers.export import __main__ as command
from controllers.export.bundle import c_bundle
from controllers.export.emit import definition, number
from controllers.export.library import STRICT, ExportedNmpc, ExportedServo, build_library
from controllers.export.pieces import tuned
from controllers.export.recorded import hard_track, record
from controllers.export.sources import ALL, NMPC, SERVO, template
from controllers.tuning import Design
from pneuid import api
from pneuid.compiled import compiler
from pneuid.errors import ComputationError, UserError
from pneuid.model import nominal_model
from pneuid.virtual_rig import ServoPlant, TruthServo
from pneuid.virtual_rig.friction import FRICTION_2011

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
EFFECTS = ("friction_pressure", "valve_dead_zone", "supply_droop")
SUPPLY = 6e5
N, NX = 8, 4
"""Sizes of the random programs."""


@pytest.fixture(scope="module")
def found():
    """Both controllers for a model with pressure laws, a dead zone and an effect that has a state of its own."""
    seal = FRICTION_2011
    values = helpers.TRUTH | {name: getattr(seal, name) for name in ("Fc", "Fs", "vs", "sigma2")}
    laws = ("Fc_ps", "Fc_dp", "Fs_ps", "Fs_dp", "vs_ps", "vs_dp", "sigma2_ps", "sigma2_dp")
    values |= {f"k{i + 1}": getattr(seal, name) for i, name in enumerate(laws)}
    values |= {"dead_zone": 0.04, "r_supply": 0.2, "tau_supply": 0.03}
    model = nominal_model(helpers.rig(), values, helpers.RANGES, EFFECTS)
    return tuned(ControlModel(model.plant, model.theta()), Design(SUPPLY), refined=False)


@pytest.fixture(scope="module")
def folder(found, tmp_path_factory):
    """The folder of an export; compiled by ``library``, not by its own check."""
    where = tmp_path_factory.mktemp("export")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("controllers.export.bundle.compiler", lambda: None)
        for name, content in c_bundle(found, "a */ name", lambda _: None).items():
            (where / name).write_bytes(content)
    return where


@pytest.fixture(scope="module")
def library(folder):
    """Compiled once, to stop at undefined behaviour where the compiler can."""
    try:
        return build_library(
            folder, folder / "tested.so", flags=("-O0", "-fsanitize=undefined", "-fno-sanitize-recover=all")
        )
    except ComputationError:
        return build_library(folder, folder / "tested.so", flags=("-O0",))


@pytest.fixture(scope="module")
def loops(found):
    """Both controllers in closed loop on the virtual rig, which shares nothing with the model, noise included; each with
    the controller's memory at the end."""
    recorded = {}
    for controller in (found.servo, found.nmpc):
        lasts = 0.15 if controller is found.nmpc else 0.0
        track = hard_track(found.model, controller.sample_time, 0.6, controller.preview, lasts)
        run = record(controller, ServoPlant(TruthServo()), track, SUPPLY, seed=3)
        recorded[controller.name] = (run, controller.memory)
    return recorded


# --- equality ---


@needs_compiler
@pytest.mark.parametrize(("name", "kind"), [("servo", ExportedServo), ("nmpc", ExportedNmpc)])
def test_c_commands_what_python_commands(name, kind, loops, library):
    run, memory = loops[name]
    assert np.ptp(run.u) > 15.0  # the valve is at its limits
    exported = kind(library)
    np.testing.assert_allclose(exported.play(run.seen, run.target), run.u, rtol=0.0, atol=1e-9)
    # the inverse valve rounds commands to 0.08 mV; estimates are not rounded, so compare these too
    np.testing.assert_allclose(exported.memory(memory.size), memory, rtol=1e-9, atol=1e-12)
    # nothing is kept outside the structure: a second one, used between, does not disturb the first
    other = kind(library)
    other.play(run.seen[:20] * [1.0, 0.9, 0.9, 1.0], run.target)
    np.testing.assert_array_equal(exported.play(run.seen, run.target), exported.play(run.seen, run.target))


@needs_compiler
@pytest.mark.parametrize(("psup", "share"), [(0.6 * SUPPLY, 0.6), (1.3 * SUPPLY, 1.0)])
def test_a_change_of_command_costs_less_where_the_supply_moves_less(psup, share, found, loops, library):
    run = loops["nmpc"][0]
    seen = run.seen[:40].copy()
    seen[:, 3] = psup
    exported, controller = ExportedNmpc(library), found.nmpc
    controller.reset(Measurement(*seen[0]), run.target[: controller.preview])
    expected = [controller.step(Measurement(*row), run.target[k : k + controller.preview]) for k, row in enumerate(seen)]
    assert pytest.approx(share**2 * controller.change_weight, rel=1e-12) == controller.program.R
    np.testing.assert_allclose(exported.play(seen, run.target), expected, rtol=0.0, atol=1e-9)


@needs_compiler
def test_nonsense_is_handled_as_in_python(found, loops, library):
    run = loops["servo"][0]
    seen = run.seen[:60].copy()
    seen[10, 0], seen[20, 1], seen[30, 3] = np.nan, np.inf, -np.inf
    exported, controller = ExportedServo(library), found.servo
    controller.reset(Measurement(*seen[0]), run.target[:2])
    expected = [controller.step(Measurement(*row), run.target[k : k + 2]) for k, row in enumerate(seen)]
    np.testing.assert_allclose(exported.play(seen, run.target), expected, atol=1e-9)
    with pytest.raises(ValueError, match="finite"):
        exported.play(seen[10:], run.target)


# --- the quadratic program ---


class Program(ctypes.Structure):
    """``pneuid_qp`` up to the solution, for the sizes of the random programs."""

    _fields_ = [
        ("A", ctypes.c_double * (N * NX * NX)), ("B", ctypes.c_double * (N * NX)), ("c", ctypes.c_double * (N * NX)),
        ("Q", ctypes.c_double * ((N + 1) * NX)), ("q", ctypes.c_double * ((N + 1) * NX)), ("R", ctypes.c_double),
        ("lower", ctypes.c_double * ((N + 1) * NX)), ("upper", ctypes.c_double * ((N + 1) * NX)),
        ("give", ctypes.c_double * NX), ("x", ctypes.c_double * ((N + 1) * NX)), ("u", ctypes.c_double * N),
        ("work", ctypes.c_double * 4096),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    """``pneuid_qp_solve`` compiled for the random programs."""
    where = tmp_path_factory.mktemp("qp")
    (where / "pneuid_model.h").write_text(f"#define PNEUID_STAGES {N}\n#define PNEUID_NX {NX}\n")
    for name in ("pneuid_qp.c", "pneuid_qp.h", "pneuid_math.h"):
        (where / name).write_text(template(name))
    built = ctypes.CDLL(str(build_library(where, where / "qp.so", ("pneuid_qp.c",))))
    built.pneuid_qp_solve.argtypes = [ctypes.c_void_p, ctypes.c_double]

    def solve(program):
        block = Program()
        for key in ("A", "B", "c", "Q", "q", "lower", "upper", "give"):
            values = np.ascontiguousarray(getattr(program, key), dtype=float).ravel()
            getattr(block, key)[:] = values.tolist()
        block.R = program.R
        block.x[:NX] = program.x0.tolist()
        solved = built.pneuid_qp_solve(ctypes.byref(block), 1e-10)
        return np.array(block.u), bool(solved)

    return solve


@needs_compiler
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("bound", [0.1, 0.5, 50.0])
def test_random_programs_are_solved_as_in_python_and_as_by_a_reference(bound, soft, solver):
    for seed in range(2):
        program = qp.Program(*problem(seed, bound, soft))
        u, solved = solver(program)
        python = qp.solve(*program, 1e-10)
        assert solved == python.solved
        np.testing.assert_allclose(u, python.u, atol=1e-9)
        np.testing.assert_allclose(u, reference(program), atol=1e-6)


@needs_compiler
def test_recorded_programs_with_active_bounds_agree_with_a_reference(found, loops):
    """Those of the closed loop around the fast move, where command and pressures are at their limits."""
    controller, run = found.nmpc, loops["nmpc"][0]
    controller.reset(Measurement(*run.seen[0]), run.target[: controller.preview])
    tried = 0
    for k, row in enumerate(run.seen):
        controller.step(Measurement(*row), run.target[k : k + controller.preview])
        if controller.iterations > 0 and tried < 2 and k % 7 == 0:
            program = controller.program
            np.testing.assert_allclose(qp.solve(*program, 1e-11).u, reference(program), atol=1e-6)
            tried += 1
    assert tried == 2


# --- the code ---


def test_numbers_read_back_exactly():
    for value in (0.1, -3.0, 1e-300, 1.2e-8, np.nextafter(1.0, 2.0)):
        assert float(number(value)) == value
    assert number(-np.inf) == "-INFINITY"


def test_an_operation_without_a_c_form_is_named():
    a = ca.SX.sym("a")
    with pytest.raises(ComputationError, match="no C form"):
        definition(ca.Function("odd", [a], [ca.erf(a)]), "odd", ("a",), ("r",))


def test_the_name_of_a_model_cannot_end_a_comment(folder):
    first = (folder / "pneuid_model.h").read_text().splitlines()[0]
    assert first.count("*/") == 1
    assert first.endswith("*/")


def test_the_product_uses_neither_heap_nor_static_memory(folder):
    for name in ALL:
        text = (folder / name).read_text()
        assert not any(word in text for word in ("malloc", "calloc", "free(", "printf", "fopen"))
        assert not any(line.startswith("static") and "=" in line and "const" not in line for line in text.splitlines())


@pytest.fixture(scope="module")
def harness(folder, library):
    """The user's own check, on the library compiled already."""
    line = [compiler()[0], *STRICT, "-O1", "main.c", str(library), "-o", "harness", "-lm", f"-Wl,-rpath,{folder}"]
    subprocess.run(line, cwd=folder, check=True)
    return folder / "harness"


@needs_compiler
def test_the_harness_plays_the_recordings_back(folder, harness):
    for kind in ("servo", "nmpc"):
        done = subprocess.run(
            [harness, kind, f"{kind}.csv", "out.csv"], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert (folder / "out.csv").read_text().startswith("t [s],u [V]\n0,")
    # a wrong command is found out
    text = (folder / "servo.csv").read_text().splitlines()
    cells = text[20].split(",")
    text[20] = ",".join([*cells[:-1], repr(float(cells[-1]) + 1e-6)])
    (folder / "wrong.csv").write_text("\n".join(text) + "\n")
    assert subprocess.run([harness, "servo", "wrong.csv"], cwd=folder, capture_output=True, check=False).returncode == 1
    assert (
        subprocess.run([harness, "servo", "absent.csv"], cwd=folder, capture_output=True, check=False).returncode == 2
    )


@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no valgrind")
def test_valgrind_finds_nothing(folder, harness):
    lines = (folder / "nmpc.csv").read_text().splitlines()[250:310]
    # the rows beyond the twelfth are the preview
    lines[12:] = [",".join([line.split(",")[0], *["nan"] * 4, *line.split(",")[5:]]) for line in lines[12:]]
    (folder / "short.csv").write_text("\n".join(["header", *lines]) + "\n")
    for kind in ("servo", "nmpc"):
        line = ["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", harness, kind, "short.csv"]
        # started in the middle of a recording it commands something else, which is no fault
        assert subprocess.run(line, cwd=folder, capture_output=True, check=False).returncode in (0, 1)


@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="no ARM compiler")
def test_a_cortex_m7_takes_it(folder):
    flags = ["-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-O0", "-c"]
    for name in dict.fromkeys((*SERVO, *NMPC)):
        line = ["arm-none-eabi-gcc", *STRICT, *flags, name, "-o", f"{name}.arm"]
        subprocess.run(line, cwd=folder, check=True, capture_output=True)


# --- the command ---


def test_slips_are_one_line(tmp_path):
    with pytest.raises(UserError, match="--to"):
        command.main(["m.json", "--to", "matlab"])
    with pytest.raises(UserError, match="--alpha 2"):
        command.main(["m.json", "--to", "c", "--alpha", "2"])
    with pytest.raises(UserError, match="cannot read the model"):
        command.main([str(tmp_path / "absent.json"), "--to", "c", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_a_bench_model_is_refused_and_results_are_not_overwritten(tmp_path):
    bench = nominal_model(helpers.rig("bench"), {}, helpers.RANGES)
    bench.save(tmp_path / "bench.json")
    with pytest.raises(UserError, match="model of a servo rig"):
        command.main([str(tmp_path / "bench.json"), "--to", "c", "--out", str(tmp_path / "out")])
    servo = nominal_model(helpers.rig(), helpers.TRUTH, helpers.RANGES)
    servo.save(tmp_path / "servo.json")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(UserError, match="holds results already"):
        command.main([str(tmp_path / "servo.json"), "--to", "c", "--out", str(tmp_path / "full")])


def test_a_failed_export_leaves_nothing(tmp_path, monkeypatch, found):
    nominal_model(helpers.rig(), helpers.TRUTH, helpers.RANGES).save(tmp_path / "servo.json")
    monkeypatch.setattr(command, "tuned", lambda *_: found)
    monkeypatch.setattr("controllers.export.bundle.compiler", lambda: None)
    with pytest.raises(UserError, match="no C compiler"):
        command.main([str(tmp_path / "servo.json"), "--to", "fmu", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
    # C needs no compiler, and says that it was not checked
    command.main([str(tmp_path / "servo.json"), "--to", "c", "--out", str(tmp_path / "out")])
    assert {"Makefile", "README.md", "main.c", "nmpc.csv", "pneuid_servo.c"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }
    assert "@" not in (tmp_path / "out" / "README.md").read_text()


def test_help_shows_an_example():
    assert "--to c --out" in command.parser().format_help()


def test_a_model_with_an_effect_of_ones_own_is_exported_where_its_file_is_named(tmp_path, monkeypatch):
    file = tmp_path / "drag.py"
    shown = (Path(__file__).parents[1] / "docs" / "own_effect.md").read_text(encoding="utf-8")
    file.write_text(shown.split("```python\n")[1].split("```")[0], encoding="utf-8")
    api.fit(helpers.rig(), helpers.train_runs()[:1], add=["drag_of_chain"], effect_files=[file]).save(tmp_path / "m.json")
    monkeypatch.setattr(command, "tuned", lambda model, design: tuned(model, design, refined=False))
    asked = [str(tmp_path / "m.json"), "--to", "c", "--out", str(tmp_path / "out")]
    with pytest.raises(UserError, match=r"--effect-file drag\.py"):
        command.main(asked)
    command.main([*asked, "--effect-file", str(file)])
    assert (tmp_path / "out" / "pneuid_nmpc.c").exists()
