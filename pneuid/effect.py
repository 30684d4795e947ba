"""The contract of a physical effect: what one class in one file declares and implements.

The plant is evaluated in the fixed order that the physics gives. Each method of ``Effect`` below is a port: a map from
the value that stands there to the new value, the identity unless an effect overrides it. Off means exactly absent:
at the off-values every port returns what it was given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

from pneuid.physics.friction import Coefficients, FrictionLaw
from pneuid.physics.smoothing import Expression, Smoothing
from pneuid.rig import Rig

EQUATIONS = ("valve", "flow_1", "flow_2", "pressure_1", "pressure_2", "friction", "force")
"""Equations that an effect can enter; ``sensor_SIGNAL`` stands beside them."""


@dataclass(frozen=True)
class Parameter:
    """Declaration of one parameter.

    lower, upper : physical bounds, SI; start : where a fit begins; scale : typical size, SI (makes the search
    dimensionless); positive : searched on a logarithmic scale, ``scale`` and ``prior`` then count in e-folds; off : value
    at which its effect vanishes, None for a shape that means nothing while the amplitudes are off; prior : standard
    deviation around ``start`` of a weak prior, None for none (only where ordinary data leave a direction open).
    """

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    start: float
    scale: float
    source: str
    positive: bool = False
    off: float | None = None
    prior: float | None = None


@dataclass(frozen=True)
class State:
    """A state an effect brings. It relaxes towards a target: ``ds/dt = (target - s) / time_constant``.

    initial, spread : value and 1-sigma at the start of a run; scale : typical size. All in ``unit``.
    """

    name: str
    unit: str
    initial: float
    spread: float
    scale: float


@dataclass
class Scope:
    """What a port may look at: everything evaluated before it, absolute pressures, SI.

    rig : rig constants; p : the effect's own parameters; state : the effect's own states; the other fields are the
    plant's signals and are None until their stage has been evaluated. Pressure ranges are those of the data that the
    model was fitted on.
    """

    rig: SimpleNamespace
    smoothing: Smoothing
    p: SimpleNamespace
    state: SimpleNamespace
    x: Expression = None
    v: Expression = None
    p1: Expression = None
    p2: Expression = None
    z: Expression = None
    psup: Expression = None
    opening_1: Expression = None
    opening_2: Expression = None
    supply_flow: Expression = None
    """Mass flow drawn from the supply, kg/s."""
    full_flow: Expression = None
    """Choked flow from the nominal supply through the fully open valve, kg/s."""


@dataclass(frozen=True)
class Constraint:
    """``value >= 0`` must hold; keeps a law physical over the range of the data."""

    name: str
    value: Expression


class Effect:
    """One physical effect. Subclasses set the class attributes and override the ports they enter."""

    name: str
    mechanism: str
    """One sentence: what physically happens."""
    equation: str
    """The equation it enters, one of ``EQUATIONS`` or ``sensor_SIGNAL``."""
    reference: str
    """Source with equation number."""
    experiment: str
    """The recording that reveals it."""
    confused_with: tuple[str, ...] = ()
    rigs: tuple[str, ...] = ("servo", "bench")
    """Kinds of rig whose data can show it."""
    guarantees: tuple[str, ...] = ()
    """Promises checked by the contract suite: ``dissipative``, ``conserves mass``."""
    states: Sequence[State] = ()

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Declarations of its parameters on this rig."""
        raise NotImplementedError(self.name)

    def constraints(self, base: dict[str, Expression], scope: Scope) -> tuple[Constraint, ...]:
        """Inequalities among its parameters and the ``base`` ones that keep it physical."""
        return ()

    # --- ports, in the order in which the plant evaluates them ---

    def mass(self, m: Expression, scope: Scope) -> Expression:
        """Moving mass, kg."""
        return m

    def valve(self, opening: Expression, scope: Scope) -> Expression:
        """Signed relative opening, -1..1 before saturation."""
        return opening

    def supply(self, psup: Expression, scope: Scope) -> Expression:
        """Absolute pressure at the valve's supply port, Pa."""
        return psup

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Mass flows into the chambers, kg/s (``flow_1``, ``flow_2``)."""
        return mdot1, mdot2

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Friction coefficients at the operating point (``friction``)."""
        return k

    def friction(self, force: Expression, scope: Scope) -> Expression:
        """Friction force, N, against +v (``friction``)."""
        return force

    def force(self, force: Expression, scope: Scope) -> Expression:
        """Sum of the forces on the moving mass other than pressure and inertia, N, in +x (``force``)."""
        return force

    def sensor(self, signal: str, value: Expression, scope: Scope) -> Expression:
        """What the sensor of ``signal`` shows for the true ``value``."""
        return value

    def relaxations(self, scope: Scope) -> dict[str, tuple[Expression, Expression]]:
        """``state name -> (target, time constant in s)`` of its states, with every flow known."""
        return {}
