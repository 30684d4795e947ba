"""A user's own Python file, run because the user named it; its hash says later whether it is still the same."""

from __future__ import annotations

import hashlib
import sys
import traceback
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from pneuid.errors import UserError


@dataclass(frozen=True)
class PythonFile:
    """A file that has been run: its name, the sha256 (hex) of exactly the bytes that ran, and the module they made."""

    file: str
    sha256: str
    module: ModuleType


def run_python_file(path: str | Path) -> PythonFile:
    """Run a file as a module of its own; once per process while its content stays.

    Raises ``UserError`` naming the file and line for one that cannot be read or run.
    """
    target = Path(path)
    try:
        content = target.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: cannot read the effect file: {error.strerror}") from error
    return _run(str(path), content)


@lru_cache(maxsize=32)
def _run(path: str, content: bytes) -> PythonFile:
    digest = hashlib.sha256(content).hexdigest()
    module = ModuleType(f"pneuid_own_{digest[:16]}")
    module.__file__ = path
    # dataclasses and pickle look their module up by name
    sys.modules[module.__name__] = module
    try:
        exec(compile(content, path, "exec"), module.__dict__)  # noqa: S102 - the user named the file to be run
    except SyntaxError as error:
        raise UserError(f"{path}: line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise UserError(f"{path}: line {line_in(path, error)}: {type(error).__name__}: {error}") from error
    return PythonFile(path, digest, module)


def line_in(path: str, error: BaseException) -> int:
    """Line of the file in which the error arose, 0 where it arose outside."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return (lines or [0])[-1] or 0
