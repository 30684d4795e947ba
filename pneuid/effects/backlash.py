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


class Backlash(Effect):
    """``v' = F/m + (b/2) c''``: the rod recoils while the load behind it crosses the play from side to side.

    ``b`` is the play times the load's share of the moving mass; ``c``, -1..1, is the side on which rod and load touch. It
    follows the sign of what the contact passes on, ``a = (pressure force - friction)/m``, as a critically damped path of
    time constant ``T`` (order ``sqrt(play/|a|)``), and stays where nothing is passed on. Momentum is conserved; bouncing
    is left out. Typical: b 20 um to 0.5 mm, T 3 to 20 ms.
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
        """Play times the share of the mass behind it, and the time constant of the load's crossing."""
        return (
            Parameter("b_play", "b", "m", 0.0, 2e-2, 0.0, 1e-4, _SOURCE, off=0.0),
            Parameter("T_play", "T", "s", 2e-3, 0.1, 6e-3, 1.0, _SOURCE, positive=True, prior=0.7),
        )

    def _crossing(self, scope: Scope) -> Expression:
        """Second derivative of the side, 1/s^2: drawn to the side that the contact asks for, critically damped."""
        rig, T = scope.rig, scope.p.T_play
        pushing = motion.pressure_force(scope.p1, scope.p2, rig.A1, rig.A2, rig.patm)
        asked = ca.tanh((pushing - scope.friction) / (scope.mass * _DECIDED))
        return asked * asked * (asked - scope.state.side) / T**2 - 2.0 * scope.state.side_rate / T

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add the recoil."""
        return force + 0.5 * scope.p.b_play * scope.mass * self._crossing(scope)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The side and its rate, stepped like the piston's position and speed so that no momentum is lost."""
        return {
            "side": integrated(scope.state.side, scope.state.side_rate),
            "side_rate": integrated(scope.state.side_rate, self._crossing(scope)),
        }
