"""What the predictive controller knows of the plant over its horizon: stage dynamics and the friction to come.

Stage states are position, velocity, chamber pressures, the identified effects' own states and the command, each
divided by its typical size; the bristle is left out (its eigenvalue of 1e4 1/s would cost 36 Runge-Kutta steps) and
friction enters as a known force. That force is the bristle's, carried ahead from the observer along the reference
velocity and at the pressures last predicted, scaled by ``alpha``, plus the residual of the extended state observer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers.control_model import EFFECTS, ControlModel
from pneuid.compiled import compile_functions
from pneuid.plant import Stages
from pneuid.step import relaxed

PARTS = 4
"""Parts of a stage in which the effects' own states follow."""


@dataclass(frozen=True)
class Horizon:
    """Compiled functions over ``N`` stages of ``interval`` seconds; ``nx`` stage states of typical size ``scale``.

    dynamics : ``(s (nx,N), du (N), force (N), psup, theta) -> next (nx,N), A (nx, nx N), B (nx, N)``, scaled.
    friction : ``(z, x_ref (N+1), v_ref (N+1), p1 (N), p2 (N), effects (:,N), alpha, residual, theta) -> force (1,N)``.
    """

    dynamics: ca.Function
    friction: ca.Function
    N: int
    nx: int
    interval: float
    scale: np.ndarray
    compiled: bool


def stage_scale(model: ControlModel) -> np.ndarray:
    """Typical sizes of the stage states; the command's is a tenth of full scale."""
    core = list(model.plant.state_scales)
    return np.array([*core[:4], *core[EFFECTS:], 0.1 * model.value("full_scale")])


def build_horizon(model: ControlModel, N: int, interval: float) -> Horizon:
    """Compile the functions of one horizon."""
    dynamics, friction = _dynamics(model, N, interval), _friction(model, N, interval)
    (dynamics, friction), compiled = compile_functions([dynamics, friction], "controllers_horizon")
    scale = stage_scale(model)
    return Horizon(dynamics, friction, N, scale.size, interval, scale, compiled)


def _advanced(start: ca.SX, at: Stages, h: float) -> ca.SX:
    """State without the bristle after ``h`` seconds at the rates of ``at``: effect states by their exact exponential."""
    moved = [start[i] + h * rate for i, rate in enumerate(at.explicit)]
    moved += [relaxed(start[4 + i], source, decay, h) for i, (source, decay) in enumerate(at.relaxing[1:])]
    return ca.vertcat(*moved)


def _concluded(start: ca.SX, of: list[Stages], h: float) -> ca.SX:
    """Motion and pressures after ``h`` seconds by the rates of the four stages of the classical Runge-Kutta rule."""
    rates = zip(*(at.explicit for at in of), strict=True)
    moved = [start[i] + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0 for i, (k1, k2, k3, k4) in enumerate(rates)]
    return ca.vertcat(*moved)


def _followed(start: ca.SX, after: ca.SX, first: Stages, h: float, rates: Callable[[ca.SX], Stages]) -> ca.SX:
    """Effect states after ``h`` seconds in which motion and pressures go evenly from those of ``start`` to ``after``.

    In ``PARTS`` parts, each by an exponential at the rates of its middle, which is foretold by the rates before: a contact's
    corner between sticking and slipping takes a fraction of the stage, and states that follow each other may be as fast as it.
    """
    part, reached, last = h / PARTS, start, first

    def moved(of: Stages, duration: float, end: float) -> ca.SX:
        others = start[:4] + end * (after - start[:4])
        return ca.vertcat(others, *(relaxed(reached[i], *pull, duration) for i, pull in enumerate(of.relaxing[1:], start=4)))

    for k in range(PARTS if start.numel() > 4 else 0):
        last = rates(moved(last, 0.5 * part, (k + 0.5) / PARTS))
        reached = moved(last, part, (k + 1.0) / PARTS)
    return reached[4:]


def _dynamics(model: ControlModel, N: int, interval: float) -> ca.Function:
    """The stage mapped over the horizon; supply and theta are the same for all stages."""
    return stage_function(model, interval).map("controllers_dynamics", "serial", N, [3, 4], [])


def stage_function(model: ControlModel, interval: float) -> ca.Function:
    """``(s, du, force, psup, theta) -> (next, A, B)``: a classical Runge-Kutta step with its derivatives, scaled.

    Effect states relax by exponentials at rates frozen within each stage of the rule: a contact that lets go within a few
    micrometres has eigenvalues that no explicit rule carries over ``interval``.
    """
    scale = ca.DM(stage_scale(model))
    nx = scale.numel()
    s, du = ca.SX.sym("s", nx), ca.SX.sym("du")
    force, psup, theta = ca.SX.sym("force"), ca.SX.sym("psup"), model.theta_symbol()
    size = scale[: nx - 1]
    u = (s[nx - 1] + du) * scale[nx - 1]
    core, h = s[: nx - 1] * size, interval

    def rates(at: ca.SX) -> Stages:
        return model.plant.evaluate(ca.vertcat(at[:4], 0.0, at[4:]), [u, psup], theta, lambda _: force)

    k1 = rates(core)
    k2 = rates(_advanced(core, k1, 0.5 * h))
    k3 = rates(_advanced(core, k2, 0.5 * h))
    k4 = rates(_advanced(core, k3, h))
    others = _concluded(core, [k1, k2, k3, k4], h)
    after = ca.vertcat(ca.vertcat(others, _followed(core, others, k1, h, rates)) / size, s[nx - 1] + du)
    outputs = [after, ca.densify(ca.jacobian(after, s)), ca.densify(ca.jacobian(after, du))]
    return ca.Function("controllers_stage", [s, du, force, psup, theta], ca.cse(outputs))


def bristle_function(model: ControlModel, interval: float) -> ca.Function:
    """``(z, x, v, p1, p2, effects, theta) -> (z, friction)``: the bristle after the interval, carried at the velocity
    ``v`` by its exact exponential, and the model's friction in N at mid-interval."""
    z, theta = ca.SX.sym("z"), model.theta_symbol()
    effects = ca.SX.sym("effects", model.states - EFFECTS)
    x, v, p1, p2 = (ca.SX.sym(name) for name in ("x", "v", "p1", "p2"))
    patm = model.named(theta, "patm")

    def at(deflection: ca.SX) -> Stages:
        return model.plant.evaluate(ca.vertcat(x, v, p1, p2, deflection, effects), [model.neutral, patm], theta)

    def moved(duration: float) -> ca.SX:
        source, decay = at(z).relaxing[0]
        q = ca.fmax(decay * duration, 1e-12)
        return z * ca.exp(-q) - source * duration * ca.expm1(-q) / q

    given = [z, x, v, p1, p2, effects, theta]
    return ca.Function("controllers_bristle", given, [moved(interval), at(moved(0.5 * interval)).friction])


def _friction(model: ControlModel, N: int, interval: float) -> ca.Function:
    """The bristle carried along the reference, and the known force of every stage."""
    chain = bristle_function(model, interval).mapaccum("controllers_bristle_chain", N)
    theta_mx = ca.MX.sym("theta", model.theta.size)
    z0, x_ref, v_ref = ca.MX.sym("z"), ca.MX.sym("x_ref", 1, N + 1), ca.MX.sym("v_ref", 1, N + 1)
    pressure_1, pressure_2 = ca.MX.sym("p1", 1, N), ca.MX.sym("p2", 1, N)
    states = ca.MX.sym("effects", model.states - EFFECTS, N)
    alpha, residual = ca.MX.sym("alpha"), ca.MX.sym("residual")
    middle = (0.5 * (x_ref[:, :-1] + x_ref[:, 1:]), 0.5 * (v_ref[:, :-1] + v_ref[:, 1:]))
    _, force = chain(z0, *middle, pressure_1, pressure_2, states, ca.repmat(theta_mx, 1, N))
    inputs = [z0, x_ref, v_ref, pressure_1, pressure_2, states, alpha, residual, theta_mx]
    return ca.Function("controllers_friction_ahead", inputs, [alpha * force + residual])
