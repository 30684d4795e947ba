"""A closed volume behind a restriction at chamber 1."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope, State
from pneuid.physics.chamber import through_throttle
from pneuid.physics.friction import FrictionLaw
from pneuid.physics.gas import R_AIR
from pneuid.rig import Rig

SOURCE = (
    "ISO 6358-2:2013 (a tank that fills and empties through a flow path); Doebelin, Measurement Systems (McGraw-Hill 2003), "
    "chapter 6 (a cavity behind a tube)"
)
"""What both side volumes stand on."""


class SideVolume1(Effect):
    """``mdot_1 -= V_s/(R T) (p1 - p_s)/tau(p1, p_s)``: what flows into a volume ``V_s`` at ``p_s`` is lost to the chamber.

    ``tau`` is stated at 4 bar. Behind a capillary (``m = 0``) the flow is in proportion to ``p1^2 - p_s^2``, behind an orifice
    (``m = 1``) to the root of the difference, so that it fills the slower the further it is behind. Without a restriction it is
    an unlisted dead volume. Typical: V_s 5 to 200 cm^3, tau 10 ms to 0.5 s.
    """

    name = "side_volume_1"
    mechanism = "a gauge line, a dead-end hose or an accumulator behind a throttle fills and empties from chamber 1 late"
    equation = "flow_1"
    reference = SOURCE
    experiment = "fast pressure steps in chamber 1 followed by dwells of a second with the valve closed"
    confused_with = ("dead_volume", "heat_transfer", "line_delay", "inlet_mixing")
    rigs = ("servo",)
    states = (State("side_gap_1", "Pa", 0.0, 2e4, 5e3),)

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The volume, its time constant at 4 bar, and whether it lies behind a capillary or an orifice."""
        V0 = rig.V01
        return (
            Parameter("V_side_1", "V_s1", "m^3", 0.0, 50 * V0, 0.0, V0, SOURCE, off=0.0),
            Parameter("tau_side_1", "τ_s1", "s", 5e-3, 3.0, 0.06, 1.0, SOURCE, positive=True, prior=1.0),
            Parameter("side_orifice_1", "m_s1", "1", 0.0, 1.0, 0.3, 0.3, SOURCE, prior=0.4),
        )

    def _rate(self, scope: Scope) -> Expression:
        return through_throttle(scope.p1, scope.state.side_gap_1, scope.p.tau_side_1, scope.p.side_orifice_1)

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Take what the side volume draws from the flow into the chamber."""
        drawn = scope.p.V_side_1 / (R_AIR * scope.rig.T) * self._rate(scope) * scope.state.side_gap_1
        return mdot1 - drawn, mdot2

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """The difference grows with the chamber's pressure and is filled through the restriction."""
        rate = self._rate(scope)
        return {"side_gap_1": (scope.p1_rate / rate, 1.0 / rate)}
