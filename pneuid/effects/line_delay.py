"""Tubes between valve and chambers."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.lag import Stage, two_lags
from pneuid.physics.tube import share_filling, share_venting
from pneuid.rig import Rig

_SOURCE = (
    "Richer, Hurmuzlu, J. Dyn. Syst. Meas. Control 122 (2000) 416, part 1, section on the connecting tubes (delay L/c)"
)

_SERIES = "ISO 6358-1:2013, eq. (1) and (2), with ISO 6358-3:2014 for components in series"

_SHORTEST = 1.0e-3
"""Time constant in s with which the delay is screened; below it the lag keeps its delay alone."""


class LineDelay(Effect):
    """The flow into a chamber follows the valve's behind two lags in a row of mean delay ``tau``, about ``L/c``.

    The second has the share ``h`` of it, and the first is driven on by ``f`` times the way that the second is behind it. A tube
    that is a resistance before a volume is a lag of first order, ``h = 0``. One whose wave comes late and unchanged is near to
    ``h = f = 1/2``, whose response has the delay and the spread in time of a pure one.
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
        """Delay of both tubes, 3 ms for each metre, its shape, and squared ratio of the valve's conductance to a tube's."""
        return (
            Parameter("tau_line", "τ_l", "s", 0.0, 0.2, 0.0, 3e-3, _SOURCE, off=0.0),
            Parameter("order_line", "h_l", "1", 0.0, 0.5, 0.2, 0.1, _SOURCE, prior=0.2),
            Parameter("swing_line", "f_l", "1", 0.0, 0.8, 0.1, 0.1, _SOURCE, prior=0.2),
            Parameter("r_line", "r_l", "1", 0.0, 25.0, 0.0, 0.1, _SERIES, off=0.0),
        )

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
        behind = (own.flow_between_1, own.flow_behind_1), (own.flow_between_2, own.flow_behind_2)
        return tuple(
            two_lags(through / scope.full_flow, past, p.tau_line, p.order_line, _SHORTEST, p.swing_line)
            for through, past in zip(_through(scope), behind, strict=True)
        )


def _through(scope: Scope) -> tuple[Expression, Expression]:
    """What valve and tube in series let through towards both chambers, kg/s."""
    signed = scope.opening_1 - scope.opening_2
    return scope.valve_flow_1 * _share(signed, scope.p1, scope), scope.valve_flow_2 * _share(-signed, scope.p2, scope)


def _share(opening: Expression, p: Expression, scope: Scope) -> Expression:
    """Share of its flow that the edge into (``opening`` > 0) or out of a chamber at ``p`` keeps."""
    R, rig = scope.p.r_line * opening * opening, scope.rig
    return ca.if_else(opening > 0.0, share_filling(R, p, scope.psup, rig.b), share_venting(R, p, rig.patm, rig.b))
