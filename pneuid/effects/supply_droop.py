"""Supply pressure that sinks while air is drawn."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 3 (reservoir behind a restriction); ISO 6358-1:2013, eq. (1)"

_SMALL = 0.02
"""Flow, in choked flows of the fully open valve, below which the drop is linear."""


class SupplyDroop(Effect):
    """Supply at the valve is ``psup (1 - r q^m)``, ``q`` the supply flow averaged over the time constant ``tau``.

    ``q`` counts in choked flows of the fully open valve, so ``r`` is the relative drop that such a flow would cause. A
    regulator's pressure sinks in proportion to the flow (m = 1), that behind an orifice with its square (m = 2, ISO 6358 at
    small drops).
    """

    name = "supply_droop"
    mechanism = "regulator and line cannot deliver the flow drawn, so the pressure at the valve sinks"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "large fast steps at high flow"
    rigs = ("servo",)
    states = (State("q_supply", "1", 0.0, 0.3, 0.02),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Relative drop at full flow, its exponent, and the time constant of the supply's volume."""
        return (
            Parameter("r_supply", "r_s", "1", 0.0, 5.0, 0.0, 0.1, _SOURCE, off=0.0),
            Parameter("m_supply", "m_s", "1", 0.8, 2.2, 1.4, 0.1, _SOURCE, prior=0.3),
            Parameter("tau_supply", "tau_s", "s", 2e-3, 2.0, 0.05, 1.0, _SOURCE, positive=True, prior=1.5),
        )

    def supply(self, psup: Expression, scope: Scope) -> Expression:
        """Lower the supply by a power of the averaged flow."""
        q = scope.state.q_supply
        return psup * (1.0 - scope.p.r_supply * q * (q * q + _SMALL**2) ** (0.5 * (scope.p.m_supply - 1.0)))

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The averaged flow follows the flow drawn."""
        return {"q_supply": (scope.supply_flow / scope.full_flow, scope.p.tau_supply)}
