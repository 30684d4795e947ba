"""Nonlinear model predictive control by the real-time iteration.

Every sample the identified plant is linearised along the last solution, shifted by one, and one quadratic program
gives the next command. The weights follow from one bandwidth, see ``tuning``. State bounds are soft, the command's
are hard; the change of the command is what is penalised, so nothing pulls the plan away from the reference.
The plan is made on the plant with a rounded valve: inside a sharp dead zone a linearisation sees no effect of the
command at all. What the plan's command does there is then done on the sharp plant, by the inverse valve.
Source: Diehl, Bock, Schloeder, SIAM J. Control Optim. 43 (2005) 1714 (real-time iteration).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers import qp
from controllers.base import POSITION, VELOCITY, Array, Controller, Measurement
from controllers.control_model import EFFECTS, ControlModel, Z
from controllers.horizon import build_horizon
from controllers.inplace import InPlace
from controllers.inverse_valve import same_effect_function
from controllers.observer import ObserverGains, memory_size, observed, start_memory
from pneuid.compiled import compile_functions


@dataclass(frozen=True)
class MpcGains:
    """Weights and the observer's gains.

    velocity : s, weight of a velocity error relative to a position error; change : m/V, change of the command that
    costs as much as a position error; supply : Pa absolute, below which ``change`` falls with the measured supply, because
    what a command sets flowing does: the loop keeps its bandwidth; terminal : factor on the weights of the last stage; the
    rest as in ``ObserverGains``.
    """

    velocity: float
    change: float
    supply: float
    terminal: float
    bandwidth: float
    pressure_trust: float
    alpha: float
    learning: float


ERROR_SCALE = 1e-4
"""Position error that counts 1/2 in the cost, m; sets the scale of the quadratic program only."""

TOLERANCE = 1e-4
"""Of the quadratic program's interior point, whose commands are of order one; what it leaves is taken to the last digit."""

ASIDE = 1e-6
"""Distance from the ends of the command, in its scale, at which a plan that saturates is linearised: at the very end the
last digit would decide whether the valve has any authority there."""

GIVE = 1e-3
"""Softness of the state bounds: crossing by one typical size costs as much as 2 mm of position error."""

ROUNDED_OPENING = 0.02
"""Width of the valve's rounding in the plan, relative to full scale."""

ROUNDED_LAMINAR = 5e-3
"""Width of the laminar patch in the plan; keeps the chamber's eigenvalue within the Runge-Kutta step."""


class Mpc(Controller):
    """NMPC on position, velocity, pressures and effect states, with friction as a known force over the horizon."""

    name = "nmpc"

    def __init__(self, model: ControlModel, gains: MpcGains, sample_time: float = 2e-3, stages: int = 40) -> None:
        super().__init__(sample_time, model.lowest, model.highest, model.neutral)
        self.model, self.preview, self._ambient = model, stages + 2, model.value("patm")
        self.horizon = build_horizon(model, stages, sample_time)
        self._plan_x, self._plan_u = np.zeros((stages + 1, self.horizon.nx)), np.zeros(stages)
        self._planned = model.neutral
        self._prepare_observer()
        self._prepare_horizon()
        self._prepare_bounds()
        self.retune(gains)
        self.iterations = 0
        """Interior-point iterations of the last step; 0 when no bound was active."""

    def retune(self, gains: MpcGains) -> None:
        """Other gains for the same controller, without compiling again."""
        h, self.gains = self.horizon, gains
        self._numbers[:] = gains.bandwidth, gains.pressure_trust, gains.alpha, gains.learning
        weight = np.zeros(h.nx)
        weight[0] = (h.scale[0] / ERROR_SCALE) ** 2
        weight[1] = (h.scale[1] * gains.velocity / ERROR_SCALE) ** 2
        self._Q = np.tile(weight, (h.N + 1, 1))
        self._Q[h.N] *= gains.terminal
        self.change_weight = (gains.change * h.scale[-1] / ERROR_SCALE) ** 2
        """Weight of a scaled command change at the supply of the gains and above."""
        self.program = qp.Program(
            np.swapaxes(self._A, 1, 2), self._B, np.zeros_like(self._B), self._Q, np.zeros_like(self._Q),
            self.change_weight, self._lower, self._upper, self._give, self._stage_state(),
        )  # fmt: skip
        """The quadratic program of the last step, its arrays partly shared with the controller's work space."""

    @property
    def memory(self) -> np.ndarray:
        """A copy of the observer's memory, for inspection."""
        return self._memory.copy()

    def plan(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Copies of the plan: stage states ``(N+1, nx)`` and command changes ``(N,)``, scaled, and forces ``(N,)`` in N."""
        return self._plan_x.copy(), self._plan_u.copy(), self._force.copy()

    def _prepare_observer(self) -> None:
        """Fixed memory of the observer and of the translation of a planned command into one for the valve."""
        model, size = self.model, memory_size(self.model)
        self._memory, self._observed, self._state = np.zeros(size), np.zeros(size), np.zeros(model.states)
        self._seen, self._acting, self._numbers = np.zeros(4), np.zeros(1), np.zeros(4)
        theta = model.theta.copy()
        given = (self._memory, self._seen, self._acting, self._numbers, theta)
        compiled = compile_functions([observer_function(model, self.sample_time)], "controllers_observer")[0][0]
        self._observe = InPlace(compiled, given, (self._observed,))
        self._supply, self._meant, self._command_out = np.zeros(1), np.zeros(1), np.zeros(1)
        self._rounded = model.with_values(smooth_opening=ROUNDED_OPENING, smooth_laminar=ROUNDED_LAMINAR)
        lead = np.array([self.sample_time])
        translated = (self._meant, self._state, self._supply, lead, self._rounded, theta)
        self._translate = InPlace(same_effect_function(model), translated, (self._command_out,))

    def _prepare_horizon(self) -> None:
        """Fixed memory of the stage dynamics and of the friction to come."""
        h = self.horizon
        N, nx, zeros = h.N, h.nx, np.zeros
        self._force, self._start_x, self._start_u = zeros(N), zeros((N, nx)), zeros(N)
        self._after, self._A, self._B = zeros((N, nx)), zeros((N, nx, nx)), zeros((N, nx))
        given = (self._start_x, self._start_u, self._force, self._supply, self._rounded)
        self._linearise = InPlace(h.dynamics, given, (self._after, self._A, self._B))
        self._z, self._share, self._residual = zeros(1), zeros(1), zeros(1)
        self._x_ref, self._v_ref, self._p1, self._p2 = zeros(N + 1), zeros(N + 1), zeros(N), zeros(N)
        self._effects = zeros((N, self.model.states - EFFECTS))
        ahead = (self._z, self._x_ref, self._v_ref, self._p1, self._p2, self._effects, self._share, self._residual)
        self._friction = InPlace(h.friction, (*ahead, self.model.theta.copy()), (self._force,))

    def _prepare_bounds(self) -> None:
        """Soft bounds on position and pressures, hard ones on the command; the supply's are set in every step."""
        h, model = self.horizon, self.model
        self._give = np.zeros(h.nx)
        self._give[:4] = GIVE
        self._lower, self._upper = np.full((h.N + 1, h.nx), -np.inf), np.full((h.N + 1, h.nx), np.inf)
        self._lower[:, 0], self._upper[:, 0] = 0.0, model.value("stroke") / h.scale[0]
        self._lower[:, -1], self._upper[:, -1] = model.lowest / h.scale[-1], model.highest / h.scale[-1]
        self._lower[:, 2:4] = 0.9 * model.value("patm") / h.scale[2]

    def _start(self, measurement: Measurement) -> None:
        self._memory[:] = start_memory(self.model, measurement)
        self._state[:] = self._memory[: self.model.states]
        self._planned = self.neutral
        self._plan_x[:] = self._stage_state()
        self._plan_u[:] = 0.0

    def _stage_state(self) -> np.ndarray:
        """The estimate as a stage state, scaled."""
        s = self._state
        return np.concatenate([s[:Z], s[EFFECTS:], [self._planned]]) / self.horizon.scale

    def _command(self, measurement: Measurement, reference: Array) -> float:
        self._seen[:], self._acting[0], self._supply[0] = measurement, self.applied, measurement.psup
        self._observe()
        self._memory[:] = self._observed
        self._state[:] = self._memory[: self.model.states]
        self._plan_x[:-1], self._plan_u[:-1] = self._plan_x[1:], self._plan_u[1:]
        self._plan_u[-1] = 0.0
        # the command acts from row 1 on
        ahead = reference[1 : self.horizon.N + 2]
        self._friction_ahead(ahead)
        self._planned = self._plan(ahead)
        self._meant[0] = self._planned
        self._translate()
        return float(self._command_out[0])

    def _weight_of_change(self) -> float:
        """Weight of a scaled command change under the measured supply; below ambient pressure no valve moves anything."""
        return self.change_weight * min(max(float(self._supply[0]), self._ambient) / self.gains.supply, 1.0) ** 2

    def _friction_ahead(self, ahead: Array) -> None:
        """Fill the known friction force of every stage."""
        scale, plan = self.horizon.scale, self._plan_x[:-1]
        self._z[0] = self._state[Z]
        self._x_ref[:], self._v_ref[:] = ahead[:, POSITION], ahead[:, VELOCITY]
        self._p1[:], self._p2[:] = plan[:, 2] * scale[2], plan[:, 3] * scale[3]
        self._effects[:] = plan[:, 4:-1] * scale[4:-1]
        self._residual[0] = self._memory[self.model.states]
        self._share[0] = self.gains.alpha + self._memory[self.model.states + 1]
        self._friction()

    def _plan(self, ahead: Array) -> float:
        """One real-time iteration; returns the first command, V (not finite when the program has no solution)."""
        h = self.horizon
        self._start_x[:], self._start_u[:] = self._plan_x[:-1], self._plan_u
        held, (low, high) = self._start_x[:, -1], (self._lower[0, -1] + ASIDE, self._upper[0, -1] - ASIDE)
        self._start_u[:] = np.minimum(np.maximum(held + self._start_u, low), high) - held
        self._linearise()
        # CasADi writes column by column: each stage's matrix arrives transposed
        A = np.ascontiguousarray(self._A.transpose(0, 2, 1))
        target = np.zeros((h.N + 1, h.nx))
        target[:, 0], target[:, 1] = ahead[:, POSITION] / h.scale[0], ahead[:, VELOCITY] / h.scale[1]
        with np.errstate(over="ignore", invalid="ignore"):  # on nonsense from the sensors; what is not finite is not played
            c = self._after - np.einsum("iab,ib->ia", A, self._start_x) - self._B * self._start_u[:, None]
        self._upper[:, 2:4] = 1.05 * self._supply[0] / h.scale[2]
        self.program = qp.Program(
            A, self._B, c, self._Q, -self._Q * target, self._weight_of_change(), self._lower, self._upper,
            self._give, self._stage_state(),
        )  # fmt: skip
        found = qp.solve(*self.program, TOLERANCE)
        self.iterations = found.iterations
        if not np.all(np.isfinite(found.u)):
            return float("nan")
        self._plan_x[:], self._plan_u[:] = found.x, found.u
        return float(found.x[1, -1] * h.scale[-1])


class MpcEso(Mpc):
    """The same without a friction model: all friction is the observer's residual force (``alpha = 0``)."""

    name = "nmpc_eso"


def observer_function(model: ControlModel, sample_time: float) -> ca.Function:
    """``(memory, seen, applied, gains, theta) -> memory``: the observer of one sample, interpreted."""
    memory, seen, applied = ca.SX.sym("memory", memory_size(model)), ca.SX.sym("seen", 4), ca.SX.sym("applied")
    numbers, theta = ca.SX.sym("gains", 4), model.theta_symbol()
    gains = ObserverGains(*(numbers[i] for i in range(4)))
    after = observed(model, memory, seen, applied, gains, sample_time, theta)
    return ca.Function("controllers_observer", [memory, seen, applied, numbers, theta], [after], {"cse": True})
