"""Cascade without friction compensation: position loop, force loop on the measured pressures, inverted valve.

The position loop asks for an acceleration, hence for a pressure force; the force loop asks for its rate; the inverse
of the composed flow map gives the command. The three closed-loop poles follow from one bandwidth, see ``tuning``.
Friction is left to the integral of the position error.
Source: the structure of backstepping for pneumatic servos, e.g. Smaoui, Brun, Thomasset, Control Eng. Practice 14
(2006) 893, section 4, without its robust terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers.base import ACCELERATION, JERK, POSITION, VELOCITY, Measurement
from controllers.control_model import ControlModel, Instant, V, X
from controllers.inverse_valve import command_for
from controllers.law import CompiledLaw, Sample
from controllers.observer import ObserverGains, memory_size, observed, start_memory


@dataclass(frozen=True)
class CascadeGains:
    """Gains of the cascade and of the observer it runs on.

    position : 1/s^2; damping : 1/s; integral : 1/s^3; force : 1/s; hold : m, error at rest below which the pressures
    are left alone (0: never); lead : s, see ``inverse_valve``; the last three as in ``ObserverGains``.
    """

    position: Any
    damping: Any
    integral: Any
    force: Any
    hold: Any
    lead: Any
    bandwidth: Any
    pressure_trust: Any
    alpha: Any
    learning: Any

    @property
    def observer(self) -> ObserverGains:
        """The observer's own gains."""
        return ObserverGains(self.bandwidth, self.pressure_trust, self.alpha, self.learning)


@dataclass(frozen=True)
class Wanted:
    """What the loops ask for: pressure force [N], its rate [N/s], the integral of the error [m s]."""

    force: Any
    force_rate: Any
    integral: Any


@dataclass(frozen=True)
class FrictionEstimate:
    """What is known of friction: the believed share of the model's force [N, against +v], the foreseeable part of its
    rate [N/s] (viscous; bristle and Stribeck slope are fast and uncertain), and the residual force [N, against +x]."""

    believed: Any
    believed_rate: Any
    residual: Any


@dataclass(frozen=True)
class Compensation:
    """Friction to be cancelled: force [N] and the part of its rate that is foreseeable [N/s]."""

    force: Any
    rate: Any


def at_rest(state: Any, target: Any, hold: Any) -> Any:
    """1 while the reference stands still and the piston stands within ``hold`` metres of it, else 0."""
    still = ca.logic_and(target[VELOCITY] == 0.0, target[ACCELERATION] == 0.0)
    near = ca.logic_and(ca.fabs(target[POSITION] - state[X]) < hold, ca.fabs(state[V]) < 100.0 * hold)
    return ca.logic_and(still, near)


def wanted_force(
    gains: CascadeGains,
    now: Instant,
    state: Any,
    acceleration: Any,
    target: Any,
    integral: Any,
    compensation: Compensation,
    sample_time: float,
) -> Wanted:
    """Position loop and force loop.

    state, acceleration : estimates at the sample the command acts from; target : reference there, 4 columns;
    compensation : friction to be cancelled.
    """
    e, e_rate = target[POSITION] - state[X], target[VELOCITY] - state[V]
    asked = target[ACCELERATION] + gains.damping * e_rate + gains.position * e + gains.integral * integral
    asked_rate = target[JERK] + gains.damping * (target[ACCELERATION] - acceleration) + gains.position * e_rate
    force = now.mass * asked - now.other + compensation.force
    rate = now.mass * asked_rate + compensation.rate + gains.force * (force - now.pressure_force)
    held = at_rest(state, target, gains.hold)
    return Wanted(
        force=force,
        force_rate=ca.if_else(held, 0.0, rate),
        integral=ca.if_else(held, integral, integral + sample_time * e),
    )


class Cascade(CompiledLaw):
    """Position and force loops on the inverted valve; no friction compensation."""

    name = "cascade"
    gains_type = CascadeGains

    def __init__(self, model: ControlModel, gains: CascadeGains, sample_time: float = 1e-3) -> None:
        super().__init__(model, gains, sample_time)

    def start(self, measurement: Measurement) -> np.ndarray:
        """Observer at rest, no integral."""
        return np.append(start_memory(self.model, measurement), 0.0)

    def law(self, memory: Any, sample: Sample, gains: CascadeGains) -> tuple[Any, Any]:
        """Observe, then command for the next sample."""
        model, T, psup = self.model, self.sample_time, sample.seen[3]
        size = memory_size(model)
        estimate = observed(model, memory[:size], sample.seen, sample.applied, gains.observer, T, sample.theta)
        state, residual, share = estimate[: model.states], estimate[model.states], estimate[model.states + 1]
        now = model.instant(state, sample.applied, psup, sample.theta)
        aim, share = sample.target[1, :], gains.alpha + share
        friction = FrictionEstimate(share * now.friction, share * now.viscous * aim[ACCELERATION], residual)
        acceleration = now.acceleration + (now.friction - friction.believed - residual) / now.mass
        wanted = wanted_force(gains, now, state, acceleration, aim, memory[size], self.compensation(friction), T)
        u = command_for(model, wanted.force_rate, state, psup, gains.lead, sample.theta)
        # the integral waits while the command is at a limit
        inside = ca.logic_and(u > model.lowest + 1e-3, u < model.highest - 1e-3)
        integral = ca.if_else(inside, wanted.integral, memory[size])
        return u, ca.vertcat(estimate, integral)

    def compensation(self, _: FrictionEstimate) -> Compensation:
        """What of friction to cancel: nothing."""
        return Compensation(0.0, 0.0)


class CascadeEso(Cascade):
    """The cascade with all friction estimated as the observer's residual force, without a friction model."""

    name = "cascade_eso"

    def compensation(self, friction: FrictionEstimate) -> Compensation:
        """The residual force; ``alpha`` is 0 here, so it holds all of friction."""
        return Compensation(friction.residual, 0.0)
