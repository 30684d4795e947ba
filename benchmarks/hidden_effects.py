"""Hidden effects: does the diagnosis name what the virtual rig hides, and keep quiet where nothing is hidden?

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

from pneuid import Recording, Rig, api
from pneuid.criticism.decision import diagnose
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import fit
from pneuid.virtual_rig import ATMOSPHERE, HIDDEN_EFFECTS, NOTHING, TruthServo, record_servo

RUNS = (("multisine", 3.0), ("steps", 5.0), ("slow", 7.0), ("multisine", 5.0), ("steps", 7.0))
"""Excitation and supply (bar gauge): three to train, two held out."""


def rig_of(truth: TruthServo, supplies: dict[str, float]) -> Rig:
    """What the engineer knows: dimensions from the data sheet, the valve's conductance 20 % off."""
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
                "conductance": f"{truth.conductance * 0.8!r} m^3/(s*Pa)", "critical_ratio": truth.critical_ratio,
                "full_scale": f"{truth.full_scale!r} V", "null": f"{truth.null!r} V",
            },
            "supply": {"pressure": "600 kPa"},
            "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
            "runs": {name: {"supply": f"{bar * 100!r} kPa"} for name, bar in supplies.items()},
        }
    )  # fmt: skip


def record(hidden_name: str, strength: str, seed: int) -> tuple[Rig, list[Recording]]:
    """The five runs of one case."""
    truth = TruthServo()
    hidden = HIDDEN_EFFECTS[hidden_name][strength] if hidden_name != "none" else NOTHING
    names = [f"run_{i}.csv" for i in range(len(RUNS))]
    rig = rig_of(truth, {name: bar for name, (_, bar) in zip(names, RUNS, strict=True)})
    runs = []
    for i, (name, (excitation, bar)) in enumerate(zip(names, RUNS, strict=True)):
        made = record_servo(truth, hidden, excitation, 6.0, seed * 100 + i, supply=bar * 1e5 + ATMOSPHERE)
        runs.append(Recording.from_arrays(name, rig, **made))
    return rig, runs


def case(hidden_name: str, strength: str, seed: int) -> dict:
    """One case from recording to verdict."""
    warnings.simplefilter("ignore")
    rig, runs = record(hidden_name, strength, seed)
    began = time.monotonic()
    base = fit(api.plant_of(rig), runs[:3], exact=False)
    found = diagnose(base, runs[3:], CATALOGUE)
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
    lines = [f"{'hidden':22s} {'cases':>5s} {'exact':>5s} {'first':>5s} {'ambig.':>6s} {'explained (median, least)':>26s} {'s':>4s}"]
    for name, part in frame.groupby("hidden", sort=False):
        null = name == "none"
        exact = sum(r["verdict"] == "adequate" if null else r["effects"] == [name] for _, r in part.iterrows())
        first = 0 if null else sum(bool(r["effects"]) and r["effects"][0] == name for _, r in part.iterrows())
        ambiguous = int((part.verdict == "ambiguous").sum())
        share = "" if null else f"{part.explained.median():.3f}, {part.explained.min():.3f}"
        lines.append(f"{name:22s} {len(part):5d} {exact:5d} {first:5d} {ambiguous:6d} {share:>26s} {part.seconds.median():4.0f}")
    hidden, null = frame[frame.hidden != "none"], frame[frame.hidden == "none"]
    right = sum(bool(r["effects"]) and r["effects"][0] == r["hidden"] for _, r in hidden.iterrows())
    lines.append(f"right effect first: {right} of {len(hidden)}; false alarms: {int((null.verdict != 'adequate').sum())} of {len(null)}")
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
            print(f"{row['hidden']:22s} {row['strength']:6s} {row['seed']:3d} {row['verdict']:9s} {row['effects']} "
                  f"{row['error_before']:.2f} -> {row['error_after']:.2f} floors, {row['seconds']:.0f} s", flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
