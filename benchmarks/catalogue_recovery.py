"""Recovery: screening must rank an effect first, and the refit find its numbers, where the data have its own form.

    python benchmarks/catalogue_recovery.py [NAME ...]

For each servo effect of the pneumatic, valve and sensor groups: two runs of 2.5 s are simulated with the catalogue's own model
(eight steps per sample, closed loop, sensor noise), the base model is fitted, the catalogue screened, the effect refitted
to the exact stage. This checks the chain from declaration to estimate; ``hidden_effects.py`` is the test on foreign forms.
"""

from __future__ import annotations

import sys
import time

import casadi as ca
import numpy as np

from pneuid.criticism.refitting.refits import Asked, Standing, refit
from pneuid.criticism.screening.scores import screen
from pneuid.effects import CATALOGUE
from pneuid.estimation.fit import fit
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.resources import scenario_path
from pneuid.rig import Rig
from pneuid.step import substep

DT, SUBSTEPS, SECONDS = 1e-3, 8, 2.5
TRUTH = {"Fc": 12.0, "Fs": 20.0, "vs": 0.008, "sigma0": 4e5, "sigma1": 250.0, "sigma2": 45.0, "n": 1.2, "C": 1.2e-8}
RANGES = {"p1_low": 1.1e5, "p1_high": 8e5, "p2_low": 1.1e5, "p2_high": 8e5, "x_low": 0.1, "x_high": 0.4}
STRENGTH = {
    "leakage_internal": {"G_leak": 2e-10}, "leakage_external_1": {"C_leak_1": 2e-10},
    "leakage_external_2": {"C_leak_2": 2e-10}, "dead_volume": {"dV01": 6e-6, "dV02": 4e-6},
    "heat_transfer": {"heat_weight": 1.0, "h_wall": 60.0, "n": 1.39}, "inlet_mixing": {"mixing": 0.1},
    "supply_droop": {"r_supply": 0.5}, "line_delay": {"tau_line": 5e-3, "r_line": 0.5},
    "exhaust_restriction": {"r_exhaust": 0.5},
    "valve_offset": {"offset_valve": 0.02}, "valve_dead_zone": {"dead_zone": 0.03},
    "valve_asymmetry": {"asymmetry": 0.08}, "valve_lag": {"tau_valve": 5e-3}, "valve_hysteresis": {"play": 0.02},
    "valve_null_leakage": {"null_leak": 0.01}, "valve_critical_ratio": {"critical_ratio": 0.42},
    "side_volume_1": {"V_side_1": 20e-6}, "side_volume_2": {"V_side_2": 20e-6},
    "valve_flow_force": {"flow_force": 0.12, "port_push": 0.01}, "valve_curve": {"curve": 0.15},
    "sensor_offset_p1": {"offset_p1": 8e3}, "sensor_offset_p2": {"offset_p2": 8e3},
    "sensor_lag_p1": {"tau_p1": 4e-3}, "sensor_lag_p2": {"tau_p2": 4e-3}, "channel_skew": {"skew_x": 1e-3, "skew_p": 3e-3},
}  # fmt: skip


def recorded(rig: Rig, name: str, run: str, seed: int) -> Recording:
    """One closed-loop run with the effect at its strength."""
    plant = Plant(rig, "lugre", [CATALOGUE[name]])
    values = plant.starts() | TRUTH | STRENGTH[name]
    theta, rng = plant.theta(values, RANGES), np.random.default_rng(seed)
    s, w, slope = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", 2), ca.SX.sym("slope", 2)
    step = ca.Function("step", [s, w, slope], [substep(plant, s, w, slope, DT / SUBSTEPS, theta)])
    shown = ca.Function("shown", [s, w], [ca.vertcat(*plant.evaluate(s, w, theta).outputs.values())])
    t = np.arange(round(SECONDS / DT)) * DT
    reference, psup = _reference(t, seed, rng), float(rig.run(run).supply or rig.supply)
    known = {"x": 0.25, "p1": 3e5, "p2": 3.3e5} | {own.name: own.initial for own in plant.effect_states}
    state, u = np.array([known.get(item, 0.0) for item in plant.states]), 0.0
    commands, outputs = [], []
    for wanted in reference:
        commands.append(u)
        outputs.append(np.asarray(shown(state, [u, psup])).ravel())
        command = 60.0 * (wanted - state[0]) - 2.0 * state[1] + 0.03 * rng.standard_normal()
        rate = (float(np.clip(command, -10.0, 10.0)) - u) / DT
        for _ in range(SUBSTEPS):
            state = np.asarray(step(state, [u, psup], [rate, 0.0])).ravel()
            u += rate * DT / SUBSTEPS
    y = np.array(outputs).T + np.array([[20e-6], [500.0], [500.0]]) * rng.standard_normal((3, t.size))
    return Recording.from_arrays(run, rig, t=t, u=np.array(commands), x=y[0], p1=y[1], p2=y[2])


def _reference(t: np.ndarray, seed: int, rng: np.random.Generator) -> np.ndarray:
    """Wanted position (N,) in m: a sum of sines for odd seeds, steps for even ones."""
    if seed % 2:
        parts = zip((0.5, 0.9, 1.7, 2.9), (0.06, 0.03, 0.012, 0.006), rng.uniform(0, 2 * np.pi, 4), strict=True)
        return 0.25 + np.sum([size * np.sin(2 * np.pi * f * t + phase) for f, size, phase in parts], axis=0)
    return np.asarray(np.repeat(rng.uniform(0.12, 0.38, t.size // 400 + 1), 400)[: t.size])


def case(rig: Rig, name: str) -> str:
    """One line: rank, predicted and actual drop, stage, recovered values with standard errors beside the true ones."""
    began = time.monotonic()
    runs = [recorded(rig, name, "train_2.csv", 1), recorded(rig, name, "train_3.csv", 2)]
    base = fit(Plant(rig, "lugre"), runs, exact=False)
    scores = screen(base, list(CATALOGUE.values()), list(CATALOGUE))
    own = next(score for score in scores if score.effect.name == name)
    after = refit(Standing.of(base), Asked(CATALOGUE[name], own.start), list(CATALOGUE))
    final = fit(after.plant, runs, after.values)
    spread = dict(zip(final.problem.free, final.spread.std, strict=True)) if final.spread else {}
    found = ", ".join(
        f"{item} {final.values[item]:.4g} +- {spread.get(item, np.nan):.1g} (true {STRENGTH[name].get(item, 'start')})"
        for item in final.plant.own_parameters(name)
    )
    return (
        f"{name:21s} rank {scores.index(own) + 1} drop {own.drop:7.0f} cost {base.relaxed_cost:7.0f} {final.stage:7s} "
        f"chi2 {final.cost_per_sample:.3f}  {found}  group {', '.join(own.group) or '-'}  [{time.monotonic() - began:.0f} s]"
    )


if __name__ == "__main__":
    demo = Rig.from_toml(scenario_path("demo/rig.toml"))
    for chosen in sys.argv[1:] or STRENGTH:
        print(case(demo, chosen), flush=True)
