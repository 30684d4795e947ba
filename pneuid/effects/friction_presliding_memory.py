"""Pre-sliding hysteresis with non-local memory: a Maxwell-slip element beside the bristle."""

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
    """``W y`` on top of the friction, ``y = z2/d`` the deflection of an element that sticks below ``d`` and slips at it.

    Sticking ``dz2/dt = v``, slipping ``z2 = d sign(v)``: stiffness ``W/d``, break force ``W``, another pair than the
    bristle's ``sigma0`` and ``Fs``. Typical: W 10 to 50 % of Fc, d 20 um to 1 mm for elastomer seals.
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
    states = (State("z_element", "m", 0.0, 1e-4, 3e-5),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Break force and break displacement of the element."""
        force = max(2.0, 0.01 * rig.A1 * 1e6)
        return (
            Parameter("W_element", "W", "N", 0.0, 1e2 * force, 0.0, force, _SOURCE, off=0.0),
            Parameter("d_element", "d", "m", 5e-6, 5e-3, 2e-4, 1.0, _SOURCE, positive=True, prior=1.5),
        )

    def friction(self, force: Expression, scope: Scope) -> Expression:
        """Add the element's spring force."""
        return force + scope.p.W_element * scope.state.z_element / scope.p.d_element

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Elastic while sticking, drawn to the break displacement in the direction of motion while slipping.

        Slipping is a relaxation over a distance, so it is exact at any speed and step; reversal ends it at once.
        """
        width, d = scope.smoothing.speed, scope.p.d_element
        pulled = sign(scope.v, width) * scope.state.z_element / d
        slipping = 0.5 * (1.0 + ca.tanh((pulled - (1.0 - _CORNER)) / (2 * _SHARPNESS)))
        decay = absolute(scope.v, width) * slipping / (_CORNER * d) + _FORGETTING
        source = scope.v * (1.0 - slipping + slipping / _CORNER)
        return {"z_element": (source / decay, 1.0 / decay)}
