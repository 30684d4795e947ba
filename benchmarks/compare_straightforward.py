"""The product's fit and the frozen baseline on the same synthetic data, from the same first guess.

    python benchmarks/compare_straightforward.py --samples 1000 5000 --seeds 1 2

The data come from the very time step that both use, so both must end at the same optimum, near the truth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from straightforward_ipopt import COMPILED, INTERPRETED, Options, solve_straightforward

from pneuid.estimation.first_guess import first_guess, first_nodes, motions
from pneuid.estimation.fit import fit
from pneuid.estimation.preparation import data_ranges, noise_of, prepare
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.step import substep, substeps_needed
from pneuid.virtual_rig.recording import record_servo
from pneuid.virtual_rig.truth import TruthServo

RIG = {
    "kind": "servo",
    "conventions": {"pressure": "gauge"},
    "cylinder": {
        "bore": "32 mm", "rod": "12 mm", "stroke": "500 mm", "dead_volume_1": "12 cm^3", "dead_volume_2": "14 cm^3",
    },
    "load": {"mass": "2.4 kg"},
    "valve": {"conductance": "1.2e-8 m^3/(s*Pa)", "critical_ratio": 0.30, "full_scale": "10 V", "null": "0 V"},
    "supply": {"pressure": "600 kPa"},
    "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
}  # fmt: skip
TRUTH = {"Fc": 18.0, "Fs": 27.0, "vs": 0.012, "sigma0": 4e5, "sigma1": 250.0, "sigma2": 45.0, "n": 1.2, "C": 1.2e-8}
DT = 1e-3

SWEEP = {
    f"{kind}, K = {samples}, {strategy}": replace(base, samples=samples, ipopt={"mu_strategy": strategy})
    for kind, base in (("interpreted", INTERPRETED), ("compiled", COMPILED))
    for samples in (1, 5, 10, 25)
    for strategy in ("monotone", "adaptive")
} | {
    "interpreted, K = 25, one thread": replace(INTERPRETED, samples=25, threads=1),
    "interpreted, K = 25, mapaccum": replace(INTERPRETED, samples=25, chain="mapaccum"),
    "compiled at -O1, K = 5": replace(COMPILED, flags=("-O1",)),
    "compiled, K = 5, default mu_init": replace(COMPILED, ipopt={"mu_init": 0.1}),
}


def synthetic(plant: Plant, samples: int, seed: int, truth: Mapping[str, float]) -> tuple[Recording, int]:
    """A run of ``samples`` at 1 kHz simulated with the plant's own step, noise as the rig says; and its substeps.

    The command is the one of a closed loop around the virtual rig of the same parameters, so that the motion is usual.
    """
    seen = record_servo(TruthServo(), duration=samples * DT, seed=seed, with_truth=True)
    ranges = {"p1_low": 1e5, "p1_high": 7e5, "p2_low": 1e5, "p2_high": 7e5, "x_low": 0.1, "x_high": 0.4}
    theta = plant.theta(truth, ranges, smoothing=FINE)
    substeps = substeps_needed(plant, theta, DT)
    s, w, slope, h = ca.SX.sym("s", 5), ca.SX.sym("w", 2), ca.SX.sym("slope", 2), DT / substeps
    step = ca.Function("step", [s, w, slope], [substep(plant, s, w, slope, h, ca.DM(theta))])
    u = np.vstack([seen["u"], np.full(samples, plant.rig.supply)])
    slopes = np.diff(u, axis=1, append=u[:, -1:]) / DT
    states = np.empty((5, samples))
    state = np.array([seen[f"true_{name}"][0] for name in plant.states])
    for k in range(samples):
        states[:, k] = state
        for j in range(substeps):
            state = np.asarray(step(state, u[:, k] + j * h * slopes[:, k], slopes[:, k])).ravel()
    rng = np.random.default_rng(seed)
    noisy = {
        name: states[plant.states.index(name)] + plant.rig.noise[name] * rng.standard_normal(samples)
        for name in plant.outputs
    }
    return Recording.from_arrays("synthetic", plant.rig, t=seen["t"], u=seen["u"], **noisy), substeps


def _shown(label: str, numbers: Mapping[str, Any]) -> None:
    print(f"  {label:34s}" + "  ".join(f"{name} {value}" for name, value in numbers.items()), flush=True)


def compare(samples: int, seed: int, chosen: Mapping[str, Options]) -> None:
    """Fit one synthetic run with the product and with every chosen baseline, and print what each took and found."""
    plant = Plant(Rig.from_dict(RIG), "lugre")
    recording, substeps = synthetic(plant, samples, seed, TRUTH)
    began = time.perf_counter()
    product = fit(plant, [recording])
    seconds = time.perf_counter() - began
    final = product.exact or product.relaxed
    print(f"N = {samples}, seed {seed}, {substeps} substeps (product: {product.substeps})")
    cost = 2 * final.cost / (samples * len(plant.outputs))
    solving = product.relaxed.seconds + (product.exact.seconds if product.exact else 0.0)
    _shown("product", {
        "chi2": f"{cost:.6f}", "solve s": f"{solving:.2f}", "all s": f"{seconds:.2f}", "its": product.iterations,
        "status": product.status,
    })  # fmt: skip
    runs = (prepare(recording, plant, noise_of(plant.rig, [recording])),)
    moved = motions(runs)
    guess = first_guess(plant, runs, moved)
    theta = plant.theta(guess, data_ranges([recording], plant), smoothing=FINE)
    for label, options in chosen.items():
        nodes = first_nodes(plant, runs, moved, guess, options.samples)
        found = solve_straightforward(
            plant, theta, plant.parameter_names, runs[0].data, nodes, product.substeps, options=options
        )
        worst = max(abs(found["values"][name] / TRUTH[name] - 1.0) for name in TRUTH)
        _shown(label, {
            "chi2": f"{2 * found['cost'] / len(plant.outputs):.6f}", "solve s": f"{found['seconds']:.2f}",
            "build s": f"{found['build_seconds']:.2f}", "its": found["iterations"], "status": found["status"],
            "largest error": f"{100 * worst:.1f} %",
        })  # fmt: skip


def main() -> None:
    """Parse the arguments and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=[1000], help="samples at 1 kHz")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--sweep", action="store_true", help="every option set that was tried, not the two best alone")
    given = parser.parse_args()
    best = {"straightforward, compiled": COMPILED, "straightforward, interpreted": INTERPRETED}
    chosen = SWEEP if given.sweep else best
    for samples in given.samples:
        for seed in given.seeds:
            compare(samples, seed, chosen)


if __name__ == "__main__":
    main()
