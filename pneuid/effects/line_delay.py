"""Tubes between valve and chambers."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, stiffly, swinging, vanishing_lag
from pneuid.physics.tube import share_filling, share_venting
from pneuid.rig import Rig

_SOURCE = (
    "Richer, Hurmuzlu, J. Dyn. Syst. Meas. Control 122 (2000) 416, part 1, section on the connecting tubes (delay L/c)"
)

_SERIES = "ISO 6358-1:2013, eq. (1) and (2), with ISO 6358-3:2014 for components in series"

_SURGE = "Wylie, Streeter, Suo, Fluid Transients in Systems (Prentice Hall 1993), chapter 1 (Joukowsky's surge, c dv)"

_SHORTEST = 1.0e-3
"""Time in s with which the tubes are screened; well below it they are a delay of ``2 tau`` alone, whatever the damping."""

_QUIET = 10.0
"""Surge in Pa below which the valve's answer to it is not taken into a step of the integrator."""

_LEAST = 2.0e4
"""Least absolute pressure at a port, Pa."""


class LineDelay(Effect):
    """The flow that arrives in a chamber answers the valve's by ``1 / (1 + 2 D tau s + tau^2 s^2)``, ``tau`` about ``L/c``.

    That is one section of a tube: a volume at the valve from which air of some inertia is sped up. With ``D`` near 0.7 it is
    close to a wave that comes unchanged, ``1.4 tau`` late, with a large one a resistance before a volume.
    While the flow ``q`` changes the pressure at the valve's port is ``tau dq/dt`` times Joukowsky's ``c / A_t`` above the
    chamber's, and the valve passes the less: ``k = c q_0 / (A_t p_0)`` by the choked flow ``q_0`` of the fully open valve from
    the supply ``p_0``. ``l`` is the length of the tube to chamber 1 over that to chamber 2, ``tau`` of their geometric mean.
    The tube's own resistance stands in series with the valve, ``r = (C / C_tube)^2``: an edge of opening ``s`` passes ``s q``,
    ``q`` its ISO 6358 flow over its conductance, and the tube the same, ``r s^2 q^2 = p_up^2 - p_down^2``. A filling edge keeps
    all of its flow while the pressure at its port leaves it choked, a venting one then the share ``1 / sqrt(1 + r s^2)``.
    """

    name = "line_delay"
    mechanism = "air needs time, and pressure, to run through the tubes between the valve and the chambers"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "fast steps of the command at several supply pressures"
    confused_with = ("valve_lag", "channel_skew", "dead_volume", "exhaust_restriction", "supply_droop")
    rigs = ("servo",)
    states = tuple(
        State(name, "1", 0.0, 0.3, 0.01)
        for name in ("flow_between_1", "flow_behind_1", "flow_between_2", "flow_behind_2")
    )

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Time of a wave through the tubes, 3 ms for each metre, and squared ratio of the valve's conductance to a tube's.

        Of usual tubes the surge ``k`` is 0.2 to 1, and the damping below 1.
        """
        return (
            Parameter("tau_line", "τ_l", "s", 0.0, 0.2, 0.0, 3e-3, _SOURCE, off=0.0),
            Parameter("damping_line", "D_l", "1", 0.0, 4.0, 0.7, 0.1, _SOURCE, prior=0.5),
            Parameter("r_line", "r_l", "1", 0.0, 25.0, 0.0, 0.1, _SERIES, off=0.0),
            Parameter("surge_line", "k_l", "1", 0.0, 5.0, 0.3, 0.1, _SURGE, prior=0.5),
            Parameter("lengths_line", "l_l", "1", 0.2, 5.0, 1.0, 0.3, _SOURCE, positive=True, prior=0.4),
        )

    def drawn(self, supply_1: Expression, supply_2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """What the tubes' resistance leaves of both in the long run."""
        R, (longer_1, longer_2) = scope.p.r_line * (scope.opening_1 + scope.opening_2) ** 2, _longer(scope)
        share_1 = share_filling(longer_1 * R, scope.p1, scope.psup, scope.b)
        return supply_1 * share_1, supply_2 * share_filling(longer_2 * R, scope.p2, scope.psup, scope.b)

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Replace the valve's flow by what arrives of it; states count in flows through the fully open valve."""
        arriving_1, arriving_2 = (arriving * scope.full_flow for arriving, _ in self._followed(scope))
        return mdot1 - scope.valve_flow_1 + arriving_1, mdot2 - scope.valve_flow_2 + arriving_2

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """What arrives follows what valve and tube let through."""
        (_, stages_1), (_, stages_2) = self._followed(scope)
        return dict(zip((state.name for state in self.states), (*stages_1, *stages_2), strict=True))

    @staticmethod
    def _followed(scope: Scope) -> tuple[tuple[Expression, tuple[Stage, Stage]], ...]:
        """What arrives in both chambers, as a share of the flow through the fully open valve, and what its states follow."""
        p, own = scope.p, scope.state
        past = (own.flow_between_1, own.flow_behind_1), (own.flow_between_2, own.flow_behind_2)
        surge = p.surge_line * vanishing_lag(p.tau_line, _SHORTEST)[0] * scope.psup
        above = tuple(surge * (between - behind) for between, behind in past)
        at_ports, at_chambers = _through(scope, *above), _through(scope, 0.0, 0.0)
        found = []
        for k, longer in enumerate(_longer(scope)):
            delay = longer * p.tau_line
            # by the surge alone a full chamber would ring, where the valve's curve is steep
            arriving, (drive, last) = swinging(at_ports[k], past[k], delay, p.damping_line, _SHORTEST, at_chambers[k])
            # what the surge itself does to the flow, where the valve's curve is steep
            steep = surge * (at_chambers[k] - at_ports[k]) * above[k] / (above[k] * above[k] + _QUIET * _QUIET)
            found.append((arriving, (stiffly(drive, past[k][0], steep), last)))
        return tuple(found)


def _longer(scope: Scope) -> tuple[Expression, Expression]:
    """Lengths of the tubes to both chambers over their geometric mean."""
    ratio = ca.sqrt(scope.p.lengths_line)
    return ratio, 1.0 / ratio


def _through(scope: Scope, above_1: Expression, above_2: Expression) -> tuple[Expression, Expression]:
    """What valve and tube in series let through towards both chambers, as a share of the flow through the fully open valve.

    above_1, above_2 : Pa by which the pressures at the valve's ports are more than the chambers' as the air is sped up.
    """
    signed = scope.opening_1 - scope.opening_2
    port_1, port_2 = (ca.fmax(p + above, _LEAST) for p, above in ((scope.p1, above_1), (scope.p2, above_2)))
    (flow_1, flow_2), (longer_1, longer_2) = scope.valve_flows(port_1, port_2), _longer(scope)
    share_1, share_2 = _share(signed, port_1, longer_1, scope), _share(-signed, port_2, longer_2, scope)
    return flow_1 * share_1 / scope.full_flow, flow_2 * share_2 / scope.full_flow


def _share(opening: Expression, p: Expression, longer: Expression, scope: Scope) -> Expression:
    """Share of its flow that the edge into (``opening`` > 0) or out of a port at ``p`` keeps, before a tube so much longer."""
    R, b = longer * scope.p.r_line * opening * opening, scope.b
    return ca.if_else(opening > 0.0, share_filling(R, p, scope.psup, b), share_venting(R, p, scope.rig.patm, b))
