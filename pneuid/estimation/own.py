"""What a run has for itself: quantities that are fitted for one run alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pneuid.effect import Parameter
from pneuid.errors import UserError
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig

QUANTITIES = {"mass": "mass_run", "supply": "supply_shift"}
"""Quantities that may be free in one run, and the constant of the plant that carries each."""

_SOURCE = 'stated free for this run ("free" in rig.toml)'


@dataclass(frozen=True)
class Own:
    """Stated values of one run (kg; absolute Pa, None where the supply was measured) and which of them are fitted."""

    run: str
    mass: float
    supply: float | None
    free: tuple[str, ...]

    def constants(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Moving mass in kg and shift of the supply in Pa, fitted values of this run replacing the stated ones."""
        supply = self.supply or 0.0
        return values.get(key("mass", self.run), self.mass), values.get(key("supply", self.run), supply) - supply

    def parameters(self) -> tuple[Parameter, ...]:
        """Declarations of its free quantities."""
        found = []
        if "mass" in self.free:
            record = "fast reversals with this load"
            low, high = self.mass / 5, self.mass * 5
            named = key("mass", self.run)
            found.append(Parameter(named, "m", "kg", low, high, self.mass, 1.0, _SOURCE, True, experiment=record))
        if "supply" in self.free and self.supply is not None:
            low, high = 0.3 * self.supply, 2.0 * self.supply
            record = "large steps of the command at this supply, or its pressure recorded (psup)"
            named = key("supply", self.run)
            found.append(Parameter(named, "p_s", "Pa", low, high, self.supply, 1.0, _SOURCE, True, experiment=record))
        return tuple(found)


def key(quantity: str, run: str) -> str:
    """Name of a quantity of one run among the parameters of a fit."""
    return f"{quantity}@{run}"


def of_key(name: str) -> tuple[str, str | None]:
    """Quantity and run of a parameter's name; the run is None for what all runs share."""
    quantity, at, run = name.partition("@")
    return quantity, run if at else None


def own_of(rig: Rig, recording: Recording) -> Own:
    """What the rig file says of one run. Raises ``UserError`` for a free quantity that this run cannot have."""
    stated = rig.run(recording.name)
    servo, measured = rig.kind == "servo", "psup" in recording.recorded
    for quantity in stated.free:
        if quantity == "supply" and (measured or not servo):
            why = "is measured in this run" if measured else "does not exist on a bench"
            raise UserError(
                f'{rig.where}: runs."{recording.name}".free: the supply pressure {why}; remove it from the list'
            )
    supply = (rig.supply if stated.supply is None else stated.supply) if servo and not measured else None
    return Own(recording.name, rig.mass if stated.mass is None else stated.mass, supply, tuple(stated.free))


def declared(plant: Plant, owns: Sequence[Own]) -> tuple[Parameter, ...]:
    """The plant's parameters, then those of single runs, once each where several sections are of one run."""
    own = {parameter.name: parameter for one in owns for parameter in one.parameters()}
    return plant.parameters + tuple(own.values())
