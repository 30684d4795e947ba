"""Sanity checks of what the rig file says: the table of a run, the supply, the moving mass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from pneuid.plausibility.finding import Finding
from pneuid.recording import Recording
from pneuid.rig import Rig

_ABOVE, _OFTEN = 1.05, 0.02
"""Gauge chamber pressure over the gauge supply that is stated, and share of a run above it, that no supply so low explains.
Of 192 recordings of 24 random rigs, half of them with an effect hidden, none goes above; with the supply stated as five
sevenths of what it is half of them do for a quarter of the time."""

_UNIT = 1.5
"""Chamber over supply from which a wrong unit is the likelier slip, which has a check of its own."""

_SLOWEST, _FASTEST = 0.5, 2e4
"""Acceleration [m/s^2] by the whole supply that a moving mass may have; random rigs of all sizes have 20 to 3000."""

_USUAL = 6e5
"""Gauge pressure, Pa, that stands for the supply on a bench, whose rig file states none."""


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


def supply_too_low(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """A chamber above the stated supply for longer than a compression by the load lasts."""
    if rig.kind != "servo":
        return None
    for run in runs:
        if "supply" in rig.run(run.name).free:
            continue
        stated = run.signals["psup"] - rig.patm
        chamber = np.maximum(run.signals["p1"], run.signals["p2"]) - rig.patm
        above = float(np.mean(chamber > _ABOVE * stated))
        top, usual = float(np.percentile(chamber, 98)) / 1e5, float(np.median(stated)) / 1e5
        if above > _OFTEN and top < _UNIT * usual:
            convention = rig.pressure_convention
            least = top + (rig.patm / 1e5 if convention == "abs" else 0.0)
            return Finding(
                "supply_too_low", run.name,
                f"a chamber reaches {top:.3g} bar gauge and is above the supply of {usual:.3g} bar for "
                f"{100 * above:.0f} % of the run",
                "the supply of this run is stated too low",
                f'state it under [runs."{run.name}"] as supply = "{least:.3g} bar" ({convention}) or more, or record psup',
            )  # fmt: skip
    return None


def mass_out_of_scale(rig: Rig, _runs: Sequence[Recording]) -> Finding | None:
    """A moving mass that the pressure could throw, or could not move: grams for kilograms, kilograms for tonnes."""
    if rig.A1 <= 0.0:  # a bench without a bore
        return None
    pressure = max(rig.supply - rig.patm, 1e5) if rig.kind == "servo" else _USUAL
    acceleration = pressure * rig.A1 / rig.mass
    if _SLOWEST < acceleration < _FASTEST:
        return None
    return Finding(
        "mass_out_of_scale", "load.mass",
        f"{pressure / 1e5:.3g} bar on the piston accelerate {rig.mass:g} kg by {acceleration:.2g} m/s^2 (20 to 3000 is usual)",
        "the unit of the mass, or of the bore, is wrong", "compare mass and bore in rig.toml with the machine",
    )  # fmt: skip


def _plain(name: str) -> str:
    """Letters and digits of a file's name, without folder and ending."""
    return re.sub(r"[^a-z0-9]", "", PurePath(name.replace("\\", "/")).stem.lower())
