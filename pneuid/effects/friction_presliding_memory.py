"""Pre-sliding hysteresis with non-local memory: two Maxwell-slip elements beside the bristle."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.smoothing import absolute, sign
from pneuid.rig import Rig

_SOURCE = (
    "Lampaert, Al-Bender, Swevers, IEEE Int. Conf. Physics and Control 2003, 1170 (generalised Maxwell-slip); "
    "Al-Bender, Lampaert, Swevers, IEEE Trans. Automatic Control 50 (2005) 1883"
)
_CORNER = 0.2
"""Share of the break displacement over which sticking turns into slipping."""

_SHARPNESS = 0.2 * _CORNER
"""Relative displacement over which the element tells sticking from slipping."""

_FORGETTING = 1.0e-9
"""Decay in 1/s of a sticking element, so that its time constant stays finite."""


class FrictionPreslidingMemory(Effect):
    """``w Fc ((1 - c) y1 + c y2)`` on top of the friction, ``y = z/d`` the deflections of two elements, each of which sticks
    below its ``d`` and slips at it.

    Sticking ``dz/dt = v``, slipping ``z = d sign(v)``. The first breaks at ``d``, the second at ``r d``. All that slips at once
    is ``w`` times the Coulomb level as effects leave it, since elements share the load of one seal: pressed on harder, each
    breaks at a higher force. Typical: w 10 to 100 %, d 20 um to 1 mm for elastomer seals.
    """

    name = "friction_presliding_memory"
    mechanism = (
        "parts of the seal of different stiffness let go one after the other, so pre-sliding remembers where it turned"
    )
    equation = "friction"
    reference = _SOURCE
    experiment = "small reversals within the pre-sliding range, nested and of different size"
    confused_with = ("friction_dwell", "backlash", "law:lugre", "law:dahl")
    guarantees = ("dissipative",)
    states = (State("z_element", "m", 0.0, 1e-4, 3e-5), State("z_second", "m", 0.0, 1e-4, 1e-4))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Break force over the Coulomb level, break displacement of the first element, the second's over it and its share."""
        return (
            Parameter("w_element", "w", "1", 0.0, 50.0, 0.0, 0.3, _SOURCE, off=0.0),
            Parameter("d_element", "d", "m", 5e-6, 5e-3, 2e-4, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("r_element", "r", "1", 1.5, 50.0, 4.0, 1.0, _SOURCE, positive=True, prior=0.7),
            Parameter("c_element", "c", "1", 0.0, 0.9, 0.4, 0.1, _SOURCE, prior=0.2),
        )

    def friction(self, force: Expression, scope: Scope) -> Expression:
        """Add the force of both elements' springs."""
        p, state = scope.p, scope.state
        first, second = state.z_element / p.d_element, state.z_second / (p.r_element * p.d_element)
        return force + p.w_element * scope.Fc * ((1.0 - p.c_element) * first + p.c_element * second)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Elastic while sticking, drawn to the break displacement in the direction of motion while slipping.

        Slipping is a relaxation over a distance, so it is exact at any speed and step; reversal ends it at once.
        """
        p, state = scope.p, scope.state
        return {
            "z_element": _drawn(state.z_element, p.d_element, scope),
            "z_second": _drawn(state.z_second, p.r_element * p.d_element, scope),
        }


def _drawn(z: Expression, d: Expression, scope: Scope) -> tuple[Expression, Expression]:
    """Target and time constant of the deflection of an element that breaks at ``d``."""
    width = scope.smoothing.speed
    pulled = sign(scope.v, width) * z / d
    slipping = 0.5 * (1.0 + ca.tanh((pulled - (1.0 - _CORNER)) / (2 * _SHARPNESS)))
    decay = absolute(scope.v, width) * slipping / (_CORNER * d) + _FORGETTING
    source = scope.v * (1.0 - slipping + slipping / _CORNER)
    return source / decay, 1.0 / decay
