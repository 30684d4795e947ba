"""Sanity checks of recordings: the slips that pneumatic logs arrive with, said in words, never repaired.

A check is a function of a rig and its recordings that returns a ``Finding`` or None. To add one: one such function, one
line in ``CHECKS``. A physical effect (leak, dead zone, lag, friction of any kind) must never be called a slip.
"""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.plausibility.bench import (
    bench_chambers,
    bench_reference,
    bench_unit,
    reversed_bench_position,
    reversed_force,
)
from pneuid.plausibility.finding import Check, Finding
from pneuid.plausibility.sensors import clipped_sensor, sample_rate
from pneuid.plausibility.servo import (
    pressure_reference,
    reversed_command,
    reversed_position,
    swapped_chambers,
    unit_of_pressure,
)
from pneuid.plausibility.settings import mass_out_of_scale, misnamed_run, supply_too_low
from pneuid.plausibility.skew import channel_skew
from pneuid.recording import Recording
from pneuid.rig import Rig

__all__ = ["CHECKS", "Check", "Finding", "check_recordings"]

CHECKS: dict[str, Check] = {
    "misnamed_run": misnamed_run,
    "mass_out_of_scale": mass_out_of_scale,
    "swapped_chambers": swapped_chambers,
    "reversed_command": reversed_command,
    "reversed_position": reversed_position,
    "unit_of_pressure": unit_of_pressure,
    "pressure_reference": pressure_reference,
    "supply_too_low": supply_too_low,
    "reversed_force": reversed_force,
    "reversed_bench_position": reversed_bench_position,
    "bench_chambers": bench_chambers,
    "bench_reference": bench_reference,
    "bench_unit": bench_unit,
    "channel_skew": channel_skew,
    "clipped_sensor": clipped_sensor,
    "sample_rate": sample_rate,
}
"""Every check by name, those that spoil others first."""


def check_recordings(rig: Rig, recordings: Sequence[Recording]) -> tuple[Finding, ...]:
    """What the checks find in ``recordings`` of ``rig``, in the order of the registry; empty where nothing is suspected."""
    if not recordings:
        return ()
    found = [check(rig, recordings) for check in CHECKS.values()]
    return tuple(one for one in found if one is not None)
