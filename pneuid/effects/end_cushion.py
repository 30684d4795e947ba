"""Pneumatic end-position cushioning: near an end air is trapped in a ring that a needle throttle drains."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.physics.valve import flow_function
from pneuid.rig import Rig

_SOURCE = "Beater, Pneumatic Drives (Springer 2007), chapter on linear drives (end-position cushioning)"

_NEEDLE = "ISO 6358-1:2013, eq. (1) and (2)"

_OPEN = 2.0e-3
"""Time constant in s by which ring and chamber become one through the free passage."""

_CHECK = 1.0e3
"""Pressure difference in Pa over which the check valve opens."""

_CRITICAL = 0.3
"""Critical pressure ratio of the needle, an orifice without a long passage (ISO 6358: 0.2 to 0.5)."""

_LAMINAR = 0.01
"""Overpressure, as a share of the ring's pressure, below which the needle's flow is proportional to it."""

_LOOKS = (
    {"L_cushion": 0.0125}, {"L_cushion": 0.05},
    {"tau_needle_1": 0.045, "tau_needle_2": 0.045}, {"tau_needle_1": 0.9, "tau_needle_2": 0.9},
)  # fmt: skip
"""Lengths and needles a prior deviation off: a cushion that is shorter than usual shows little of itself as a long one."""


class _Side(NamedTuple):
    """One end of the cylinder, shut as far as it is.

    part : the ring's share of the chamber's volume; exchange : rate at which needle, passage and check valve even the pressures
    out, 1/s; squeezed : growth of an overpressure by the ring's own compression, 1/s; left_behind : what the overpressure gains
    as the ring is pressed and the rest of the chamber emptied, Pa/s; faster : what the chamber's pressure gains by being
    smaller, Pa/s."""

    part: Expression
    over: Expression
    exchange: Expression
    squeezed: Expression
    left_behind: Expression
    faster: Expression


class EndCushion(Effect):
    """Within ``L`` of the end a spigot shuts the volume before a share ``a`` of the piston's area off from the port.

    The ring's pressure ``p + dp`` is no sensor's: it brakes with ``a A dp``, rises as the ring is compressed, drains through a
    needle, and what is left of the chamber empties the faster for it. A check valve that cracks at ``p_c`` lets air in, within
    ``tau_c``. The needle is an orifice by ISO 6358-1: ``tau = a A (L + L_0) / (n R T C rho_0)`` is the time constant of a ring
    beside a far larger chamber at the cushion's entry, while the flow is choked; it drains ``psi / (1 - r)`` times as fast,
    ``r = p/(p + dp)``. Of the ring's length ``L_0`` is left at the end of the stroke. A spigot that tapers closes the orifice
    as it goes in, from ``C`` to ``C / (1 + k_c)``. ``a_1, dp_1, tau_1`` are those of the cap end (chamber 1), ``a_2, dp_2,
    tau_2`` of the rod end. ``s = 1/(1 + exp((distance - L)/e_c))`` shuts. Typical: a 0.6 to 0.9, L 10 to 30 mm, tau 50 ms to
    2 s, tau_c 1 to 5 ms, L_0 0.5 to 5 mm, p_c up to 10 kPa.
    """

    name = "end_cushion"
    mechanism = "near the end a spigot shuts air in, which leaves through a needle throttle alone and brakes the piston"
    equation = "pressure_1"
    reference = _SOURCE
    experiment = "fast strokes into both ends"
    confused_with = ("valve_asymmetry",)
    looks = _LOOKS
    rigs = ("servo",)
    states = (State("dp_ring_1", "Pa", 0.0, 1e4, 3e4), State("dp_ring_2", "Pa", 0.0, 1e4, 3e4))

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Share of the area that is shut off at each end, over which length, and what spigots, valves and needles are like."""
        return (
            Parameter("cushion_1", "a_1", "1", 0.0, 0.95, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("cushion_2", "a_2", "1", 0.0, 0.95, 0.0, 0.2, _SOURCE, off=0.0),
            Parameter("L_cushion", "L", "m", 2e-3, 0.1, 0.025, 1.0, _SOURCE, positive=True, prior=0.7),
            Parameter("rest_cushion", "L_0", "m", 2e-4, 0.03, 1e-3, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("taper_cushion", "k_c", "1", 0.0, 10.0, 0.3, 0.5, _SOURCE, prior=1.0),
            Parameter("edge_cushion", "e_c", "m", 1e-4, 5e-3, 5e-4, 1.0, _SOURCE, positive=True, prior=0.7),
            Parameter("crack_check", "p_c", "Pa", -1e3, 3e4, 4e3, 1e3, _SOURCE, prior=3e3),
            Parameter("tau_check", "tau_c", "s", 5e-4, 0.05, 1e-3, 1.0, _SOURCE, positive=True, prior=1.0),
            Parameter("tau_needle_1", "tau_1", "s", 5e-3, 20.0, 0.2, 1.0, _NEEDLE, positive=True, prior=1.5),
            Parameter("tau_needle_2", "tau_2", "s", 5e-3, 20.0, 0.2, 1.0, _NEEDLE, positive=True, prior=1.5),
        )

    def _sides(self, scope: Scope) -> tuple[_Side, _Side]:
        rig, p, state = scope.rig, scope.p, scope.state
        return (
            _side(
                scope, p.cushion_1, p.tau_needle_1, state.dp_ring_1, scope.p1, scope.mdot1, scope.V1, scope.x, rig.A1, scope.v
            ),
            _side(
                scope, p.cushion_2, p.tau_needle_2, state.dp_ring_2, scope.p2, scope.mdot2, scope.V2, rig.stroke - scope.x,
                rig.A2, -scope.v,
            ),
        )  # fmt: skip

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """What is left of a chamber is smaller, and gets what the needle lets through: ring and chamber keep their mass."""
        one, two = (of.faster + of.part * of.exchange * of.over for of in self._sides(scope))
        return rate1 + one, rate2 + two

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Add what the rings push more than the chambers' pressures do."""
        one, two = scope.rig.A1 * scope.state.dp_ring_1, scope.rig.A2 * scope.state.dp_ring_2
        return force + scope.p.cushion_1 * one - scope.p.cushion_2 * two

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """Overpressure of each ring: pressed, left behind as the chamber empties, evened out through needle or valve."""
        found = {}
        for own, of in zip(self.states, self._sides(scope), strict=True):
            source = of.left_behind + of.squeezed * of.over
            found[own.name] = source / of.exchange, 1.0 / of.exchange
        return found


def _side(
    scope: Scope, share: Expression, tau: Expression, over: Expression, p: Expression, mdot: Expression, V: Expression,
    room: Expression, A: Expression, speed: Expression,
) -> _Side:  # fmt: skip
    """One end with ``room`` (m) left before it, which the piston leaves at ``speed``: its chamber's ``p, mdot, V, A``, the
    ring's overpressure ``over``, and the end's own ``share`` and ``tau``."""
    length = scope.p.L_cushion
    shut = 0.5 * (1.0 - ca.tanh((room - length) / (2 * scope.p.edge_cushion)))
    trapped = 0.5 * (1.0 + ca.tanh((over + scope.p.crack_check) / _CHECK))
    inside = ca.fmin(ca.fmax(room, 0.0) / length, 1.0)
    room = ca.fmax(room, 0.0) + scope.p.rest_cushion
    ring = share * A * room
    rest, entering = V - ring, R_AIR * scope.rig.T * mdot
    smaller = scope.n / rest * (entering - p * (1.0 - share) * A * speed)
    whole = scope.n / V * (entering - p * A * speed)
    # what leaves the ring fills the rest as well, the less there is of it the more
    open_by = (1.0 + scope.p.taper_cushion * inside) / (1.0 + scope.p.taper_cushion)
    needle = shut * (length + scope.p.rest_cushion) / (room * tau) * open_by * _eased(over, p) * V / rest
    exchange = needle + (1.0 - shut) / _OPEN + (1.0 - trapped) / scope.p.tau_check
    pressed = -scope.n * speed / room
    return _Side(ring / V, over, exchange, shut * pressed, shut * (p * pressed - smaller), shut * (smaller - whole))


def _eased(over: Expression, p: Expression) -> Expression:
    """Times as fast as in choked flow, relative to the overpressure, that a needle evens out the overpressure of a ring."""
    above = ca.fmax(over, 0.0)
    part = ca.fmax(above / (p + above), _LAMINAR)
    return flow_function(1.0 - part, _CRITICAL, _LAMINAR) / part
