"""A friction law too simple for the data, as a missing effect: the steps from one law to a richer one.

While screened, a step adds to the simple law what the richer one has: a surplus of static friction, a softer bristle.
When it is added, the richer law takes the simple one's place and starts from what screening found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics import friction
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_STRIBECK = "Bo, Pavelescu, Wear 82 (1982) 277 (exponential form of the Stribeck curve)"
_DAHL = "Dahl, AIAA Journal 14 (1976) 1675"
_LUGRE = "Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419, eq. (1)-(4)"

_LEAST_SURPLUS = 0.02
"""Static surplus, relative to Fc, that a fit of the richer law starts with at least."""


def _typical_force(rig: Rig) -> float:
    return max(3.0, 0.1 * rig.A1 * 1e5)


def _surplus(of: str, rig: Rig) -> tuple[Parameter, ...]:
    """Static friction above the Coulomb level; the Stribeck velocity is the law's own until it is fitted."""
    force = _typical_force(rig)
    return (Parameter(f"dFs_{of}", "F_s - F_c", "N", 0.0, 1e2 * force, 0.0, 0.5 * force, _STRIBECK, off=0.0),)


def _compliance(of: str, rig: Rig) -> tuple[Parameter, ...]:
    """Compliance of the bristle on top of the stiff carrier's."""
    soft = 3e-5 / _typical_force(rig)
    return (Parameter(f"compliance_{of}", "1/σ0", "m/N", 0.0, 1e2 * soft, 0.0, soft, _DAHL, off=0.0),)


def _softened(k: Coefficients, compliance: Expression) -> Coefficients:
    """A softer bristle of the same damping ratio."""
    ratio = 1.0 / (1.0 + k.sigma0 * compliance)
    return replace(k, sigma0=k.sigma0 * ratio, sigma1=k.sigma1 * ca.sqrt(ratio))


def _softened_stiffness(compliance: float, rig: Rig) -> float:
    """Stiffness in N/m of the static laws' carrier in series with ``compliance`` (m/N)."""
    servo = rig.kind == "servo"
    carrier = rig.mass * friction.CARRIER_FREQUENCY**2 if servo else friction.CARRIER_STIFFNESS_BENCH
    return carrier / (1.0 + carrier * compliance)


def _usual_damping(stiffness: float, rig: Rig) -> float:
    """Damping in N s/m of a bristle with the carrier's damping ratio."""
    return 2.0 * friction.CARRIER_DAMPING_RATIO * float(np.sqrt(stiffness * rig.mass))


class LawStribeck(Effect):
    """``g(v) = Fc + dFs exp(-(v/vs)^2)`` in place of the constant ``Fc``."""

    name = "law:stribeck"
    mechanism = "static friction lies above sliding friction and falls off with speed as the oil film builds up"
    equation = "friction"
    reference = _STRIBECK
    experiment = "break-away by slow ramps, then strokes at slow constant speeds"
    confused_with = ("law:lugre", "friction_dwell")
    guarantees = ("dissipative",)
    laws = ("coulomb",)
    richer_law = "stribeck"

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Surplus of the static friction."""
        return _surplus("stribeck", rig)

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Raise the static level."""
        return replace(k, Fs=k.Fs + scope.p.dFs_stribeck)

    def law_start(self, values: Mapping[str, float], amplitudes: Mapping[str, float], rig: Rig) -> dict[str, float]:
        """Static level from the screened surplus."""
        return {"Fs": values["Fc"] + max(amplitudes.get("dFs_stribeck", 0.0), _LEAST_SURPLUS * values["Fc"])}


class LawDahl(Effect):
    """A bristle of stiffness ``sigma0`` that gives way before it slips, in place of rigid sticking."""

    name = "law:dahl"
    mechanism = "the seal lip gives way elastically before it slips, so friction builds up over a displacement"
    equation = "friction"
    reference = _DAHL
    experiment = "reversals of a few micrometres, slow"
    confused_with = ("law:lugre", "friction_presliding_memory")
    guarantees = ("dissipative",)
    laws = ("coulomb",)
    richer_law = "dahl"

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Compliance of the bristle."""
        return _compliance("dahl", rig)

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Soften the bristle."""
        return _softened(k, scope.p.compliance_dahl)

    def law_start(self, values: Mapping[str, float], amplitudes: Mapping[str, float], rig: Rig) -> dict[str, float]:
        """Stiffness from the screened compliance."""
        return {"sigma0": _softened_stiffness(amplitudes.get("compliance_dahl", 0.0), rig)}


class LawLugre(Effect):
    """Stribeck curve and damped bristle together: what the rig's law has not of ``Fs, vs, sigma0, sigma1``."""

    name = "law:lugre"
    mechanism = "the seal lip gives way before it slips, and static friction lies above sliding friction"
    equation = "friction"
    reference = _LUGRE
    experiment = "break-away by slow ramps and reversals of a few micrometres"
    confused_with = ("law:stribeck", "law:dahl", "friction_presliding_memory", "friction_dwell")
    guarantees = ("dissipative",)
    laws = ("coulomb", "stribeck", "dahl")
    richer_law = "lugre"

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Of surplus, compliance and damping, those that the law lacks."""
        found = () if "Fs" in law.fitted else _surplus("lugre", rig)
        if law.static:
            return found + _compliance("lugre", rig)
        typical = _usual_damping(_typical_force(rig) / 3e-5, rig)
        damping = Parameter("damping_lugre", "σ1", "N*s/m", 0.0, 1e2 * typical, 0.0, 0.3 * typical, _LUGRE, off=0.0)
        return (*found, damping)

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Raise the static level, soften or damp the bristle."""
        p = scope.p
        if hasattr(p, "dFs_lugre"):
            k = replace(k, Fs=k.Fs + p.dFs_lugre)
        if hasattr(p, "compliance_lugre"):
            return _softened(k, p.compliance_lugre)
        return replace(k, sigma1=k.sigma1 + p.damping_lugre)

    def law_start(self, values: Mapping[str, float], amplitudes: Mapping[str, float], rig: Rig) -> dict[str, float]:
        """What the simple law has stays; the rest from the screened amplitudes, the damping from a usual damping ratio."""
        surplus = max(amplitudes.get("dFs_lugre", 0.0), _LEAST_SURPLUS * values["Fc"])
        stiffness = values.get("sigma0", _softened_stiffness(amplitudes.get("compliance_lugre", 0.0), rig))
        usual = 0.3 * _usual_damping(stiffness, rig)
        return {
            "Fs": values.get("Fs", values["Fc"] + surplus),
            "sigma0": stiffness,
            "sigma1": max(amplitudes.get("damping_lugre", usual), 0.1 * usual),
        }
