"""The real measurements: EMPS and Zillen, beside the published figures.

    python benchmarks/real_data.py --data FOLDER

The data are not shipped; see ``scenarios/real/README.md`` for where they come from.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

import pneuid
from pneuid import api
from pneuid.resources import scenario_path

EMPS = {"mass": 95.1089, "sigma2": 203.5034, "Fc": 20.3935, "F_g": -3.1648}
"""Janot, Gautier, Brunot 2019: kg, N/(m/s), N, N."""

EMPS_DIRECTION = {"mass": 95.154, "Fv+": 166.71, "Fv-": 240.42, "Fc+": 20.144, "Fc-": 20.628}

ZILLEN_SLOPE = 0.66
"""Zillen, Vallery, Smit 2021: N/bar, O-ring."""

BARS = (1, 3, 5, 7)
ZILLEN_SPEED = 0.01
"""m/s: the machine drives the rod at 5 to 15 mm/s; Fc and the viscous part trade with each other, friction there is known."""


def relative_error(measured: np.ndarray, predicted: np.ndarray, rate: float) -> float:
    """Published metric: after a 100 Hz zero-phase filter, every tenth sample."""
    b, a = butter(4, 100.0 / (0.5 * rate))
    f, g = (filtfilt(b, a, signal)[::10] for signal in (measured, predicted))
    return float(np.linalg.norm(f - g) / np.linalg.norm(f))


def _line(name: str, value: float, published: float) -> None:
    print(f"  {name:7s} {value:9.3f}  published {published:9.3f}  {100 * (value / published - 1):+.2f} %")


def emps(folder: Path) -> None:
    """Fit, diagnose, fit with what was named."""
    rig = pneuid.Rig.from_toml(scenario_path("real/emps/rig.toml"))
    run = pneuid.Recording.read(folder / "emps" / "DATA_EMPS.mat", rig)
    base = pneuid.fit(rig, [run], add=["load_mass", "gravity"])
    print("EMPS, coulomb + load_mass + gravity")
    for name, published in EMPS.items():
        _line(name, base.values[name], published)
    error = relative_error(run.signals["F"], base.simulate(run)["F"], run.rate)
    print(f"  relative error {100 * error:.2f} %  published 4.08 %")
    found = base.diagnose([run])
    print(f"  diagnose: {found.verdict} {list(found.effects)}; {'; '.join(found.sentences)}")
    better = pneuid.fit(rig, [run], add=["load_mass", "friction_direction"])
    v = better.values
    fitted = {
        "mass": v["mass"], "Fv+": v["sigma2"] + v["sigma2_d"], "Fv-": v["sigma2"] - v["sigma2_d"],
        "Fc+": v["Fc"] + v["Fc_d"], "Fc-": v["Fc"] - v["Fc_d"],
    }  # fmt: skip
    print("EMPS, coulomb + load_mass + friction_direction")
    for name, published in EMPS_DIRECTION.items():
        _line(name, fitted[name], published)
    error = relative_error(run.signals["F"], better.simulate(run)["F"], run.rate)
    print(f"  relative error {100 * error:.2f} %")


def zillen(folder: Path) -> None:
    """Each pressure held out in turn, from a constant friction; the slope with run-based standard errors, two ways."""
    rig = pneuid.Rig.from_toml(scenario_path("real/zillen/rig.toml"))
    path = folder / "zillen_pneumatic_friction" / "friction"
    runs = [pneuid.Recording.read(path / f"O-ring_{bar}bar.csv", rig) for bar in BARS]
    slopes, named = [], []
    for held in runs:
        train = [run for run in runs if run is not held]
        base = pneuid.fit(rig, train)
        verdict = api.diagnose(base, train, [held])
        named.append(list(verdict.diagnosis.effects))
        slopes.append(_slope(verdict.best.values))
        accepted = [rung for rung in verdict.rungs if rung.accepted]
        print(
            f"Zillen O-ring, {held.name} held out: {verdict.diagnosis.verdict} {named[-1]}; rmse of F held out "
            f"{accepted[0].hold_out['F']:.2f} -> {accepted[-1].hold_out['F']:.2f} N; "
            f"slope {slopes[-1]:.2f} N/bar (author {ZILLEN_SLOPE})",
            flush=True,
        )
    found = sorted(set(named[0]).intersection(*named) | {"friction_pressure"})
    every = pneuid.fit(rig, runs, add=found)
    # the four models above are the fits without one of the runs: their spread is the error that the choice of runs leaves
    error = np.sqrt((len(runs) - 1) / len(runs) * np.sum((np.array(slopes) - np.mean(slopes)) ** 2))
    _sloped(f"all runs with {', '.join(found)}, error from leaving one run out", _slope(every.values), error)
    levels = [_steady(pneuid.fit(rig, [run]).values, 0.0) for run in runs]
    fitted, covariance = np.polyfit(BARS, levels, 1, cov=True)
    _sloped("line through four models, one per run, error from its rest", fitted[0], np.sqrt(covariance[0, 0]))


def _slope(values: Mapping[str, float]) -> float:
    """Slope of friction by pressure at the rig's speed, N/bar, between the lowest and the highest."""
    low, high = (_steady(values, 1e5 * bar) for bar in (BARS[0], BARS[-1]))
    return (high - low) / (BARS[-1] - BARS[0])


def _steady(values: Mapping[str, float], pressure: float) -> float:
    """Steady friction at the rig's speed, N, at that pressure in Pa (gauge) in chamber 1 and the rod side vented."""

    def law(name: str, by_ps: str, by_dp: str) -> float:
        return values.get(name, 0.0) + (values.get(by_ps, 0.0) + values.get(by_dp, 0.0)) * pressure

    Fc = law("Fc", "k1", "k2")
    Fs = law("Fs", "k3", "k4") if "k3" in values else Fc + values.get("Fs", values["Fc"]) - values["Fc"]
    peak = np.exp(-((ZILLEN_SPEED / max(law("vs", "k5", "k6"), 2e-4)) ** 2)) if "vs" in values else 0.0
    slipping = values.get("w_element", 0.0) * Fc  # what a memory of pre-sliding adds once all of it slips
    return float(Fc + (max(Fs, Fc) - Fc) * peak + law("sigma2", "k7", "k8") * ZILLEN_SPEED + slipping)


def _sloped(how: str, slope: float, error: float) -> None:
    away = (slope - ZILLEN_SLOPE) / error
    print(f"  slope, {how}: {slope:.2f} +- {error:.2f} N/bar, {away:+.1f} errors from the author's {ZILLEN_SLOPE}", flush=True)


def main() -> None:
    """Run both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER", help="the folder that holds both data sets")
    given = parser.parse_args()
    emps(given.data)
    zillen(given.data)


if __name__ == "__main__":
    main()
