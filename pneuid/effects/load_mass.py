"""A moving mass other than the rig file says."""

from __future__ import annotations

from pneuid.effect import Effect, Expression, Parameter, Scope
from pneuid.physics.friction import FrictionLaw
from pneuid.rig import Rig

_SOURCE = (
    "Newton's second law; Swevers, Verdonck, De Schutter, IEEE Control Systems 27(5) (2007) 58 (payload identification)"
)


class LoadMass(Effect):
    """The nominal moving mass becomes a fitted parameter; what one run adds to it stays as the rig file says."""

    name = "load_mass"
    mechanism = "what moves is heavier or lighter than the rig file says"
    equation = "force"
    reference = _SOURCE
    experiment = "fast reversals: steps or a sine of high frequency"

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """The moving mass, off at the rig's own value."""
        m = rig.mass
        return (Parameter("mass", "m", "kg", 1e-2 * m, 1e2 * m, m, 0.3, _SOURCE, positive=True, off=m),)

    def mass(self, m: Expression, scope: Scope) -> Expression:
        """Shift the mass of every run by the difference to the nominal one."""
        return m + (scope.p.mass - scope.rig.mass_nominal)
