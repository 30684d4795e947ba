"""Pneumatic end-position cushioning: near an end air is trapped in a ring that a needle throttle drains."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter on linear drives (end-position cushioning)"

_EDGE = 0.15
"""Share of the cushion's length over which the spigot closes the free passage."""

_OPEN = 2.0e-3
"""Time constant in s by which ring and chamber become one through the free passage, or through the check valve."""

_CHECK = 1.0e3
"""Pressure difference in Pa over which the check valve opens."""


class _Side(NamedTuple):
    """One end of the cylinder. shut : 0 where the passage is open to 1; trapped : 0 where the check valve is open to 1;
    exchange : rate at which needle and passage even the pressures out, 1/s; growth : rate of the volume over it, 1/s; emptied :
    what the port takes out, as fall of what is left of the chamber, Pa/s."""

    share: Expression
    over: Expression
    shut: Expression
    trapped: Expression
    exchange: Expression
    growth: Expression
    emptied: Expression


class EndCushion(Effect):
    """Within ``L`` of the end a spigot shuts a share ``a`` of the area off from the port, with as much of the volume.

    The ring's pressure ``p + dp`` is no sensor's: it brakes with ``a A dp``, rises as the ring is compressed, drains through a
    needle within the time ``tau`` at the cushion's entry, and what is left of the chamber empties the faster for it. A
    check valve lets air in. ``a_1, dp_1`` act at the cap end (chamber 1), ``a_2, dp_2`` at the rod end.
    ``s = 1/(1 + exp((distance - L)/(0.15 L)))`` shuts. Typical: a 0.6 to 0.9, L 10 to 30 mm, tau 20 ms to 0.5 s.
    """

    name = "end_cushion"
    mechanism = "near the end a spigot shuts air in, which leaves through a needle throttle alone and brakes the piston"
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "fast strokes into both ends"
    confused_with = ("valve_asymmetry",)
    rigs = ("servo",)
    states = (State("dp_ring_1", "Pa", 0.0, 1e4, 1e4), State("dp_ring_2", "Pa", 0.0, 1e4, 1e4))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Share of the area that is shut off at each end, the length over which it is, and the needle's time constant."""
        return (
            Parameter("cushion_1", "a_1", "1", 0.0, 0.95, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("cushion_2", "a_2", "1", 0.0, 0.95, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("L_cushion", "L", "m", 2e-3, 0.1, 0.025, 1.0, _SOURCE, positive=True, prior=0.7),
            Parameter("tau_needle", "tau", "s", 2e-3, 10.0, 0.1, 1.0, _SOURCE, positive=True, prior=1.5),
        )

    def _sides(self, scope: Scope) -> tuple[_Side, _Side]:
        rig, parameter, state, length = scope.rig, scope.p, scope.state, scope.p.L_cushion

        def side(
            share: Expression, over: Expression, mdot: Expression, V: Expression, room: Expression, A: Expression,
            speed: Expression,
        ) -> _Side:  # fmt: skip
            shut = 0.5 * (1.0 - ca.tanh((room - length) / (2 * _EDGE * length)))
            trapped = 0.5 * (1.0 + ca.tanh(over / _CHECK))
            at_entry = V + A * (length - room)
            exchange = shut * at_entry / (V * parameter.tau_needle) + (1.0 - shut) / _OPEN
            emptied = -scope.n * R_AIR * rig.T * mdot / ((1.0 - share) * V)
            return _Side(share, over, shut, trapped, exchange, A * speed / V, shut * trapped * emptied)

        return (
            side(parameter.cushion_1, state.dp_ring_1, scope.mdot1, scope.V1, scope.x, rig.A1, scope.v),
            side(parameter.cushion_2, state.dp_ring_2, scope.mdot2, scope.V2, rig.stroke - scope.x, rig.A2, -scope.v),
        )

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """What is left of a chamber is smaller, and gets what the needle lets through: ring and chamber keep their mass."""
        one, two = (of.share * (of.trapped * of.exchange * of.over - of.emptied) for of in self._sides(scope))
        return rate1 + one, rate2 + two

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add what the rings push more than the chambers' pressures do."""
        one, two = self._sides(scope)
        return force + scope.rig.A1 * one.share * one.over - scope.rig.A2 * two.share * two.over

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Overpressure of each ring: left behind as the chamber empties, compressed, evened out through needle or valve."""
        found = {}
        for own, of in zip(self.states, self._sides(scope), strict=True):
            decay = of.exchange + (1.0 - of.trapped) / _OPEN
            source = of.emptied - of.shut * scope.n * of.over * of.growth
            found[own.name] = source / decay, 1.0 / decay
        return found
