"""The models that a study makes its controllers from: the rig's own numbers, or fits to noisy recordings of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from controllers.conditions import Played
from controllers.grid import Candidate
from controllers.measure import measured_runs
from controllers.nominal import nominal_model
from controllers.registry import CONTROLLERS
from controllers.scenario import Recordings, Scenario
from pneuid import api
from pneuid.model import Model, load
from pneuid.pool import Pool
from pneuid.store import Store, key_of
from pneuid.virtual_rig.hidden import Hidden
from pneuid.virtual_rig.sensors import Sensors
from pneuid.virtual_rig.truth import TruthServo

AWARE, CONSTANT = "pressure laws", "constant friction"
WITH, WITHOUT = "with ", "without "

Plan = tuple[tuple[str, float], ...]

EVERY_PRESSURE: Plan = (("slow", 3.0), ("multisine", 3.0), ("slow", 7.0), ("multisine", 7.0))
"""Recordings that pressure laws can be identified from: excitation and supply in bar gauge, none at the design's 5."""

ONE_PRESSURE: Plan = (("slow", 5.0), ("multisine", 5.0), ("slow", 5.0), ("steps", 5.0))
"""Recordings at the design supply, which is where someone who knows of no pressure laws finds his constants."""


def compensating() -> tuple[str, ...]:
    """Controllers that use the model's friction: only they differ between two models of it."""
    return tuple(name for name, entry in CONTROLLERS.items() if entry.compensates)


@dataclass(frozen=True)
class Identification:
    """A model to be identified: the rig that is measured, what is recorded and which effects are fitted."""

    label: str
    truth: TruthServo
    hidden: Hidden
    sensors: Sensors
    training: Plan
    recordings: Recordings
    add: tuple[str, ...]


def identified(task: Identification) -> Model:
    """Record the virtual rig and fit the model."""
    runs = measured_runs(
        task.truth, task.hidden, task.recordings.seed, task.recordings.duration, training=task.training, held_out=(),
        sensors=task.sensors,
    )  # fmt: skip
    return api.fit(runs.rig, runs.train, add=task.add, name=task.label).content


def identifications(scenario: Scenario, truth: TruthServo, hidden: Hidden) -> Iterator[Identification]:
    """What a scenario with identified models fits: friction with and without pressure laws, or, for a price list, a
    model with and without each effect."""
    sensors = scenario.sensors
    if not scenario.prices:
        plans: tuple[tuple[str, Plan, tuple[str, ...]], ...] = (
            (AWARE, EVERY_PRESSURE, ("friction_pressure",)),
            (CONSTANT, ONE_PRESSURE, ()),
        )
        for label, training, add in plans:
            yield Identification(label, truth, hidden, sensors, training, scenario.recordings, add)
    for price in scenario.prices:
        rig = Played(truth, hidden, sensors).under(price.condition)
        for words, add in ((WITH, (price.effect,)), (WITHOUT, ())):
            label = words + price.effect
            yield Identification(label, rig.truth, rig.hidden, sensors, EVERY_PRESSURE, scenario.recordings, add)


def built_in(truth: TruthServo, design_supply: float) -> list[Candidate]:
    """The rig's own model, and beside it, where its friction follows the pressures, the one with constant friction."""
    plant, theta = nominal_model(truth)
    if not plant.effects:
        return [Candidate("exact", plant, theta)]
    constant = nominal_model(truth, frozen_at=design_supply)
    return [Candidate(AWARE, plant, theta), Candidate(CONSTANT, *constant, controllers=compensating())]


def candidates_of(
    scenario: Scenario, truth: TruthServo, hidden: Hidden, pool: Pool, store: Store, folder: Path | None = None,
    told: Callable[[str], None] = lambda _: None,
) -> list[Candidate]:  # fmt: skip
    """The candidates of a scenario; identified models are saved into ``folder``/models and taken from there again."""
    if scenario.models == "known":
        return built_in(truth, scenario.design.supply)
    tasks = list(identifications(scenario, truth, hidden))
    paths = {task.label: (folder or Path()) / "models" / f"{task.label.replace(' ', '_')}.json" for task in tasks}
    models: dict[str, Model] = {}
    for task in tasks:
        if folder is not None and key_of(task) in store and paths[task.label].exists():
            models[task.label] = load(paths[task.label])
    missing = [task for task in tasks if task.label not in models]
    for place, model in pool.each(identified, missing):
        task = missing[place]
        models[task.label] = model
        told(f"identified a model {task.label}: {model.fit.stage}")
        if folder is not None:
            paths[task.label].parent.mkdir(exist_ok=True)
            model.save(paths[task.label])
            store.put(key_of(task), str(paths[task.label].name))
    return [_candidate(task, models[task.label]) for task in tasks]


def _candidate(task: Identification, model: Model) -> Candidate:
    found = Candidate(task.label, model.plant, model.theta())
    if task.label == CONSTANT:
        return replace(found, controllers=compensating())
    for words in (WITH, WITHOUT):
        if task.label.startswith(words):
            return replace(found, conditions=(task.label.removeprefix(words),))
    return found
