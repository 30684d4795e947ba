"""The documentation holds what it says: links, pictures, rig files, Python, commands, generated pages, and the site itself."""

from __future__ import annotations

import ast
import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from pneuid.api import plant_of
from pneuid.effects._spline import SIGNALS_OF
from pneuid.rig import Rig

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", *sorted(DOCS.rglob("*.md")))
SAMPLES = 2000
"""Rows of each run that the README's example is given: 2 s of 6."""

FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)")
COMMAND = re.compile(r"python -m ([\w.]+)")
OUTSIDE = {"venv", "pip", "http.server", "pytest"}
"""Modules of ``python -m`` that are not the project's."""


@dataclass(frozen=True)
class Block:
    """A fenced block: where it stands, its language and text."""

    where: str
    language: str
    text: str


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks_of(text: str, where: str) -> list[Block]:
    return [Block(f"{where}#{k}", language, body) for k, (language, body) in enumerate(FENCE.findall(text), 1)]


def prose_of(text: str) -> str:
    """The page without fenced and inline code, where a bracket is no link."""
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", text))


def anchors_of(page: Path) -> set[str]:
    """Anchors of a page's headings, as the site makes them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE):
        plain = re.sub(r"[^\w\s-]", "", re.sub(r"[`*]", "", heading).lower())
        found.add(re.sub(r"[\s-]+", "-", plain.strip()))
    return found


def link_faults(text: str, page: Path) -> list[str]:
    """Relative links and pictures of ``text`` that lead nowhere, or out of the site."""
    faults = []
    for target in LINK.findall(prose_of(text)):
        if target.startswith(("https://", "http://", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        found = (page.parent / path).resolve() if path else page
        if not found.exists():
            faults.append(f"{named(page)}: {target} does not exist")
        elif page.is_relative_to(DOCS) and not found.is_relative_to(DOCS):
            faults.append(f"{named(page)}: {target} leads out of the site")
        elif anchor and found.suffix == ".md" and anchor not in anchors_of(found):
            faults.append(f"{named(page)}: {target} names no heading")
    return faults


def rig_blocks() -> list[Block]:
    return [block for block in every_block("toml") if re.search(r"^kind\s*=", block.text, re.MULTILINE)]


def every_block(language: str) -> list[Block]:
    found = [block for page in PAGES for block in blocks_of(page.read_text(encoding="utf-8"), named(page))]
    return [block for block in found if block.language == language]


def example() -> Block:
    """The README's example."""
    return next(block for block in every_block("python") if block.where.startswith("README.md"))


def script(name: str) -> ModuleType:
    """A script of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def loaded_from_elsewhere(html: str) -> list[str]:
    """Addresses on other hosts that a browser fetches when it opens the page."""
    return re.findall(r"<(?:script|img|iframe|link)\b[^>]*?(?:src|href)=[\"']?(https?://[^\"'\s>]+)", html)


# --- the pages ---


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_and_pictures_exist(page):
    assert link_faults(page.read_text(encoding="utf-8"), page) == []


@pytest.mark.parametrize("block", rig_blocks(), ids=lambda block: block.where)
def test_rig_files_are_rigs(block):
    assert Rig.from_dict(tomllib.loads(block.text), block.where).kind in ("servo", "bench")


@pytest.mark.parametrize("block", every_block("toml"), ids=lambda block: block.where)
def test_toml_is_toml(block):
    assert tomllib.loads(block.text)


@pytest.mark.parametrize("block", every_block("python"), ids=lambda block: block.where)
def test_python_compiles_and_imports_what_exists(block):
    tree = ast.parse(block.text)
    compile(tree, block.where, "exec")
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = importlib.import_module(node.module)
            for name in (item.name for item in node.names):
                inside = hasattr(module, name) or importlib.util.find_spec(f"{node.module}.{name}") is not None
                assert inside, f"{node.module} has no {name}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_exist(page):
    for name in set(COMMAND.findall(page.read_text(encoding="utf-8"))) - OUTSIDE - {"NAME"}:
        spec = importlib.util.find_spec(name)
        assert spec is not None, f"{named(page)}: no module {name}"
        if spec.submodule_search_locations is not None:
            assert importlib.util.find_spec(f"{name}.__main__") is not None, f"{named(page)}: {name} is no command"


def test_every_command_is_documented():
    files = [path for room in ("pneuid", "controllers") for path in (ROOT / room).rglob("*.py")]
    starts = [path for path in files if "\n    run_command(main)\n" in path.read_text(encoding="utf-8")]
    commands = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__") for path in starts}
    assert commands == set(script("make_reference").COMMANDS)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in sorted(commands) if f"| `{name}" not in readme] == []


def test_no_page_loads_anything_from_elsewhere():
    assert "font: false" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert re.findall(r"!\[[^\]]*\]\(https?:|<(?:script|link|img|iframe)\b", prose_of(text)) == [], named(page)


def test_generated_pages_are_current():
    reference, catalogue = script("make_reference"), script("make_catalogue")
    words = "run: python docs/make_reference.py; python docs/make_catalogue.py"
    assert (DOCS / "reference" / "api.md").read_text(encoding="utf-8") == reference.api_page(), words
    assert (DOCS / "catalogue.md").read_text(encoding="utf-8") == catalogue.page(), words
    commands = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    for name in reference.COMMANDS:
        # argparse breaks lines differently from version to version
        assert reference.help_of(name).split() == help_shown(commands, name).split(), f"{name}: {words}"


def help_shown(page: str, name: str) -> str:
    after = page.partition(f"## `python -m {name}`\n")[2]
    return FENCE.findall(after)[0][1]


# --- the rules themselves: each must catch what it is for ---


@pytest.mark.parametrize(
    "text", ["[a](nowhere.md)", "![a](figures/nowhere.svg)", "[a](../README.md)", "[a](tutorial.md#no-such-heading)"]
)
def test_a_wrong_link_is_caught(text):
    assert len(link_faults(text, DOCS / "index.md")) == 1


def test_a_right_link_passes():
    assert link_faults("[a](tutorial.md) [b](https://example.org) `[c](no.md)`", DOCS / "index.md") == []


def test_what_a_page_fetches_is_seen():
    html = (
        '<script src=https://a.org/b.js></script><link rel="x" href="https://c.org/d.css"><a href="https://e.org">e</a>'
    )
    assert loaded_from_elsewhere(html) == ["https://a.org/b.js", "https://c.org/d.css"]


# --- the site ---


def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    for page in (tmp_path / "site").rglob("*.html"):
        assert loaded_from_elsewhere(page.read_text(encoding="utf-8")) == [], page.name


# --- the examples ---


def test_the_effect_of_ones_own_joins_the_plant(tmp_path):
    block = next(block for block in every_block("python") if block.where.startswith("docs/own_effect.md"))
    (tmp_path / "drag.py").write_text(block.text, encoding="utf-8")
    rig = Rig.from_toml(ROOT / "scenarios" / "demo" / "rig.toml")
    plant = plant_of(rig, add=["drag_of_chain"], effect_files=[tmp_path / "drag.py"])
    assert "c_chain" in plant.parameter_names


def test_own_effect_lists_the_signals_of_every_equation():
    lines = (DOCS / "own_effect.md").read_text("utf-8").splitlines()
    rows = [line.split("|")[1:3] for line in lines if line.startswith("| `")]
    listed = {
        name: re.findall(r"`([^`]+)`", signals) for names, signals in rows for name in re.findall(r"`(\w+)`", names)
    }
    for equation, signals in SIGNALS_OF.items():
        other = {"flow_1": ["psup-p2"], "flow_2": ["psup-p1"]}.get(equation, [])
        assert sorted(listed[equation]) == sorted([*signals, *other]), equation


@pytest.mark.slow
def test_the_examples_run(tmp_path, monkeypatch):
    folder = tmp_path / "scenarios" / "demo"
    shutil.copytree(ROOT / "scenarios" / "demo", folder)
    for path in folder.glob("*.csv"):
        path.write_text("".join(path.read_text(encoding="utf-8").splitlines(keepends=True)[: SAMPLES + 1]), "utf-8")
    monkeypatch.chdir(tmp_path)
    block, names = example(), {}
    exec(compile(block.text, block.where, "exec"), names)  # noqa: S102 - the README's own text
    assert names["diagnosis"].effects[0] == "friction_pressure"
    errors = [names[name].weighted_error() for name in ("comparison", "after")]
    assert errors[1] < 0.5 * errors[0]
    (tmp_path / "monday").mkdir()
    (tmp_path / "better.json").rename(tmp_path / "monday" / "model.json")
    for page in ("docs/how_to/compensator.md", "docs/control.md"):
        shown = next(block for block in every_block("python") if block.where.startswith(page))
        exec(compile(shown.text, shown.where, "exec"), {})  # noqa: S102 - the page's own text
