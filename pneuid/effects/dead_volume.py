"""Dead volumes other than the rig file says."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Richer, Hurmuzlu, J. Dyn. Syst. Meas. Control 122 (2000) 416, part 1 (inactive volume at the end of the stroke)"
)

_SMALLEST = 0.3
"""Least dead volume, relative to the rig file's; the plant keeps volumes above a fifth of that."""


class DeadVolume(Effect):
    """``V1 = V01 + dV01 + A1 x``, ``V2 = V02 + dV02 + A2 (stroke - x)``."""

    name = "dead_volume"
    mechanism = "tubing, fittings and end caps hold more or less air than the rig file says"
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "small fast steps near either end of the stroke"
    confused_with = ("line_delay", "heat_transfer")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Deviation of either dead volume from the rig file's."""
        return tuple(
            Parameter(
                f"d{name}", f"ΔV_{name[1:]}", "m^3", (_SMALLEST - 1.0) * V0, 20 * V0, 0.0, 0.2 * V0, _SOURCE, off=0.0
            )
            for name, V0 in (("V01", rig.V01), ("V02", rig.V02))
        )

    def volumes(self, V1: Expression, V2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Shift both volumes."""
        return V1 + scope.p.dV01, V2 + scope.p.dV02
