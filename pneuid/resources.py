"""Where the shipped data lie: the one resolver, for a checkout, an editable install and the wheel."""

from __future__ import annotations

from pathlib import Path

from pneuid.errors import UserError

# beside the package in every kind of install, so no folder of the user called "scenarios" can take its place
_ROOT = Path(__file__).resolve().parents[1] / "scenarios"


def scenario_path(name: str = "") -> Path:
    """Path of a shipped scenario file or folder, such as ``"real/emps/rig.toml"``; the root for an empty name.

    Raises ``UserError`` for a name that is not shipped or leads outside the shipped data.
    """
    path = (_ROOT / name).resolve()
    if path.is_relative_to(_ROOT) and path.exists():
        return path
    shipped = ", ".join(sorted(entry.name for entry in _ROOT.iterdir() if not entry.name.startswith("_")))
    raise UserError(f"scenario '{name}' is not among the shipped ones: {shipped}")
