"""Gains from the model and one bandwidth, and their refinement on the model's own simulation.

The formulas place the poles of the linearised loop. The default bandwidth is the smallest of what the sample time
allows (one sample of computation, half a sample of hold) and what the valve can deliver. Refinement searches a few
gains by Nelder and Mead on the identified model with a little extra delay, so that what wins also has margin. The
rig's hidden parameters are never looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize

from controllers import loop
from controllers.base import Controller
from controllers.cascade import CascadeGains
from controllers.control_model import ControlModel
from controllers.inverse_valve import led
from controllers.model_plant import ModelPlant
from controllers.mpc import MpcGains
from controllers.pid import PidGains
from controllers.references import Reference, Smooth, Steps
from pneuid.errors import ComputationError

ALPHA = 0.75
"""Share of the friction model that is believed from the start. Where friction has fallen by 30 %, 0.8 of the model's is
1.14 times what is there, 0.75 is 1.07 times."""

LEARNING = 0.2
"""Learning rate of the share of friction over the observer's bandwidth. Much slower, and a first move of a tenth of a
second ends before what ``alpha`` holds back is learned: the axis hunts in the dwell after it."""


@dataclass(frozen=True)
class Design:
    """What the designer chooses.

    supply : pressure the gains are made for, Pa absolute; alpha : share of the friction model that is believed;
    hold : m, see ``CascadeGains`` (the predictive controller needs none); learning : rate at which the share of friction is
    learned, see ``LEARNING``; bandwidth : rad/s, None for what the model allows.
    """

    supply: float
    alpha: float = ALPHA
    hold: float = 1e-5
    learning: float = LEARNING
    bandwidth: float | None = None


@dataclass(frozen=True)
class Authority:
    """The plant linearised at rest at mid-stroke, effects that follow the command late (a spool, a tube) having followed.

    gain : pressure-force rate per command, N/(s V); fastest : largest pressure-force rate, N/s; stiffness : of the two
    air springs, N/m; delay : mean delay of the pressure-force rate behind the command, s (0 for a prompt valve).
    """

    gain: float
    fastest: float
    stiffness: float
    delay: float


REACH = 0.3
"""Share of full scale over which the valve's gain is taken, wide enough to look past a dead zone."""

TYPICAL_ERROR = 1e-3
"""Position error, m, that should not saturate the valve."""

FOLLOWED = 0.05
"""Seconds after which a spool or a tube has followed the command, and a wall has hardly warmed."""

FOLLOWING = 100
"""Steps in which it is followed: half a millisecond each, short against a lag that limits a bandwidth."""

SAMPLES_PER_RADIAN = 12.0
"""Samples per radian of the cascade's bandwidth: leaves its force loop, 3 times faster, half a radian of delay."""

RADIANS_OF_LAG = 0.5
"""Largest product of the cascade's bandwidth and the valve's delay: the force loop, 2.5 times faster, is then as fast as the
lag. At 0.76 a loop behind a spool that lags by 10 ms, and slews half its full scale in that time, broke down."""


def authority(model: ControlModel, supply: float) -> Authority:
    """Linearise the model at rest at mid-stroke under ``supply`` [Pa, absolute]."""
    s, u, psup, theta = ca.SX.sym("s", model.states), ca.SX.sym("u"), ca.SX.sym("psup"), model.theta_symbol()
    given = [s, u, psup, theta]
    rate = ca.Function("rate", given, [model.instant(s, u, psup, theta).force_rate])
    follow = ca.Function("follow", given, [led(model, s, u, psup, FOLLOWED / FOLLOWING, theta)])
    patm, full = model.value("patm"), model.value("full_scale")
    level = patm + 0.6 * (supply - patm)
    rest = model.rest(0.5 * model.value("stroke"), level, level)

    def rates(share: float, speed: float = 0.0) -> np.ndarray:
        """Rates from the instant of the command on, until it has been followed."""
        state, found = rest.copy(), []
        state[1] = speed
        command = (model.neutral + share * full, supply, model.theta)
        for _ in range(FOLLOWING + 1):
            found.append(float(rate(state, *command)))
            state = np.array(follow(state, *command)).ravel()
        return np.array(found)

    after = np.linspace(0.0, FOLLOWED, FOLLOWING + 1)
    swing = rates(REACH) - rates(-REACH)
    return Authority(
        gain=float(swing[-1]) / (2.0 * REACH * full),
        fastest=min(rates(1.0)[-1], -rates(-1.0)[-1]),
        stiffness=rates(0.0, -0.5)[-1] - rates(0.0, 0.5)[-1],
        delay=float(np.trapezoid(np.maximum(1.0 - swing / swing[-1], 0.0), after)),
    )


def default_bandwidth(model: ControlModel, supply: float, sample_time: float) -> float:
    """Bandwidth in rad/s that the sample time and the valve's flow allow."""
    jerk = authority(model, supply).fastest / model.mass
    return float(min(1.0 / (SAMPLES_PER_RADIAN * sample_time), 0.6 * (jerk / TYPICAL_ERROR) ** (1.0 / 3.0)))


def cascade_bandwidth(model: ControlModel, supply: float, sample_time: float) -> float:
    """Bandwidth of the cascade in rad/s: a valve that lags limits it too, as the inverse valve drives the spool the harder."""
    delay = max(authority(model, supply).delay, 1e-9)
    return min(default_bandwidth(model, supply, sample_time), RADIANS_OF_LAG / delay)


def mpc_bandwidth(model: ControlModel, supply: float, sample_time: float) -> float:
    """Bandwidth of the predictive controller in rad/s: it plans through its own delay, so it may be faster."""
    return 1.75 * default_bandwidth(model, supply, 0.5 * sample_time)


def pid_gains(model: ControlModel, design: Design) -> PidGains:
    """PID: velocity gain a third of the air springs' natural frequency, the feed-forward exact at rest."""
    found = authority(model, design.supply)
    natural = np.sqrt(found.stiffness / model.mass)
    per_speed = found.stiffness / found.gain
    gain = per_speed * (design.bandwidth or 0.33 * natural)
    return PidGains(gain, 0.3 * gain, 0.15 * gain, per_speed, 5e-3, design.hold)


def cascade_gains(model: ControlModel, design: Design, sample_time: float) -> CascadeGains:
    """Position loop with two poles at the bandwidth ``w``, force loop at ``2.5 w``, observer at ``4 w``.

    The integral term is for the cascade without compensation; set it to zero where a residual force is estimated.
    """
    w = design.bandwidth or cascade_bandwidth(model, design.supply, sample_time)
    observer = 4.0 * w
    return CascadeGains(
        position=w**2, damping=2.0 * w, integral=0.25 * w**3, force=2.5 * w, hold=design.hold, lead=2.0 * sample_time,
        bandwidth=observer, pressure_trust=0.5, alpha=design.alpha, learning=design.learning * observer,
    )  # fmt: skip


def mpc_gains(model: ControlModel, design: Design, sample_time: float) -> MpcGains:
    """Weights for the bandwidth ``w`` of the optimal regulator of the chain command rate - force rate - jerk.

    Cheap control of a four-fold integrator with gain ``b`` puts its poles at radius ``w`` when ``change rate weight /
    error weight = (b / w^4)^2`` (Butterworth pattern of the symmetric root locus).
    """
    w = design.bandwidth or mpc_bandwidth(model, design.supply, sample_time)
    gain, observer = authority(model, design.supply).gain, min(300.0, 0.6 / sample_time)
    return MpcGains(
        velocity=1.5 / w, change=gain / (model.mass * sample_time * w**4),
        supply=design.supply, terminal=10.0, bandwidth=observer, pressure_trust=1.0, alpha=design.alpha,
        learning=design.learning * observer,
    )  # fmt: skip


def tuning_tracks(model: ControlModel) -> tuple[Reference, ...]:
    """Short tracks that gains are refined on: a random one and steps, in the middle of the stroke."""
    stroke = model.value("stroke")
    return (
        Smooth("random", 0.5 * stroke, 1.2, 0.08 * stroke, 1.5, 0.3, seed=7),
        Steps("steps", 0.45 * stroke, 1.6, (0.1 * stroke, 0.102 * stroke), 0.8, 0.3),
    )


MARGIN_DELAY = 2e-3
"""Extra delay between command and valve during refinement, s: about a fast valve's lag."""

TRAVEL_PRICE = 1e-6
"""Position error in m that is as bad as one full scale of valve movement per second."""


class Trial:
    """Closed loops on the model with a margin delay: the cost that refinement lowers."""

    def __init__(self, model: ControlModel, supply: float) -> None:
        self._plant, self._tracks = ModelPlant(model, MARGIN_DELAY), tuning_tracks(model)
        self._supply, self._full = supply, model.value("full_scale")

    def cost(self, controller: Controller) -> float:
        """Mean RMS error [m] over the tracks plus the price of valve movement; 1 m for a loop that diverges."""
        total = 0.0
        for track in self._tracks:
            try:
                found = loop.metrics(loop.run(controller, self._plant, track, self._supply, seed=0))
            except ComputationError:
                return 1.0
            total += found.rms + TRAVEL_PRICE * found.travel / self._full
        return total / len(self._tracks)


def refine_gains(controller: Controller, names: Sequence[str], trial: Trial, evaluations: int) -> None:
    """Search the gains ``names`` of ``controller`` by Nelder and Mead on a logarithmic scale, the rest kept.

    Deterministic; leaves the best gains met, never worse than what it was given.
    """
    first = controller.gains
    start = np.array([float(getattr(first, name)) for name in names])
    met: list[tuple[float, int, Any]] = []

    def cost(logarithms: np.ndarray) -> float:
        scaled = start * np.exp(np.clip(logarithms, -3.5, 3.5))
        controller.retune(replace(first, **dict(zip(names, scaled.tolist(), strict=True))))
        met.append((trial.cost(controller), len(met), controller.gains))
        return met[-1][0]

    simplex = np.vstack([np.zeros(start.size), 0.4 * np.eye(start.size)])
    minimize(
        cost,
        np.zeros(start.size),
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-7},
    )
    controller.retune(min(met)[2])


BANDWIDTH_FACTORS = (0.7, 0.85, 1.0, 1.2, 1.45, 1.75, 2.1)

NEAR = 1.1
"""Costs up to this times the least count as equal, and of equals the fastest is taken: the model that costs are measured on
is exact, a rig is not, and what a model does not know is left to the bandwidth."""


def refine_bandwidth(controller: Controller, gains_at: Callable[[float], Any], trial: Trial) -> float:
    """The largest factor on the bandwidth whose cost is ``NEAR`` the lowest; all gains keep the pole pattern of the formulas.

    gains_at : gains for a factor. Searching gains one by one would trade the damping that the formulas guarantee
    for the damping that friction happens to give.
    """

    def cost(factor: float) -> float:
        controller.retune(gains_at(factor))
        return trial.cost(controller)

    costs = {factor: cost(factor) for factor in BANDWIDTH_FACTORS}
    best = max(factor for factor, found in costs.items() if found <= NEAR * min(costs.values()))
    controller.retune(gains_at(best))
    return best
