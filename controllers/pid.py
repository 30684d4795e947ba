"""The baseline most servos run: PID on the position error with velocity feed-forward, no model in the loop.

``u = neutral + feed_forward v_ref + proportional e + integral sum(e) + derivative de/dt``, with a filtered derivative
and an integral that waits at the command's limits and at rest within ``hold``.
Source: Astrom, Murray, Feedback Systems (2nd ed., 2021), chapter 11, sections 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers.base import ACCELERATION, POSITION, VELOCITY, Measurement
from controllers.law import CompiledLaw, Sample


@dataclass(frozen=True)
class PidGains:
    """proportional : V/m; integral : V/(m s); derivative : V s/m; feed_forward : V s/m; filter : time constant of the
    derivative, s; hold : m, error at rest within which the integral waits."""

    proportional: Any
    integral: Any
    derivative: Any
    feed_forward: Any
    filter: Any
    hold: Any


class Pid(CompiledLaw):
    """PID with velocity feed-forward; memory: integral [m s], filtered error [m]."""

    name = "pid"
    gains_type = PidGains

    def start(self, _: Measurement) -> np.ndarray:
        """No integral, no error."""
        return np.zeros(2)

    def law(self, memory: Any, sample: Sample, gains: PidGains) -> tuple[Any, Any]:
        """Command and memory; the error is today's, the feed-forward that of the sample the command acts in."""
        T, target = self.sample_time, sample.target
        e = target[0, POSITION] - sample.seen[0]
        slope = (e - memory[1]) / (gains.filter + T)
        asked = gains.proportional * e + gains.integral * memory[0] + gains.derivative * slope
        null, full = self.model.named(sample.theta, "null"), self.model.named(sample.theta, "full_scale")
        u = null + asked + gains.feed_forward * target[1, VELOCITY]
        still = ca.logic_and(target[0, VELOCITY] == 0.0, target[0, ACCELERATION] == 0.0)
        waits = ca.logic_or(ca.fabs(u - null) >= full, ca.logic_and(still, ca.fabs(e) < gains.hold))
        return u, ca.vertcat(memory[0] + ca.if_else(waits, 0.0, T * e), memory[1] + T * slope)
