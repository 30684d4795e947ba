"""Pneumatic cylinders: model, identification, and the physical effect that the model lacks.

rig = pneuid.Rig.from_toml("rig.toml")
runs = [pneuid.Recording.read(name, rig) for name in ("mon_1.csv", "mon_2.csv")]
model = pneuid.fit(rig, runs)
comparison = model.compare(runs)
diagnosis = model.diagnose(runs, hold_out=[...])
better = pneuid.fit(rig, runs, add=diagnosis.effects)
better.save("model.json")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pneuid.api import IdentifiedModel, fit, load
    from pneuid.errors import ComputationError, UserError
    from pneuid.recording import Recording
    from pneuid.rig import Rig
    from pneuid.zero_reading import ZeroReading

__all__ = ["ComputationError", "IdentifiedModel", "Recording", "Rig", "UserError", "ZeroReading", "fit", "load"]
__version__ = "0.1.0"

_HOMES = {
    "IdentifiedModel": "pneuid.api", "fit": "pneuid.api", "load": "pneuid.api", "ComputationError": "pneuid.errors",
    "UserError": "pneuid.errors", "Recording": "pneuid.recording", "Rig": "pneuid.rig",
    "ZeroReading": "pneuid.zero_reading",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """What a notebook asks for, imported when it does: the workbench's first page cannot wait for casadi."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pneuid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
