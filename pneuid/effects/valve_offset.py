"""A valve that closes at another command than the rig file says."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 5 (null shift of proportional valves)"


class ValveOffset(Effect):
    """Opening ``s + o``, ``s`` the command relative to full scale."""

    name = "valve_offset"
    mechanism = "the spool's neutral position has shifted, so that the valve closes at another command"
    equation = "valve"
    reference = _SOURCE
    experiment = "small slow commands around null"
    confused_with = ("valve_asymmetry", "leakage_internal")
    constant = True
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Shift relative to full scale; a few percent at most when new."""
        return (Parameter("offset_valve", "o_v", "1", -0.5, 0.5, 0.0, 0.02, _SOURCE, off=0.0),)

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Shift the command."""
        return opening + scope.p.offset_valve
