"""Sanity checks of what the rig file says of single runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

from pneuid.plausibility.finding import Finding
from pneuid.recording import Recording
from pneuid.rig import Rig


def misnamed_run(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """A table [runs."..."] whose name differs from that of a recording without one in folder, case, separators or ending."""
    names = {run.name for run in runs}
    spare = {_plain(name): name for name in rig.runs if name not in names}
    for run in runs:
        meant = None if run.name in rig.runs else spare.get(_plain(run.name))
        if meant is not None:
            supply = f"a supply of {(rig.supply - rig.patm) / 1e5:.4g} bar gauge and " if rig.kind == "servo" else ""
            return Finding(
                "misnamed_run", run.name,
                f"rig.toml states nothing for this file, so {supply}a mass of {rig.mass:g} kg "
                f'{"are" if supply else "is"} taken; it has [runs."{meant}"]',
                "the two are the same run", f'write [runs."{run.name}"], the name of the file without its folder',
            )  # fmt: skip
    return None


def _plain(name: str) -> str:
    """Letters and digits of a file's name, without folder and ending."""
    return re.sub(r"[^a-z0-9]", "", PurePath(name.replace("\\", "/")).stem.lower())
