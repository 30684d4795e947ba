"""The identification's figures: coverage of its intervals, starts far off, rigs of every size, cost over samples.

    python benchmarks/identification.py coverage --seeds 1 40 --out benchmarks/results/coverage.jsonl
    python benchmarks/identification.py starts --factor 5 --seeds 1 50
    python benchmarks/identification.py rigs --seeds 1 60
    python benchmarks/identification.py scaling --samples 5000 20000 100000

Data come from the independent virtual rig (``scaling``: too), with noise and quantisation. ``--out`` gets a line per case; a
case that is in it already is not run again.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from timeit import repeat
from typing import Any

import numpy as np
from compare_straightforward import RIG

from pneuid import api
from pneuid.compiled import compile_functions
from pneuid.errors import ComputationError, UserError
from pneuid.estimation.fit import Fit, fit
from pneuid.interval import _chains
from pneuid.mapped import Mapped
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import ATMOSPHERE, NOTHING, TruthServo, random_servo, record_servo

PLAN = (("multisine", 5e5), ("steps", 7e5), ("slow", 6e5))
Row = dict[str, Any]


def stand(conductance: float = 1.0e-8) -> Rig:
    """The usual rig; the conductance on its sheet is a start value."""
    valve = {**RIG["valve"], "conductance": f"{conductance!r} m^3/(s*Pa)"}
    runs = {f"r{i}.csv": {"supply": f"{supply!r} Pa"} for i, (_, supply) in enumerate(PLAN)}
    return Rig.from_dict({**RIG, "valve": valve, "runs": runs})


def records(rig: Rig, seed: int, seconds: float) -> list[Recording]:
    """Three runs of the usual rig."""
    return [
        Recording.from_arrays(
            f"r{i}.csv", rig,
            **record_servo(TruthServo(), NOTHING, kind, seconds, 1000 * seed + i, supply=supply + ATMOSPHERE),
        )
        for i, (kind, supply) in enumerate(PLAN)
    ]  # fmt: skip


def truth() -> dict[str, float]:
    """What hides behind the sensors."""
    rig = TruthServo()
    names = ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")
    return {name: getattr(rig.friction, name) for name in names} | {"n": rig.polytropic, "C": rig.conductance}


# --- coverage ---


def coverage(seed: int, given: argparse.Namespace) -> Row:
    """Distance of each parameter from the truth in its own standard errors, one row per seed."""
    rig = stand()
    found = fit(Plant(rig, "lugre"), records(rig, seed, given.seconds))
    row: Row = {"seed": seed, "stage": found.stage, "chi2": found.cost_per_sample, "seconds": found.seconds}
    if found.spread is not None:
        pairs = zip(found.problem.free, found.spread.std, strict=True)
        row["z"] = {name: (found.values[name] - truth()[name]) / std if std > 0 else None for name, std in pairs}
        row["verdicts"] = found.verdicts
    return row


def coverage_table(rows: list[Row]) -> str:
    """Counts within the 95 % interval, pooled and per parameter."""
    exact = [row for row in rows if "z" in row]
    lines = [f"{len(rows)} seeds, {len(exact)} exact", f"{'parameter':10s} {'inside':>8s} {'mean z':>8s} {'std z':>8s}"]
    inside = total = 0
    for name in truth():
        z = np.array([row["z"][name] for row in exact if row["verdicts"][name] == "well determined"])
        if z.size == 0:
            continue
        hit = int(np.count_nonzero(np.abs(z) < 1.96))
        inside, total = inside + hit, total + z.size
        lines.append(f"{name:10s} {hit:4d}/{z.size:<4d} {z.mean():7.2f} {z.std():8.2f}")
    lines.append(f"pooled     {inside:4d}/{total:<4d} {inside / max(total, 1):7.3f}")
    return "\n".join(lines)


# --- starts far off ---


def starts(seed: int, given: argparse.Namespace) -> Row:
    """One fit from starts off by up to the factor, all parameters at once, beside one from the product's own guess."""
    rig = stand()
    plant, runs = Plant(rig, "lugre"), records(rig, 1, given.seconds)
    best = fit(plant, runs) if not hasattr(given, "best") else given.best
    given.best = best
    rng = np.random.default_rng((seed, int(1000 * given.factor)))
    start = {
        item.name: float(np.clip(best.values[item.name] * given.factor ** rng.uniform(-1, 1), item.lower, item.upper))
        for item in plant.parameters
    }
    found = fit(plant, runs, start)
    ratio = found.cost_per_sample / best.cost_per_sample
    return {
        "seed": seed, "factor": given.factor, "stage": found.stage, "best": best.cost_per_sample,
        "cost": found.cost_per_sample, "reached": found.stage == best.stage and ratio < 1.001, "seconds": found.seconds,
    }  # fmt: skip


def starts_table(rows: list[Row]) -> str:
    """How many reach the best cost within 0.1 %."""
    lines = []
    for factor in sorted({row["factor"] for row in rows}):
        part = [row for row in rows if row["factor"] == factor]
        reached = sum(row["reached"] for row in part)
        lines.append(f"factor {factor:g}: {reached} of {len(part)} reach the best cost within 0.1 %")
        lines += [f"   seed {row['seed']}: {row['stage']}, {row['cost']:.5f}" for row in part if not row["reached"]]
    return "\n".join(lines)


# --- rigs of every size ---


def rigs(seed: int, given: argparse.Namespace) -> Row:
    """One random rig: fitted, refused in words, or relaxed with a reason; errors of the well determined parameters."""
    drawn = random_servo(seed, 0.0)
    top = drawn.truth.supply - ATMOSPHERE
    plan = (("multisine", 0.6), ("travel", 1.0), ("slow", 0.8))
    supplies = {f"r{i}.csv": share * top for i, (_, share) in enumerate(plan)}
    rig = Rig.from_dict(tomllib.loads(drawn.rig_toml(supplies)))
    duration = float(np.clip(given.seconds, 1000.0 / drawn.rate, max(2.0, 12000.0 / drawn.rate)))
    row: Row = {"seed": seed, "bore": drawn.truth.bore, "mass": drawn.truth.mass, "rate": drawn.rate}
    began = time.monotonic()
    try:
        runs = [
            Recording.from_arrays(
                f"r{i}.csv", rig,
                **record_servo(drawn.truth, NOTHING, kind, duration, 10 * seed + i, supply=share * top + ATMOSPHERE,
                               rate=drawn.rate, sensors=drawn.sensors),
            )
            for i, (kind, share) in enumerate(plan)
        ]  # fmt: skip
        found = fit(api.plant_of(rig), runs)
    except (UserError, ComputationError) as error:
        return row | {"end": "refused", "said": str(error), "seconds": time.monotonic() - began}
    return row | {
        "end": found.stage, "said": found.status, "chi2": found.cost_per_sample, "errors": _errors(found, drawn.truth),
        "seconds": time.monotonic() - began,
    }  # fmt: skip


def _errors(found: Fit, of: TruthServo) -> dict[str, list[float]]:
    """Relative error and its size in standard errors of what is said to be well determined."""
    if found.spread is None:
        return {}
    known = {name: getattr(of.friction, name, None) for name in found.problem.free}
    known |= {"n": of.polytropic, "C": of.conductance}
    return {
        name: [found.values[name] / value - 1.0, (found.values[name] - value) / std]
        for name, std in zip(found.problem.free, found.spread.std, strict=True)
        if found.verdicts[name] == "well determined" and (value := known[name])
    }


def rigs_table(rows: list[Row]) -> str:
    """How each rig ended, and how right the well determined parameters are."""
    ends = Counter(row["end"] for row in rows)
    lines = [f"{len(rows)} rigs: " + ", ".join(f"{end} {count}" for end, count in ends.items())]
    errors = [pair for row in rows for pair in row.get("errors", {}).values()]
    if errors:
        relative, z = np.abs(np.array(errors)).T
        lines.append(
            f"well determined parameters: {len(errors)}, error median {100 * np.median(relative):.2f} %, 95th percentile "
            f"{100 * np.percentile(relative, 95):.1f} %; inside their 95 % interval {np.count_nonzero(z < 1.96)}"
        )
    lines.append(f"longest {max(row['seconds'] for row in rows):.0f} s")
    lines += [
        f"   {row['seed']}: bore {1e3 * row['bore']:.0f} mm, {row['rate']:.0f} Hz: {row['said']}"
        for row in rows
        if row["end"] != "exact"
    ]
    return "\n".join(lines)


# --- cost over samples ---


def held() -> int:
    """Memory that this process holds now, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def peak() -> int:
    """Most memory that it ever held, bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def scaling(samples: int, _: argparse.Namespace) -> Row:
    """A warm fit of so many samples, in forward simulations of the same data by the compiled model.

    forward : as a recording is simulated from its start, one interval after the other; lanes : all intervals side by side.
    memory : bytes per sample that the fit takes on top of the recordings; an upper bound where an earlier case took more.
    """
    rig = stand()
    plant, runs = Plant(rig, "lugre"), records(rig, 1, samples / 3000.0)
    before = held()
    fit(plant, runs)  # compiles: a long record needs other functions than a short one
    began, cpu = time.perf_counter(), time.process_time()
    found = fit(plant, runs)
    wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    memory = (peak() - before) / samples
    problem, X = found.problem, found.relaxed.X
    q, nodes = problem.split(X)
    chain = _chains(plant, (), problem.samples, problem.substeps)["values"]()
    in_turn = Mapped(compile_functions([chain], "pneuid_forward")[0][0], problem.nint)
    once = min(repeat(lambda: in_turn(nodes, problem.data, problem.theta(q)), number=1, repeat=5))
    beside = min(repeat(lambda: problem.evaluate_values(X), number=1, repeat=5))
    return {
        "samples": samples, "stage": found.stage, "seconds": wall, "cpu": cpu, "forward": once, "lanes": beside,
        "memory": memory, "forwards": wall / once, "substeps": [problem.substeps, found.substeps],
        "solving": found.relaxed.seconds + (found.exact.seconds if found.exact else 0.0),
    }  # fmt: skip


def scaling_table(rows: list[Row]) -> str:
    """Seconds and forward simulations per fit."""
    return "\n".join(
        f"{row['samples']:8d} samples: {row['stage']}, {row['seconds']:.2f} s = {row['forwards']:.0f} forward simulations "
        f"of {1e3 * row['forward']:.1f} ms ({1e3 * row['lanes']:.1f} ms side by side); "
        f"{1e6 * row['seconds'] / row['samples']:.1f} us and {1e-3 * row['memory']:.1f} kB per sample"
        for row in rows
    )


# --- the run ---

STUDIES: dict[str, tuple[Callable[[int, argparse.Namespace], Row], Callable[[list[Row]], str]]] = {
    "coverage": (coverage, coverage_table),
    "starts": (starts, starts_table),
    "rigs": (rigs, rigs_table),
    "scaling": (scaling, scaling_table),
}


def done(path: Path | None) -> Iterator[Row]:
    """Rows that the result file has already."""
    if path is not None and path.exists():
        yield from (json.loads(line) for line in path.read_text("utf-8").splitlines())


def main() -> None:
    """Run one study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=tuple(STUDIES))
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 10), metavar=("FIRST", "LAST"))
    parser.add_argument("--samples", type=int, nargs="+", default=[5000, 20000, 100000])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of a run")
    parser.add_argument("--factor", type=float, default=2.0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    solve, table = STUDIES[given.study]
    key = "samples" if given.study == "scaling" else "seed"
    wanted = given.samples if given.study == "scaling" else range(given.seeds[0], given.seeds[1] + 1)
    rows = [row for row in done(given.out) if row[key] in wanted and row.get("factor", given.factor) == given.factor]
    for case in wanted:
        if case in {row[key] for row in rows}:
            continue
        rows.append(solve(case, given))
        shown = {name: value for name, value in rows[-1].items() if name not in ("z", "verdicts", "errors")}
        print(json.dumps(shown), flush=True)
        if given.out is not None:
            with given.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
