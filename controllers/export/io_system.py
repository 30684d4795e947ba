"""The identified model for python-control: a nonlinear input/output system, and its linearisations.

An operating point is steady sliding at a constant speed past a position: pressures, bristle and command are those at
which speed and pressures stand still for the moment. At speed zero it is the piston held by its bristle, whose motion
is one of micrometres; a servo's loop is judged in sliding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import control
import numpy as np
from scipy.optimize import root

from controllers.control_model import P1, P2, ControlModel, V, X
from pneuid.api import IdentifiedModel
from pneuid.errors import ComputationError, UserError
from pneuid.model import Model

OUTPUTS = ("x", "v", "p1", "p2")


@dataclass(frozen=True)
class OperatingPoint:
    """Steady sliding: ``state`` (as ``plant.states``), command ``u`` [V], ``supply`` [Pa, absolute], ``speed`` [m/s]."""

    state: np.ndarray
    u: float
    supply: float
    speed: float


def control_model(model: Model | IdentifiedModel) -> ControlModel:
    """The model as the controllers see it. Raises ``UserError`` for the model of a bench, which has no valve."""
    content = model.content if isinstance(model, IdentifiedModel) else model
    if content.rig.kind != "servo":
        raise UserError(f"model '{content.name}' is of a bench; controllers need the model of a servo rig")
    return ControlModel(content.plant, content.theta())


def rates_function(model: ControlModel) -> ca.Function:
    """``(s, (u, psup), theta) -> (rates, A, B)``: rates of all states and their derivatives, interpreted."""
    s, w, theta = ca.SX.sym("s", model.states), ca.SX.sym("w", 2), model.theta_symbol()
    stages = model.plant.evaluate(s, w, theta)
    count = model.plant.explicit_count
    relaxing = [source - decay * s[count + i] for i, (source, decay) in enumerate(stages.relaxing)]
    rates = ca.vertcat(*stages.explicit, *relaxing)
    found = [ca.densify(item) for item in (rates, ca.jacobian(rates, s), ca.jacobian(rates, w))]
    return ca.Function("rates", [s, w, theta], found)


def to_control(model: Model | IdentifiedModel | ControlModel, name: str = "axis") -> control.NonlinearIOSystem:
    """The model as a nonlinear system: inputs u [V] and psup [Pa, absolute], outputs x, v, p1, p2, SI.

    The bristle makes it stiff: simulate with ``solve_ivp_method="BDF"`` or ``"LSODA"``. ``params`` of a simulation are
    model parameters by name. Raises ``UserError`` for the model of a bench.
    """
    found = model if isinstance(model, ControlModel) else control_model(model)
    rates = rates_function(found)

    def update(_t: float, s: Any, w: Any, params: Mapping[str, float]) -> np.ndarray:
        theta = found.with_values(**params) if params else found.theta
        return np.asarray(rates(s, w, theta)[0]).ravel()

    def output(_t: float, s: Any, _w: Any, _params: Mapping[str, float]) -> np.ndarray:
        return np.asarray(s)[: len(OUTPUTS)]

    return control.nlsys(
        update, output, inputs=["u", "psup"], outputs=list(OUTPUTS), states=list(found.plant.states), name=name
    )


def operating_point(model: ControlModel, x: float, supply: float, speed: float) -> OperatingPoint:
    """Steady sliding past ``x`` [m] at ``speed`` [m/s, not zero] under ``supply`` [Pa, absolute].

    Raises ``ComputationError`` when the axis cannot slide so fast.
    """
    rates = rates_function(model)
    patm, full = model.value("patm"), model.value("full_scale")
    sizes = np.array([1e5, 1e5, 1e-5, 0.1 * full, *(state.scale for state in model.plant.effect_states)])

    def assembled(unknown: np.ndarray) -> tuple[np.ndarray, float]:
        p1, p2, z, u, *effects = unknown * sizes
        return np.array([x, speed, p1, p2, z, *effects]), u

    weights = np.array([1.0, 1e6, 1e6, abs(speed), *(state.scale for state in model.plant.effect_states)])

    def residual(unknown: np.ndarray) -> np.ndarray:
        state, u = assembled(unknown)
        return np.asarray(rates(state, [u, supply], model.theta)[0]).ravel()[V:] / weights

    level = patm + 0.6 * (supply - patm)
    error, unknown = np.inf, np.zeros(sizes.size)
    for share in (0.1, 0.03, 0.3, 0.6):
        u = model.neutral + np.copysign(share * full, speed)
        start = np.concatenate([[level, level, np.copysign(2e-5, speed), u], model.effect_start]) / sizes
        found = root(residual, start, method="lm", options={"xtol": 1e-12, "ftol": 1e-12})
        if np.max(np.abs(found.fun)) < error:
            error, unknown = float(np.max(np.abs(found.fun))), found.x
    state, u = assembled(unknown)
    if error > 1e-6 or not (patm < state[P1] < supply and patm < state[P2] < supply):
        bar = (supply - patm) / 1e5
        raise ComputationError(
            f"the axis cannot slide steadily at {speed:g} m/s under {bar:.2g} bar gauge; ask for less"
        )
    return OperatingPoint(state, float(u), supply, speed)


def passing_point(
    model: ControlModel, passed: tuple[float, float, float, float], u: float, supply: float
) -> OperatingPoint:
    """The point at which the axis passes with (x [m], v [m/s], p1, p2 [Pa, absolute]) under ``u`` [V] and ``supply``
    [Pa, absolute], bristle and effect states settled; speed and pressures may be changing."""
    x, v, p1, p2 = passed
    state, count = model.rest(x, p1, p2), model.plant.explicit_count
    state[V] = v
    s, w, theta = ca.SX.sym("s", model.states), ca.SX.sym("w", 2), model.theta_symbol()
    stages = model.plant.evaluate(s, w, theta)
    settled = ca.Function("settled", [s, w, theta], [ca.vertcat(*(a / b for a, b in stages.relaxing))])
    for _ in range(10):  # the bristle settles at once; an effect's state may depend on another's
        state[count:] = np.asarray(settled(state, [u, supply], model.theta)).ravel()
    return OperatingPoint(state, u, supply, v)


def linearised(model: ControlModel, point: OperatingPoint) -> control.StateSpace:
    """Small deviations about an operating point: inputs u [V], psup [Pa]; outputs x, v, p1, p2; states as the plant's."""
    _, A, B = (np.asarray(item) for item in rates_function(model)(point.state, [point.u, point.supply], model.theta))
    C = np.eye(len(OUTPUTS), model.states)
    D = np.zeros((len(OUTPUTS), 2))
    return control.ss(
        A, B, C, D, states=list(model.plant.states), inputs=["u", "psup"], outputs=list(OUTPUTS),
        name=f"x_{1e3 * point.state[X]:.0f}mm_v_{1e3 * point.speed:.0f}mm_s",
    )  # fmt: skip
