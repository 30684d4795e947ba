"""Heat exchange between the air in a chamber and its wall."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics import chamber
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.physics.smoothing import absolute, positive_part
from pneuid.rig import Rig

_SOURCE = (
    "Carneiro, de Almeida, Proc. IMechE Part I 220 (2006) 301 (full-order chamber model); wall coefficient: Sieder, "
    "Tate, Ind. Eng. Chem. 28 (1936) 1429 (turbulent flow in tubes: Nu ~ Re^0.8, so it grows with density and motion)"
)

_STATED_AT, _LEAST = 4e5, 1e4
"""Absolute pressure in Pa at which ``h_0`` is stated, and the least that counts at a solver's trial point."""


class HeatTransfer(Effect):
    """``dp/dt = base(n) - e (gamma R mdot_out + (gamma-1) h A) theta / V``, ``T + theta`` the gas temperature.

    ``e = 1, n = 1.4`` is the full energy balance with wall coefficient ``h``, ``e = 0`` the polytropic base. The homotopy
    ``(1-e) base + e balance`` is the same family: what it does to the first term is a change of ``n``, which stays free.

    ``h = h_0 (1 + s w) (p / 4 bar)^a``: moving gas exchanges more, ``w`` being what flows through the port and what the piston
    displaces, over the choked flow from the nominal supply through the fully open valve; ``a`` is 0.8 where it is turbulent.
    """

    name = "heat_transfer"
    mechanism = (
        "compressed air warms up and gives its heat to the wall within a second, which one exponent cannot follow"
    )
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "large fast steps followed by dwells of a second or more with the valve closed"
    confused_with = ("dead_volume", "leakage_internal", "inlet_mixing")
    rigs = ("servo",)
    states = (State("theta_1", "K", 0.0, 15.0, 3.0), State("theta_2", "K", 0.0, 15.0, 3.0))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Weight of the energy balance, above 1 absorbing what the wall area lacks; coefficient of the wall, its growth with
        the motion of the gas and with its pressure."""
        return (
            Parameter("heat_weight", "e", "1", 0.0, 1.5, 0.0, 0.3, _SOURCE, off=0.0),
            Parameter("h_wall", "h_0", "W/(m^2*K)", 1.0, 2e3, 50.0, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("h_stir", "s", "1", 1e-2, 300.0, 1.0, 1.0, _SOURCE, positive=True, prior=1.5),
            Parameter("h_dense", "a", "1", -0.2, 1.0, 0.0, 0.3, _SOURCE, prior=0.3),
        )

    def _chambers(self, scope: Scope) -> list[tuple[Expression, ...]]:
        """Excess temperature, pressure, volume, its rate, flows in and out, wall conductance of either chamber."""
        rig, state, found = scope.rig, scope.state, []
        width = scope.smoothing.opening * scope.full_flow
        for theta, p, V, V_rate, mdot, A in (
            (state.theta_1, scope.p1, scope.V1, rig.A1 * scope.v, scope.mdot1, rig.A1),
            (state.theta_2, scope.p2, scope.V2, -rig.A2 * scope.v, scope.mdot2, rig.A2),
        ):
            filling, emptying = positive_part(mdot, width), positive_part(-mdot, width)
            dense = ca.fmax(p, _LEAST)
            displaced = absolute(V_rate, scope.smoothing.speed * A) * dense / (R_AIR * rig.T)
            stirred = 1.0 + scope.p.h_stir * (filling + emptying + displaced) / scope.full_flow
            h = scope.p.h_wall * stirred * (dense / _STATED_AT) ** scope.p.h_dense
            found.append((theta, p, V, V_rate, filling, emptying, h * chamber.wall_area(V, A)))
        return found

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Add what the temperature of the gas does to the pressure."""
        one, two = (
            scope.p.heat_weight * chamber.temperature_pressure_rate(theta, V, emptying, wall)
            for theta, _, V, _, _, emptying, wall in self._chambers(scope)
        )
        return rate1 + one, rate2 + two

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Both temperatures, driven by flow and compression and drawn to that of the wall."""
        found = {}
        for own, (theta, p, V, V_rate, filling, emptying, wall) in zip(self.states, self._chambers(scope), strict=True):
            source, decay = chamber.temperature_relaxation(theta, p, V, V_rate, filling, emptying, wall, scope.rig.T)
            found[own.name] = source / decay, 1.0 / decay
        return found
