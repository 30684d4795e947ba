"""The embedded story: the demonstration's files, and what each command finds where it was given nothing."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from pneuid.criticism.comparison.ladder import Rung, from_json
from pneuid.errors import UserError
from pneuid.recording import Recording
from pneuid.resources import scenario_path
from pneuid.rig import Rig


@dataclass(frozen=True)
class Runs:
    """A rig with the recordings to fit and those held out."""

    rig: Rig
    train: list[Recording]
    hold_out: list[Recording]


def demo_files(role: str) -> list[str]:
    """Files of the demonstration in a role, ``train`` or ``hold_out``, from where the command runs where they are below."""
    paths, here = sorted(scenario_path("demo").glob(f"{role}_*.csv")), Path.cwd()
    return [str(path.relative_to(here) if path.is_relative_to(here) else path) for path in paths]


def demo_runs() -> Runs:
    """The demonstration data shipped with the package: a servo rig with a hidden effect."""
    folder = scenario_path("demo")
    rig = Rig.from_toml(folder / "rig.toml")
    train = [Recording.read(path, rig) for path in demo_files("train")]
    hold_out = [Recording.read(path, rig) for path in demo_files("hold_out")]
    return Runs(rig, train, hold_out)


def read_runs(paths: list[str], rig: Rig) -> list[Recording]:
    """Recordings of the named files. Raises ``UserError`` for a file that is named twice or cannot be used."""
    names = [Path(path).name for path in paths]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise UserError(f"{', '.join(sorted(twice))}: named twice; every run needs a file name of its own")
    return [Recording.read(path, rig) for path in paths]


def read_ladder(path: Path) -> list[Rung]:
    """Rungs of ``path``, none where the file does not exist."""
    if not path.exists():
        return []
    try:
        return from_json(json.loads(path.read_text(encoding="utf-8")), str(path))
    except json.JSONDecodeError as error:
        raise UserError(f"{path}: line {error.lineno}: not JSON ({error.msg})") from error
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot read the ladder: {error}") from error
