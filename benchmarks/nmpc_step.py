"""One step of the predictive controller: exported C, Python, do-mpc, on the same recorded problems, interleaved.

    python benchmarks/nmpc_step.py [--problems 40]

Three things are timed per problem: the C step (call through ctypes), the Python step, and do-mpc solving the same
program to convergence with its defaults (IPOPT). The program is one and the same: stage dynamics by the stage function
that the controller linearises, known friction, quadratic tracking cost, hard command, soft position and pressures.
do-mpc converges where the real-time iteration takes one step, so agreement is told for the converged C as well.
Needs do-mpc (``pip install do-mpc``); without it the first two are timed.
"""

from __future__ import annotations

import argparse
import ctypes
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from reference_qp import reference

from controllers import qp
from controllers.base import Measurement
from controllers.control_model import ControlModel
from controllers.export.library import ExportedNmpc, build_library
from controllers.export.pieces import Controllers, tuned
from controllers.export.recorded import Recorded, hard_track, record
from controllers.export.sources import c_sources
from controllers.horizon import stage_function
from controllers.model_plant import ModelPlant
from controllers.mpc import ASIDE, Mpc
from controllers.nominal import nominal_model
from controllers.tuning import Design
from pneuid.plant import RANGES
from pneuid.virtual_rig.truth import TruthServo

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")


def made() -> Controllers:
    """The controllers of the virtual rig's own model, its laws bounded to ordinary pressures and places."""
    truth = TruthServo()
    plant, theta = nominal_model(truth)
    bounds = dict(zip(RANGES, (1.0e5, 8.0e5, 1.0e5, 8.0e5, 0.1, 0.4), strict=True))
    theta = ControlModel(plant, theta).with_values(**bounds)
    return tuned(ControlModel(plant, theta), Design(truth.supply), refined=False)


def reference_solver(nmpc: Mpc) -> tuple[Any, Any] | None:
    """do-mpc set up for the controller's own program; None where it is not installed."""
    try:
        import do_mpc  # noqa: PLC0415 - an optional peer
    except ImportError:
        return None
    h, program = nmpc.horizon, nmpc.program
    stage = stage_function(nmpc.model, h.interval)
    theta = nmpc.model.with_values(smooth_opening=0.02, smooth_laminar=5e-3)
    soft = np.flatnonzero(program.give > 0.0)
    soft = soft[[bool(np.isfinite(program.lower[1, j]) or np.isfinite(program.upper[1, j])) for j in soft]]
    model = do_mpc.model.Model("discrete", "SX")
    x, u = model.set_variable("_x", "x", shape=(h.nx, 1)), model.set_variable("_u", "du")
    slack = model.set_variable("_u", "slack", shape=(soft.size, 1))
    force, aim = model.set_variable("_tvp", "force"), model.set_variable("_tvp", "aim", shape=(2, 1))
    psup = model.set_variable("_tvp", "psup")
    after = stage(x, u, force, psup, theta)[0]
    model.set_rhs("x", after)
    model.setup()
    # do-mpc replaces its symbols at setup
    x, u, slack = model.x["x"], model.u["du"], model.u["slack"]
    aim, psup = model.tvp["aim"], model.tvp["psup"]
    after = stage(x, u, model.tvp["force"], psup, theta)[0]
    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.store_full_solution = h.N, h.interval, True
    mpc.settings.supress_ipopt_output()
    weight, last = program.Q[0], program.Q[-1]
    error = [x[j] - aim[j] for j in (0, 1)]
    mpc.set_objective(
        lterm=sum(0.5 * weight[j] * error[j] ** 2 for j in (0, 1)),
        mterm=sum(0.5 * last[j] * error[j] ** 2 for j in (0, 1)),
    )
    price = 0.5 * program.R * u**2 + sum(slack[k] ** 2 / (2.0 * program.give[j]) for k, j in enumerate(soft))
    mpc.set_rterm(rterm=price)
    # bounds on the next state, so that all stages but the given one have them
    mpc.set_nl_cons("command_high", after[-1], ub=float(program.upper[1, -1]))
    mpc.set_nl_cons("command_low", -after[-1], ub=-float(program.lower[1, -1]))
    for k, j in enumerate(soft):
        upper = 1.05 * psup / h.scale[j] if j in (2, 3) else float(program.upper[1, j])
        mpc.set_nl_cons(f"high_{j}", after[int(j)] - slack[k] - upper, ub=0.0)
        mpc.set_nl_cons(f"low_{j}", float(program.lower[1, j]) - after[int(j)] + slack[k], ub=0.0)
    ahead = mpc.get_tvp_template()
    mpc.set_tvp_fun(lambda _now: ahead)
    mpc.setup()
    return mpc, ahead


def fill(ahead: Any, nmpc: Mpc, target: np.ndarray, force: np.ndarray, psup: float) -> None:
    """The known future of one problem."""
    h = nmpc.horizon
    for i in range(h.N + 1):
        ahead["_tvp", i, "force"] = force[min(i, h.N - 1)]
        ahead["_tvp", i, "aim"] = target[1 + i, :2] / h.scale[:2]
        ahead["_tvp", i, "psup"] = psup


def converged(nmpc: Mpc, plan_x: np.ndarray, plan_u: np.ndarray, force: np.ndarray, psup: float) -> np.ndarray:
    """Command changes after repeated linearisation, by the project's own program, from the controller's last plan."""
    h = nmpc.horizon
    theta = nmpc.model.with_values(smooth_opening=0.02, smooth_laminar=5e-3)
    program = nmpc.program
    low, high = program.lower[1, -1] + ASIDE, program.upper[1, -1] - ASIDE
    for _ in range(30):
        plan_u = np.clip(plan_x[:-1, -1] + plan_u, low, high) - plan_x[:-1, -1]
        after, A, B = (np.asarray(item) for item in h.dynamics(plan_x[:-1].T, plan_u, force, psup, theta))
        A = A.reshape(h.nx, h.N, h.nx).transpose(1, 0, 2)
        B = np.ascontiguousarray(B.T)
        c = after.T - np.einsum("iab,ib->ia", A, plan_x[:-1]) - B * plan_u[:, None]
        found = qp.solve(*program._replace(A=np.ascontiguousarray(A), B=B, c=c), 1e-10)
        step = float(np.max(np.abs(found.u - plan_u)))
        plan_x, plan_u = found.x, found.u
        if step < 1e-9:
            break
    return plan_u


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=40, help="problems that do-mpc solves")
    parser.add_argument("--reference", action="store_true", help="solve every problem by qpOASES as well")
    given = parser.parse_args()
    found = made()
    supply = found.design_supply
    with tempfile.TemporaryDirectory() as folder:
        for name, text in c_sources(found, "benchmark").items():
            (Path(folder) / name).write_text(text)
        library = build_library(Path(folder), Path(folder) / "b.so", flags=FLAGS)
        measure(found, library, supply, given.problems)
        if given.reference:
            print(against_reference(found, supply))


def measure(found: Controllers, library: Path, supply: float, problems: int) -> None:
    """Time every problem of one closed loop three ways, in turns."""
    nmpc = found.nmpc
    run = recorded(found, supply)
    exported, peer = ExportedNmpc(library), reference_solver(nmpc)
    linearise = ctypes.CDLL(str(library)).pneuid_nmpc_linearise
    linearise.argtypes = [ctypes.c_void_p, ctypes.c_double]
    every = max(1, run.u.size // problems)
    seconds: dict[str, list[float]] = {name: [] for name in ("C step", "C linearisation", "Python step", "do-mpc")}
    apart, unequal, active = [], [], 0
    nmpc.reset(Measurement(*run.seen[0]), run.target[: nmpc.preview])
    exported.begin(run.seen[0])
    for k, row in enumerate(run.seen):
        ahead = run.target[k : k + nmpc.preview]
        began = time.perf_counter()
        u = nmpc.step(Measurement(*row), ahead)
        seconds["Python step"].append(time.perf_counter() - began)
        began = time.perf_counter()
        u_c = exported.step(row, ahead)
        seconds["C step"].append(time.perf_counter() - began)
        began = time.perf_counter()
        linearise(exported.structure, supply)
        seconds["C linearisation"].append(time.perf_counter() - began)
        unequal.append(abs(u - u_c))
        active += nmpc.iterations > 0
        if peer is None or k % every:
            continue
        mpc, future = peer
        plan_x, plan_u, force = nmpc.plan()
        fill(future, nmpc, ahead, force, supply)
        mpc.reset_history()
        mpc.x0 = nmpc.program.x0
        mpc.set_initial_guess()
        began = time.perf_counter()
        answer = np.asarray(mpc.make_step(nmpc.program.x0.reshape(-1, 1))).ravel()
        seconds["do-mpc"].append(time.perf_counter() - began)
        apart.append(abs(float(answer[0]) - converged(nmpc, plan_x, plan_u, force, supply)[0]))
    report(seconds, unequal, apart, active / run.u.size)


def recorded(found: Controllers, supply: float) -> Recorded:
    """One closed loop with moves that reach every bound."""
    nmpc = found.nmpc
    track = hard_track(found.model, nmpc.sample_time, 1.2, nmpc.preview, 0.3)
    return record(nmpc, ModelPlant(found.model), track, supply, seed=1)


def against_reference(found: Controllers, supply: float) -> str:
    """How far the commands of every problem, as the controller solves it, are from those of an independent solver."""
    nmpc, run = found.nmpc, recorded(found, supply)
    nmpc.reset(Measurement(*run.seen[0]), run.target[: nmpc.preview])
    free, bound = [], []
    for k, row in enumerate(run.seen):
        nmpc.step(Measurement(*row), run.target[k : k + nmpc.preview])
        apart = float(np.max(np.abs(nmpc.plan()[1] - reference(nmpc.program))))
        (bound if nmpc.iterations else free).append(apart)
    return (
        f"command changes, own - qpOASES (scaled): at most {max(free):.2g} on {len(free)} problems without active bounds, "
        f"{max(bound):.2g} on {len(bound)} with"
    )


def report(seconds: dict[str, list[float]], unequal: list[float], apart: list[float], active: float) -> None:
    """Print the table."""
    print(f"{len(unequal)} problems, {100 * active:.0f} % with active bounds")
    for name, values in seconds.items():
        if values:
            us = 1e6 * np.array(values)
            print(
                f"{name:16s} median {np.median(us):10.1f} us  p99 {np.quantile(us, 0.99):10.1f}  max {us.max():10.1f}"
            )
    medians = {name: np.median(values) for name, values in seconds.items() if values}
    print(f"C step / linearisation of the horizon: {medians['C step'] / medians['C linearisation']:.2f}")
    print(f"largest difference C - Python: {max(unequal):.2g} V")
    if apart:
        ratios = [medians["do-mpc"] / medians[name] for name in ("C step", "Python step")]
        print(f"do-mpc / C step: {ratios[0]:.0f}; do-mpc / Python step: {ratios[1]:.0f}")
        worst = f"median {np.median(apart):.2g}, max {max(apart):.2g}"
        print(f"first command change, do-mpc - converged own: {worst} (scaled)")
    else:
        print("do-mpc is not installed: pip install do-mpc")


if __name__ == "__main__":
    main()
