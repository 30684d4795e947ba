"""The catalogue of physical effects. The order is the order of the maps at a shared port, for everyone."""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.effect import Effect
from pneuid.effects._by_name import unknown_by_name
from pneuid.effects._laws import LawDahl, LawLugre, LawStribeck
from pneuid.effects.backlash import Backlash
from pneuid.effects.channel_skew import ChannelSkew
from pneuid.effects.dead_volume import DeadVolume
from pneuid.effects.end_cushion import EndCushion
from pneuid.effects.exhaust_restriction import ExhaustRestriction
from pneuid.effects.friction_direction import FrictionDirection
from pneuid.effects.friction_dwell import FrictionDwell
from pneuid.effects.friction_lag import FrictionLag
from pneuid.effects.friction_position import FrictionPosition
from pneuid.effects.friction_presliding_memory import FrictionPreslidingMemory
from pneuid.effects.friction_pressure import FrictionPressure
from pneuid.effects.friction_viscous_nonlinear import FrictionViscousNonlinear
from pneuid.effects.friction_warmup import FrictionWarmup
from pneuid.effects.gravity import Gravity
from pneuid.effects.heat_transfer import HeatTransfer
from pneuid.effects.inlet_mixing import InletMixing
from pneuid.effects.leakage_external_1 import LeakageExternal1
from pneuid.effects.leakage_external_2 import LeakageExternal2
from pneuid.effects.leakage_internal import LeakageInternal
from pneuid.effects.line_delay import LineDelay
from pneuid.effects.load_mass import LoadMass
from pneuid.effects.load_spring import LoadSpring
from pneuid.effects.mounting_compliance import MountingCompliance
from pneuid.effects.sensor_lag_f import SensorLagF
from pneuid.effects.sensor_lag_p1 import SensorLagP1
from pneuid.effects.sensor_lag_p2 import SensorLagP2
from pneuid.effects.sensor_offset_f import SensorOffsetF
from pneuid.effects.sensor_offset_p1 import SensorOffsetP1
from pneuid.effects.sensor_offset_p2 import SensorOffsetP2
from pneuid.effects.side_volume_1 import SideVolume1
from pneuid.effects.side_volume_2 import SideVolume2
from pneuid.effects.supply_droop import SupplyDroop
from pneuid.effects.valve_asymmetry import ValveAsymmetry
from pneuid.effects.valve_critical_ratio import ValveCriticalRatio
from pneuid.effects.valve_curve import ValveCurve
from pneuid.effects.valve_dead_zone import ValveDeadZone
from pneuid.effects.valve_flow_force import ValveFlowForce
from pneuid.effects.valve_hysteresis import ValveHysteresis
from pneuid.effects.valve_lag import ValveLag
from pneuid.effects.valve_null_leakage import ValveNullLeakage
from pneuid.effects.valve_offset import ValveOffset
from pneuid.errors import UserError
from pneuid.formats.rig_toml import nearest

_ORDER = (
    LoadMass(),
    ValveLag(),
    ValveHysteresis(),
    ValveOffset(),
    ValveFlowForce(),
    ValveDeadZone(),
    ValveCurve(),
    ValveAsymmetry(),
    ValveNullLeakage(),
    ExhaustRestriction(),
    ValveCriticalRatio(),
    SupplyDroop(),
    LineDelay(),
    EndCushion(),
    LeakageInternal(),
    LeakageExternal1(),
    LeakageExternal2(),
    SideVolume1(),
    SideVolume2(),
    DeadVolume(),
    HeatTransfer(),
    InletMixing(),
    FrictionPressure(),
    FrictionDirection(),
    FrictionPosition(),
    FrictionDwell(),
    FrictionViscousNonlinear(),
    FrictionWarmup(),
    FrictionLag(),
    FrictionPreslidingMemory(),
    Gravity(),
    LoadSpring(),
    Backlash(),
    MountingCompliance(),
    SensorLagP1(),
    SensorLagP2(),
    SensorLagF(),
    ChannelSkew(),
    SensorOffsetP1(),
    SensorOffsetP2(),
    SensorOffsetF(),
)

CATALOGUE: dict[str, Effect] = {effect.name: effect for effect in _ORDER}
"""Every effect by name, in port order."""

LAW_STEPS: dict[str, Effect] = {step.name: step for step in (LawStribeck(), LawDahl(), LawLugre())}
"""Steps to a richer friction law by name; added, they change the plant's law instead of standing in it."""


GROUPS = ("friction", "mechanics", "pneumatics", "valve", "sensor")
"""Groups of the catalogue, by what part of the drive they belong to."""


def group_of(effect: Effect) -> str:
    """The group of an effect: by its name where that says it, else by the equation it enters."""
    kind = effect.name.split("_")[0].split(":")[0]
    if kind in ("friction", "valve", "sensor"):
        return kind
    if effect.equation.startswith("sensor"):
        return "sensor"
    return {"friction": "friction", "force": "mechanics"}.get(effect.equation, "pneumatics")


def easily_confused(effect: Effect) -> tuple[str, ...]:
    """Names of what ordinary data confuse with a catalogue effect, whichever of the two names the other."""
    others = [other.name for other in CATALOGUE.values() if other is not effect and effect.resembles(other)]
    return (*others, *(name for name in effect.confused_with if name not in CATALOGUE))


def effects_by_name(names: Sequence[str], own: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """The named effects, each once: the catalogue's in its order, the user's ``own``, then splines and formulas as given.

    Raises ``UserError`` for a name that is in neither and says no function.
    """
    users = {effect.name: effect for effect in own}
    unknowns: dict[str, Effect] = {}
    for name in names:
        unknown = unknown_by_name(name)
        if unknown is not None:
            unknowns[unknown.name] = unknown
        elif name not in CATALOGUE and name not in users:
            near = nearest(name, [*CATALOGUE, *users])
            yours = f" or among your own ({', '.join(users)})" if users else ""
            raise UserError(f"effect '{name}' is not in the catalogue{yours}{near or ';'} python -m pneuid.effects lists it")
    chosen = [effect for effect in _ORDER if effect.name in names]
    return (*chosen, *(effect for effect in own if effect.name in names), *unknowns.values())
