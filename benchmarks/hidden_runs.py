"""Recordings of the cases of ``hidden_cases.py``: the rig, what hides in it, its runs and its rig file."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
from hidden_cases import BORES, LAWS, Case, on_bench
from hidden_counts import SHEET_ERROR
from varied_cases import Run, drawn_bench, drawn_hidden, drawn_motions, drawn_plan, drawn_servo

from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import (
    ATMOSPHERE,
    BENCH_EFFECTS,
    BENCH_SENSORS,
    HIDDEN_EFFECTS,
    NOTHING,
    OUTSIDE_EFFECTS,
    SERVO_SENSORS,
    Hidden,
    Motion,
    RandomBench,
    RandomServo,
    Sheet,
    TruthBench,
    TruthServo,
    in_proportion,
    random_bench,
    random_servo,
    reciprocation,
    record_bench,
    record_servo,
    sine,
    strokes,
)

PLAN = [
    Run("multisine", 3 / 7), Run("travel", 5 / 7), Run("slow", 1.0), Run("multisine", 5 / 7), Run("travel", 1.0)
]  # fmt: skip
"""Three training runs and two held-out ones, of all but the varied cases."""

FASTEST = 0.15
"""Highest speed on the bench, m/s, but for the sines of ``bench``."""

TRAINING = 3
TOP_SUPPLY = 7e5  # Pa gauge, of the rigs that are not drawn at random


def hidden_of(case: Case, bore: float) -> Hidden:
    """What hides in a rig of that bore [m]."""
    hidden, presets = NOTHING, BENCH_EFFECTS if on_bench(case) else HIDDEN_EFFECTS
    if case.category == "varied":
        return drawn_hidden(presets[case.names[0]]["strong"], bore, case.seed) if case.names else NOTHING
    for name in case.names:
        if name in LAWS:
            continue
        one = getattr(OUTSIDE_EFFECTS[name], case.level) if name in OUTSIDE_EFFECTS else presets[name][case.level]
        hidden = hidden.also(one)
    return in_proportion(hidden, bore)


def servo_rig(case: Case) -> tuple[RandomServo, float]:
    """The rig of a servo case, and its highest supply, Pa gauge."""
    if case.category == "varied":
        drawn = drawn_servo(case.seed)
        return drawn, drawn.truth.supply - ATMOSPHERE
    if case.rig == "random":
        drawn = random_servo(case.seed, SHEET_ERROR if case.category == "sheet" else 0.0)
        return drawn, drawn.truth.supply - ATMOSPHERE
    truth = TruthServo().scaled(BORES.get(case.rig, 0.032))
    return RandomServo(truth, SERVO_SENSORS, 1000.0, Sheet(conductance=0.8)), TOP_SUPPLY


def servo_runs(case: Case) -> tuple[list[Recording], list[Recording], Rig]:
    """Training runs, held-out runs and the rig file of a servo case."""
    drawn, top = servo_rig(case)
    duration = float(np.clip(6.0, 1500.0 / drawn.rate, max(3.0, 15000.0 / drawn.rate)))
    plan = drawn_plan(case.seed) if case.category == "varied" else PLAN
    supplies = {f"run_{i + 1}.csv": run.supply * top for i, run in enumerate(plan)}
    rig = Rig.from_dict(tomllib.loads(drawn.rig_toml(supplies)))
    hidden = hidden_of(case, drawn.truth.bore)
    runs = [
        Recording.from_arrays(
            name, rig,
            **record_servo(
                drawn.truth, hidden, run.excitation, duration, case.seed * 100 + i, supply=supply + ATMOSPHERE,
                rate=drawn.rate, sensors=drawn.sensors,
            ),
        )
        for i, (run, (name, supply)) in enumerate(zip(plan, supplies.items(), strict=True))
    ]  # fmt: skip
    return runs[:TRAINING], runs[TRAINING:], rig


def bench_rig(case: Case) -> RandomBench:
    """The rig of a bench case."""
    if case.category == "varied":
        return drawn_bench(case.seed)
    if case.rig == "random bench":
        return random_bench(case.seed)
    ratio = BORES[case.rig] / 0.032
    friction = TruthServo().scaled(BORES[case.rig]).friction
    friction = LAWS.get(case.names[0], friction) if case.names else friction
    truth = TruthBench(bore=BORES[case.rig], rod_2=0.012 * ratio, mass=0.6 * ratio**2, friction=friction)
    return RandomBench(truth, replace(BENCH_SENSORS, F_noise=0.2 * ratio), Sheet())


def _motions(seed: int) -> list[tuple[Motion, float, float]]:
    """Motion and the two pressures [Pa gauge] of three training runs and two held-out ones of a bench case."""
    rng = np.random.default_rng((seed, 3))
    speeds = [np.exp(rng.uniform(np.log(5e-4), np.log(0.15), 4)).tolist() for _ in range(2)]
    return [
        (strokes(speeds[0], longest=0.8, dwell=0.1), 3e5, 2e5), (reciprocation(amplitude=0.4e-3, turning=0.04), 1e5, 4e5),
        (strokes(speeds[1][:2], longest=0.8, dwell=1.0), 5e5, 1e5), (strokes(speeds[1], longest=0.8, dwell=0.4), 4e5, 3e5),
        (sine(amplitude=rng.uniform(0.02, 0.08), frequency=rng.uniform(0.3, 1.0), cycles=3), 2e5, 5e5),
    ]  # fmt: skip


def _motions_within(seed: int) -> list[tuple[Motion, float, float]]:
    """The same with held-out runs whose places, speeds and pressures lie inside the range of the training ones."""
    rng = np.random.default_rng((seed, 7))
    trained, unseen = (np.exp(rng.uniform(np.log(5e-4), np.log(FASTEST), 4)).tolist() for _ in range(2))
    amplitude, frequency = rng.uniform(0.02, 0.08), rng.uniform(0.3, 1.0)
    frequency = min(frequency, 0.95 * FASTEST / (2 * np.pi * amplitude))
    return [
        (strokes([*trained[:3], FASTEST], longest=1.5, dwell=0.1), 3e5, 2.5e5),
        (reciprocation(amplitude=0.4e-3, turning=0.04), 1e5, 4e5),
        (strokes([trained[3], FASTEST], longest=1.5, dwell=1.0), 5e5, 1e5),
        (strokes(unseen, longest=0.8, dwell=0.4), 4e5, 3e5),
        (sine(amplitude=amplitude, frequency=frequency, cycles=3), 2e5, 2e5),
    ]  # fmt: skip


def bench_runs(case: Case) -> tuple[list[Recording], list[Recording], Rig]:
    """Training runs, held-out runs and the rig file of a bench case."""
    drawn = bench_rig(case)
    plan = {"varied": drawn_motions, "within": _motions_within}.get(case.category, _motions)(case.seed)
    rig = Rig.from_dict(tomllib.loads(drawn.rig_toml("coulomb" if case.names and case.names[0] in LAWS else "lugre")))
    hidden = hidden_of(case, drawn.truth.bore)
    runs = [
        Recording.from_arrays(
            f"bench_{i}.csv", rig,
            **record_bench(
                drawn.truth, p1 + ATMOSPHERE, p2 + ATMOSPHERE, motion, hidden, case.seed * 100 + i, sensors=drawn.sensors
            ),
        )
        for i, (motion, p1, p2) in enumerate(plan)
    ]  # fmt: skip
    return runs[:TRAINING], runs[TRAINING:], rig


def runs_of(case: Case) -> tuple[list[Recording], list[Recording], Rig]:
    """Training runs, held-out runs and the rig file of a case."""
    return bench_runs(standing(case)) if on_bench(case) else servo_runs(case)


def standing(case: Case) -> Case:
    """The case with the size of its bench, where it names none."""
    return replace(case, rig="default") if case.rig == "bench" else case
