"""Nonlinear model predictive control by the real-time iteration.

Every sample the identified plant is linearised along the last solution, shifted by one, and one quadratic program
gives the next command. The weights follow from one bandwidth, see ``tuning``. State bounds are soft, the command's
are hard; the change of the command is what is penalised, so nothing pulls the plan away from the reference.
Source: Diehl, Bock, Schloeder, SIAM J. Control Optim. 43 (2005) 1714 (real-time iteration).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers import qp
from controllers.base import POSITION, VELOCITY, Array, Controller, Measurement
from controllers.control_model import EFFECTS, ControlModel, V, X, Z
from controllers.horizon import Horizon, build_horizon
from controllers.observer import ObserverGains, memory_size, observed
from pneuid.compiled import compile_functions


@dataclass(frozen=True)
class MpcGains:
    """Weights and the observer's gains.

    velocity : s, weight of a velocity error relative to a position error; change : m/V, change of the command that
    costs as much as a position error; terminal : factor on the weights of the last stage; the rest as in
    ``ObserverGains``.
    """

    velocity: float
    change: float
    terminal: float
    bandwidth: float
    pressure_trust: float
    alpha: float


ERROR_SCALE = 1e-4
"""Position error that counts 1/2 in the cost, m; sets the scale of the quadratic program only."""


class Mpc(Controller):
    """NMPC on position, velocity, pressures and effect states, with friction as a known force over the horizon."""

    name = "nmpc"

    def __init__(self, model: ControlModel, gains: MpcGains, sample_time: float = 2e-3, stages: int = 40) -> None:
        super().__init__(sample_time, model.lowest, model.highest, model.neutral)
        self.model, self.gains, self.preview = model, gains, stages + 2
        self.horizon = build_horizon(model, stages, sample_time)
        self._observe = _observer(model, sample_time)
        self._numbers = np.array([gains.bandwidth, gains.pressure_trust, gains.alpha])
        self._memory = np.zeros(memory_size(model))
        self._plan_x = np.zeros((stages + 1, self.horizon.nx))
        self._plan_u = np.zeros(stages)
        self._prepare_arrays()
        self._prepare_weights()
        self.iterations = 0
        """Interior-point iterations of the last step; 0 when no bound was active."""

    def _prepare_arrays(self) -> None:
        """Fixed memory that the compiled functions read and write."""
        h, effects = self.horizon, self.model.states - EFFECTS
        N, nx = h.N, h.nx
        self._stage_in = (np.zeros((N, nx)), np.zeros(N), np.zeros(N), np.zeros(1), self.model.theta.copy())
        self._stage_out = (np.zeros((N, nx)), np.zeros((N, nx, nx)), np.zeros((N, nx)))
        self._stage_run = _bound(h.dynamics, self._stage_in, self._stage_out)
        one = np.zeros
        self._friction_in = (
            one(1), one(N + 1), one(N + 1), one(N), one(N), one((N, effects)), one(1), one(1), self.model.theta.copy(),
        )  # fmt: skip
        self._friction_run = _bound(h.friction, self._friction_in, (self._stage_in[2],))
        size = memory_size(self.model)
        self._observe_in = (self._memory, np.zeros(4), np.zeros(1), self._numbers, self.model.theta.copy())
        self._observed = np.zeros(size)
        self._observe_run = _bound(self._observe, self._observe_in, (self._observed,))

    def _prepare_weights(self) -> None:
        h, g, model = self.horizon, self.gains, self.model
        N, nx = h.N, h.nx
        weight = np.zeros(nx)
        weight[0] = (h.scale[0] / ERROR_SCALE) ** 2
        weight[1] = (h.scale[1] * g.velocity / ERROR_SCALE) ** 2
        self._Q = np.tile(weight, (N + 1, 1))
        self._Q[N] *= g.terminal
        self._R = (g.change * h.scale[-1] / ERROR_SCALE) ** 2
        self._give = np.zeros(nx)
        self._give[:4] = 1e-3
        self._lower, self._upper = np.full(nx, -np.inf), np.full(nx, np.inf)
        self._lower[0], self._upper[0] = 0.0, model.value("stroke") / h.scale[0]
        self._lower[-1], self._upper[-1] = model.lowest / h.scale[-1], model.highest / h.scale[-1]
        self._lower[2:4] = 0.9 * model.value("patm") / h.scale[2]

    def _start(self, measurement: Measurement, reference: Array) -> None:
        at = self.model.rest(measurement.x, measurement.p1, measurement.p2)
        self._memory[:] = np.append(at, 0.0)
        self._plan_x[:] = self._stage_state(at, self.neutral)
        self._plan_u[:] = 0.0

    def _stage_state(self, s: np.ndarray, u: float) -> np.ndarray:
        return np.concatenate([s[:Z], s[EFFECTS:], [u]]) / self.horizon.scale

    def _command(self, measurement: Measurement, reference: Array) -> float:
        h = self.horizon
        self._observe_in[1][:] = measurement
        self._observe_in[2][0] = self.applied
        self._observe_run()
        self._memory[:] = self._observed
        s = self._memory[: self.model.states]
        # the command acts from row 1 on
        ahead = reference[1 : h.N + 2]
        self._plan_x[:-1], self._plan_u[:-1] = self._plan_x[1:], self._plan_u[1:]
        self._plan_u[-1] = 0.0
        now = self._stage_state(s, self.applied)
        self._friction_ahead(s, ahead)
        return self._plan(now, ahead, measurement.psup)

    def _friction_ahead(self, s: np.ndarray, ahead: Array) -> None:
        """Fill the known friction force of every stage."""
        h, given, plan = self.horizon, self._friction_in, self._plan_x
        given[0][0] = s[Z]
        given[1][:], given[2][:] = ahead[:, POSITION], ahead[:, VELOCITY]
        given[3][:], given[4][:] = plan[:-1, 2] * h.scale[2], plan[:-1, 3] * h.scale[3]
        given[5][:] = plan[:-1, 4:-1] * h.scale[4:-1]
        given[6][0], given[7][0] = self.gains.alpha, self._memory[self.model.states]
        self._friction_run()

    def _plan(self, now: np.ndarray, ahead: Array, psup: float) -> float:
        """One real-time iteration; returns the first command, V."""
        h, plan = self.horizon, self._plan_x
        states, changes, _, supply, _ = self._stage_in
        states[:], changes[:], supply[0] = plan[:-1], self._plan_u, psup
        self._stage_run()
        after, A, B = self._stage_out
        # CasADi writes column by column: each stage's matrix arrives transposed
        A = np.ascontiguousarray(A.transpose(0, 2, 1))
        target = np.zeros((h.N + 1, h.nx))
        target[:, 0], target[:, 1] = ahead[:, POSITION] / h.scale[0], ahead[:, VELOCITY] / h.scale[1]
        # in absolute variables: x+ = A x + B u + c
        c = after - np.einsum("iab,ib->ia", A, states) - B * changes[:, None]
        upper = np.tile(self._upper, (h.N + 1, 1))
        lower = np.tile(self._lower, (h.N + 1, 1))
        upper[:, 2:4] = 1.05 * psup / h.scale[2]
        found = qp.solve(
            A, B, c, self._Q, -self._Q * target, self._R, lower, upper, self._give, now, 1e-7
        )
        self.iterations = found.iterations
        if not np.all(np.isfinite(found.u)):
            return np.nan
        self._plan_x[:], self._plan_u[:] = found.x, found.u
        return float(found.x[1, -1] * h.scale[-1])


def _observer(model: ControlModel, sample_time: float) -> ca.Function:
    """The observer of one sample, compiled."""
    memory, seen, applied = ca.SX.sym("memory", memory_size(model)), ca.SX.sym("seen", 4), ca.SX.sym("applied")
    numbers, theta = ca.SX.sym("gains", 3), model.theta_symbol()
    gains = ObserverGains(*(numbers[i] for i in range(3)))
    after = observed(model, memory, seen, applied, gains, sample_time, theta)
    name = "controllers_observer"
    function = ca.Function(name, [memory, seen, applied, numbers, theta], [after], {"cse": True})
    return compile_functions([function], name)[0][0]


def _bound(function: ca.Function, given: tuple[np.ndarray, ...], found: tuple[np.ndarray, ...]):
    """A call of ``function`` that reads and writes these arrays in place (C order = CasADi's columns)."""
    buffer, run = function.buffer()
    for place, array in enumerate(given):
        buffer.set_arg(place, memoryview(array.reshape(-1)))
    for place, array in enumerate(found):
        buffer.set_res(place, memoryview(array.reshape(-1)))

    def call(keep: object = (buffer, given, found)) -> None:
        run()

    return call
