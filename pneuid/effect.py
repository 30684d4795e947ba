"""The contract of a physical effect: what one class in one file declares and implements.

The plant is evaluated in the fixed order that the physics gives. Each method of ``Effect`` below is a port: a map from
the value that stands there to the new value, the identity unless an effect overrides it. Off means exactly absent:
at the off-values every port returns what it was given.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from pneuid.physics.friction import LAWS, Coefficients, FrictionLaw
from pneuid.physics.smoothing import Expression, Smoothing
from pneuid.physics.valve import Edges
from pneuid.rig import Rig

EQUATIONS = ("valve", "flow_1", "flow_2", "pressure_1", "pressure_2", "friction", "force")
"""Equations that an effect can enter; ``sensor_SIGNAL`` stands beside them."""


PORTS = (
    "mass", "valve", "edges", "supply", "critical_ratio", "subsonic_index", "drawn", "flows", "volumes",
    "pressure_rates", "coefficients", "stribeck_speed", "friction", "force", "sensor",
)  # fmt: skip
"""Methods of ``Effect`` that are ports."""


@dataclass(frozen=True)
class Parameter:
    """Declaration of one parameter.

    lower, upper : physical bounds, SI; start : where a fit begins; scale : typical size, SI (makes the search
    dimensionless); positive : searched on a logarithmic scale, ``scale`` and ``prior`` then count in e-folds; off : value
    at which its effect vanishes, None for a shape that means nothing while the amplitudes are off; prior : standard
    deviation around ``start`` of a weak prior, None for none (only where ordinary data leave a direction open);
    experiment : the recording that determines it, empty where that of its effect does.
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
    experiment: str = ""

    @property
    def step_or_start(self) -> float:
        """Of an amplitude the distance from off by which the search counts, of a shape where its fit starts; in ``unit``."""
        if self.off is None:
            return self.start
        return self.off * math.expm1(self.scale) if self.positive else self.scale


@dataclass(frozen=True)
class State:
    """A state an effect brings. It relaxes towards a target: ``ds/dt = (target - s) / time_constant``.

    initial, spread : value and 1-sigma at the start of a run; scale : typical size. All in ``unit``. settled : a start that is
    guessed is the target instead of ``initial``, as a filter starts that has long followed its signal. clock : the time since
    the run began, which the piston at an end stop does not set back.
    """

    name: str
    unit: str
    initial: float
    spread: float
    scale: float
    settled: bool = False
    clock: bool = False


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
    t: Expression = None
    """Time since the run began, s, where the effect keeps a clock."""
    opening: Expression = None
    """Signed relative opening that stands at the effect's own ``valve`` port."""
    opening_1: Expression = None
    opening_2: Expression = None
    b: Expression = None
    """Critical pressure ratio of the valve's edges, as effects leave it."""
    supply_flow: Expression = None
    """Mass flow drawn from the supply, kg/s, as effects leave it once their flows are known."""
    full_flow: Expression = None
    """Choked flow from the nominal supply through the fully open valve, kg/s."""
    valve_flow_1: Expression = None
    """Mass flow through the valve towards chamber 1, kg/s."""
    valve_flow_2: Expression = None
    """Mass flow through the valve towards chamber 2, kg/s."""
    valve_flows: Any = None
    """Both, at other pressures (Pa, absolute) at the valve's ports than the chambers': a function of these two."""
    mdot1: Expression = None
    """Mass flow into chamber 1, kg/s."""
    mdot2: Expression = None
    """Mass flow into chamber 2, kg/s."""
    V1: Expression = None
    """Volume of chamber 1, m^3."""
    V2: Expression = None
    """Volume of chamber 2, m^3."""
    n: Expression = None
    """Polytropic exponent of the base model."""
    p1_rate: Expression = None
    """Rate of the pressure in chamber 1, Pa/s."""
    p2_rate: Expression = None
    """Rate of the pressure in chamber 2, Pa/s."""
    pressure_force: Expression = None
    """Net force of the measured pressures on the piston, N, in +x."""
    F: Expression = None
    """True driving force of a bench, N."""
    mass: Expression = None
    """Moving mass, kg."""
    Fc: Expression = None
    """Coulomb level of the friction, N, as effects leave it."""
    friction: Expression = None
    """Friction force, N, against +v."""
    acceleration: Expression = None
    """Acceleration of the piston, m/s^2, known to ``relaxations`` alone."""


@dataclass(frozen=True)
class Constraint:
    """``value >= 0`` must hold; keeps a law physical over the range of the data."""

    name: str
    value: Expression


@dataclass(frozen=True)
class EffectFile:
    """The file of a user's own effect: its name without folders, and the sha256 (hex) of its content."""

    file: str
    sha256: str


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
    contains: tuple[str, ...] = ()
    """Effects that this one turns into in a limit of its parameters."""
    constant: bool = False
    """Whether it is one number that is added: then it has no form, and what is left beside it is something else."""
    guarantees: tuple[str, ...] = ()
    """Promises checked by the contract suite: ``dissipative``, ``conserves mass``."""
    states: Sequence[State] = ()
    looks: Sequence[Mapping[str, float]] = ()
    """Shapes, SI by name, with which screening looks for it besides the usual ones: a resonance shows little of itself beside
    its frequency. Empty where one standard deviation to either side of each will do, and that only where it promises little."""
    laws: tuple[str, ...] = tuple(LAWS)
    """Friction laws that it can stand beside."""
    richer_law: str | None = None
    """Law that takes the place of a simpler one when this is added; its ports then serve screening alone."""
    origin: EffectFile | None = None
    """The user's file that it comes from, None for the catalogue's."""

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of the ports that it overrides."""
        return tuple(port for port in PORTS if getattr(type(self), port) is not getattr(Effect, port))

    def resembles(self, other: Effect) -> bool:
        """Whether one of the two names the other as what it is easily confused with."""
        return other.name in self.confused_with or self.name in other.confused_with

    def parameters(self, rig: Rig, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Declarations of its parameters on this rig."""
        raise NotImplementedError(self.name)

    def break_away(self, values: Mapping[str, float], ratio: float) -> dict[str, float]:
        """Own parameters, SI, with which static friction is ``ratio`` times Coulomb friction wherever this effect moves that.

        ``values`` : of all parameters, SI, laws of sliding friction included. A fit starts from there as well. Empty for an
        effect that gives break-away no law of its own.
        """
        return {}

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

    def critical_ratio(self, b: Expression, scope: Scope) -> Expression:
        """Critical pressure ratio of the valve's edges (``flow_1``)."""
        return b

    def subsonic_index(self, m: Expression, scope: Scope) -> Expression:
        """Exponent of the valve's flow function below choked flow, 0.5 for a quarter ellipse (``flow_1``)."""
        return m

    def edges(self, edges: Edges, scope: Scope) -> Edges:
        """Openings of the four metering edges, after saturation (``valve``)."""
        return edges

    def supply(self, psup: Expression, scope: Scope) -> Expression:
        """Absolute pressure at the valve's supply port, Pa."""
        return psup

    def drawn(self, supply_1: Expression, supply_2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Mass flows that the supply edges towards both chambers draw, kg/s."""
        return supply_1, supply_2

    def flows(self, mdot1: Expression, mdot2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Mass flows into the chambers, kg/s (``flow_1``, ``flow_2``)."""
        return mdot1, mdot2

    def volumes(self, V1: Expression, V2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Volumes of the chambers, m^3 (``pressure_1``, ``pressure_2``)."""
        return V1, V2

    def pressure_rates(self, rate1: Expression, rate2: Expression, scope: Scope) -> tuple[Expression, Expression]:
        """Rates of the chamber pressures, Pa/s, with flows and volumes known (``pressure_1``, ``pressure_2``)."""
        return rate1, rate2

    def coefficients(self, k: Coefficients, scope: Scope) -> Coefficients:
        """Friction coefficients at the operating point (``friction``)."""
        return k

    def stribeck_speed(self, v: Expression, scope: Scope) -> Expression:
        """Speed in m/s at which the Stribeck curve is read (``friction``)."""
        return v

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
        """``state name -> (target, time constant in s)`` of its states, with every flow and force known."""
        return {}

    def law_start(self, values: Mapping[str, float], amplitudes: Mapping[str, float], rig: Rig) -> dict[str, float]:
        """Values (SI) of the richer law's coefficients from the simple law's ``values`` and the screened amplitudes."""
        return {}


INTEGRATION_TIME = 0.01
"""Time constant in s that carries a state without one of its own. The step is second order whatever it is; relative to an
explicit midpoint step of ``h`` seconds the rate is off by ``0.21 (h / INTEGRATION_TIME)^2``."""


def integrated(state: Expression, rate: Expression) -> tuple[Expression, Expression]:
    """``(target, time constant)`` of a state with ``ds/dt = rate`` that does not relax, such as a deflection."""
    return state + INTEGRATION_TIME * rate, INTEGRATION_TIME
