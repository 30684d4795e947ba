"""IPOPT on the multiple-shooting problem, with every derivative supplied.

Two stages share one interval function. Relaxed: the continuity defects are penalised, there are no equalities, coarse
smoothing; it converges from rough starts and with a wrong model. Exact: the defects are equalities, fine smoothing,
started from the relaxed solution. IPOPT gets ``f, grad_f, g, jac_g`` and the Gauss-Newton ``hess_lag``; nothing is
differentiated at the level of the nonlinear programme.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from pneuid.ahead import is_copy
from pneuid.estimation.assembly import Assembly
from pneuid.estimation.chained import Chained
from pneuid.estimation.factor import factorised
from pneuid.estimation.shooting import Shooting

Monitor = Callable[[str, int, float], None]
"""Called with stage, iteration and cost per sample."""


SETTLED_OVER = 6
"""Iterations of the relaxed stage without a relative gain of ``SETTLED_GAIN`` after which it has settled: Gauss-Newton
steps across the kinks of stick-slip go on zigzagging at that level for a hundred more."""

SETTLED_GAIN = 1e-4
SETTLED_EXACT = 1e-6

ARRIVED, NEARBY = 0.05, 1.0
"""Distances from the optimum, in standard errors of all parameters together, at which a path needs no further step: one whose
parameters are the result, and one of a part of the record, whose optimum is further than that from the whole's."""

LAST_STEP = 10.0
"""Times the distance asked for from which the step there is taken without looking at the slopes where it ends."""

AS_EXPECTED = (0.7, 2.0)
"""Shares of the expected fall of the cost between which it must lie then."""

INTERRUPTED = "Interrupted"
"""Status of a stage that was stopped by ctrl-C; its outcome is the best point so far."""

CONVERGED = "Converged"
"""Status of a stage that ended within the distance from the optimum that was asked for."""

LONGEST_SECONDS = 900.0
"""A stage is stopped after this time whatever its state; iterations limit it long before, on any machine."""

CONTINUOUS = 1e-3
"""Largest defect, in units of the state scale, of a point that counts as continuous (0.1 um, 10 um/s, 1 Pa, 10 nm)."""

_ROUGH = {"tol": 1e-4, "mu_strategy": "monotone", "mu_init": 1e-5, "max_iter": 60}
"""IPOPT on a relaxed problem."""

DAMPING_START = 0.1
"""Levenberg-Marquardt damping, relative to the Hessian's diagonal, after the first shortened step."""


@dataclass(frozen=True)
class Outcome:
    """How a stage ended: variables, cost (data and prior, unscaled), IPOPT's word, iterations, seconds."""

    X: np.ndarray
    cost: float
    penalty: float
    status: str
    success: bool
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Settling:
    """When a stage has settled: a relative ``gain`` of less over so many iterations, or at the distance ``arrived``."""

    gain: float
    over: int = SETTLED_OVER
    arrived: float = 0.0


USUAL, ROUGHLY = Settling(SETTLED_GAIN), Settling(1e-3)
"""For a relaxed problem, and for one that only leads to the next."""

CLOSE = Settling(SETTLED_EXACT, arrived=ARRIVED)
NEAR = Settling(SETTLED_GAIN, 2, NEARBY)
"""For a path whose parameters are the result, and for one of a part of the record."""

AGAIN = Settling(0.5 * SETTLED_GAIN, 1)
"""For a relaxed problem whose parameters and path are all but right: what is left to do is the nodes' part."""


class _Evaluator:
    """One evaluation per point, shared by the functions that IPOPT asks for."""

    def __init__(
        self, problem: Shooting, relaxed: bool, stage: str, settling: Settling, monitor: Monitor | None, deadline: float
    ) -> None:
        self.problem, self.relaxed, self.stage, self.settling = problem, relaxed, stage, settling
        self.assembly = Assembly(problem, relaxed)
        self.scale = 1.0 / max(problem.total_samples, 1)
        self.monitor, self.deadline = None if is_copy() else monitor, deadline
        self.iterations = 0
        self.best: tuple[float, np.ndarray] | None = None
        self.history: list[float] = []
        self.feasible: tuple[float, np.ndarray] | None = None
        self.stopped = ""
        self.damping, self._trials, self._last = 0.0, 0, np.inf
        self._value_key, self._value, self._slope = b"", (0.0, np.zeros(0)), np.zeros((0, 0))
        self._key, self._at = b"", (np.zeros(0), np.zeros(0), np.zeros(0))
        self.failure: BaseException | None = None

    def value(self, X: np.ndarray) -> tuple[float, np.ndarray]:
        """Scaled objective and constraints."""
        key = X.tobytes()
        if key != self._value_key:
            self._trials += 1
            end, cost = self.problem.evaluate_values(X)
            inequalities, self._slope = self.problem.constraints(X[: self.problem.nq])
            with np.errstate(over="ignore", invalid="ignore"):  # a trial point may lie anywhere
                defects = self.problem.defects(end, X).ravel()
                cost += 0.5 * float(np.sum(self.problem.prior_residual(X) ** 2))
                if self.relaxed:
                    cost += 0.5 * float(np.sum((defects / self.problem.relaxation) ** 2))
            g = inequalities if self.relaxed else np.concatenate([defects, inequalities])
            self._value_key, self._value = key, (cost * self.scale, g)
            if self.relaxed and np.isfinite(cost) and (self.best is None or cost * self.scale < self.best[0]):
                self.best = (cost * self.scale, X.copy())
        return self._value

    def derivatives(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gradient, Jacobian nonzeros, Hessian nonzeros."""
        key = X.tobytes()
        if key != self._key:
            self.value(X)
            at = self.problem.evaluate(X)
            gradient, hessian = self.assembly.gradient_and_hessian(at, X, self.scale)
            if self.relaxed:
                self._damp(hessian)
            self._key, self._at = key, (gradient, self.assembly.jacobian(at, self._slope), hessian)
        return self._at

    def _damp(self, hessian: np.ndarray) -> None:
        """Levenberg-Marquardt term in place: IPOPT adds none to a Hessian that is positive definite already.

        Raised when the last step was shortened or led uphill, lowered when a full step led downhill.
        """
        cost = self._value[0]
        if self._trials > 1 or cost > self._last:
            self.damping = max(3.0 * self.damping, DAMPING_START)
        else:
            self.damping = 0.4 * self.damping if self.damping > 1e-3 else 0.0
        self._trials, self._last = 0, cost
        hessian[self.assembly.pattern.hess_diagonal] *= 1.0 + self.damping

    def after_iteration(self, X: np.ndarray, cost: float, g: np.ndarray) -> bool:
        """Report to the monitor; True when IPOPT should stop (settled, out of time, interrupted)."""
        self.iterations += 1
        if self.relaxed:
            self.history.append(cost if self.best is None else self.best[0])
        elif np.all(np.abs(g[: self.assembly.pattern.ndef]) < CONTINUOUS):
            if self.feasible is None or cost < self.feasible[0]:
                self.feasible = (cost, X.copy())
            self.history.append(self.feasible[0])
        if self.failure is None and self.monitor is not None:
            try:
                self.monitor(self.stage, self.iterations, cost)
            except KeyboardInterrupt as stop:
                self.failure = stop
        if self.failure is not None:
            self.stopped = INTERRUPTED
        elif time.monotonic() > self.deadline:
            self.stopped = "Time_Limit_Exceeded"
        elif self._arrived(X):
            self.stopped = CONVERGED
        elif self._settled(cost):
            self.stopped = "Settled"
        return bool(self.stopped)

    def _settled(self, cost: float) -> bool:
        gain, over = self.settling.gain, self.settling.over
        if len(self.history) <= over:
            return False
        best = self.history[-1]
        return self.history[-1 - over] - best < gain * abs(best) and cost < (1 + 10 * gain) * best

    def _arrived(self, X: np.ndarray) -> bool:
        """Whether the optimum is as near as was asked for, at ``X`` or a step from it, which then is the best point."""
        if not self.settling.arrived or X.tobytes() != self._key:
            return False
        step, distance = self._to_optimum(X)
        if distance < self.settling.arrived:
            return True
        if distance > LAST_STEP * self.settling.arrived:
            return False
        q, scaling = (X + step)[: self.problem.nq], self.problem.scaling
        if np.any(q < scaling.lower) or np.any(q > scaling.upper):
            return False
        before, trials = self.value(X)[0], self._trials
        fall, expected = before - self.value(X + step)[0], 0.5 * distance**2 * self.scale
        self._trials = trials  # a look is none of the solver's trials
        return bool(AS_EXPECTED[0] * expected < fall < AS_EXPECTED[1] * expected)

    def _to_optimum(self, X: np.ndarray) -> tuple[np.ndarray, float]:
        """Step to the optimum of the Gauss-Newton model at ``X``, and its length in standard errors of all variables together.

        Parameters on a bound are held; infinite where the model has no optimum.
        """
        gradient, _, hessian = (item.copy() for item in self._at)
        hessian[self.assembly.pattern.hess_diagonal] /= 1.0 + self.damping
        held = np.flatnonzero(self.problem.scaling.on_bound(X[: self.problem.nq]))
        gradient[held] = 0.0
        hessian[self.assembly.pattern.hess_diagonal[held]] *= 1e12
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                step = factorised(self.assembly.hessian_matrix(hessian), self.problem.nq).solve(gradient)
            except RuntimeError:  # SuperLU: a variable that nothing sees at this point
                return np.zeros(X.size), np.inf
            if not np.all(np.isfinite(step)):
                return np.zeros(X.size), np.inf
            return -step, float(np.sqrt(gradient @ step / self.scale))


class _Function(ca.Callback):
    """A CasADi function whose value comes from the shared evaluator."""

    def __init__(
        self,
        name: str,
        evaluator: _Evaluator,
        inputs: list[tuple[int, int]],
        outputs: list[ca.Sparsity],
        compute: Callable,
    ) -> None:
        ca.Callback.__init__(self)
        self._inputs, self._outputs, self._compute, self._evaluator = inputs, outputs, compute, evaluator
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._inputs[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._outputs[i]

    def has_eval_buffer(self) -> bool:
        """CasADi asks: numbers come and go by address."""
        return True

    def eval_buffer(self, arguments: Sequence[memoryview | None], results: Sequence[memoryview | None]) -> int:
        """One evaluation, nonzeros in and out; 0 says that it went well, NaN that it was stopped."""
        # an input that is not there stands for zeros
        given = [
            np.frombuffer(item) if item is not None and item.nbytes else np.zeros(rows * columns)
            for item, (rows, columns) in zip(arguments, self._inputs, strict=True)
        ]
        try:
            found = self._compute(given[0].copy(), given)
        except KeyboardInterrupt as stop:
            # an exception cannot cross the solver: it is kept, and the next iteration stops
            self._evaluator.failure = stop
            found = [np.full(sparsity.nnz(), np.nan) for sparsity in self._outputs]
        for result, value in zip(results, found, strict=True):
            if result is not None and result.nbytes:
                np.frombuffer(result)[:] = value
        return 0


def _ipopt(evaluator: _Evaluator, options: dict) -> tuple[ca.Function, list[_Function]]:
    """The solver and the callbacks it needs kept alive."""
    n, pattern = evaluator.problem.size, evaluator.assembly.pattern
    m = pattern.ndef + pattern.ncon
    scalar, dense_g = ca.Sparsity.dense(1, 1), ca.Sparsity.dense(m, 1)
    x_p, lam = [(n, 1), (0, 1)], [(1, 1), (m, 1)]

    def objective(X: np.ndarray, _: list) -> list:
        f, g = evaluator.value(X)
        return [np.array([f]), g]

    def gradient(X: np.ndarray, _: list) -> list:
        return [np.array([evaluator.value(X)[0]]), evaluator.derivatives(X)[0]]

    def jacobian(X: np.ndarray, _: list) -> list:
        return [evaluator.value(X)[1], evaluator.derivatives(X)[1]]

    def hessian(X: np.ndarray, given: list) -> list:
        return [float(given[2][0]) * evaluator.derivatives(X)[2]]

    fg = _Function("pneuid_fg", evaluator, [(n, 1)], [scalar, dense_g], objective)
    grad_f = _Function("pneuid_grad", evaluator, x_p, [scalar, ca.Sparsity.dense(n, 1)], gradient)
    jac_g = _Function("pneuid_jac", evaluator, x_p, [dense_g, pattern.jac_sparsity], jacobian)
    hess = _Function("pneuid_hess", evaluator, x_p + lam, [pattern.hess_sparsity], hessian)

    def progress(X: np.ndarray, given: list) -> list:
        return [np.array([float(evaluator.after_iteration(X, float(given[1][0]), given[2].copy()))])]

    shapes = [(n, 1), (1, 1), (m, 1), (n, 1), (m, 1), (0, 1)]
    each = _Function("pneuid_iteration", evaluator, shapes, [scalar], progress)
    x = ca.MX.sym("x", n)
    f, g = fg(x)
    ipopt = {"print_level": 0, "sb": "yes", "max_iter": 200, **options}
    solver = ca.nlpsol(
        "pneuid_nlp", "ipopt", {"x": x, "f": f, "g": g},
        {"grad_f": grad_f, "jac_g": jac_g, "hess_lag": hess, "no_nlp_grad": True, "calc_lam_p": False,
         "print_time": False, "show_eval_warnings": False, "error_on_fail": False,
         "iteration_callback": each, "ipopt": ipopt},
    )  # fmt: skip
    return solver, [fg, grad_f, jac_g, hess, each]


@np.errstate(over="ignore", invalid="ignore")  # a trial point may lie anywhere, and a fit may diverge
def _solve(
    problem: Shooting, X0: np.ndarray, relaxed: bool, stage: str, settling: Settling, options: dict,
    monitor: Monitor | None,
) -> Outcome:
    began = time.monotonic()
    evaluator = _Evaluator(problem, relaxed, stage, settling, monitor, began + LONGEST_SECONDS)
    solver, _kept = _ipopt(evaluator, options)
    lower, upper = np.full(problem.size, -np.inf), np.full(problem.size, np.inf)
    lower[: problem.nq], upper[: problem.nq] = problem.scaling.lower, problem.scaling.upper
    ndef, ncon = evaluator.assembly.pattern.ndef, problem.ncon
    found = solver(
        x0=X0, lbx=lower, ubx=upper,
        lbg=np.zeros(ndef + ncon), ubg=np.concatenate([np.zeros(ndef), np.full(ncon, np.inf)]),
    )  # fmt: skip
    stats = solver.stats()
    X = np.asarray(found["x"]).ravel()
    status = evaluator.stopped or str(stats["return_status"])
    if relaxed and evaluator.best is not None:
        X = evaluator.best[1]
    if not relaxed and status == "Settled" and evaluator.feasible is not None:
        X = evaluator.feasible[1]
    end, data_cost = problem.evaluate_values(X)
    penalty = 0.5 * float(np.sum((problem.defects(end, X) / problem.relaxation) ** 2))
    success = bool(stats["success"]) or status in ("Settled", CONVERGED)
    return Outcome(
        X=X, cost=data_cost, penalty=penalty, status=status, success=success,
        iterations=evaluator.iterations, seconds=time.monotonic() - began,
    )  # fmt: skip


def solve_relaxed(
    problem: Shooting, X0: np.ndarray, monitor: Monitor | None = None, settling: Settling = USUAL
) -> Outcome:
    """Minimise cost plus penalised defects from ``X0``; never worse than the best point visited."""
    return _solve(problem, X0, True, "relaxed", settling, _ROUGH, monitor)


def solve_relaxed_again(problem: Shooting, X0: np.ndarray, monitor: Monitor | None = None) -> Outcome:
    """The same from parameters and a path that are all but right."""
    return _solve(problem, X0, True, "relaxed", AGAIN, _ROUGH, monitor)


def solve_chained(
    problem: Chained, X0: np.ndarray, monitor: Monitor | None = None, settling: Settling = CLOSE
) -> Outcome:
    """Minimise the cost along paths that are continuous within the windows of ``problem``; the best point visited."""
    options = {"tol": 1e-6, "mu_strategy": "monotone", "mu_init": 1e-7, "max_iter": 40}
    return _solve(problem, X0, True, "continuous", settling, options, monitor)


def solve_exact(problem: Shooting, X0: np.ndarray, monitor: Monitor | None = None, iterations: int = 40) -> Outcome:
    """Minimise the cost subject to continuity, from a point ``X0`` near the solution."""
    # the last digits of the dual infeasibility are the kinks' rounding: a cost that no longer moves is the end
    options = {
        "tol": 1e-6, "mu_strategy": "monotone", "mu_init": 1e-7, "max_iter": iterations,
        "acceptable_tol": 1e-3, "acceptable_iter": 2, "acceptable_obj_change_tol": 1e-7,
        "acceptable_constr_viol_tol": 1e-3, "acceptable_dual_inf_tol": 1e-3,
    }  # fmt: skip
    return _solve(problem, X0, False, "exact", Settling(SETTLED_EXACT), options, monitor)
