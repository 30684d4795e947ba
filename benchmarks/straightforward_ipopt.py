"""The frozen baseline."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from pneuid.plant import Plant
from pneuid.step import stable_upper_bounds, substep


@dataclass(frozen=True)
class Options:
    """What a careful user may choose."""

    samples: int = 25
    interval: str = "sx"
    parallel: str = "thread"
    threads: int = 2
    compile_flags: str | None = None
    ipopt: dict[str, Any] = field(default_factory=dict)


BEST = Options()


def solve_straightforward(
    plant: Plant,
    theta0: np.ndarray,
    free_names: Sequence[str],
    data: np.ndarray,
    nodes: np.ndarray,
    substeps: int,
    breaks: Sequence[int] = (),
    options: Options = BEST,
    verbose: bool = False,
) -> dict[str, Any]:
    began = time.perf_counter()
    problem = _Problem(plant, theta0, free_names, data, substeps, breaks, options, verbose)
    build_seconds = time.perf_counter() - began

    began = time.perf_counter()
    found = problem.solver(
        x0=np.concatenate([problem.q0, (nodes / plant.state_scales[:, None]).T.ravel()]),
        lbx=problem.lower, ubx=problem.upper, lbg=problem.lbg, ubg=problem.ubg,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    stats = problem.solver.stats()
    q = np.asarray(found["x"]).ravel()[: len(free_names)]
    return {
        "values": dict(zip(free_names, problem.values(q), strict=True)),
        "cost": float(found["f"]),
        "iterations": int(stats["iter_count"]),
        "seconds": seconds,
        "build_seconds": build_seconds,
        "status": str(stats["return_status"]),
        "split": {k: v for k, v in stats.items() if k.startswith("t_wall")},
    }


class _Problem:
    def __init__(self, plant, theta0, free_names, data, substeps, breaks, options, verbose) -> None:
        theta0 = np.asarray(theta0, dtype=float).ravel()
        index = [plant.theta_names.index(name) for name in free_names]
        declared = [plant.parameters[plant.parameter_names.index(name)] for name in free_names]
        self.positive = np.array([p.positive for p in declared])
        self.scale = np.array([1.0 if p.positive else p.scale for p in declared])
        limit = stable_upper_bounds(plant, theta0, float(np.median(data[0])), substeps)
        lower = np.array([p.lower for p in declared])
        upper = np.array([min(p.upper, limit.get(p.name, np.inf)) for p in declared])
        self.q0 = self.to_q(theta0[index])

        padded, linked = _intervals(plant, data, breaks, options.samples)
        count = padded.shape[1] // options.samples
        ns, ny, nq = len(plant.states), len(plant.outputs), len(index)

        q = ca.MX.sym("q", nq)
        X = ca.MX.sym("X", ns, count)
        V = ca.veccat(q, X)
        interval = self._interval(plant, theta0, index, substeps, options)
        mapped = interval.map(count, options.parallel, options.threads) if options.parallel != "serial" else interval.map(count)
        end, residual = mapped(X, padded.reshape(padded.shape[0] * options.samples, count, order="F"), ca.repmat(q, 1, count))
        r = ca.vec(residual)
        gaps = ca.vec(end[:, linked] - X[:, [i + 1 for i in linked]])
        inequalities = self._constraints(plant, theta0, index)(q)
        n = data.shape[1]
        f = 0.5 * ca.dot(r, r) / n
        g = ca.vertcat(gaps, inequalities)
        J = ca.jacobian(r, V)
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
        H = ca.triu(ca.mtimes(J.T, J)) * (sigma / n)
        hess = ca.Function("nlp_hess_l", [V, ca.MX(0, 1), sigma, lam], [H], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])
        ipopt = {"tol": 1e-6, "max_iter": 300, "print_level": 5 if verbose else 0, "max_wall_time": 60.0, "sb": "yes", **options.ipopt}
        self.solver = ca.nlpsol(
            "straightforward", "ipopt", {"x": V, "f": f, "g": g},
            {"hess_lag": hess, "print_time": False, "show_eval_warnings": False, "error_on_fail": False, "calc_lam_p": False, "ipopt": ipopt},
        )  # fmt: skip
        free = np.full(ns * count, np.inf)
        self.lower = np.concatenate([self.to_q(lower), -free])
        self.upper = np.concatenate([self.to_q(upper), free])
        nc = inequalities.numel()
        self.lbg = np.zeros(g.numel())
        self.ubg = np.concatenate([np.zeros(gaps.numel()), np.full(nc, np.inf)])

    def to_q(self, values):
        return np.where(self.positive, np.log(np.where(self.positive, values, 1.0)), values / self.scale)

    def values(self, q):
        return np.where(self.positive, np.exp(np.where(self.positive, q, 0.0)), q * self.scale)

    def _theta(self, theta0, index, q):
        theta = ca.SX(ca.DM(theta0))
        for j, i in enumerate(index):
            theta[i] = ca.exp(q[j]) if self.positive[j] else q[j] * self.scale[j]
        return theta

    def _constraints(self, plant, theta0, index):
        q = ca.SX.sym("q", len(index))
        found = [c.value for c in plant.constraints(self._theta(theta0, index, q))]
        return ca.Function("constraints", [q], [ca.vertcat(*found) if found else ca.SX(0, 1)])

    def _interval(self, plant, theta0, index, substeps, options):
        nw, ny, ns = len(plant.inputs), len(plant.outputs), len(plant.states)
        s, q = ca.SX.sym("s", ns), ca.SX.sym("q", len(index))
        d = ca.SX.sym("d", 1 + 2 * nw + 2 * ny)
        dt, w, slope, y, weight = ca.vertsplit(d, [0, 1, 1 + nw, 1 + 2 * nw, 1 + 2 * nw + ny, 1 + 2 * nw + 2 * ny])
        theta = self._theta(theta0, index, q)
        size = ca.DM(plant.state_scales)
        state = s * size
        outputs = plant.evaluate(state, w, theta).outputs
        r = weight * (ca.vertcat(*(outputs[name] for name in plant.outputs)) - y)
        h = dt / substeps
        start, given, rate, step = (ca.SX.sym(name, k) for name, k in (("s", ns), ("w", nw), ("dw", nw), ("h", 1)))
        one = ca.Function("one", [start, given, rate, step, q],
                          [substep(plant, start * size, given, rate, step, theta) / size], {"cse": True})
        moved = s
        for j in range(substeps):
            moved = one(moved, w + (j * h) * slope, slope, h, q)
        jit = {}
        if options.compile_flags is not None:
            jit = {"jit": True, "compiler": "shell", "jit_options": {"flags": options.compile_flags.split(), "verbose": False}}
        K, rows = options.samples, d.numel()
        if options.interval == "sx":
            D = ca.SX.sym("D", rows * K)
            x, found = s, []
            sample = ca.Function("sample", [s, d, q], [moved, r], {"cse": True})
            for k in range(K):
                x, rk = sample(x, D[k * rows : (k + 1) * rows], q)
                found.append(rk)
            return ca.Function("interval", [s, D, q], [x, ca.vertcat(*found)], jit)
        sample = ca.Function("sample", [s, d, q], [moved, r], {"cse": True, **(jit if options.interval == "sample" else {})})
        S, D, Q = ca.MX.sym("s", ns), ca.MX.sym("D", rows * K), ca.MX.sym("q", len(index))
        if options.interval == "sample":
            x, found = S, []
            for k in range(K):
                x, rk = sample(x, D[k * rows : (k + 1) * rows], Q)
                found.append(rk)
            return ca.Function("interval", [S, D, Q], [x, ca.vertcat(*found)])
        chain = sample.mapaccum("chain", K)
        xs, rs = chain(S, ca.reshape(D, rows, K), ca.repmat(Q, 1, K))
        return ca.Function("interval", [S, D, Q], [xs[:, -1], ca.vec(rs)], jit)


def _intervals(plant, data, breaks, K):
    """Data padded run by run to whole intervals, and the intervals that join the next one."""
    nw, ny = len(plant.inputs), len(plant.outputs)
    edges = [0, *breaks, data.shape[1]]
    parts, linked, count = [], [], 0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        run = data[:, a:b]
        missing = -(b - a) % K
        tail = np.repeat(run[:, -1:], missing, axis=1)
        tail[1 + nw : 1 + 2 * nw] = 0.0
        tail[-ny:] = 0.0
        parts += [run, tail]
        intervals = (b - a + missing) // K
        linked += range(count, count + intervals - 1)
        count += intervals
    return np.hstack(parts), linked


def synthetic(samples: int, seed: int = 1):
    from pneuid.physics.smoothing import FINE
    from pneuid.recording import Recording
    from pneuid.rig import Rig
    from pneuid.step import substeps_needed
    from pneuid.virtual_rig.recording import record_servo
    from pneuid.virtual_rig.truth import TruthServo

    rig = Rig.from_dict({
        "kind": "servo", "conventions": {"pressure": "gauge"},
        "cylinder": {"bore": "32 mm", "rod": "12 mm", "stroke": "500 mm", "dead_volume_1": "12 cm^3", "dead_volume_2": "14 cm^3"},
        "load": {"mass": "2.4 kg"},
        "valve": {"conductance": "1.2e-8 m^3/(s*Pa)", "critical_ratio": 0.30, "full_scale": "10 V", "null": "0 V"},
        "supply": {"pressure": "600 kPa"}, "sensors": {"x": "20 um", "p1": "0.5 kPa", "p2": "0.5 kPa"},
    })
    plant = Plant(rig, "lugre")
    seen = record_servo(TruthServo(), duration=samples / 1000.0, seed=seed, with_truth=True)
    truth = dict(zip(plant.parameter_names, [18.0, 27.0, 0.012, 4e5, 250.0, 45.0, 1.2, 1.2e-8]))
    n, dt = len(seen["t"]), 1e-3
    ranges = {"p1_low": 1e5, "p1_high": 7e5, "p2_low": 1e5, "p2_high": 7e5, "x_low": 0.1, "x_high": 0.4}
    theta = plant.theta(truth, ranges, smoothing=FINE)
    u, psup = seen["u"], np.full(n, rig.supply)
    slopes = np.vstack([np.append(np.diff(u), 0.0) / dt, np.zeros(n)])
    need = substeps_needed(plant, theta, dt)
    s, w, dw, h, th = (ca.SX.sym(k, m) for k, m in (("s", 5), ("w", 2), ("dw", 2), ("h", 1), ("th", theta.size)))
    one = ca.Function("one", [s, w, dw, h, th], [substep(plant, s, w, dw, h, th)])
    state = np.array([seen[f"true_{k}"][0] for k in ("x", "v", "p1", "p2", "z")])
    states = np.empty((5, n))
    for k in range(n):
        states[:, k] = state
        for j in range(need):
            state = np.asarray(one(state, [u[k] + j * dt / need * slopes[0, k], psup[k]], slopes[:, k], dt / need, theta)).ravel()
    rng = np.random.default_rng(seed)
    sigma = np.array([20e-6, 500.0, 500.0])
    y = states[[0, 2, 3]] + sigma[:, None] * rng.standard_normal((3, n))
    rec = Recording.from_arrays("synthetic", rig, t=seen["t"], u=u, x=y[0], p1=y[1], p2=y[2])
    return plant, rec, truth


def main() -> None:
    import sys, ast
    from pneuid.estimation.first_guess import first_guess, first_nodes, motions
    from pneuid.estimation.preparation import data_ranges, noise_of, prepare
    from pneuid.estimation.fit import fit, _substeps
    from pneuid.physics.smoothing import FINE, COARSE
    N = int(sys.argv[1]); seed = int(sys.argv[2])
    plant, rec, truth = synthetic(N, seed)
    runs = (prepare(rec, plant, noise_of(plant.rig, [rec])),)
    ranges = data_ranges([rec], plant)
    moved = motions(runs)
    guess = first_guess(plant, runs, moved)
    need = _substeps(plant, guess, ranges, 1e-3)
    print("N", N, "substeps", need, "start/truth", {k: round(guess[k] / truth[k], 3) for k in truth})
    for _ in range(2):
        b = time.perf_counter(); f = fit(plant, [rec]); e = time.perf_counter() - b
    print("product", f.stage, f.status, "%.3f s total, soft %.3f (%d) hard %s" % (e, f.relaxed.seconds, f.relaxed.iterations, f.exact and (round(f.exact.seconds, 3), f.exact.iterations)), "chi2/N %.6f" % (2 * (f.exact or f.relaxed).cost / N), "substeps", f.substeps, {k: round(v / truth[k], 4) for k, v in f.values.items()}, flush=True)
    for text in sys.argv[3:]:
        d = ast.literal_eval("{" + text + "}")
        sm = {"fine": FINE, "coarse": COARSE}[d.pop("smooth", "fine")]
        sub = d.pop("sub", f.substeps)
        o = Options(**d)
        th0 = plant.theta(guess, ranges, smoothing=sm)
        r = solve_straightforward(plant, th0, plant.parameter_names, runs[0].data, first_nodes(plant, runs, moved, guess, o.samples), sub, options=o)
        split = {k[7:]: round(v, 2) for k, v in r.pop("split").items() if v > 0.05}
        print(text, "| %.3f build, %.2f s, %d its, %s, chi2/N %.6f" % (r["build_seconds"], r["seconds"], r["iterations"], r["status"], 2 * r["cost"]), split, flush=True)
        print("   ", {k: round(float(v / truth[k]), 4) for k, v in r["values"].items()}, flush=True)


if __name__ == "__main__":
    main()
