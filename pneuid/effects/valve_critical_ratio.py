"""A critical pressure ratio other than the rig file says."""

from __future__ import annotations

import casadi as ca

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = "ISO 6358-1:2013, eq. (2) and clause 3 (critical back-pressure ratio b)"


class ValveCriticalRatio(Effect):
    """The critical pressure ratio ``b`` of the valve and its subsonic index ``m`` become fitted parameters.

    Another ratio alone cannot follow a valve whose flow falls off more or less steeply than the quarter ellipse, m = 0.5. The
    ratio may depend on the opening ``s``: ``b_rig + (b - b_rig) (1 + c (1 - 2 s))``, so that ``b`` is that at half of it.
    """

    name = "valve_critical_ratio"
    mechanism = "flow through the valve chokes at another pressure ratio than the rig file says"
    equation = "flow_1"
    reference = _SOURCE
    experiment = "steps of many sizes, with chambers near supply pressure and near atmosphere"
    confused_with = ("exhaust_restriction", "supply_droop")
    rigs = ("servo",)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The ratio, off at the rig's own value, spool valves have 0.15 to 0.5; the index, off at that of the ellipse."""
        b = rig.critical_ratio
        low, high = min(0.02, 0.5 * b), max(0.8, 0.5 * (1.0 + b))
        return (
            Parameter("critical_ratio", "b", "1", low, high, b, 0.05, _SOURCE, off=b),
            Parameter("subsonic_index", "m", "1", 0.4, 0.7, 0.5, 0.05, _SOURCE, off=0.5),
            Parameter("ratio_slope", "c", "1", -1.0, 1.0, 0.0, 0.1, _SOURCE, prior=0.4),
        )

    def critical_ratio(self, b: Expression, scope: Scope) -> Expression:
        """Shift the valve's ratio by the difference to the rig file's."""
        other, opened = scope.p.critical_ratio - scope.rig.b, scope.opening_1 + scope.opening_2
        return ca.fmin(ca.fmax(b + other * (1.0 + scope.p.ratio_slope * (1.0 - 2.0 * opened)), 0.01), 0.95)

    def subsonic_index(self, m: Expression, scope: Scope) -> Expression:
        """The exponent of its own."""
        return scope.p.subsonic_index
