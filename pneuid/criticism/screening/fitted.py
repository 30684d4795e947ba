"""The fitted model as screening sees it: its residuals, how they move with parameters and nodes, and the Hessian's solver."""

from __future__ import annotations

import numpy as np

from pneuid.cores import threads
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.interval import trajectory_function
from pneuid.mapped import Mapped
from pneuid.plant import Plant


class Fitted:
    """What was fitted: residuals, their Jacobian and a solver for the Hessian of the free variables.

    Residuals are stacked: weighted outputs of every interval, sample by sample, then the defects in units of their
    allowed spread.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        problem, X = fit.problem, fit.relaxed.X
        q = X[: problem.nq]
        width = problem.scaling.upper - problem.scaling.lower
        held = (q - problem.scaling.lower < 1e-3 * width) | (problem.scaling.upper - q < 1e-3 * width)
        self.free = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
        gradient, hessian = relaxed_system(problem, X)
        H = hessian[self.free][:, self.free]
        self.gradient = gradient[self.free]
        self.solver = factorised(H, int((~held).sum()))
        self.rows, self.ends = problem.jacobian(X)
        self.ends = self.ends[problem.linked] / problem.relaxation
        values = dict(zip(problem.free, problem.scaling.to_values(q), strict=True))
        self.values = problem.values | values
        self.nodes = problem.split(X)[1]
        shown = self.response(self.runner(problem.plant), problem.plant, self.nodes, self.values)
        ny = len(problem.plant.outputs)
        measured = problem.data[-2 * ny : -ny] * problem.data[-ny:]
        defect = -(self.nodes / problem.state_scale[:, None])[:, problem.linked + 1].T / problem.relaxation
        self.residual = shown + np.concatenate([-measured.T.ravel(), defect.ravel()])

    def runner(self, plant: Plant) -> Mapped:
        """Trajectories of ``plant`` over all intervals."""
        problem = self.fit.problem
        return Mapped(trajectory_function(plant, problem.samples, problem.substeps), problem.nint, threads())

    def response(self, run: Mapped, plant: Plant, nodes: np.ndarray, values: dict[str, float]) -> np.ndarray:
        """Weighted outputs and end states of ``plant``, stacked; states that the fitted plant lacks are left out."""
        problem = self.fit.problem
        outputs, states = run(nodes, problem.data, problem.theta_of(values, plant))
        with np.errstate(invalid="ignore"):  # what runs away over a masked sample is not finite, and promises nothing
            shown = outputs * problem.data[-len(plant.outputs) :]
        own = [plant.states.index(name) for name in problem.plant.states]
        ends = states[own, problem.samples :: problem.samples + 1] / problem.state_scale[:, None]
        return np.concatenate([shown.T.ravel(), ends[:, problem.linked].T.ravel() / problem.relaxation])

    def cross(self, change: np.ndarray) -> np.ndarray:
        """Inner products ``(free, k)`` of stacked changes ``(m, k)`` with the columns of the free variables."""
        problem = self.fit.problem
        k, split = change.shape[1], self.rows.shape[0] * self.rows.shape[1]
        defects = change[split:].reshape(problem.linked.size, problem.ns, k)
        blocks = self.rows.transpose(0, 2, 1) @ change[:split].reshape(problem.nint, -1, k)
        blocks[problem.linked] += self.ends.transpose(0, 2, 1) @ defects
        nodes = blocks[:, problem.nq :]
        nodes[problem.linked + 1] -= defects / problem.relaxation
        found = np.concatenate([blocks[:, : problem.nq].sum(axis=0), nodes.reshape(-1, k)])
        return np.asarray(found[self.free])

    def projected(self, raw: np.ndarray, base: np.ndarray) -> np.ndarray:
        """What is left of a stacked change ``raw``, whose inner products with the free columns are ``base``, once the fitted
        parameters and nodes have followed."""
        problem = self.fit.problem
        follow = np.zeros(problem.size)
        follow[self.free] = -self.solver.solve(base)
        nodes = follow[problem.nq :].reshape(problem.nint, problem.ns)
        local = np.hstack([np.tile(follow[: problem.nq], (problem.nint, 1)), nodes])
        rows = np.einsum("ikw,iw->ik", self.rows, local)
        ends = np.einsum("ikw,iw->ik", self.ends, local[problem.linked]) - nodes[problem.linked + 1] / problem.relaxation
        return np.asarray(raw + np.concatenate([rows.ravel(), ends.ravel()]))
