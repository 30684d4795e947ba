"""Play between piston rod and load."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State, integrated
from pneuid.physics import motion
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Nordin, Gutman, Automatica 38 (2002) 1633 (two masses and a dead zone), reduced to the path of the load in the gap"
)

_DECIDED = 0.3
"""Acceleration in m/s^2 that a contact must pass on to the load for the side it lies on to be decided."""

_DAMPING = 0.7
"""Damping ratio of the path: its step response is nearest to a free crossing under a constant force, 6.5 % of the play off."""

_SHORTEST = 1e-3
"""Time constant in s that the path falls below at no acceleration, so that a step of a millisecond can follow it."""


class Backlash(Effect):
    """``v' = F/m + (b/2) c''``: the rod recoils while the load behind it crosses the play from side to side.

    ``b`` is the play times the load's share of the moving mass; ``c``, -1..1, is the side on which rod and load touch. It
    follows the sign of what the contact passes on, ``a = (pressure force - friction)/m``, as a damped path of time constant
    ``T sqrt((1 m/s^2)/|a|)``, since a free crossing takes ``sqrt(2 play/|a_rod|)`` with the rod's own acceleration, and stays
    where nothing is passed on. Momentum is conserved; bouncing is left out. Typical: b 20 um to 0.5 mm, T 2 to 20 ms.
    """

    name = "backlash"
    mechanism = "clevis or coupling leaves play, so at each change of force the rod runs ahead until it meets the load"
    equation = "force"
    reference = _SOURCE
    experiment = "fast reversals of small amplitude"
    confused_with = ("friction_presliding_memory", "load_mass", "mounting_compliance")
    rigs = ("servo",)
    states = (State("side", "1", 0.0, 1.0, 0.3), State("side_rate", "1/s", 0.0, 30.0, 30.0))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Play times the share of the mass behind it, and the time constant of the load's crossing at 1 m/s^2."""
        return (
            Parameter("b_play", "b", "m", 0.0, 2e-2, 0.0, 1e-4, _SOURCE, off=0.0),
            Parameter("T_crossing", "T", "s", 2e-3, 0.1, 8e-3, 1.0, _SOURCE, positive=True, prior=0.7),
        )

    def _crossing(self, scope: Scope) -> Expression:
        """Second derivative of the side, 1/s^2: drawn to the side that the contact asks for, as hard as it pushes."""
        rig, side, rate = scope.rig, scope.state.side, scope.state.side_rate
        a = (motion.pressure_force(scope.p1, scope.p2, rig.A1, rig.A2, rig.patm) - scope.friction) / scope.mass
        size, asked = ca.sqrt(a * a + _DECIDED**2), ca.tanh(a / _DECIDED)
        w = ca.sqrt(size / (scope.p.T_crossing**2 + size * _SHORTEST**2))
        return w * w * asked * asked * (asked - side) - 2.0 * _DAMPING * w * rate

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add the recoil."""
        return force + 0.5 * scope.p.b_play * scope.mass * self._crossing(scope)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The side and its rate, stepped like the piston's position and speed so that no momentum is lost."""
        return {
            "side": integrated(scope.state.side, scope.state.side_rate),
            "side_rate": integrated(scope.state.side_rate, self._crossing(scope)),
        }
