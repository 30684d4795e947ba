"""One time step: exponential explicit midpoint, shared by simulation, estimation and MPC.

The bristle and every state that relaxes take their exact exponential with the coefficients frozen; the rest takes the
explicit midpoint rule. Second order; stable in the bristle at any speed, where a Runge-Kutta rule of fixed step is
not. Limits of the step: ``h sqrt(sigma0/m)``, ``h (sigma1+sigma2)/m`` and ``h`` times the fastest chamber.
Source of the idea: Hochbruck, Ostermann, Acta Numerica 19 (2010) 209, section 2 (exponential midpoint).
"""

from __future__ import annotations

from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from pneuid.mapped import Mapped
from pneuid.physics.gas import R_AIR, RHO_REFERENCE
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant, once_per_structure

BRISTLE_LIMIT = 1.4
DAMPING_LIMIT = 1.0
CHAMBER_LIMIT = 1.5
SHORT = 0.51e-3
"""Sample time in s, half a millisecond and what a clock is off, that one step may take."""

LARGEST_SUBSTEPS = 40
"""More substeps than this per sample mean a sample rate too low for the friction asked for."""

STRUCTURES = 64
"""Plants whose symbolic functions are kept: every effect that a diagnosis tries is a structure of its own."""


def relaxed(s: Any, source: Any, decay: Any, h: Any) -> Any:
    """Exact solution after ``h`` of ``ds/dt = source - decay s`` with both frozen."""
    q = ca.fmax(decay * h, 1e-12)
    return s + (s - source * h / q) * ca.expm1(-q)


def _advance(plant: Plant, s: Any, at: Any, h: Any) -> Any:
    count = plant.explicit_count
    moved = [s[i] + h * at.explicit[i] for i in range(count)]
    moved += [relaxed(s[count + i], source, decay, h) for i, (source, decay) in enumerate(at.relaxing)]
    return ca.vertcat(*moved)


def substep(plant: Plant, s: Any, w: Any, w_rate: Any, h: Any, theta: Any) -> Any:
    """State after ``h`` seconds; ``w`` is the input at the start, ``w_rate`` its slope per second (all symbolic)."""
    middle = _advance(plant, s, plant.evaluate(s, w, theta), 0.5 * h)
    return _advance(plant, s, plant.evaluate(middle, w + 0.5 * h * w_rate, theta), h)


def fastest_rates(plant: Plant, theta: np.ndarray) -> dict[str, float]:
    """Rates in 1/s that limit the step: bristle, damping, chamber (the last with the piston at the data's ends)."""
    if not plant.servo:
        return {}
    value = dict(zip(plant.theta_names, theta, strict=True))
    # slope of the flow function in its linear patch, per unit of pressure
    edge = 1.0 - FINE.laminar
    slope = np.sqrt(1.0 - ((edge - value["b"]) / (1.0 - value["b"])) ** 2) / FINE.laminar
    smallest = min(
        value["V01"] + value["A1"] * max(value["x_low"], 0.0),
        value["V02"] + value["A2"] * max(value["stroke"] - value["x_high"], 0.0),
    )
    chamber = value["n"] * R_AIR * value["T"] * value["C"] * RHO_REFERENCE * slope / smallest
    bristle, damping = _rates_at_rest(plant, theta)
    return {"bristle": bristle, "damping": damping, "chamber": float(chamber)}


@once_per_structure(STRUCTURES)
def _mechanics(plant: Plant) -> ca.Function:
    """``(s, w, theta)`` to the derivatives of the mechanical states' rates by these states."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    at = plant.evaluate(s, w, theta)
    count = plant.explicit_count
    rates = [*at.explicit, *(source - decay * s[count + i] for i, (source, decay) in enumerate(at.relaxing))]
    mechanical = _mechanical(plant)
    moving = ca.vertcat(*(rates[i] for i in mechanical))
    return ca.Function("mechanics", [s, w, theta], [ca.densify(ca.jacobian(moving, s[mechanical]))])


def _mechanical(plant: Plant) -> list[int]:
    return [i for i, name in enumerate(plant.states) if name not in ("p1", "p2")]


def _rates_at_rest(plant: Plant, theta: np.ndarray) -> tuple[float, float]:
    """Largest natural frequency (rad/s) and damping rate (1/s) of the mechanics at rest.

    Found by differentiating the balances, so that effects need not be known here: what pulls the moving mass back, and
    every oscillation that effects bring with states of their own. Taken at the ends of the recorded travel and
    pressures, the effects' states at and beside their initial values.
    """
    still = np.array(theta, dtype=float)
    still[plant.theta_names.index("smooth_speed")] = 1e-12  # at rest a rounded |v| would count as sliding
    value = dict(zip(plant.theta_names, theta, strict=True))
    given = {"u": value["null"], "psup": value["p1_high"] + value["patm"]}
    states = []
    for place, p1, p2, aside in product(("low", "high"), ("low", "high"), ("low", "high"), (-3.0, 0.0, 3.0)):
        known = {"x": value[f"x_{place}"], "p1": value[f"p1_{p1}"], "p2": value[f"p2_{p2}"]}
        known |= {own.name: own.initial + aside * own.scale for own in plant.effect_states}
        states.append([known.get(name, 0.0) for name in plant.states])
    count, mechanical = len(states), _mechanical(plant)
    inputs = np.tile([given[name] for name in plant.inputs], (count, 1))
    (found,) = Mapped(_mechanics(plant), count)(np.array(states).T, inputs.T, np.tile(still, (count, 1)).T)
    A = found.reshape(len(mechanical), count, len(mechanical)).transpose(1, 0, 2)
    eigenvalues = np.linalg.eigvals(A)
    ringing = np.abs(eigenvalues[np.abs(eigenvalues.imag) > 0.1 * np.abs(eigenvalues)])
    v = mechanical.index(plant.states.index("v"))
    # where damping outweighs the stiffness nothing rings, but the step feels the stiffness all the same
    held = A[:, v, v] ** 2 - np.einsum("kj,kj->k", A[:, v], A[:, :, v])
    natural = max(float(np.sqrt(held.max(initial=0.0))), float(ringing.max(initial=0.0)))
    return natural, max(-float(A[:, v, v].min()), 0.0)


@once_per_structure(STRUCTURES)
def _mass_function(plant: Plant) -> ca.Function:
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    return ca.Function("moving_mass", [s, w, theta], [plant.evaluate(s, w, theta).mass])


def _moving_mass(plant: Plant, theta: np.ndarray) -> float:
    """Moving mass in kg, effects included; it does not depend on the state."""
    return float(_mass_function(plant)(0, 0, theta))


def stable_upper_bounds(plant: Plant, theta: np.ndarray, interval: float, substeps: int) -> dict[str, float]:
    """Largest ``sigma0`` (N/m) and ``sigma1`` (N s/m) that this step can carry; empty where the motion is imposed."""
    if not plant.servo or plant.law.static:
        return {}
    mass, h = _moving_mass(plant, theta), interval / substeps
    bounds = {"sigma0": mass * (1.25 * BRISTLE_LIMIT / h) ** 2, "sigma1": 1.2 * DAMPING_LIMIT * mass / h}
    return {name: bound for name, bound in bounds.items() if name in plant.law.fitted}


def substeps_needed(plant: Plant, theta: np.ndarray, interval: float) -> int:
    """Substeps per sample of ``interval`` seconds that keep the step inside its limits, on a servo rig at least 2 of more than
    half a millisecond."""
    rates = fastest_rates(plant, theta)
    if not rates:
        return 1
    limits = {"bristle": BRISTLE_LIMIT, "damping": DAMPING_LIMIT, "chamber": CHAMBER_LIMIT}
    least = 1 if interval <= SHORT else 2
    return max(least, *(int(np.ceil(interval * rates[name] / limits[name])) for name in rates))
