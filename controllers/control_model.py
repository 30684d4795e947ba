"""What controllers take from an identified model: forces, flows and rates of the composed plant.

Everything comes from ``Plant.evaluate``, so whatever effects were identified act in every controller without being
mentioned here. ``theta`` stays an input of all compiled functions: one compilation serves every fit of one structure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from pneuid.plant import Plant

X, V, P1, P2, Z, EFFECTS = range(6)
"""Places in the plant's state; the effects' own states start at ``EFFECTS``."""


@dataclass(frozen=True)
class Instant:
    """Forces and rates at one state and command, all symbolic, SI, absolute pressures.

    pressure_force : N, in +x; force_rate : its rate, N/s; friction : N, against +v; other : all forces but pressure
    and friction, N, in +x; acceleration : m/s^2 with the model's own friction; mass : kg; viscous : slope of the
    steady friction with speed, N s/m.
    """

    pressure_force: Any
    force_rate: Any
    friction: Any
    other: Any
    acceleration: Any
    mass: Any
    viscous: Any


class ControlModel:
    """One identified plant as the controllers see it.

    plant : servo plant; theta : its full column ``(len(plant.theta_names),)``, SI. Raises ``ValueError`` for a bench
    plant, which has no valve, or a theta of another length.
    """

    def __init__(self, plant: Plant, theta: np.ndarray) -> None:
        if not plant.servo:
            raise ValueError("controllers need the plant of a servo rig; a bench has no valve to command")
        theta = np.asarray(theta, dtype=float).ravel()
        if theta.size != len(plant.theta_names):
            raise ValueError(f"theta has {theta.size} values, the plant has {len(plant.theta_names)}")
        self.plant, self.theta = plant, theta
        self.states = len(plant.states)
        self.effect_start = np.array([state.initial for state in plant.effect_states])
        null, full = self.value("null"), self.value("full_scale")
        self.neutral, self.lowest, self.highest = null, null - full, null + full
        symbol = self.theta_symbol()
        self.mass = float(ca.Function("controllers_mass", [symbol], [self.moving_mass(symbol)])(theta))

    def value(self, name: str) -> float:
        """A parameter, constant or width by its name in ``plant.theta_names``, SI."""
        return float(self.theta[self.plant.theta_names.index(name)])

    def with_values(self, **values: float) -> np.ndarray:
        """A copy of theta in which the named entries are replaced (SI)."""
        theta = self.theta.copy()
        for name, value in values.items():
            theta[self.plant.theta_names.index(name)] = value
        return theta

    def rest(self, x: float, p1: float, p2: float) -> np.ndarray:
        """Plant state at rest at ``x`` [m] and absolute pressures [Pa], bristle and effects at their start."""
        return np.concatenate([[x, 0.0, p1, p2, 0.0], self.effect_start])

    # --- symbols ---

    def theta_symbol(self) -> ca.SX:
        """A symbol for the whole theta column."""
        return ca.SX.sym("theta", len(self.plant.theta_names))

    def named(self, theta: Any, name: str) -> Any:
        """An entry of a symbolic theta by name."""
        return theta[self.plant.theta_names.index(name)]

    def moving_mass(self, theta: Any) -> Any:
        """Moving mass in kg, effects included."""
        patm = self.named(theta, "patm")
        state = ca.vertcat(0.5 * self.named(theta, "stroke"), 0.0, patm, patm, 0.0, ca.DM(self.effect_start))
        return self.plant.evaluate(state, [self.neutral, patm], theta).mass

    def instant(self, s: Any, u: Any, psup: Any, theta: Any) -> Instant:
        """Forces and rates at plant state ``s``, command ``u`` [V] and supply ``psup`` [Pa, absolute]."""
        stages = self.plant.evaluate(s, [u, psup], theta)
        A1, A2, patm = (self.named(theta, name) for name in ("A1", "A2", "patm"))
        pushing = (s[P1] - patm) * A1 - (s[P2] - patm) * A2
        mass = stages.mass
        acceleration = stages.explicit[1]
        rates = (stages.explicit[2], stages.explicit[3])
        other = mass * acceleration + stages.friction - pushing
        force_rate = A1 * rates[0] - A2 * rates[1]
        return Instant(pushing, force_rate, stages.friction, other, acceleration, mass, stages.coefficients.sigma2)


class KnownFriction:
    """The plant with ``alpha`` times its own friction and a ``residual`` force [N, against +v], for ``step.substep``.

    The rest of the friction is the business of whoever estimates the residual.
    """

    def __init__(self, model: ControlModel, alpha: Any, residual: Any) -> None:
        self.model, self.alpha, self.residual = model, alpha, residual
        self.explicit_count = model.plant.explicit_count

    def evaluate(self, s: Any, w: Any, theta: Any) -> Any:
        """All stages of the plant under the known friction."""
        return self.model.plant.evaluate(s, w, theta, lambda own: self.alpha * own + self.residual)
