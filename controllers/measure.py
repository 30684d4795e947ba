"""Measuring the virtual rig: the recordings an engineer would take of it, and the rig file he would write."""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.story import Runs
from pneuid.virtual_rig import ATMOSPHERE, SERVO_SENSORS, record_servo
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.sensors import Sensors
from pneuid.virtual_rig.truth import TruthServo

TRAINING = (("multisine", 3.0), ("steps", 5.0), ("slow", 7.0))
"""Excitation and supply in bar gauge of the runs to fit."""

HELD_OUT = (("multisine", 5.0), ("steps", 7.0))
"""Those held out."""

DATA_SHEET_ERROR = 0.8
"""What the data sheet says of the valve's conductance, relative to the truth."""


def rig_of(truth: TruthServo, supplies: dict[str, float], sensors: Sensors = SERVO_SENSORS) -> Rig:
    """The rig file of ``truth`` as its engineer knows it; ``supplies`` is bar gauge by file name."""
    return Rig.from_dict(
        {
            "kind": "servo",
            "conventions": {"pressure": "gauge"},
            "cylinder": {
                "bore": f"{truth.bore * 1e3!r} mm", "rod": f"{truth.rod_2 * 1e3!r} mm", "stroke": f"{truth.stroke * 1e3!r} mm",
                "dead_volume_1": f"{truth.dead_volume_1 * 1e6!r} cm^3", "dead_volume_2": f"{truth.dead_volume_2 * 1e6!r} cm^3",
            },
            "load": {"mass": f"{truth.mass!r} kg"},
            "valve": {
                "conductance": f"{truth.conductance * DATA_SHEET_ERROR!r} m^3/(s*Pa)", "critical_ratio": truth.critical_ratio,
                "full_scale": f"{truth.full_scale!r} V", "null": f"{truth.null!r} V",
            },
            "supply": {"pressure": "600 kPa"},
            "sensors": {
                "x": f"{sensors.x_noise * 1e6!r} um", "p1": f"{sensors.p_noise!r} Pa", "p2": f"{sensors.p_noise!r} Pa",
            },
            "runs": {name: {"supply": f"{bar * 100!r} kPa"} for name, bar in supplies.items()},
        }
    )  # fmt: skip


def measured_runs(
    truth: TruthServo, hidden: Hidden, seed: int = 1, duration: float = 6.0, rate: float = 1000.0,
    training: Sequence[tuple[str, float]] = TRAINING, held_out: Sequence[tuple[str, float]] = HELD_OUT,
    sensors: Sensors = SERVO_SENSORS,
) -> Runs:  # fmt: skip
    """Noisy, quantised recordings of the virtual rig in closed loop (``duration`` s at ``rate`` Hz each)."""
    plan = [(f"run_{i + 1}.csv", *item) for i, item in enumerate([*training, *held_out])]
    rig = rig_of(truth, {name: bar for name, _, bar in plan}, sensors)
    recordings = [
        Recording.from_arrays(
            name, rig,
            **record_servo(truth, hidden, excitation, duration, seed * 100 + i, supply=bar * 1e5 + ATMOSPHERE, rate=rate,
                           sensors=sensors),
        )
        for i, (name, excitation, bar) in enumerate(plan)
    ]  # fmt: skip
    return Runs(rig, recordings[: len(training)], recordings[len(training) :])
