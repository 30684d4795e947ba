"""A project: a folder with rig.toml, recordings, and result folders that the commands read and write too."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pneuid.errors import UserError
from pneuid.resources import scenario_path
from pneuid.workbench.rig_text import RIG_TEMPLATE
from pneuid.workbench.security import SUFFIXES, safe_name

RIG = "rig.toml"
SETTINGS = "workbench.json"
ROLES = ("train", "hold_out", "zero", "unused")
_SCHEMA = 1


@dataclass(frozen=True)
class RunFile:
    """One recording of the project: file name, size in bytes, time of change in ns, role."""

    name: str
    size: int
    changed: int
    role: str


class Project:
    """Files of one project folder; made where it does not exist. Raises ``UserError`` where it cannot be used."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        if self.folder.exists() and not self.folder.is_dir():
            raise UserError(f"{folder}: is a file; give the folder of a project")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"{folder}: cannot be created: {error.strerror}") from error

    # --- recordings ---

    def path(self, name: str) -> Path:
        """Path of a recording of the project. Raises ``UserError`` for a name that leads anywhere else."""
        found = self.folder / safe_name(name)
        if found.resolve().parent != self.folder:
            raise UserError(f"{name}: leads outside the project folder; copy the file into it")
        return found

    def runs(self) -> list[RunFile]:
        """Recordings in order of name."""
        roles = self._settings().get("roles", {})
        found = []
        for path in sorted(self.folder.iterdir()):
            if path.suffix.lower() in SUFFIXES and path.is_file() and not path.name.startswith("."):
                stat = path.stat()
                role = roles.get(path.name)
                found.append(
                    RunFile(
                        path.name, stat.st_size, stat.st_mtime_ns, role if role in ROLES else default_role(path.name)
                    )
                )
        return found

    def of_role(self, role: str) -> list[str]:
        """Names of the recordings in a role."""
        return [run.name for run in self.runs() if run.role == role]

    def set_role(self, name: str, role: str) -> None:
        """Keep the role of a recording. Raises ``UserError`` for an unknown one."""
        if role not in ROLES:
            raise UserError(f"{role!r} is no role of a run; choose one of {', '.join(ROLES)}")
        settings = self._settings()
        settings.setdefault("roles", {})[safe_name(name)] = role
        write(self.folder / SETTINGS, json.dumps({"schema": _SCHEMA, **settings}, indent=1))

    def incoming(self, name: str) -> Path:
        """Where an upload waits to be checked: the same file name, apart from the runs.

        Raises ``UserError`` for an unusable name, or one that is taken.
        """
        if self.path(name).exists():
            raise UserError(f"{name}: the project holds a run of this name already; rename the file or remove that run")
        waiting = self.folder / ".incoming"
        waiting.mkdir(exist_ok=True)
        return waiting / name

    def accept(self, waiting: Path) -> None:
        """Take a checked upload into the project."""
        waiting.replace(self.path(waiting.name))

    def remove(self, name: str) -> None:
        """Put a run aside into ``removed/``: what was measured is not deleted by a click."""
        aside = self.folder / "removed"
        aside.mkdir(exist_ok=True)
        path = self.path(name)
        target, count = aside / name, 2
        while target.exists():
            target, count = aside / f"{path.stem}_{count}{path.suffix}", count + 1
        path.replace(target)

    # --- rig ---

    @property
    def has_rig(self) -> bool:
        """Whether there is a rig.toml."""
        return (self.folder / RIG).is_file()

    def rig_text(self) -> str:
        """rig.toml as it stands; a template where there is none."""
        if not self.has_rig:
            return RIG_TEMPLATE
        return (self.folder / RIG).read_text(encoding="utf-8", errors="replace")

    # --- results ---

    def models(self) -> list[str]:
        """Result folders that hold a model.json, oldest first."""
        return self._folders("model.json")

    def diagnoses(self) -> list[str]:
        """Result folders that hold a diagnosis.json, oldest first."""
        return self._folders("diagnosis.json")

    def studies(self) -> list[str]:
        """Folders, up to two levels down, that hold a study.json, oldest first."""
        return self._folders("study.json", "*/*/study.json")

    def _folders(self, file: str, deeper: str = "") -> list[str]:
        paths = [*self.folder.glob(f"*/{file}"), *(self.folder.glob(deeper) if deeper else ())]
        if file == "study.json" and (self.folder / file).is_file():
            paths.append(self.folder / file)
        paths = [path for path in paths if not path.relative_to(self.folder).parts[0].startswith(".")]
        return [
            str(path.parent.relative_to(self.folder)) for path in sorted(paths, key=lambda path: path.stat().st_mtime)
        ]

    def result(self, folder: str, file: str) -> Any:
        """Content of a JSON result, None where it is absent or cannot be read."""
        path = (self.folder / folder / file).resolve()
        if not path.is_relative_to(self.folder):
            return None
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def fingerprint(self) -> tuple[Any, ...]:
        """Changes when another program, or a command, adds or changes a run, the rig or a result."""
        results = [path.stat().st_mtime_ns for path in self.folder.glob("*/*.json")]
        rig = (self.folder / RIG).stat().st_mtime_ns if self.has_rig else 0
        return tuple(self.runs()), rig, tuple(sorted(results))

    def _settings(self) -> dict[str, Any]:
        try:
            found = json.loads((self.folder / SETTINGS).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        if not isinstance(found, dict) or not isinstance(found.get("roles", {}), dict):
            return {}
        return found


def default_role(name: str) -> str:
    """``hold_out`` or ``zero`` (a zero reading) for a file that says so in its name, else ``train``."""
    if name.lower().startswith("zero"):
        return "zero"
    return "hold_out" if name.lower().startswith(("hold", "held", "test", "val")) else "train"


def write(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def demo_project(folder: Path) -> Project:
    """The embedded demonstration in ``folder``: copied where it is not there yet, results in it are kept."""
    project = Project(folder)
    for source in sorted(scenario_path("demo").iterdir()):
        if (source.name == RIG or source.suffix == ".csv") and not (project.folder / source.name).exists():
            shutil.copy(source, project.folder / source.name)
    return project
