"""The house (docs: DESIGN): which room a module is in, what it may import and what it may do.

Read from the source, so that an import inside a function counts too.
"""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

ROOMS: tuple[tuple[str, ...], ...] = (
    ("errors", "resources"),
    ("cores",),  # how many may be used
    ("ahead", "pool", "store"),  # where tasks run and what is known already
    ("signals", "units"),
    ("formats", "rig", "columns", "recording"),
    ("physics",),
    ("plausibility",),
    ("effect", "effects"),
    ("plant", "own_plant"),
    ("step", "compiled", "vectors", "lanes", "mapped", "interval"),
    ("simulate",),
    ("estimation", "zero_reading"),
    ("model",),
    ("criticism",),
    ("api",),
    ("",),  # pneuid/__init__.py, the front door
    ("report",),
    ("story", "terminal"),  # what commands share: the demonstration, the options and the progress bar
    ("workbench",),
    ("identify", "compare", "diagnose", "bench", "fleet"),
)
"""Rooms of ``pneuid`` from top to bottom; a module imports its own room and rooms above it only."""

CHAPTERS = ("prediction", "comparison", "screening", "refitting", "unknown", "decision", "next_experiment")
"""Chapters of ``pneuid.criticism`` in the order of reading; a module imports its own and earlier ones only."""

FRONT = next(rank for rank, names in enumerate(ROOMS) if "" in names)
COMMANDS = len(ROOMS) - 1
VIRTUAL_RIG_MAY_IMPORT = {"errors", "signals", "units", "virtual_rig"}
VIRTUAL_RIG_USERS = set(ROOMS[COMMANDS]) | {"story", "workbench"}

MAY_TOUCH_FILES = (
    "formats", "rig", "recording", "zero_reading", "model", "compiled", "virtual_rig.files", "report", "resources", "story",
    "store",
)  # fmt: skip
FILE_FUNCTIONS = {"print", "open", "input", "exec", "eval"}
FILE_METHODS = {
    "read_text", "read_bytes", "write_text", "write_bytes", "unlink", "mkdir", "rmdir", "touch", "savefig",
    "read_csv", "read_table", "to_csv", "loadtxt", "savetxt", "genfromtxt", "fromfile", "tofile", "savez", "loadmat",
}  # fmt: skip
FILE_CALLS = {"np.load", "np.save", "numpy.load", "numpy.save", "json.load", "json.dump", "Path.open", "io.open"}
TERMINAL_MODULES = {"argparse", "matplotlib", "rich"}
FIGURE_MODULES = ("pneuid.report", "controllers.figures", "controllers.export.figures")


# --- reading the source ---


def modules(package: str) -> dict[str, Path]:
    """Dotted name -> file of every module under ``package``."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


PNEUID, CONTROLLERS, SCENARIOS = modules("pneuid"), modules("controllers"), modules("scenarios")
KNOWN = PNEUID.keys() | CONTROLLERS.keys() | SCENARIOS.keys()


def is_module(name: str) -> bool:
    """True for a module that exists and for one that a room or the language names."""
    package, _, last = name.rpartition(".")
    return name in KNOWN or last == "__main__" or (package == "pneuid" and any(last in room for room in ROOMS))


def imports(name: str, source: str, is_package: bool = False) -> Iterator[str]:
    """Dotted names of all that the module imports, wherever the statement stands; ``from a import b`` is ``a.b`` if
    that is a module."""
    package = name if is_package else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                yield f"{base}.{alias.name}" if is_module(f"{base}.{alias.name}") else base
        elif isinstance(node, ast.Call) and dotted(node.func).split(".")[-1] in ("import_module", "__import__"):
            first = node.args[0] if node.args else None
            if isinstance(first, ast.Constant) and isinstance(first.value, str):
                yield first.value


def dotted(node: ast.AST) -> str:
    """``a.b.c`` of a name or an attribute chain; the last attribute alone where it hangs on something else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = dotted(node.value)
        return f"{before}.{node.attr}" if before else node.attr
    return ""


def within(name: str, parents: tuple[str, ...]) -> bool:
    return any(name == parent or name.startswith(parent + ".") for parent in parents)


# --- the rules ---


def room_of(name: str) -> int | None:
    """Rank of a ``pneuid`` module, None for a module that no room names."""
    parts = name.split(".")[1:] or [""]
    if parts[-1] == "__main__":
        return COMMANDS
    return next((rank for rank, names in enumerate(ROOMS) if parts[0] in names), None)


def is_command(name: str) -> bool:
    return room_of(name) == COMMANDS


def direction_faults(name: str, source: str, is_package: bool = False) -> list[str]:
    """What ``name`` (a module of ``pneuid`` or ``controllers``) imports against the direction."""
    faults = []
    targets = [target for target in imports(name, source, is_package) if within(target, ("pneuid", "controllers"))]
    if within(name, ("controllers",)):
        return [f"{name} imports the command {t}" for t in targets if within(t, ("pneuid",)) and is_command(t)]
    in_virtual_rig = within(name, ("pneuid.virtual_rig",))
    own = room_of(name)
    if own is None and not in_virtual_rig:
        return [f"{name} is in no room; name it in ROOMS of {Path(__file__).name}"]
    for target in targets:
        head = [*target.split("."), ""][1]
        if within(target, ("controllers",)):
            faults.append(f"{name} imports {target}: pneuid never imports controllers")
        elif in_virtual_rig:
            if head not in VIRTUAL_RIG_MAY_IMPORT:
                faults.append(f"{name} imports {target}: the virtual rig shares nothing with the model")
        elif head == "virtual_rig":
            if own != COMMANDS and name.split(".")[1] not in VIRTUAL_RIG_USERS:
                faults.append(f"{name} imports {target}: only commands and the workbench use the virtual rig")
        elif (rank := room_of(target)) is None or own is None or rank > own:
            faults.append(f"{name} imports {target}, which stands below it")
    return faults


def chapter_faults(name: str, source: str, is_package: bool = False) -> list[str]:
    """What a module of ``pneuid.criticism`` imports of a later chapter."""
    own = CHAPTERS.index(name.split(".")[2])
    heads = [(target, [*target.split("."), "", ""][2]) for target in imports(name, source, is_package)]
    return [
        f"{name} imports {target}, of a later chapter"
        for target, head in heads
        if within(target, ("pneuid.criticism",)) and head in CHAPTERS and CHAPTERS.index(head) > own
    ]


def purity_faults(name: str, source: str, is_package: bool = False) -> list[str]:
    """What ``name`` does that belongs to another room: printing, plotting, arguments, files."""
    faults = []
    command = is_command(name) or within(name, ("pneuid.terminal",))
    for target in imports(name, source, is_package):
        top = target.split(".")[0]
        allowed = within(name, FIGURE_MODULES) if top == "matplotlib" else command
        if top in TERMINAL_MODULES and not allowed:
            faults.append(f"{name} imports {target}")
    if command or within(name, tuple(f"pneuid.{part}" for part in (*MAY_TOUCH_FILES, "workbench"))):
        return faults
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            last = called.split(".")[-1]
            if called in FILE_FUNCTIONS | FILE_CALLS or last in FILE_METHODS:
                faults.append(f"{name}:{node.lineno} calls {called}")
    return faults


# --- the house as it stands ---


def _checked(name: str) -> tuple[str, str, bool]:
    path = (PNEUID | CONTROLLERS)[name]
    return name, path.read_text(encoding="utf-8"), path.name == "__init__.py"


@pytest.mark.parametrize("name", [*PNEUID, *CONTROLLERS])
def test_imports_point_up(name):
    assert direction_faults(*_checked(name)) == []


@pytest.mark.parametrize("name", [name for name in PNEUID if name.count(".") > 2 and within(name, ("pneuid.criticism",))])
def test_chapters_build_on_earlier_ones(name):
    assert chapter_faults(*_checked(name)) == []


@pytest.mark.parametrize("name", PNEUID)
def test_only_the_edge_prints_plots_and_opens_files(name):
    assert purity_faults(*_checked(name)) == []


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controllers_draw_in_one_file(name):
    drawn = [t for t in imports(*_checked(name)) if t.split(".")[0] == "matplotlib"]
    assert drawn == [] or within(name, FIGURE_MODULES)


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios_import_nothing(name):
    source = SCENARIOS[name].read_text(encoding="utf-8")
    assert list(imports(name, source)) == []


# --- the rules themselves: each must catch what it is for ---


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("pneuid.plant", "from pneuid.estimation import interval"),
        ("pneuid.plant", "from pneuid import step"),
        ("pneuid.plant", "import pneuid.model as m"),
        ("pneuid.plant", "def late():\n    from pneuid.model import Model"),
        ("pneuid.plant", "import importlib\nimportlib.import_module('pneuid.model')"),
        ("pneuid.plant", "from pneuid import Rig"),
        ("pneuid.estimation.solver", "from ..criticism import screening"),
        ("pneuid.simulate", "import controllers.base"),
        ("pneuid.simulate", "from controllers import base"),
        ("pneuid.virtual_rig.kernel", "from pneuid.physics import gas"),
        ("pneuid.estimation.solver", "from pneuid.virtual_rig import kernel"),
        ("pneuid.estimation.solver", "from pneuid import virtual_rig"),
        ("pneuid.somewhere", "import numpy"),
        ("controllers.study", "from pneuid import identify"),
        ("controllers.study", "from pneuid.effects import __main__"),
    ],
)
def test_a_wrong_import_is_caught(name, source):
    assert direction_faults(name, source)


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("pneuid.plant", "from pneuid.physics import chamber, friction\nfrom pneuid.effect import Effect"),
        ("pneuid.recording", "from pneuid.rig import Rig"),
        ("pneuid.identify", "import pneuid\nfrom pneuid.report import html\nfrom pneuid.virtual_rig import recording"),
        ("pneuid.virtual_rig.truth", "from pneuid.virtual_rig import friction\nfrom pneuid.units import quantity"),
        ("controllers.study", "import pneuid\nfrom pneuid import step\nfrom pneuid.virtual_rig import recording"),
    ],
)
def test_a_right_import_passes(name, source):
    assert direction_faults(name, source) == []


def test_a_chapter_that_looks_ahead_is_caught():
    ahead = "from pneuid.criticism.decision.walk import Walk"
    assert chapter_faults("pneuid.criticism.refitting.refits", ahead)
    assert chapter_faults("pneuid.criticism.decision.rest", ahead) == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("pneuid.plant", "print('here')"),
        ("pneuid.plant", "def f(path):\n    with open(path) as file:\n        return file.read()"),
        ("pneuid.plant", "from pathlib import Path\nPath('a').read_text()"),
        ("pneuid.plant", "def f(path):\n    path.write_bytes(b'')"),
        ("pneuid.estimation.fit", "import numpy as np\nnp.save('a.npy', 1)"),
        ("pneuid.estimation.fit", "def f():\n    import rich.console"),
        ("pneuid.criticism.comparison.ladder", "from matplotlib import pyplot"),
        ("pneuid.identify", "import matplotlib.pyplot as plt"),
        ("pneuid.model", "import argparse"),
        ("pneuid.virtual_rig.kernel", "print(1)"),
    ],
)
def test_a_wrong_deed_is_caught(name, source):
    assert purity_faults(name, source)


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("pneuid.identify", "import argparse, rich\nprint('here')"),
        ("pneuid.effects.__main__", "from rich.table import Table"),
        ("pneuid.report.figures", "import matplotlib.pyplot as plt"),
        ("pneuid.rig", "from pathlib import Path\nPath('a').read_bytes()"),
        ("pneuid.plant", "opening = valve.open_fraction(u)\nname = 'print(1)'  # print(1)"),
    ],
)
def test_a_right_deed_passes(name, source):
    assert purity_faults(name, source) == []


# --- the catalogue and the front door ---


def test_every_effect_file_is_registered():
    from pneuid.effects import CATALOGUE

    registered = {type(effect).__module__ for effect in CATALOGUE.values()}
    files = {name for name in PNEUID if name.startswith("pneuid.effects.") and not name.split(".")[-1].startswith("_")}
    assert files - registered == set(), "a file in pneuid/effects without a line in the registry"


def test_effects_are_registered_by_their_own_name():
    from pneuid.effects import CATALOGUE

    assert {name: effect.name for name, effect in CATALOGUE.items()} == {name: name for name in CATALOGUE}


def test_importing_pneuid_imports_no_command_and_no_matplotlib():
    commands = sorted(name for name in PNEUID if is_command(name))
    code = (
        "import sys, pneuid\n"
        "for name in ('pneuid.rig', 'pneuid.recording', 'pneuid.plant'): __import__(name)\n"
        f"print([m for m in {[*commands, 'matplotlib', 'controllers']!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_no_module_is_named_like_an_exported_function():
    for package in (name for name, path in PNEUID.items() if path.name == "__init__.py"):
        exported = set(getattr(importlib.import_module(package), "__all__", ()))
        inside = {name.removeprefix(package + ".") for name in PNEUID if name.startswith(package + ".")}
        assert exported & inside == set(), f"{package} exports a name that is a module too"


def test_shipped_data_are_found():
    from importlib.resources import files

    from pneuid.errors import UserError
    from pneuid.resources import scenario_path

    rig = scenario_path("real/emps/rig.toml")
    assert rig.read_text(encoding="utf-8") == (files("scenarios") / "real" / "emps" / "rig.toml").read_text("utf-8")
    for absent in ("nowhere", "../pyproject.toml"):
        with pytest.raises(UserError, match="not among the shipped ones"):
            scenario_path(absent)
