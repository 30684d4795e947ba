"""Friction that varies along the stroke."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, section 2.1 (position dependence)"

_TERMS = 14
"""A ring of a twentieth of the range needs as many: with eight of them its rest, 2.0 floors, hid a growing static friction."""

_SMOOTH = 4
"""Waves up to which any amplitude is as likely; that of shorter ones fades with the square of their number."""

_LOWEST = 0.05


class FrictionPosition(Effect):
    """``Fc`` and ``Fs`` times ``1 + sum c_j cos(j pi s)``, ``s`` the position within the range fitted on (0..1)."""

    name = "friction_position"
    mechanism = "bore wear, dents or misalignment make the seal bind at some places of the stroke"
    equation = "friction"
    reference = _SOURCE
    experiment = "slow strokes over the whole travel in both directions"
    guarantees = ("dissipative",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Cosine amplitudes relative to the mean friction; what is expected of them fades with the square of their number."""
        found = []
        for j in range(1, _TERMS + 1):
            faded = min(1.0, (_SMOOTH / j) ** 2)
            found.append(Parameter(f"c{j}", f"c{j}", "1", -3.0, 3.0, 0.0, 0.1 * faded, _SOURCE, off=0.0, prior=faded))
        return tuple(found)

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Scale the Coulomb and the static level alike."""
        factor: Expression = 1.0
        s = (scope.x - scope.rig.x_low) / (scope.rig.x_high - scope.rig.x_low)
        s = ca.fmin(ca.fmax(s, 0.0), 1.0)
        for j in range(1, _TERMS + 1):
            factor = factor + getattr(scope.p, f"c{j}") * ca.cos(j * np.pi * s)
        factor = ca.fmax(factor, _LOWEST)
        return replace(k, Fc=k.Fc * factor, Fs=k.Fs * factor)
