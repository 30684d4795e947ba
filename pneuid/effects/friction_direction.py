"""Friction that differs between extending and retracting."""

from __future__ import annotations

from dataclasses import replace

from pneuid.effect import Constraint, Effect, Expression, Parameter, Scope
from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import sign
from pneuid.rig import Rig

_SOURCE = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, section 2.1"


class FrictionDirection(Effect):
    """``Fc, Fs, sigma2`` shifted by ``+d`` when extending and by ``-d`` when retracting."""

    name = "friction_direction"
    mechanism = "seal lips and bearings resist differently in the two directions of motion"
    equation = "friction"
    reference = _SOURCE
    experiment = "strokes at several speeds in both directions"
    confused_with = ("gravity", "sensor_offset_p1", "sensor_offset_p2")
    guarantees = ("dissipative",)

    _targets = {"Fc": "Fc_d", "Fs": "Fs_d", "sigma2": "sigma2_d"}

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Half the difference of each coefficient between the two directions."""
        force = max(2.0, 0.01 * rig.A1 * 1e6)
        scales = {"Fc": force, "Fs": force, "sigma2": 10 * force}
        units = {"Fc": "N", "Fs": "N", "sigma2": "N*s/m"}
        return tuple(
            Parameter(name, f"d{target}", units[target], -1e3 * scales[target], 1e3 * scales[target], 0.0,
                      scales[target], _SOURCE, off=0.0)
            for target, name in self._targets.items()
            if target in law.fitted
        )  # fmt: skip

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Shift each coefficient along the sign of the speed."""
        s = sign(scope.v, scope.smoothing.speed)
        Fc = k.Fc + scope.p.Fc_d * s
        Fs = k.Fs + (scope.p.Fs_d if hasattr(scope.p, "Fs_d") else scope.p.Fc_d) * s
        return replace(k, Fc=Fc, Fs=Fs, sigma2=k.sigma2 + scope.p.sigma2_d * s)

    def constraints(self, base: dict[str, Expression], scope: Scope) -> tuple[Constraint, ...]:
        """Both directions keep a positive friction with ``Fs >= Fc``."""
        found = []
        for way in (1.0, -1.0):
            at = {
                name: base[name] + way * getattr(scope.p, self._targets[name]) for name in self._targets if name in base
            }
            found += [Constraint("Fc", at["Fc"]), Constraint("sigma2", at["sigma2"])]
            if "Fs" in at:
                found.append(Constraint("Fs - Fc", at["Fs"] - at["Fc"]))
        return tuple(found)
