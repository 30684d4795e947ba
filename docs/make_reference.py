"""Writes docs/reference/api.md from docstrings and commands.md from ``--help``: ``python docs/make_reference.py``."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pneuid
from pneuid.criticism.comparison.comparison import Comparison, SignalError
from pneuid.criticism.decision.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.effect import Effect, Parameter, Scope, State
from pneuid.model import Estimate, Model

FOLDER = Path(__file__).with_name("reference")

SECTIONS: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("From recordings to a model", (pneuid.Rig, pneuid.Recording, pneuid.ZeroReading, pneuid.fit, pneuid.load,
                                    pneuid.IdentifiedModel)),
    ("What a model holds", (Model, Estimate)),
    ("What a comparison says", (Comparison, SignalError)),
    ("What a diagnosis says", (Diagnosis, Candidate, Unknown)),
    ("An effect", (Effect, Parameter, State, Scope)),
    ("Errors", (pneuid.UserError, pneuid.ComputationError)),
)
"""What a notebook user and the author of an effect meet."""

COMMANDS = (
    "pneuid.identify", "pneuid.compare", "pneuid.diagnose", "pneuid.effects", "pneuid.bench", "pneuid.workbench",
    "controllers.study", "controllers.export",
)  # fmt: skip

_API_HEAD = """# Python

Written by `python docs/make_reference.py` from the docstrings; do not edit. Everything is SI inside, pressures absolute;
arrays are numpy's, shapes in brackets.
"""

_COMMANDS_HEAD = """# Commands

Written by `python docs/make_reference.py` from each command's `--help`; do not edit. Exit codes: 0 success, 2 bad input (one
line that names file, column and row), 1 the computation failed, 130 ctrl-C.
"""


# --- the Python page ---


def api_page() -> str:
    """The whole page on the Python interface."""
    parts = [_API_HEAD]
    for title, members in SECTIONS:
        parts += [f"## {title}\n", *(entry(member) for member in members)]
    return "\n".join(parts)


def entry(member: Any) -> str:
    """One class with its public members, or one function."""
    if not inspect.isclass(member):
        return f"### `{public_name(member)}`\n\n{signature(public_name(member), member)}\n{prose(inspect.getdoc(member))}\n"
    lines = [f"### `{public_name(member)}`\n", f"{prose(inspect.getdoc(member))}\n"]
    fields = getattr(member, "__dataclass_fields__", {})
    if fields:
        lines += ["Fields: " + ", ".join(f"`{name}`" for name in fields if not name.startswith("_")) + ".\n"]
    for name, what in own_members(member):
        text = inspect.getdoc(what.fget if isinstance(what, property) else what)
        if isinstance(what, property):
            lines.append(f"**`{name}`** (property). {prose(text)}\n")
        else:
            lines.append(f"{signature(name, what)}\n{prose(text)}\n")
    return "\n".join(lines)


def own_members(member: type) -> Iterator[tuple[str, Any]]:
    """Documented public methods and properties that the class itself defines, in the order of the source."""
    for name, raw in vars(member).items():
        what = raw.__func__ if isinstance(raw, classmethod | staticmethod) else raw
        documented = isinstance(what, property) or inspect.isfunction(what)
        if documented and not name.startswith("_") and inspect.getdoc(what):
            yield name, what


def signature(name: str, function: Callable[..., Any]) -> str:
    """The signature as a block of Python stubs, one argument a line where it is long."""
    whole = inspect.signature(function)
    given = [item for item in whole.parameters.values() if item.name not in ("self", "cls")]
    words: list[str] = []
    for item in given:
        if item.kind is inspect.Parameter.KEYWORD_ONLY and "*" not in words:
            words.append("*")
        default = "" if item.default is inspect.Parameter.empty else f" = {item.default!r}"
        words.append(f"{str(item.replace(default=inspect.Parameter.empty)).replace(chr(39), '')}{default}")
    back = whole.return_annotation
    end = "" if back is inspect.Signature.empty else f" -> {str(back).replace(chr(39), '')}"
    line = f"{name}({', '.join(words)}){end}"
    if len(line) > 100:
        line = f"{name}(\n" + "".join(f"    {word},\n" for word in words) + f"){end}"
    return f"```text\n{line}\n```\n"


def public_name(member: Any) -> str:
    """``pneuid.NAME`` for what the front door exports, the full name for the rest."""
    name = str(member.__name__)
    return f"pneuid.{name}" if name in pneuid.__all__ else f"{member.__module__}.{name}"


def prose(text: str | None) -> str:
    """A docstring as Markdown: double backticks become single ones; characters that Markdown would take stay themselves."""
    parts = re.split(r"(``.*?``)", text or "", flags=re.DOTALL)
    plain = [part.replace("``", "`") if part.startswith("``") else re.sub(r"([*_<|])", r"\\\1", part) for part in parts]
    return "".join(plain)


# --- the page of commands ---


def commands_page() -> str:
    """The whole page on the commands."""
    parts = [_COMMANDS_HEAD]
    for name in COMMANDS:
        parts += [f"## `python -m {name}`\n", f"```text\n{help_of(name)}```\n"]
    return "\n".join(parts)


def help_of(name: str) -> str:
    """What ``python -m NAME --help`` prints, 100 columns wide."""
    before = {key: os.environ.get(key) for key in ("COLUMNS", "NO_COLOR")}
    os.environ.update(COLUMNS="100", NO_COLOR="1")
    module = importlib.import_module(name)
    if hasattr(module, "__path__"):
        module = importlib.import_module(f"{name}.__main__")
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
            module.main(["--help"])
    finally:
        for key, value in before.items():
            os.environ.pop(key, None)
            if value is not None:
                os.environ[key] = value
    return said.getvalue()


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for page, text in (("api.md", api_page()), ("commands.md", commands_page())):
        (FOLDER / page).write_text(text, encoding="utf-8")
