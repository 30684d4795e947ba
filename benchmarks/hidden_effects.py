"""Hidden effects: does the diagnosis name what the virtual rig hides, and keep quiet where nothing is hidden.

    python benchmarks/hidden_effects.py --seeds 5 --null 20 --workers 2 --out benchmarks/results/hidden_effects.jsonl

Each case records three training and two held-out runs of 6 s at 1 kHz with noise and quantisation on the independent
virtual rig, whose effects have forms unlike the catalogue's, fits the base model, diagnoses, and writes one line. A
run can be stopped and started again: finished cases are kept. Strengths alternate between weak and strong by seed.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
import pandas as pd

from controllers.measure import measured_runs
from pneuid import api
from pneuid.criticism.decision import diagnose
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import fit
from pneuid.virtual_rig import HIDDEN_EFFECTS, NOTHING, TruthServo


def case(hidden_name: str, strength: str, seed: int) -> dict:
    """One case from recording to verdict."""
    warnings.simplefilter("ignore")
    hidden = HIDDEN_EFFECTS[hidden_name][strength] if hidden_name != "none" else NOTHING
    runs = measured_runs(TruthServo(), hidden, seed)
    began = time.monotonic()
    base = fit(api.plant_of(runs.rig), runs.train, exact=False)
    found = diagnose(base, runs.hold_out, CATALOGUE)
    diagnosis = found.diagnosis
    rungs = [rung for rung in found.rungs if rung.accepted]
    floor = found.rungs[-1].noise_floor
    errors = [float(np.sqrt(np.mean([(rung.hold_out[s] / floor[s]) ** 2 for s in floor]))) for rung in rungs]
    return {
        "hidden": hidden_name, "strength": strength, "seed": seed, "verdict": diagnosis.verdict,
        "effects": list(diagnosis.effects), "first": diagnosis.ranking[0].effect if diagnosis.ranking else None,
        "group": list(diagnosis.ranking[0].indistinguishable_from) if diagnosis.ranking else [],
        "error_before": errors[0], "error_after": errors[-1],
        "explained": (errors[0] ** 2 - errors[-1] ** 2) / max(errors[0] ** 2 - 1, 1e-9),
        "screen": {item.effect: item.screen_gain for item in diagnosis.ranking[:4]}, "seconds": time.monotonic() - began,
    }  # fmt: skip


def table(rows: list[dict]) -> str:
    """Counts per hidden effect."""
    frame = pd.DataFrame(rows)
    lines = [
        f"{'hidden':22s} {'cases':>5s} {'exact':>5s} {'first':>5s} {'ambig.':>6s} {'explained (median, least)':>26s} {'s':>4s}"
    ]
    for name, part in frame.groupby("hidden", sort=False):
        null = name == "none"
        exact = sum(r["verdict"] == "adequate" if null else r["effects"] == [name] for _, r in part.iterrows())
        first = 0 if null else sum(bool(r["effects"]) and r["effects"][0] == name for _, r in part.iterrows())
        ambiguous = int((part.verdict == "ambiguous").sum())
        share = "" if null else f"{part.explained.median():.3f}, {part.explained.min():.3f}"
        lines.append(
            f"{name:22s} {len(part):5d} {exact:5d} {first:5d} {ambiguous:6d} {share:>26s} {part.seconds.median():4.0f}"
        )
    hidden, null = frame[frame.hidden != "none"], frame[frame.hidden == "none"]
    right = sum(bool(r["effects"]) and r["effects"][0] == r["hidden"] for _, r in hidden.iterrows())
    lines.append(
        f"right effect first: {right} of {len(hidden)}; false alarms: {int((null.verdict != 'adequate').sum())} of {len(null)}"
    )
    return "\n".join(lines)


def main() -> None:
    """Run the cases that are not in the result file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--null", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/hidden_effects.jsonl"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {(row["hidden"], row["strength"], row["seed"]) for row in rows}
    seeds = range(given.first_seed, given.first_seed + max(given.seeds, given.null))
    wanted = [(name, ("strong", "weak")[seed % 2], seed) for seed in seeds[: given.seeds] for name in HIDDEN_EFFECTS]
    wanted += [("none", "strong", seed) for seed in seeds[: given.null]]
    with ProcessPoolExecutor(given.workers) as pool, given.out.open("a") as file:
        for job in as_completed([pool.submit(case, *item) for item in wanted if item not in done]):
            row = job.result()
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(
                f"{row['hidden']:22s} {row['strength']:6s} {row['seed']:3d} {row['verdict']:9s} {row['effects']} "
                f"{row['error_before']:.2f} -> {row['error_after']:.2f} floors, {row['seconds']:.0f} s",
                flush=True,
            )
    print(table(rows))


if __name__ == "__main__":
    main()
