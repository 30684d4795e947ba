"""Numerical inversion of the composed flow map: which command gives a wanted rate of the pressure force.

The map from command to ``A1 dp1/dt - A2 dp2/dt`` rises with the command whatever effects were identified (supply to
chamber 1 grows, supply to chamber 2 falls), so bisection finds the command; a dead zone, a droop or a leak needs no
word of its own. Where an effect puts a state between command and flow (a spool that lags), the flow is taken as it
will be after a short ``lead``.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from controllers.control_model import EFFECTS, ControlModel
from pneuid.compiled import compile_functions
from pneuid.step import relaxed

HALVINGS = 18
"""Bisections: the range of the command (20 V) down to 0.08 mV, below any converter's step."""


def led_force_rate(model: ControlModel, s: Any, u: Any, psup: Any, lead: Any, theta: Any) -> Any:
    """Rate of the pressure force in N/s under ``u`` [V], effect states carried ``lead`` seconds ahead."""
    return model.instant(led(model, s, u, psup, lead, theta), u, psup, theta).force_rate


def led(model: ControlModel, s: Any, u: Any, psup: Any, lead: Any, theta: Any) -> Any:
    """Plant state ``s`` with its effect states carried ``lead`` seconds ahead under ``u`` [V], the others as they are.

    By way of the middle of the lead: one effect state may follow another that follows the command.
    """
    if model.states == EFFECTS:
        return s
    middle = _carried(model, s, s, u, psup, 0.5 * lead, theta)
    return _carried(model, s, middle, u, psup, lead, theta)


def _carried(model: ControlModel, s: Any, at: Any, u: Any, psup: Any, lead: Any, theta: Any) -> Any:
    stages = model.plant.evaluate(at, [u, psup], theta)
    pairs = enumerate(stages.relaxing[1:], start=EFFECTS)
    return ca.vertcat(s[:EFFECTS], *(relaxed(s[i], source, decay, lead) for i, (source, decay) in pairs))


def command_for(model: ControlModel, wanted: Any, s: Any, psup: Any, lead: Any, theta: Any) -> Any:
    """Command in V for a ``wanted`` rate of the pressure force [N/s] at plant state ``s``; a limit if out of reach."""
    null, full = model.named(theta, "null"), model.named(theta, "full_scale")
    low, high = null - full, null + full
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        short = led_force_rate(model, s, middle, psup, lead, theta) < wanted
        low, high = ca.if_else(short, middle, low), ca.if_else(short, high, middle)
    return 0.5 * (low + high)


def same_effect_function(model: ControlModel) -> ca.Function:
    """``same_effect``, compiled."""
    return compile_functions([same_effect(model)], "controllers_same_effect")[0][0]


def same_effect(model: ControlModel) -> ca.Function:
    """``(u, s, psup, lead, meant, theta) -> command``: does on ``theta`` what ``u`` does on ``meant``; interpreted."""
    s, u, psup, lead = ca.SX.sym("s", model.states), ca.SX.sym("u"), ca.SX.sym("psup"), ca.SX.sym("lead")
    meant, theta = ca.SX.sym("meant", model.theta.size), model.theta_symbol()
    command = command_for(model, led_force_rate(model, s, u, psup, lead, meant), s, psup, lead, theta)
    return ca.Function("controllers_same_effect", [u, s, psup, lead, meant, theta], [command], {"cse": True})


class InverseValve:
    """The map and its inverse as compiled functions of numbers.

    Plant state ``s`` ``(model.states,)``, commands in V, supply in Pa absolute, rates in N/s.
    """

    def __init__(self, model: ControlModel, lead: float) -> None:
        self.model, self.lead = model, lead
        s, theta, first = ca.SX.sym("s", model.states), model.theta_symbol(), ca.SX.sym("first")
        psup, ahead = ca.SX.sym("psup"), ca.SX.sym("lead")
        given = [first, s, psup, ahead, theta]
        rate = led_force_rate(model, s, first, psup, ahead, theta)
        command = command_for(model, first, s, psup, ahead, theta)
        functions = [
            ca.Function("controllers_force_rate", given, [rate]),
            ca.Function("controllers_inverse_valve", given, [command]),
        ]
        (self._forward, self._inverse), self.compiled = compile_functions(functions, "controllers_valve")

    def forward(self, s: np.ndarray, u: float, psup: float) -> float:
        """Rate of the pressure force in N/s."""
        return float(self._forward(u, s, psup, self.lead, self.model.theta))

    def __call__(self, wanted: float, s: np.ndarray, psup: float) -> float:
        """Command in V for a wanted rate."""
        return float(self._inverse(wanted, s, psup, self.lead, self.model.theta))
