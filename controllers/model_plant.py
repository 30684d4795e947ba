"""The identified model played as a plant: what gains are tuned on, never the rig's hidden truth."""

from __future__ import annotations

from collections import deque
from typing import cast

import casadi as ca
import numpy as np

from controllers.base import Array
from controllers.control_model import ControlModel, KnownFriction
from controllers.inplace import InPlace
from pneuid.compiled import compile_functions
from pneuid.errors import ComputationError
from pneuid.physics.motion import GRAVITY
from pneuid.plant import Plant
from pneuid.step import substep, substeps_needed

STEP = 1e-3
"""Longest step of the model, s; substeps within it as in the simulation of a fit."""


class ModelPlant:
    """The model with the interface of the virtual rig's ``ServoPlant``.

    delay : extra time from command to valve in s, rounded to whole steps; a loop that does not survive a small one
    has no margin. x_noise, p_noise : 1-sigma of the sensors, m and Pa; x_grid : their resolution, m; friction : share
    of the model's friction that this plant has.
    """

    def __init__(
        self,
        model: ControlModel,
        delay: float = 0.0,
        x_noise: float = 2e-6,
        x_grid: float = 1e-6,
        p_noise: float = 500.0,
        friction: float = 1.0,
    ) -> None:
        self.model, self.x_noise, self.x_grid, self.p_noise = model, x_noise, x_grid, p_noise
        self._waiting = round(delay / STEP)
        function = compile_functions([step_function(model, friction)], "controllers_model_step")[0][0]
        self._s, self._next, self._given = np.zeros(model.states), np.zeros(model.states), np.zeros(2)
        self._h = np.zeros(1)
        self._run = InPlace(function, (self._s, self._given, self._h, model.theta.copy()), (self._next,))
        self._queue: deque[float] = deque()

    def reset(self, x0: float, supply: float | None = None) -> None:
        """At rest at ``x0`` [m] under ``supply`` [Pa, absolute]; chambers near 60 % of its gauge value, in balance."""
        model = self.model
        supply = model.plant.rig.supply if supply is None else supply
        patm, A1, A2 = (model.value(name) for name in ("patm", "A1", "A2"))
        level = 0.6 * (supply - patm)
        load = model.mass * GRAVITY * np.sin(model.value("incline"))
        self._s[:] = model.rest(x0, patm + min((level * A2 + load) / A1, supply - patm), patm + level)
        self._given[1] = supply
        self._queue = deque([model.neutral] * self._waiting)

    def step(self, u: float, dt: float) -> None:
        """``dt`` seconds under the held command ``u`` [V]. Raises ``ComputationError`` if the state diverges."""
        count = max(1, round(dt / STEP))
        self._h[0] = dt / count
        for _ in range(count):
            self._queue.append(u)
            self._given[0] = self._queue.popleft()
            self._run()
            self._s[:] = self._next
        if not np.all(np.isfinite(self._s)):
            raise ComputationError(f"the model's state stopped being finite under u = {u} V")

    def measure(self, rng: np.random.Generator | None = None) -> dict[str, float]:
        """x [m], p1, p2 [Pa, absolute] with the sensors' noise and grid; without ``rng`` the true values."""
        x, p1, p2 = self._s[0], self._s[2], self._s[3]
        if rng is not None:
            noise = rng.standard_normal(3)
            x = self.x_grid * round((x + self.x_noise * noise[0]) / self.x_grid)
            p1, p2 = p1 + self.p_noise * noise[1], p2 + self.p_noise * noise[2]
        return {"x": float(x), "p1": float(p1), "p2": float(p2)}

    @property
    def array(self) -> Array:
        """The true state, in the order of the plant's states; not a copy."""
        return self._s


def step_function(model: ControlModel, friction: float = 1.0) -> ca.Function:
    """``(s, (u, psup), h, theta) -> s`` after ``h <= STEP`` seconds, interpreted; ``friction`` as in ``ModelPlant``."""
    # the step needs the plant's evaluation alone
    plant = model.plant if friction == 1.0 else cast("Plant", KnownFriction(model, friction, 0.0))
    s, given, h, theta = ca.SX.sym("s", model.states), ca.SX.sym("w", 2), ca.SX.sym("h"), model.theta_symbol()
    count = substeps_needed(model.plant, model.theta, STEP)
    after = s
    for _ in range(count):
        after = substep(plant, after, given, ca.DM.zeros(2), h / count, theta)
    return ca.Function("controllers_model_step", [s, given, h, theta], [after], {"cse": True})
