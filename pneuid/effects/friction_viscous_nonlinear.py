"""Viscous friction that is not proportional to speed."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Bo, Pavelescu, Wear 82 (1982) 277 (friction-speed relation with a power of the speed)"

_REFERENCE_SPEED = 0.1
"""Speed in m/s at which the viscous force is ``sigma2 v`` whatever the power."""

_LOWEST_SPEED = 1.0e-3
"""Speed in m/s below which the viscous coefficient stays finite; a power below 1 would make it infinite at rest."""


class FrictionViscousNonlinear(Effect):
    """``sigma2 v (|v|/v0)^(d - 1)`` with ``v0 = 0.1 m/s``, ``|v|`` rounded over 1 mm/s; ``d = 1`` is the linear law.

    Typical: 0.3 to 0.8 for thin oil films under elastomer lips (their thickness grows with speed), above 1 with air drag.
    """

    name = "friction_viscous_nonlinear"
    mechanism = "the oil film under the seal thickens with speed, so viscous force does not grow in proportion to speed"
    equation = "friction"
    reference = _SOURCE
    experiment = "strokes at constant speeds from slow to the fastest"
    confused_with = ("friction_lag",)
    guarantees = ("dissipative",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The power of the speed."""
        return (Parameter("d_viscous", "δ_v", "1", 0.2, 3.0, 1.0, 0.2, _SOURCE, off=1.0),)

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Scale ``sigma2`` by the power of the speed."""
        squared = (scope.v * scope.v + _LOWEST_SPEED**2) / _REFERENCE_SPEED**2
        return replace(k, sigma2=k.sigma2 * ca.exp(0.5 * (scope.p.d_viscous - 1.0) * ca.log(squared)))
