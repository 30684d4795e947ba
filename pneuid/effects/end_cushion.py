"""Pneumatic end-position cushioning: near an end air is trapped in a ring that a needle throttle drains."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter on linear drives (end-position cushioning)"

_EDGE = 1.0e-3
"""Length in m over which the seal on the spigot closes the free passage."""

_OPEN = 2.0e-3
"""Time constant in s by which ring and chamber become one through the free passage, or through the check valve."""

_CLEARANCE = 1.0e-3
"""What is left of the ring's length at the end of the stroke, m; tubes and ports belong to the rest of the chamber."""

_CHECK = 1.0e3
"""Pressure difference in Pa over which the check valve opens."""


class _Side(NamedTuple):
    """One end of the cylinder, shut as far as it is.

    part : the ring's share of the chamber's volume; trapped : 0 where the check valve is open to 1; exchange : rate at which
    needle and passage even the pressures out, 1/s; squeezed : growth of an overpressure by the ring's own compression, 1/s;
    left_behind : what the overpressure gains as the ring is pressed and the rest of the chamber emptied, Pa/s; faster : what
    the chamber's pressure gains by being smaller, Pa/s."""

    part: Expression
    over: Expression
    trapped: Expression
    exchange: Expression
    squeezed: Expression
    left_behind: Expression
    faster: Expression


class EndCushion(Effect):
    """Within ``L`` of the end a spigot shuts the volume before a share ``a`` of the piston's area off from the port.

    The ring's pressure ``p + dp`` is no sensor's: it brakes with ``a A dp``, rises as the ring is compressed, drains through a
    needle within the time ``tau`` at the cushion's entry, and what is left of the chamber empties the faster for it. A
    check valve lets air in. ``a_1, dp_1`` act at the cap end (chamber 1), ``a_2, dp_2`` at the rod end.
    ``s = 1/(1 + exp((distance - L)/(1 mm)))`` shuts. Typical: a 0.6 to 0.9, L 10 to 30 mm, tau 20 ms to 0.5 s.
    """

    name = "end_cushion"
    mechanism = "near the end a spigot shuts air in, which leaves through a needle throttle alone and brakes the piston"
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "fast strokes into both ends"
    confused_with = ("valve_asymmetry",)
    rigs = ("servo",)
    states = (State("dp_ring_1", "Pa", 0.0, 1e4, 3e4), State("dp_ring_2", "Pa", 0.0, 1e4, 3e4))

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
            share: Expression, over: Expression, p: Expression, mdot: Expression, V: Expression, room: Expression,
            A: Expression, speed: Expression,
        ) -> _Side:  # fmt: skip
            shut = 0.5 * (1.0 - ca.tanh((room - length) / (2 * _EDGE)))
            trapped = 0.5 * (1.0 + ca.tanh(over / _CHECK))
            room = ca.fmax(room, 0.0) + _CLEARANCE
            ring = share * A * room
            rest, entering = V - ring, R_AIR * rig.T * mdot
            smaller = scope.n / rest * (entering - p * (1.0 - share) * A * speed)
            whole = scope.n / V * (entering - p * A * speed)
            exchange = shut * (length + _CLEARANCE) / (room * parameter.tau_needle) + (1.0 - shut) / _OPEN
            pressed = -scope.n * speed / room
            return _Side(
                ring / V, over, trapped, exchange, shut * pressed, shut * trapped * (p * pressed - smaller),
                shut * trapped * (smaller - whole),
            )  # fmt: skip

        return (
            side(parameter.cushion_1, state.dp_ring_1, scope.p1, scope.mdot1, scope.V1, scope.x, rig.A1, scope.v),
            side(
                parameter.cushion_2, state.dp_ring_2, scope.p2, scope.mdot2, scope.V2, rig.stroke - scope.x, rig.A2, -scope.v
            ),
        )

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """What is left of a chamber is smaller, and gets what the needle lets through: ring and chamber keep their mass."""
        one, two = (of.faster + of.trapped * of.part * of.exchange * of.over for of in self._sides(scope))
        return rate1 + one, rate2 + two

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add what the rings push more than the chambers' pressures do."""
        one, two = scope.rig.A1 * scope.state.dp_ring_1, scope.rig.A2 * scope.state.dp_ring_2
        return force + scope.p.cushion_1 * one - scope.p.cushion_2 * two

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Overpressure of each ring: pressed, left behind as the chamber empties, evened out through needle or valve."""
        found = {}
        for own, of in zip(self.states, self._sides(scope), strict=True):
            decay = of.exchange + (1.0 - of.trapped) / _OPEN
            source = of.left_behind + of.squeezed * of.over
            found[own.name] = source / decay, 1.0 / decay
        return found
