"""The virtual rig's recordings as measurement files; the only module here that opens one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import to_display
from pneuid.virtual_rig.truth import ATMOSPHERE

DECIMALS = {"t": 6, "u": 5, "x": 4, "v": 4, "p1": 2, "p2": 2, "psup": 2, "F": 3}
"""Decimals of each signal in its display unit: 0.1 um, 0.01 kPa, 10 uV, 1 mN."""


def write_csv(
    path: str | Path, record: Mapping[str, NDArray[np.float64]], gauge: bool = True, patm: float = ATMOSPHERE
) -> None:
    """Write the measured signals of ``record`` (SI, absolute) with a ``name [unit]`` header.

    Pressures are written in kPa gauge, against ``patm`` [Pa], unless ``gauge`` is false. Channels
    that are no signal of the vocabulary, such as ``true_x``, are left out.
    """
    names = [name for name in DECIMALS if name in record]
    columns = []
    for name in names:
        signal = SIGNALS[name]
        values = record[name] - patm if gauge and name in PRESSURES else record[name]
        columns.append(values * to_display(1.0, signal.unit, signal.display_unit))
    header = ",".join(f"{name} [{SIGNALS[name].display_unit}]" for name in names)
    formats = [f"%.{DECIMALS[name]}f" for name in names]
    with Path(path).open("w", encoding="utf-8", newline="\n") as file:
        np.savetxt(file, np.column_stack(columns), fmt=formats, delimiter=",", header=header, comments="")
