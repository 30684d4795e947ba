"""Supply pressure that sinks while air is drawn."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter 3 (reservoir behind a restriction); ISO 6358-1:2013, eq. (1)"

_LAMINAR = 0.001
"""Drop, over that at which the restriction chokes, below which its flow is linear."""

_QUARTER = 7.0
"""``(2 - u) / u`` at a quarter of the drop that chokes."""


class SupplyDroop(Effect):
    """Supply at the valve is ``psup (1 - r q)``, ``q`` what a volume behind a restriction lacks: ``tau S dq/dt = S Q - q``.

    ``Q`` is the flow drawn, in choked flows of the fully open valve. ``S = (7 u / (2 - u))^k``, ``k = (m - 1) / m``, is what
    the restriction resists, ``u = q / (7^k q_c)`` the share of the drop that chokes it; at a quarter of that S is 1. In steady
    flow the drop grows with the flow's power ``m`` at first. A regulator's pressure sinks in proportion (m = 1, whatever q_c);
    an orifice has the ellipse of ISO 6358 (m = 2), and what is drawn beyond ``q_c`` empties the volume.
    """

    name = "supply_droop"
    mechanism = "regulator and line cannot deliver the flow drawn, so the pressure at the valve sinks"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "large fast steps at high flow"
    rigs = ("servo",)
    states = (State("q_drop", "1", 0.0, 0.3, 0.02),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Relative drop, its exponent at small flows, the time constant of the supply's volume, and the flow that chokes."""
        return (
            Parameter("r_supply", "r_s", "1", 0.0, 5.0, 0.0, 0.1, _SOURCE, off=0.0),
            Parameter("m_supply", "m_s", "1", 0.8, 2.2, 1.4, 0.1, _SOURCE, prior=0.3),
            Parameter("tau_supply", "tau_s", "s", 2e-3, 2.0, 0.15, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("q_supply", "q_c", "1", 0.1, 10.0, 1.0, 0.3, _SOURCE, positive=True, prior=0.7),
        )

    def supply(self, psup: Expression, scope: Scope) -> Expression:
        """Lower the supply by what the volume has given up."""
        return psup * (1.0 - scope.p.r_supply * scope.state.q_drop)

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The volume's pressure approaches that at which as much flows in as is drawn."""
        p, drop = scope.p, ca.fmax(scope.state.q_drop, 0.0)
        k = (p.m_supply - 1.0) / p.m_supply
        u = drop / (_QUARTER**k * p.q_supply)
        open_ = ca.fmin(u, 1.0)
        S = (_QUARTER * ca.fmax(u, 1.0) ** 2 * (open_ + _LAMINAR) / (2.0 - open_)) ** k
        return {"q_drop": (S * scope.supply_flow / scope.full_flow, p.tau_supply * S)}
