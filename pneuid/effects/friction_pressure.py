"""Friction that grows with chamber pressure: seal lips pressed against the wall."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from pneuid.effect import Constraint, Effect, Expression, Parameter, Scope
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.rig import Rig

_PER = 1.0e5
"""Pascal per bar; the study states its coefficients per bar."""

_SOURCE = "Liu, Chen, Tao, JFPS 2011, paper 1D1-2, eq. (13), (15)"

_LOWEST_VS = 2.0e-4
_LOWEST_FC = 1.0e-3


class FrictionPressure(Effect):
    """``Fc, Fs, vs, sigma2`` affine in ``ps`` and ``dp``, clamped to the pressures fitted on.

    ``ps`` is the study's working pressure, that of chamber 1 (gauge), not the supply's; ``dp = p1 - p2``.
    """

    name = "friction_pressure"
    mechanism = "pressure presses the seal lips against the wall, so friction grows and the oil film is squeezed out"
    equation = "friction"
    reference = _SOURCE
    experiment = "runs at several chamber pressures (on a servo rig several supplies), with strokes in both directions"
    confused_with = ("friction_direction",)
    guarantees = ("dissipative",)

    _laws = {"Fc": ("k1", "k2"), "Fs": ("k3", "k4"), "vs": ("k5", "k6"), "sigma2": ("k7", "k8")}
    _units = {"Fc": "N/Pa", "Fs": "N/Pa", "vs": "m/(s*Pa)", "sigma2": "N*s/(m*Pa)"}

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """k1..k8 for the coefficients that the friction law fits."""
        # one seal force scale: friction of a cylinder is a small share of its pressure force
        force = max(2.0, 0.01 * rig.A1 * 1e6)
        scales = {"Fc": force, "Fs": 2 * force, "vs": 2e-3, "sigma2": 10 * force}
        found = []
        for target, names in self._laws.items():
            if target not in law.fitted:
                continue
            scale = scales[target] / (6 * _PER)
            for name, of in zip(names, ("ps", "dp"), strict=True):
                found.append(
                    Parameter(
                        name, f"{name} (d{target}/d{of})", self._units[target], -50 * scale, 50 * scale, 0.0, scale,
                        _SOURCE, off=0.0, prior=10 * scale,
                    )
                )  # fmt: skip
        return tuple(found)

    def _shift(self, target: str, ps: Expression, dp: Expression, scope: Scope) -> Expression:
        names = self._laws[target]
        if not hasattr(scope.p, names[0]):
            return 0.0
        return getattr(scope.p, names[0]) * ps + getattr(scope.p, names[1]) * dp

    def break_away(self, values: Mapping[str, float], ratio: float) -> dict[str, float]:
        """The laws of ``Fs`` are ``ratio`` times those of ``Fc``, ``vs`` has none."""
        start = {fs: ratio * values[fc] for fs, fc in zip(self._laws["Fs"], self._laws["Fc"], strict=True)}
        return {name: value for name, value in (start | dict.fromkeys(self._laws["vs"], 0.0)).items() if name in values}

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Add the pressure laws; ``vs >= 0.2 mm/s``, ``Fs >= Fc > 0``, ``sigma2 >= 0``."""
        rig = scope.rig
        p1 = ca.fmin(ca.fmax(scope.p1, rig.p1_low), rig.p1_high)
        p2 = ca.fmin(ca.fmax(scope.p2, rig.p2_low), rig.p2_high)
        ps, dp = p1 - rig.patm, p1 - p2
        Fc = ca.fmax(k.Fc + self._shift("Fc", ps, dp, scope), _LOWEST_FC)
        same = not hasattr(scope.p, "k3")
        Fs = Fc + (k.Fs - k.Fc) if same else ca.fmax(k.Fs + self._shift("Fs", ps, dp, scope), Fc)
        return replace(
            k,
            Fc=Fc,
            Fs=Fs,
            vs=ca.fmax(k.vs + self._shift("vs", ps, dp, scope), _LOWEST_VS),
            sigma2=ca.fmax(k.sigma2 + self._shift("sigma2", ps, dp, scope), 0.0),
        )

    def constraints(self, base: dict[str, Expression], scope: Scope) -> tuple[Constraint, ...]:
        """Positive ``Fc``, ``Fs - Fc`` and ``sigma2`` at the corners of the fitted pressures, ``vs`` not far below zero."""
        rig = scope.rig
        found = []
        for p1 in (rig.p1_low, rig.p1_high):
            for p2 in (rig.p2_low, rig.p2_high):
                ps, dp = p1 - rig.patm, p1 - p2
                at = {name: base[name] + self._shift(name, ps, dp, scope) for name in self._laws if name in base}
                found.append(Constraint("Fc", at["Fc"] - _LOWEST_FC))
                found.append(Constraint("sigma2", at["sigma2"]))
                if "Fs" in at:
                    found.append(Constraint("Fs - Fc", at["Fs"] - at["Fc"]))
                    # the floor may hold vs at a corner, as in the study at 600 kPa in both chambers, but not everywhere
                    found.append(Constraint("vs", at["vs"] + base["vs"]))
        return tuple(found)
