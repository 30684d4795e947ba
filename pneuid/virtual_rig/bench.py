"""The virtual friction bench: imposed motion, regulated chambers, driving force measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import ComputationError
from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.kernel import friction_coefficients, run_imposed, stribeck
from pneuid.virtual_rig.motion import MOTIONS, Motion, reciprocation, strokes
from pneuid.virtual_rig.packing import pack
from pneuid.virtual_rig.sensors import BENCH_SENSORS, Sensors, averaged, on_grid
from pneuid.virtual_rig.servo import substeps_for
from pneuid.virtual_rig.truth import TruthBench

Array = NDArray[np.float64]

BUFFER_TIME = 0.05
"""Time constant [s] with which a chamber's pressure follows the disturbance by the motion."""

STUDY_PRESSURES = (
    *((1e5 * bar, 1e5 * bar) for bar in range(7)),
    *((3e5, 1e5 * bar) for bar in (0, 1, 2, 5, 6)),
)
"""Pressure pairs (p1, p2) [Pa, gauge] of the 2011 study: equal ones, and 3 bar in the rodless chamber."""

STUDY_UNSEEN = ((3e5, 4e5),)
"""The pair [Pa, gauge] that the study keeps for its verification."""

SLOW_SPEEDS = (0.5e-3, 0.7e-3, 1e-3, 1.4e-3, 2e-3, 3e-3)
FAST_SPEEDS = (5e-3, 10e-3, 20e-3, 40e-3, 60e-3, 90e-3, 120e-3, 150e-3)
"""Steady speeds [m/s] of the virtual study."""


def study_motions(
    slow: Sequence[float] = SLOW_SPEEDS, fast: Sequence[float] = FAST_SPEEDS, amplitude: float = 0.5e-3
) -> dict[str, Motion]:
    """What the 2011 bench does at one pressure pair: slow strokes of a few mm, fast ones, and slow reciprocation.

    Speeds [m/s]; ``amplitude`` [m] of the reciprocation at 0.5 mm/s and 2 kHz, two cycles.
    """
    return {
        "slow": strokes(slow, start=0.2, travel=2.5e-3, longest=5.0, rate=500.0),
        "fast": strokes(fast, start=0.15, travel=0.2, longest=1.0, acceleration=0.5, rate=1000.0),
        "reciprocation": reciprocation(amplitude=amplitude, turning=0.04, rate=2000.0),
    }


def record_study(
    truth: TruthBench,
    pressures: Sequence[tuple[float, float]],
    motions: Mapping[str, Motion],
    seed: int = 0,
    *,
    sensors: Sensors = BENCH_SENSORS,
) -> dict[str, dict[str, Array]]:
    """Every motion at every pressure pair (p1, p2) [Pa, gauge] as ``record_bench`` returns it, by file name."""
    found = {}
    for p1, p2 in pressures:
        for j, (name, motion) in enumerate(motions.items()):
            own = int(np.random.SeedSequence([seed, round(p1), round(p2), j]).generate_state(1)[0])
            record = record_bench(truth, truth.patm + p1, truth.patm + p2, motion, seed=own, sensors=sensors)
            found[f"p1_{p1 / 1e3:.0f}_p2_{p2 / 1e3:.0f}_{name}.csv"] = record
    return found


def record_bench(
    truth: TruthBench,
    p1: float | Array,
    p2: float | Array,
    motion: str | Motion = "strokes",
    hidden: Hidden = NOTHING,
    seed: int = 0,
    *,
    sensors: Sensors = BENCH_SENSORS,
    step: float = 10e-6,
    with_truth: bool = False,
) -> dict[str, Array]:
    """One bench run at regulator settings ``p1``, ``p2`` (absolute Pa): t [s], x [m], p1, p2 [Pa], F [N].

    A setting is one number or one per sample.

    F is the force of the motor on the rod, positive in +x: ``m a + friction - (p1-patm) A1 +
    (p2-patm) A2 + load``. ``step`` [s] is the bristle's; the bristle starts unstrained.
    ``with_truth`` adds the noise-free ``true_x``, ``true_v``, ``true_a``, ``true_p1``, ``true_p2``, ``true_F`` and
    ``true_friction``. Only the friction, load and sensor effects of ``hidden`` act on a bench.

    Raises ``KeyError`` for an unknown motion, ``ValueError`` for a motion that leaves the stroke or a
    pressure below vacuum, ``ComputationError`` when the force is not finite.
    """
    path = _motion(motion)
    if min(np.min(p1), np.min(p2)) < 0.0:
        raise ValueError(f"p1 and p2 are absolute pressures and not negative, got {np.min(p1)} and {np.min(p2)} Pa")
    if not (np.min(path.x) >= 0.0 and np.max(path.x) <= truth.stroke):
        raise ValueError(f"the motion spans {np.min(path.x)} to {np.max(path.x)} m, the stroke is {truth.stroke} m")
    interval = float(path.t[1] - path.t[0])
    sag = truth.regulator_droop * _smoothed(path.v, interval)
    q1, q2 = np.maximum(p1 - sag, 0.0), np.maximum(p2 + sag, 0.0)
    par = pack(truth.as_servo(), hidden)
    friction, force = run_imposed(path.x, path.v, path.a, q1, q2, interval, substeps_for(interval, step), par)
    if not np.all(np.isfinite(force)):
        raise ComputationError("the virtual bench's force is not finite; check friction and motion")
    noise = np.random.default_rng(seed).standard_normal((4, path.t.size))
    felt = averaged(force, hidden.sensor_lag_F / interval, round(hidden.form.averages)) + hidden.sensor_offset_F
    record = {
        "t": path.t.copy(),
        "x": on_grid(path.x + sensors.x_noise * noise[0], sensors.x_grid),
        "p1": on_grid(q1 + sensors.p_noise * noise[1] + hidden.sensor_offset_p1, sensors.p_grid),
        "p2": on_grid(q2 + sensors.p_noise * noise[2] + hidden.sensor_offset_p2, sensors.p_grid),
        "F": on_grid(felt + sensors.F_noise * noise[3], sensors.F_grid),
    }
    if with_truth:
        record |= {"true_x": path.x, "true_v": path.v, "true_a": path.a, "true_p1": q1, "true_p2": q2}
        record |= {"true_F": force, "true_friction": friction}
    return record


def steady_friction(truth: TruthBench, v: Array, p1: float, p2: float) -> Array:
    """True steady friction force [N] over speed ``v`` [m/s] at ``p1``, ``p2`` (absolute Pa), no hidden effect.

    Source: Liu, Chen, Tao 2011, eq. 5.
    """
    par = pack(truth.as_servo(), NOTHING)
    y = np.zeros(at.STATES)
    y[at.P1], y[at.P2] = p1, p2
    fc, fs, vs, viscous = friction_coefficients(0.5 * truth.stroke, y, par)
    speeds = np.asarray(v, dtype=np.float64)
    force = np.array([stribeck(speed, fc, fs, vs) * np.sign(speed) + viscous * speed for speed in speeds.ravel()])
    return force.reshape(speeds.shape)


def _motion(wanted: str | Motion) -> Motion:
    if isinstance(wanted, Motion):
        return wanted
    if wanted not in MOTIONS:
        raise KeyError(f"no motion {wanted!r}; there are {sorted(MOTIONS)}")
    return MOTIONS[wanted]()


def _smoothed(v: Array, interval: float) -> Array:
    """First-order lag of the speed, exact for a speed held over each interval."""
    keep = float(np.exp(-interval / BUFFER_TIME))
    out = np.empty_like(v)
    level = 0.0
    for k, value in enumerate(v):
        level = keep * level + (1.0 - keep) * float(value)
        out[k] = level
    return out
