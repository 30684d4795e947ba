"""Viscous friction that is not proportional to speed."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from pneuid.effect import Effect, Parameter, Scope
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Carreau, Trans. Soc. Rheology 16 (1972) 99 (viscosity over the rate of shear)"

_POWER = "Bo, Pavelescu, Wear 82 (1982) 277 (friction-speed relation with a power of the speed)"

_REFERENCE_SPEED = 0.1
"""Speed in m/s at which the viscous force is ``sigma2 v`` whatever the power."""


class FrictionViscousNonlinear(Effect):
    """``sigma2 v ((v^2 + v_k^2)/(v0^2 + v_k^2))^((d - 1)/2)``, ``v0 = 0.1 m/s``; ``d = 1`` is the linear law.

    Below the knee ``v_k`` in proportion to speed, far above it with the power ``d``; half a power above 0.3 m/s is nearly
    Eyring's ``asinh(v/(0.28 m/s))``. Typical: d 0.3 to 0.8 for thin oil films under elastomer lips (their thickness grows with
    speed, and they thin under shear), 2 and above with air drag; v_k 1 mm/s to 0.3 m/s.
    """

    name = "friction_viscous_nonlinear"
    mechanism = "the oil film under the seal thickens with speed, so viscous force does not grow in proportion to speed"
    equation = "friction"
    reference = _SOURCE
    experiment = "strokes at constant speeds from slow to the fastest"
    confused_with = ("friction_lag",)
    guarantees = ("dissipative",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The power of the speed, and the speed from which it holds."""
        return (
            Parameter("d_viscous", "δ_v", "1", 0.0, 3.0, 1.0, 0.2, _POWER, off=1.0),
            Parameter("v_knee", "v_k", "m/s", 1e-3, 3.0, 0.02, 1.0, _SOURCE, positive=True, prior=1.5),
        )

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Scale ``sigma2`` by the power of the speed."""
        knee = scope.p.v_knee * scope.p.v_knee
        squared = (scope.v * scope.v + knee) / (_REFERENCE_SPEED**2 + knee)
        return replace(k, sigma2=k.sigma2 * ca.exp(0.5 * (scope.p.d_viscous - 1.0) * ca.log(squared)))
