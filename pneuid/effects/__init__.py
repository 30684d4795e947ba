"""The catalogue of physical effects. The order is the order of the maps at a shared port, for everyone."""

from __future__ import annotations

from pneuid.effect import Effect
from pneuid.effects.friction_direction import FrictionDirection
from pneuid.effects.friction_position import FrictionPosition
from pneuid.effects.friction_pressure import FrictionPressure
from pneuid.effects.gravity import Gravity
from pneuid.effects.leakage_internal import LeakageInternal
from pneuid.effects.load_mass import LoadMass
from pneuid.effects.supply_droop import SupplyDroop
from pneuid.effects.valve_dead_zone import ValveDeadZone
from pneuid.errors import UserError
from pneuid.formats.rig_toml import nearest

_ORDER = (
    LoadMass(),
    ValveDeadZone(),
    SupplyDroop(),
    LeakageInternal(),
    FrictionPressure(),
    FrictionDirection(),
    FrictionPosition(),
    Gravity(),
)

CATALOGUE: dict[str, Effect] = {effect.name: effect for effect in _ORDER}
"""Every effect by name, in port order."""


def effects_by_name(names: tuple[str, ...] | list[str]) -> tuple[Effect, ...]:
    """The named effects in catalogue order. Raises ``UserError`` for a name that is not in the catalogue."""
    for name in names:
        if name not in CATALOGUE:
            near = nearest(name, list(CATALOGUE))
            raise UserError(f"effect '{name}' is not in the catalogue{near or ';'} it holds {', '.join(CATALOGUE)}")
    return tuple(effect for effect in _ORDER if effect.name in names)
