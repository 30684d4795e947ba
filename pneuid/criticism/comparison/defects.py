"""What each balance leaves unexplained: the jumps between intervals of the relaxed fit, beside what noise would leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Shooting

_BALANCES = (("force", "v", "N"), ("pressure_1", "p1", "kPa"), ("pressure_2", "p2", "kPa"))
"""Equation, the state whose jump it leaves, and the unit it is shown in (kPa per interval)."""

ACTING_ON = {
    "force": ("force", "friction"),
    "pressure_1": ("flow_1", "flow_2", "pressure_1", "pressure_2", "valve"),
    "pressure_2": ("flow_2", "flow_1", "pressure_1", "pressure_2", "valve"),
}
"""Equations of the catalogue that act on a balance."""

_DRAWS = 3


@dataclass(frozen=True)
class EquationDefect:
    """What one balance leaves unexplained between intervals: rms and what noise alone would leave, in ``unit``."""

    equation: str
    unit: str
    rms: float
    expected_rms: float


def node_jumps(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """Defects ``(nlinked, ns)`` of a relaxed solution, SI per interval."""
    end, _ = problem.evaluate_values(X)
    return np.asarray(problem.defects(end, X) * problem.state_scale)


def noise_jumps(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """Rms ``(ns,)`` of the defects that the sensors' white noise alone would leave in a right model, SI per interval.

    The gradient of an interval's cost under noise has the covariance of its Gauss-Newton block; drawn from it, the
    linearised relaxed fit answers with steps, and the steps with defects. Seed fixed.
    """
    at = problem.evaluate(X)
    _, hessian = relaxed_system(problem, X)
    solver = factorised(hessian, problem.nq, 1e-12)
    nq, ns, width = problem.nq, problem.ns, problem.nq + problem.ns
    blocks = at.gram[:, :width, :width]
    vectors, values = np.linalg.eigh(blocks)[::-1]
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    rng = np.random.default_rng(2011)
    total = np.zeros(ns)
    for _ in range(_DRAWS):
        noise = np.einsum("iab,ib->ia", root, rng.standard_normal((problem.nint, width)))
        gradient = np.concatenate([noise[:, :nq].sum(axis=0), noise[:, nq:].ravel()])
        step = -solver.solve(gradient)
        nodes = step[nq:].reshape(problem.nint, ns)
        local = np.hstack([np.tile(step[:nq], (problem.nint, 1)), nodes])
        moved = np.einsum("iks,is->ik", at.sensitivity, local)[problem.linked] - nodes[problem.linked + 1]
        total += np.mean(moved**2, axis=0)
    return np.asarray(np.sqrt(total / _DRAWS) * problem.state_scale)


def equation_defects(fit: Fit) -> list[EquationDefect]:
    """Unexplained force (N) and pressure (kPa per interval) of a servo fit; empty on a bench: its only state is the bristle."""
    problem = fit.problem
    if not fit.plant.servo:
        return []
    rms = np.sqrt(np.mean(node_jumps(problem, fit.relaxed.X) ** 2, axis=0))
    expected = noise_jumps(problem, fit.relaxed.X)
    length = float(np.median(problem.data[0])) * problem.samples
    theta = dict(zip(fit.plant.theta_names, fit.plant.theta(fit.values, fit.ranges), strict=True))
    mass = theta.get("mass", theta["mass_run"])
    factors = {"N": mass / length, "kPa": 1e-3}
    return [
        EquationDefect(equation, unit, float(rms[i] * factors[unit]), float(expected[i] * factors[unit]))
        for equation, state, unit in _BALANCES
        for i in [problem.plant.states.index(state)]
    ]
