"""The 2011 study on the virtual bench by both routes, over seeds of the sensors' noise.

    python benchmarks/study_2011.py --seeds 1 2 3

Per seed: every coefficient of both routes against the truth, in percent and in standard errors, and the pressure pair kept
out of the fit against the noise-free curve over 0.5 to 150 mm/s. Goals: joint fit within 3 standard errors and 5 %,
unseen pair within 0.5 N.
"""

from __future__ import annotations

import argparse

from pneuid.bench import both_routes, true_coefficients, virtual_runs
from pneuid.report.study_report import verification_errors
from pneuid.virtual_rig import TruthBench
from pneuid.virtual_rig.bench import STUDY_PRESSURES, STUDY_UNSEEN, study_motions


def one_seed(seed: int) -> None:
    """Record, identify by both routes, print the errors."""
    bench = TruthBench()
    truth = true_coefficients(bench.friction)
    runs = virtual_runs(bench, seed, STUDY_PRESSURES, STUDY_UNSEEN, study_motions())
    outcome = both_routes(runs, f"seed {seed}", truth=truth)
    fit = outcome.model.fit
    print(
        f"seed {seed}: {fit.stage}, cost per sample {fit.cost_per_sample:.4f}, {fit.iterations} iterations", flush=True
    )
    classic = outcome.study.coefficients()
    for name, true in truth.items():
        value, std = outcome.result.joint[name]
        joint = f"{100 * (value / true - 1):+7.2f} % {(value - true) / std if std else float('nan'):+6.1f} std"
        own = classic.get(name)
        words = "not seen"
        if own is not None:
            words = f"{100 * (own.value / true - 1):+7.2f} % {(own.value - true) / own.std:+6.1f} std"
        print(f"  {name:7s} classic {words}; joint {joint}")
    for entry in verification_errors(outcome.result):
        print(
            f"  unseen pair, {entry['route']}: {entry['points']:.3f} N of the points, {entry['truth']:.3f} N of the true curve"
        )
    for item in outcome.study.conditions:
        if item.Fs is None:
            p1, p2 = ((p - bench.patm) / 1e3 for p in (item.p1, item.p2))
            print(f"  p1 {p1:.0f}, p2 {p2:.0f} kPa: {item.verdict}")
    test = outcome.study.laws["vs"]
    print(f"  vs needs k5, k6: {test.needed} (p = {test.p_slopes:.2g}, {test.conditions} pressure pairs)", flush=True)


def main() -> None:
    """Run every seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    for seed in parser.parse_args().seeds:
        one_seed(seed)


if __name__ == "__main__":
    main()
