"""The frozen baseline: multiple shooting of the same model as a careful CasADi user writes it, without own derivatives.

The same plant, time step, data, parameter bounds and inequalities as the product; what differs is how IPOPT gets its
derivatives. Here CasADi differentiates the whole nonlinear programme: an SX sample function, chained over an interval,
mapped over the intervals as MX, continuity as equalities, and the Gauss-Newton Hessian ``J'J`` from the symbolic
Jacobian of all residuals, passed as ``hess_lag`` (the way of CasADi's own ``docs/examples/python/sysid.py``). Variables
are scaled: parameters by logarithm or scale, states by the plant's state scales; the cost is per sample.

Tried on one run of 1 kHz data with 5 states and 8 parameters, from the product's first guess (figures: README.md):

- Intervals of 1, 5, 10 and 25 samples. Compiled, 5 is the fastest at N = 5000 and the steadiest there; interpreted, 25
  is the best; 1 often wanders.
- Chains: interpreted, one expanded SX graph per interval is the fastest; a row of calls takes 1.4x, ``mapaccum`` 1.6x.
  Compiled, only the row of calls was tried.
- The sample function and its derivatives compiled just in time: solves 2 to 7 times faster, 9 to 25 s of build, not
  cached. -O1 halves the build and takes 1.2x per iteration.
- ``map`` on two threads is 1.25x faster than serial. Openmp is not in the wheel and was not tried.
- ``mu_strategy`` adaptive failed more often than monotone at N = 5000. ``mu_init = 1e-4`` rescues starts that the
  default loses and loses others. ``nlp_scaling_method = none`` takes the same iterations.
- Coarse smoothing with monotone ran to 300 iterations where fine needed 22. Two stages were not tried: that is
  the product.
- IPOPT's exact Hessian: not run here; a prototype was not converged at ten times the time.

Hard continuity straight from a first guess is fragile: iterations change several times over with the seed, the interval
and even the compiler, and some starts end at 300 iterations. So report the failures beside the times.

Frozen in 2026; a later change of the product is measured against this file as it stands.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from pneuid.effect import Parameter
from pneuid.plant import Plant
from pneuid.step import stable_upper_bounds, substep

WALL_SECONDS = 120.0
IPOPT = {
    "tol": 1e-6, "max_iter": 300, "mu_init": 1e-4, "sb": "yes",
    # a cost that no longer moves is the end, as in the product: at the kinks of friction the last digits of the
    # gradient are rounding
    "acceptable_tol": 1e-3, "acceptable_iter": 2, "acceptable_obj_change_tol": 1e-7,
    "acceptable_constr_viol_tol": 1e-3, "acceptable_dual_inf_tol": 1e-3,
}  # fmt: skip
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")
"""Compiler flags, those of the product."""


@dataclass(frozen=True)
class Options:
    """What a careful user may choose.

    samples : samples per interval; chain : how an interval is built from its samples: ``expand`` (one SX graph),
    ``calls`` (an MX row of calls) or ``mapaccum``; flags : compile the sample function and its derivatives just in
    time with these flags, None interprets; threads : of the map over intervals, 1 is serial; ipopt : further options.
    """

    samples: int = 25
    chain: str = "expand"
    flags: tuple[str, ...] | None = None
    threads: int = 2
    ipopt: dict[str, Any] = field(default_factory=dict)


INTERPRETED = Options(samples=25, chain="expand", flags=None)
"""Best without a compiler."""

COMPILED = Options(samples=5, chain="calls", flags=FLAGS)
"""Best solve time; its compilation counts in ``build_seconds`` (nothing is cached)."""


class Scaling:
    """Between physical parameters (SI) and search variables: logarithm where positive, else value/scale."""

    def __init__(self, declared: Sequence[Parameter]) -> None:
        self.positive = np.array([parameter.positive for parameter in declared], dtype=bool)
        self.scale = np.array([1.0 if parameter.positive else parameter.scale for parameter in declared])

    def to_q(self, values: np.ndarray) -> np.ndarray:
        """Search variables from physical values, both ``(nq,)``."""
        return np.where(self.positive, np.log(np.where(self.positive, values, 1.0)), values / self.scale)

    def to_values(self, q: np.ndarray) -> np.ndarray:
        """Physical values from search variables, both ``(nq,)``."""
        return np.where(self.positive, np.exp(np.where(self.positive, q, 0.0)), q * self.scale)

    def into(self, theta: np.ndarray, index: Sequence[int], q: ca.SX) -> ca.SX:
        """``theta`` with the entries at ``index`` replaced by the symbolic physical values of ``q``."""
        full = ca.SX(ca.DM(theta))
        for j, i in enumerate(index):
            full[i] = ca.exp(q[j]) if self.positive[j] else q[j] * self.scale[j]
        return full


def solve_straightforward(
    plant: Plant,
    theta0: np.ndarray,
    free_names: Sequence[str],
    data: np.ndarray,
    nodes: np.ndarray,
    substeps: int,
    breaks: Sequence[int] = (),
    options: Options = COMPILED,
    verbose: bool = False,
) -> dict[str, Any]:
    """Minimise ``sum r^2 / (2 N)`` over the free parameters and the node states, continuity exact.

    theta0 : ``(len(theta),)``, the whole theta column with the start of the free ones; free_names : names of the
    searched parameters; data : ``(rows, N)`` with rows dt, inputs, input slopes, measured outputs, weights (1/sigma, 0
    drops a sample); nodes : ``(ns, intervals)`` start of every interval of ``options.samples`` samples, run by run, SI;
    substeps per sample; breaks : sample numbers at which a new run begins.

    Returns values (SI, by name), nodes ``(ns, intervals)``, cost (as minimised), iterations, seconds (of the solver
    call), build_seconds (symbols, sparsity, compilation), status (IPOPT's word), wall (seconds by function).
    """
    began = time.perf_counter()
    theta = np.asarray(theta0, dtype=float).ravel()
    index = [plant.theta_names.index(name) for name in free_names]
    declared = [plant.parameters[plant.parameter_names.index(name)] for name in free_names]
    scaling = Scaling(declared)
    padded, linked = whole_intervals(plant, data, breaks, options.samples)
    solver, defects, inequalities = _programme(
        plant, theta, index, scaling, padded, linked, data.shape[1], substeps, options, verbose
    )
    limit = stable_upper_bounds(plant, theta, float(np.median(data[0])), substeps)
    lower = scaling.to_q(np.array([parameter.lower for parameter in declared]))
    upper = scaling.to_q(np.array([min(parameter.upper, limit.get(parameter.name, np.inf)) for parameter in declared]))
    start = np.clip(scaling.to_q(theta[index]), lower, upper)
    free = np.full(nodes.size, np.inf)
    build_seconds = time.perf_counter() - began

    began = time.perf_counter()
    found = solver(
        x0=np.concatenate([start, (nodes / plant.state_scales[:, None]).T.ravel()]),
        lbx=np.concatenate([lower, -free]), ubx=np.concatenate([upper, free]),
        lbg=np.zeros(defects + inequalities), ubg=np.concatenate([np.zeros(defects), np.full(inequalities, np.inf)]),
    )  # fmt: skip
    seconds = time.perf_counter() - began
    stats = solver.stats()
    X = np.asarray(found["x"]).ravel()
    values = scaling.to_values(X[: len(index)])
    return {
        "values": {name: float(value) for name, value in zip(free_names, values, strict=True)},
        "nodes": X[len(index) :].reshape(-1, len(plant.states)).T * plant.state_scales[:, None],
        "cost": float(found["f"]),
        "iterations": int(stats["iter_count"]),
        "seconds": seconds,
        "build_seconds": build_seconds,
        "status": str(stats["return_status"]),
        "wall": {name.removeprefix("t_wall_"): value for name, value in stats.items() if name.startswith("t_wall_nlp")},
    }


def _programme(
    plant: Plant, theta: np.ndarray, index: Sequence[int], scaling: Scaling, padded: np.ndarray, linked: Sequence[int],
    total: int, substeps: int, options: Options, verbose: bool,
) -> tuple[ca.Function, int, int]:  # fmt: skip
    """The solver, the number of continuity equations and that of inequalities."""
    rows, K = padded.shape[0], options.samples
    count = padded.shape[1] // K
    q, nodes = ca.MX.sym("q", len(index)), ca.MX.sym("nodes", len(plant.states), count)
    variables = ca.veccat(q, nodes)
    interval = _interval(plant, theta, index, scaling, substeps, options)
    mapped = interval.map(count, "thread", options.threads) if options.threads > 1 else interval.map(count)
    end, residual = mapped(nodes, padded.reshape(rows * K, count, order="F"), ca.repmat(q, 1, count))
    r = ca.vec(residual)
    following = [i + 1 for i in linked]
    gaps = ca.vec(end[:, list(linked)] - nodes[:, following])
    positive = _inequalities(plant, theta, index, scaling)(q)
    g = ca.vertcat(gaps, positive)

    J = ca.jacobian(r, variables)
    sigma, multipliers, none = ca.MX.sym("sigma"), ca.MX.sym("multipliers", g.numel()), ca.MX(0, 1)
    hessian = ca.Function(
        "gauss_newton", [variables, none, sigma, multipliers], [ca.triu(ca.mtimes(J.T, J)) * (sigma / total)],
        ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
    )  # fmt: skip
    ipopt = {**IPOPT, "max_wall_time": WALL_SECONDS, "print_level": 5 if verbose else 0, **options.ipopt}
    solver = ca.nlpsol(
        "straightforward", "ipopt", {"x": variables, "f": 0.5 * ca.dot(r, r) / total, "g": g},
        {"hess_lag": hessian, "print_time": False, "show_eval_warnings": False, "error_on_fail": False,
         "calc_lam_p": False, "ipopt": ipopt},
    )  # fmt: skip
    return solver, gaps.numel(), positive.numel()


def _inequalities(plant: Plant, theta: np.ndarray, index: Sequence[int], scaling: Scaling) -> ca.Function:
    """``q -> values >= 0`` that keep the plant's laws physical."""
    q = ca.SX.sym("q", len(index))
    found = [constraint.value for constraint in plant.constraints(scaling.into(theta, index, q))]
    return ca.Function("inequalities", [q], [ca.vertcat(*found) if found else ca.SX(0, 1)])


def _sample(
    plant: Plant, theta: np.ndarray, index: Sequence[int], scaling: Scaling, substeps: int, compiling: dict
) -> ca.Function:
    """``(s, d, q) -> (s of the next sample, weighted residuals)``, states scaled, ``d`` one data column."""
    nw, ny, ns = len(plant.inputs), len(plant.outputs), len(plant.states)
    s, d, q = ca.SX.sym("s", ns), ca.SX.sym("d", 1 + 2 * nw + 2 * ny), ca.SX.sym("q", len(index))
    dt, w, slope, y, weight = ca.vertsplit(d, [0, 1, 1 + nw, 1 + 2 * nw, 1 + 2 * nw + ny, 1 + 2 * nw + 2 * ny])
    full, size = scaling.into(theta, index, q), ca.DM(plant.state_scales)
    outputs = plant.evaluate(s * size, w, full).outputs
    residual = weight * (ca.vertcat(*(outputs[name] for name in plant.outputs)) - y)
    h = dt / substeps
    state = s * size
    for j in range(substeps):
        state = substep(plant, state, w + (j * h) * slope, slope, h, full)
    return ca.Function("sample", [s, d, q], [state / size, residual], {"cse": True, **compiling})


def _interval(
    plant: Plant, theta: np.ndarray, index: Sequence[int], scaling: Scaling, substeps: int, options: Options
) -> ca.Function:
    """``(s, data of K samples in one column, q) -> (end state, residuals of K samples in one column)``."""
    compiling: dict[str, Any] = {}
    if options.flags is not None:
        compiling = {"jit": True, "compiler": "shell", "jit_options": {"flags": list(options.flags), "verbose": False}}
    sample = _sample(plant, theta, index, scaling, substeps, compiling)
    K, rows, ns, nq = options.samples, sample.size1_in(1), len(plant.states), len(index)
    symbol = ca.SX.sym if options.chain == "expand" else ca.MX.sym
    s, data, q = symbol("s", ns), symbol("data", rows * K), symbol("q", nq)
    if options.chain == "mapaccum":
        states, residuals = sample.mapaccum("chain", K)(s, ca.reshape(data, rows, K), ca.repmat(q, 1, K))
        return ca.Function("interval", [s, data, q], [states[:, -1], ca.vec(residuals)])
    state, found = s, []
    for k in range(K):
        state, residual = sample(state, data[k * rows : (k + 1) * rows], q)
        found.append(residual)
    return ca.Function("interval", [s, data, q], [state, ca.vertcat(*found)])


def whole_intervals(
    plant: Plant, data: np.ndarray, breaks: Sequence[int], samples: int
) -> tuple[np.ndarray, list[int]]:
    """``data`` padded run by run to whole intervals (weight 0), and the intervals whose end meets the next start."""
    nw, ny = len(plant.inputs), len(plant.outputs)
    edges = [0, *breaks, data.shape[1]]
    parts: list[np.ndarray] = []
    linked: list[int] = []
    count = 0
    for first, last in pairwise(edges):
        tail = np.repeat(data[:, last - 1 : last], -(last - first) % samples, axis=1)
        tail[1 + nw : 1 + 2 * nw] = 0.0
        tail[-ny:] = 0.0
        parts += [data[:, first:last], tail]
        intervals = (last - first + tail.shape[1]) // samples
        linked += range(count, count + intervals - 1)
        count += intervals
    return np.hstack(parts), linked
