"""A user's own effects: classes in a file that the user names, the same kind of class as the catalogue's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from pneuid.effect import EQUATIONS, Effect, EffectFile
from pneuid.errors import UserError
from pneuid.formats.python_file import PythonFile, line_in, run_python_file

_WORDS = {
    "experiment": "recordings in which what it depends on varies over its whole range",
    "reference": "the user's own",
}  # fmt: skip
"""What an own effect need not say about itself."""

T = TypeVar("T")


def own_effects(paths: Sequence[str | Path], taken: Mapping[str, Effect]) -> tuple[Effect, ...]:
    """The effects in the user's files, in the order of the files and of the classes in them.

    taken : effects whose names are not free. Raises ``UserError`` naming the file and class for what is not an effect.
    """
    found: dict[str, Effect] = {}
    for path in paths:
        for effect in _effects_in(run_python_file(path)):
            if effect.name in taken or effect.name in found:
                raise UserError(f"{path}: effect '{effect.name}': the name is taken; give it another one")
            found[effect.name] = effect
    return tuple(found.values())


@lru_cache(maxsize=32)
def _effects_in(file: PythonFile) -> tuple[Effect, ...]:
    own = [
        item for item in vars(file.module).values()
        if isinstance(item, type) and issubclass(item, Effect) and item.__module__ == file.module.__name__
    ]  # fmt: skip
    if not own:
        raise UserError(f"{file.file}: holds no effect; write a class that derives from pneuid.effect.Effect")
    return tuple(_made(kind, file) for kind in dict.fromkeys(own))


def _made(kind: type[Effect], file: PythonFile) -> Effect:
    where = f"{file.file}: class {kind.__name__}"
    for field in ("name", "equation", "mechanism"):
        value = getattr(kind, field, None)
        if not isinstance(value, str) or not value:
            raise UserError(f"{where}: {field} is missing; set it to a text")
    if ":" in kind.name or " " in kind.name:
        raise UserError(f"{where}: name '{kind.name}' may hold letters, digits and underscores only")
    if kind.equation not in EQUATIONS and not kind.equation.startswith("sensor_"):
        raise UserError(f"{where}: equation '{kind.equation}'; choose one of {', '.join(EQUATIONS)}, sensor_SIGNAL")
    for field, words in _WORDS.items():
        if not hasattr(kind, field):
            setattr(kind, field, words)
    if kind.parameters is Effect.parameters:
        raise UserError(f"{where}: declares no parameters; write parameters(self, rig, law), a tuple of Parameter")
    kind.origin = EffectFile(Path(file.file).name, file.sha256)
    effect = tried(kind.name, file.file, kind)
    if not effect.ports:
        raise UserError(f"{where}: enters no equation; write one of the ports, such as force(self, force, scope)")
    return effect


def tried(name: str, path: str, call: Callable[[], T]) -> T:
    """What ``call`` returns; what goes wrong in the user's own lines is one ``UserError`` with the line."""
    try:
        return call()
    except UserError:
        raise
    except Exception as error:
        line = line_in(path, error)
        at = f"line {line}: " if line else ""
        raise UserError(f"{path}: effect '{name}': {at}{type(error).__name__}: {error}") from error


