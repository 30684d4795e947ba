"""The riskiest assumption: what the relaxed and the exact stage do when the model is wrong.

    python benchmarks/wrong_model.py --seeds 3 --out benchmarks/results/wrong_model.jsonl

Ten hidden effects of the virtual rig, forms unlike the catalogue's, and the same with nothing hidden. The base model is
fitted by the relaxed stage; then the exact stage is run regardless of the gate, so that the table shows what the gate
spares the user.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

from controllers.measure import measured_runs
from pneuid import api
from pneuid.estimation.fit import fit
from pneuid.estimation.solver import solve_exact
from pneuid.physics.smoothing import FINE
from pneuid.virtual_rig import HIDDEN_EFFECTS, NOTHING, Hidden, TruthServo

CASES = {"none": NOTHING} | {name: levels["strong"] for name, levels in HIDDEN_EFFECTS.items()}
CASES |= {"valve_lag": Hidden(valve_lag=0.004), "friction_viscous_nonlinear": Hidden(friction_viscous_nonlinear=0.6)}


def case(name: str, seed: int) -> dict:
    """Both stages on one recording set."""
    runs = measured_runs(TruthServo(), CASES[name], seed)
    relaxed = fit(api.plant_of(runs.rig), runs.train, exact=False)
    problem = relaxed.problem
    problem.set_smoothing(FINE)
    began = time.monotonic()
    exact = solve_exact(problem, relaxed.relaxed.X)
    links = max(problem.linked.size * problem.ns, 1)
    return {
        "hidden": name, "seed": seed, "relaxation": problem.relaxation, "relaxed": relaxed.relaxed.status,
        "relaxed_s": round(relaxed.relaxed.seconds, 2), "misfit": relaxed.cost_per_sample,
        # in units of the tight allowance, whatever the level solved
        "jumps": float(np.sqrt(relaxed.defect_level)) * problem.relaxation / 0.1,
        "exact": exact.status, "exact_misfit": 2 * exact.cost / max(problem.weighted, 1),
        "exact_jumps": float(np.sqrt(2 * exact.penalty / links)), "exact_its": exact.iterations,
        "exact_s": round(time.monotonic() - began, 2),
    }  # fmt: skip


def main() -> None:
    """Run what is not in the result file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/wrong_model.jsonl"))
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {(row["hidden"], row["seed"]) for row in rows}
    warnings.simplefilter("ignore")
    with given.out.open("a") as file:
        for seed in range(1, given.seeds + 1):
            for name in CASES:
                if (name, seed) not in done:
                    rows.append(case(name, seed))
                    file.write(json.dumps(rows[-1]) + "\n")
                    file.flush()
    print(pd.DataFrame(rows).sort_values(["hidden", "seed"]).to_string(index=False, float_format=lambda x: f"{x:.3g}"))


if __name__ == "__main__":
    main()
