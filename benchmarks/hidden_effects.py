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
import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from hidden_cases import KNOWN, Case, cases, in_catalogue
from hidden_counts import table
from hidden_runs import runs_of

from pneuid import api
from pneuid.criticism.decision.rest import explained
from pneuid.criticism.decision.verdict import diagnose
from pneuid.errors import ComputationError, UserError
from pneuid.estimation.fit import fit


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
    """Digest of all that a verdict depends on: the product's source, and what makes the cases and their recordings."""
    here = Path(__file__).parent
    own = [here / f"{name}.py" for name in ("hidden_effects", "hidden_cases", "hidden_runs", "varied_cases")]
    files = [*sorted((here.parent / "pneuid").rglob("*.py")), *own]
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
