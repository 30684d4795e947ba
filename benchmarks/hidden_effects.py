"""Hidden effects: does the diagnosis name what the virtual rig hides, and keep quiet where nothing is hidden.

    python benchmarks/hidden_effects.py --list
    python benchmarks/hidden_effects.py --seeds 5 --null 100 --workers 2 --out benchmarks/results/hidden_effects.jsonl
    python benchmarks/hidden_effects.py --only gravity backlash pair --seeds 2 --budget 1800

Each case records three training and two held-out runs with noise and quantisation on the independent virtual rig, whose
effects have forms unlike the catalogue's, fits the base model, diagnoses, and writes one line. One mix of excitations
serves every case but the varied ones, null cases included: multisine, moves to the ends with rests of 0.05 to 2 s, slow
ramps. Categories:

- ``servo``: each effect, weak and strong, at the default bore, half and twice of it
- ``bench``: the same on the friction bench, friction laws that are too simple included; held-out speeds and pressures leave the
  range of the training runs. ``within``: the same benches with held-out runs that stay inside it, as the guide asks
- ``varied``: each effect with rig, excitations, strength and form drawn at random (``varied_cases.py``)
- ``pair``: two effects at once; ``drawn pair``: any two that are not easily confused, drawn at random, at the bores of
  ``servo``
- ``outside``: effects that the catalogue does not hold
- ``null``: random rigs (bore 10 to 200 mm, 0.1 to 100 kg, 100 Hz to 10 kHz) and the default one, nothing hidden; ``sheet``: the
  same with mass, dead volumes and critical ratio some 3 % off in the rig file, where naming just these is no false alarm

A run can be stopped and started again: a case is kept while the product's source stays as it is. Hidden effects without an
entry in the catalogue are counted and skipped. Counts, not rates, are printed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from hidden_counts import SHEET_ERROR, table
from varied_cases import Run, drawn_bench, drawn_hidden, drawn_motions, drawn_plan, drawn_servo

from pneuid import api
from pneuid.criticism.decision.verdict import diagnose
from pneuid.criticism.unknown.rest import explained
from pneuid.effects import CATALOGUE, LAW_STEPS
from pneuid.errors import ComputationError, UserError
from pneuid.estimation.fit import fit
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
    Friction,
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

DRAWN = 1000
"""Seeds of varied cases per seed of the benchmark."""

FASTEST = 0.15
"""Highest speed on the bench, m/s, but for the sines of ``bench``."""

TRAINING = 3
TOP_SUPPLY = 7e5  # Pa gauge, of the rigs that are not drawn at random
KNOWN = CATALOGUE | LAW_STEPS
"""All that the diagnosis chooses from."""

BORES = {"default": 0.032, "half": 0.016, "double": 0.064}
LAWS = {
    "law:lugre": Friction(),
    "law:dahl": Friction(Fc=20.0, Fs=20.0, sigma0=1.5e5, sigma1=0.0),
    "law:stribeck": Friction(sigma0=2.0e7, sigma1=0.0),
}
"""True friction of benches whose rig file says coulomb."""

PAIRS = (
    ("gravity", "leakage_internal"), ("friction_pressure", "valve_dead_zone"), ("friction_direction", "load_spring"),
    ("supply_droop", "load_mass"), ("valve_offset", "leakage_external_2"), ("friction_position", "heat_transfer"),
    ("valve_hysteresis", "friction_viscous_nonlinear"), ("friction_warmup", "exhaust_restriction"),
    ("end_cushion", "valve_asymmetry"), ("line_delay", "friction_pressure"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One case: the category, the rig, what hides in it, how strongly, and the seed."""

    category: str
    rig: str
    names: tuple[str, ...]
    level: str
    seed: int

    @property
    def key(self) -> str:
        """The case in one word."""
        return "/".join((self.category, self.rig, "+".join(self.names) or "none", self.level, str(self.seed)))


def cases(seeds: Sequence[int], nulls: Sequence[int]) -> Iterator[Case]:
    """Every case, spread so that a part of them already covers all effects."""
    for i, seed in enumerate(seeds):
        for level in ("strong", "weak"):
            size = tuple(BORES)[(i + (level == "weak")) % len(BORES)]
            yield from (Case("servo", size, (name,), level, seed) for name in HIDDEN_EFFECTS)
            yield from (Case(bench, size, (name,), level, seed) for bench in ("bench", "within") for name in BENCH_EFFECTS)
        yield from (Case("bench", "default", (law,), "strong", seed) for law in LAWS)
        yield from (Case("varied", "random", (name,), "drawn", _own(seed, j)) for j, name in enumerate(HIDDEN_EFFECTS))
        yield from (Case("varied", "random bench", (name,), "drawn", _own(seed, j)) for j, name in enumerate(BENCH_EFFECTS))
        yield from (Case("varied", rig, (), "none", _own(seed, 100)) for rig in ("random", "random bench"))
        yield from (Case("pair", "default", pair, ("strong", "weak")[i % 2], seed) for pair in PAIRS)
        yield from (
            Case("drawn pair", tuple(BORES)[(i + j) % len(BORES)], pair, ("strong", "weak")[j % 2], seed)
            for j, pair in enumerate(drawn_pairs(seed))
        )
        for name, item in OUTSIDE_EFFECTS.items():
            yield from (Case("outside", rig, (name,), ("strong", "weak")[i % 2], seed) for rig in item.rigs)
    for i, seed in enumerate(nulls):
        yield Case("null", ("random", "random", "random bench", "default")[i % 4], (), "none", seed)
        if i % 5 == 0:
            yield Case("sheet", "random", (), "none", seed)


def drawn_pairs(seed: int) -> list[tuple[str, str]]:
    """Pairs of effects, none of which names the other as what it is easily confused with."""
    apart = [
        (one, other) for one, other in combinations(HIDDEN_EFFECTS, 2) if not CATALOGUE[one].resembles(CATALOGUE[other])
    ]
    rng = np.random.default_rng((seed, 17))
    return [apart[i] for i in rng.choice(len(apart), len(PAIRS), replace=False)]


def _own(seed: int, number: int) -> int:
    """A seed of its own for each varied case, so that every one has another rig."""
    return seed * DRAWN + number


def in_catalogue(case: Case) -> bool:
    """Whether the catalogue holds all that the case hides, or need not."""
    return case.category == "outside" or all(name in KNOWN for name in case.names)


# --- one case ---


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


def on_bench(case: Case) -> bool:
    """Whether the case stands on the friction bench."""
    return case.category in ("bench", "within") or case.rig.endswith("bench")


def runs_of(case: Case) -> tuple[list[Recording], list[Recording], Rig]:
    """Training runs, held-out runs and the rig file of a case."""
    return bench_runs(standing(case)) if on_bench(case) else servo_runs(case)


def standing(case: Case) -> Case:
    """The case with the size of its bench, where it names none."""
    return replace(case, rig="default") if case.rig == "bench" else case


def solve(case: Case) -> dict[str, Any]:
    """One case from recording to verdict, as a line of the result file."""
    warnings.simplefilter("ignore")
    row: dict[str, Any] = {"key": case.key, **asdict(case), "names": list(case.names)}
    began = time.monotonic()
    try:
        train, held, rig = runs_of(case)
        base = fit(api.plant_of(rig), train)
        found = explained(diagnose(base, held, KNOWN), held)
    except (UserError, ComputationError, RuntimeError, ValueError) as error:
        return row | {"verdict": "failed", "effects": [], "said": str(error)[:200], "seconds": time.monotonic() - began}
    diagnosis = found.diagnosis
    floor = found.rungs[-1].noise_floor
    errors = [
        float(np.sqrt(np.mean([(rung.hold_out[s] / floor[s]) ** 2 for s in floor])))
        for rung in found.rungs
        if rung.accepted
    ]
    return row | {
        "verdict": diagnosis.verdict, "effects": list(diagnosis.effects),
        "unknown": None if diagnosis.unknown is None else
            {"equation": diagnosis.unknown.equation, "depends_on": list(diagnosis.unknown.depends_on)},
        "error_before": errors[0], "error_after": errors[-1],
        "explained": (errors[0] ** 2 - errors[-1] ** 2) / max(errors[0] ** 2 - 1.0, 1e-9),
        "screen": {item.effect: item.screen_gain for item in diagnosis.ranking[:4]}, "said": list(diagnosis.sentences),
        "seconds": time.monotonic() - began,
    }  # fmt: skip


# --- the run ---


def source_hash() -> str:
    """Digest of all that a verdict depends on: the product's source and this file."""
    files = [*sorted((Path(__file__).parents[1] / "pneuid").rglob("*.py")), Path(__file__)]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def wanted(given: argparse.Namespace) -> list[Case]:
    """The cases that the command line asks for, those without a catalogue entry left out and counted."""
    first = given.first_seed
    every = list(cases(range(first, first + given.seeds), range(first, first + given.null)))
    if given.only:
        every = [case for case in every if set(given.only) & {case.category, case.rig, *case.names}]
    skipped = Counter(name for case in every if not in_catalogue(case) for name in case.names if name not in KNOWN)
    if skipped:
        print(
            "no catalogue entry yet, cases skipped: " + ", ".join(f"{name} {n}" for name, n in sorted(skipped.items()))
        )
    known = [case for case in every if in_catalogue(case)]
    if given.sample is None:
        return known
    drawn = np.random.default_rng(first).permutation(len(known))[: given.sample]
    return [known[i] for i in drawn]


def run(todo: Sequence[Case], given: argparse.Namespace, stamp: str, rows: list[dict[str, Any]]) -> None:
    """Work through ``todo`` until it is done or the budget is spent, one line per case into the result file."""
    ends = time.monotonic() + given.budget
    queue = iter(todo)
    pending: set[Future[dict[str, Any]]] = set()
    with ProcessPoolExecutor(given.workers) as pool, given.out.open("a", encoding="utf-8") as file:
        while True:
            while len(pending) < given.workers and time.monotonic() < ends and (case := next(queue, None)):
                pending.add(pool.submit(solve, case))
            if not pending:
                break
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            for job in done:
                row = {**job.result(), "source": stamp}
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()
                sizes = (
                    f"{row['error_before']:.2f} -> {row['error_after']:.2f} floors"
                    if "explained" in row
                    else row["said"]
                )
                print(
                    f"{row['key']:60s} {row['verdict']:9s} {row['effects']} {sizes}, {row['seconds']:.0f} s", flush=True
                )


def main() -> None:
    """Run the cases that are not in the result file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="seeds per effect and strength")
    parser.add_argument("--null", type=int, default=100, help="rigs without a hidden effect")
    parser.add_argument("--first-seed", type=int, default=1001)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="categories, effects or rigs to run")
    parser.add_argument("--sample", type=int, metavar="N", help="only N of the cases, drawn at random")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--budget", type=float, default=float("inf"), metavar="SECONDS", help="start no case after this"
    )
    parser.add_argument("--list", action="store_true", help="count the cases and stop")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/hidden_effects.jsonl"))
    given = parser.parse_args()
    chosen, stamp = wanted(given), source_hash()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    kept = [json.loads(line) for line in given.out.read_text("utf-8").splitlines()] if given.out.exists() else []
    by_key = {row["key"]: row for row in kept if row["source"] == stamp}
    rows = [by_key[case.key] for case in chosen if case.key in by_key]
    todo = [case for case in chosen if case.key not in by_key]
    print(f"{len(chosen)} cases, {len(rows)} of them done by this source ({stamp})")
    if given.list:
        counts = Counter((case.category, "+".join(case.names) or case.rig) for case in chosen)
        print("\n".join(f"  {category:8s} {name:44s} {count:4d}" for (category, name), count in counts.items()))
        return
    run(todo, given, stamp, rows)
    if rows:
        print(table(rows))


if __name__ == "__main__":
    main()
