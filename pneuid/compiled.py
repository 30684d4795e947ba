"""Generates C from CasADi functions, compiles it once and caches it by content.

Without a compiler the same functions run interpreted, and the caller is told.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future
from functools import lru_cache
from pathlib import Path

import casadi as ca

from pneuid.cores import threads

# not -ffast-math, which makes the whole process flush denormals; without finite-math and signed-zeros fmin and fmax are library
# calls; derivatives divide by the same thing many times, a tenth of their time without reciprocals; the last lets the compiler
# inline one sample's functions into the chain. The rest of -O3, and scheduling again once registers are given out, would take
# half as long again to compile and win nothing on such long straight lines
_FLAGS = (
    "-O2", "-finline-functions", "-fno-schedule-insns2", "-march=native", "-fPIC", "-shared", "-fno-math-errno",
    "-fno-trapping-math", "-ffinite-math-only", "-fno-signed-zeros", "-freciprocal-math", "-fno-semantic-interposition",
)  # fmt: skip
_TIMEOUT_SECONDS = 300
_PATIENCE_SECONDS, _LOOK_SECONDS = 20.0, 0.02  # ten times what a library takes


@lru_cache(maxsize=1)
def compiler() -> tuple[str, str] | None:
    """Path and version of the C compiler (``CC``, then cc, gcc, clang), or None."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        path = shutil.which(name) if name else None
        if path is None:
            continue
        found = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
        if found.returncode == 0:
            return path, found.stdout.splitlines()[0]
    return None


@lru_cache(maxsize=1)
def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith(("flags", "Features")):
                return platform.machine() + line
    return platform.machine() + platform.processor()


def cache_folder() -> Path:
    """Folder of compiled functions, private to the user (``PNEUID_CACHE`` overrides it)."""
    named = os.environ.get("PNEUID_CACHE")
    folder = Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pneuid"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def compile_functions(functions: Sequence[ca.Function], prefix: str) -> tuple[list[ca.Function], bool]:
    """Compiled counterparts of ``functions`` and True, or the functions themselves and False without a compiler.

    ``prefix`` starts every generated symbol, so that none collides with one of the C library's.
    """
    tool = compiler()
    if tool is None:
        return list(functions), False
    generator = ca.CodeGenerator(f"{prefix}.c", {"with_header": False, "verbose": False})
    for function in functions:
        generator.add(function)
    library = compiled_library(generator.dump(), prefix)
    if library is None:
        return list(functions), False
    return [ca.external(function.name(), str(library)) for function in functions], True


def compiled_library(source: str, prefix: str) -> Path | None:
    """The library that C ``source`` compiles to, from the cache where it is there; None where it does not compile."""
    tool = compiler()
    if tool is None:
        return None
    library = _library(source, prefix, tool)
    begun = _BEGUN.pop((os.getpid(), library), None)
    if begun is None and any(path == library for _, path in _BEGUN):
        _wait_for(library)
    built = library.exists() or (_build(tool[0], source, library) if begun is None else begun.result())
    return library if built else None


def _wait_for(library: Path) -> None:
    """Until the process that this one is a copy of has compiled a library that it had begun, or too long."""
    until = time.monotonic() + _PATIENCE_SECONDS
    while not library.exists() and time.monotonic() < until:
        time.sleep(_LOOK_SECONDS)


def begin(source: str, prefix: str) -> None:
    """Compile C ``source`` beside what else is done, where there is a core for it; ``compiled_library`` waits for it."""
    tool = compiler()
    if tool is None or threads() == 1:
        return
    library = _library(source, prefix, tool)
    if library.exists() or (os.getpid(), library) in _BEGUN:
        return
    done = _BEGUN[os.getpid(), library] = Future()

    def build() -> None:
        try:
            with _places(os.getpid()):
                done.set_result(_build(tool[0], source, library))
        except OSError as error:  # such as a full disk, for whoever needs the library
            done.set_exception(error)

    # a thread that nobody waits for: at the end of the program what is not needed any more is dropped
    threading.Thread(target=build, daemon=True).start()


_BEGUN: dict[tuple[int, Path], Future[bool]] = {}
"""Compilations that this process has begun; a forked one knows nothing of how those of its parent went on."""


@lru_cache(maxsize=4)
def _places(process: int) -> threading.Semaphore:  # noqa: ARG001 - see above
    """As many as may compile at once."""
    return threading.Semaphore(threads())


def _library(source: str, prefix: str, tool: tuple[str, str]) -> Path:
    """Where the library of a ``source`` lies."""
    content = "\n".join([source, " ".join(_FLAGS), *tool, _processor(), ca.CasadiMeta.version()])
    return cache_folder() / f"{prefix}_{hashlib.sha256(content.encode()).hexdigest()[:32]}.so"


def lanes() -> int:
    """Numbers that this processor's vectors hold, as far as is known."""
    return 8 if "avx512f" in _processor() else 4


def _build(tool: str, source: str, library: Path) -> bool:
    """Compile to a temporary file and move it in place, so that parallel runs never load half a library."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        written, built = Path(folder) / "source.c", Path(folder) / "library.so"
        written.write_text(source)
        command = [tool, *_FLAGS, str(written), "-o", str(built), "-lm"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIMEOUT_SECONDS)
        except subprocess.TimeoutExpired:
            return False
        if done.returncode != 0:
            return False
        built.replace(library)
    return True
