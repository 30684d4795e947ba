"""Supply pressure that sinks while air is drawn."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import RHO_REFERENCE
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 3 (reservoir behind a restriction, linearised)"


class SupplyDroop(Effect):
    """Supply at the valve is ``psup - R m``, ``m`` the supply flow averaged over the time constant ``tau``."""

    name = "supply_droop"
    mechanism = "regulator and line cannot deliver the flow drawn, so the pressure at the valve sinks"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "large fast steps at high flow"
    rigs = ("servo",)
    states = (State("m_droop", "kg/s", 0.0, 1e-4, 1e-3),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Flow resistance of the supply and the time constant of its volume."""
        # the resistance at which full choked flow would cost a tenth of the supply pressure
        scale = 0.1 / (rig.conductance * RHO_REFERENCE)
        return (
            Parameter("R_supply", "R_s", "Pa*s/kg", 0.0, 50 * scale, 0.0, scale, _SOURCE, off=0.0),
            Parameter("tau_supply", "tau_s", "s", 2e-3, 2.0, 0.05, 0.05, _SOURCE, positive=True, prior=1.5),
        )

    def supply(self, psup: Expression, scope: Scope) -> Expression:
        """Lower the supply in proportion to the averaged flow."""
        return psup - scope.p.R_supply * scope.state.m_droop

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The averaged flow follows the flow drawn."""
        return {"m_droop": (scope.supply_flow, scope.p.tau_supply)}
