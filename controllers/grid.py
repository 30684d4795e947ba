"""The closed loops of a study: controllers, models, conditions, supplies, references and seeds, and their results.

First every controller is tuned once per model, then the loops are run; both as tasks of a ``Pool``, both remembered in a
``Store``. A task is a pure function of its argument, so the numbers do not depend on who runs it.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from controllers import loop
from controllers.base import Controller
from controllers.conditions import Condition, Played
from controllers.control_model import ControlModel
from controllers.references import Reference
from controllers.registry import build
from controllers.scenario import Scenario
from controllers.tuning import Design
from pneuid.errors import ComputationError
from pneuid.plant import Plant
from pneuid.pool import InProcess, Pool
from pneuid.store import Store, key_of, numbers, plain
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.servo import ServoPlant
from pneuid.virtual_rig.truth import TruthServo


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model that controllers are made from: plant and theta, SI.

    label : names it in results; controllers : those made from it, None for all of the scenario; conditions : names of
    those it is played under, None for all.
    """

    label: str
    plant: Plant
    theta: np.ndarray
    controllers: tuple[str, ...] | None = None
    conditions: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Result:
    """One closed loop: which, and how good (metrics None where the rig's state diverged).

    supply : Pa absolute; gains : what the controller ran with; signature : hash of position and command, sample by sample,
    which tells whether two runs were the same to the last bit; run : the signals, of the loops that are drawn only.
    """

    model: str
    controller: str
    condition: str
    supply: float
    reference: str
    seed: int
    metrics: loop.Metrics | None
    gains: dict[str, float]
    signature: str
    run: loop.Run | None = field(repr=False)


@dataclass(frozen=True, eq=False)
class Variant:
    """A controller made from a model."""

    candidate: Candidate
    controller: str
    design: Design
    refined: bool

    @property
    def key(self) -> str:
        """Hash of all that decides the gains."""
        plant = self.candidate.plant
        structure = (plant.law.name, tuple(effect.name for effect in plant.effects), plant.theta_names)
        numbers_of = [float(value) for value in np.asarray(self.candidate.theta).ravel()]
        return key_of(structure, numbers_of, self.controller, self.design, self.refined)


@dataclass(frozen=True, eq=False)
class Batch:
    """The loops of one tuned controller on one rig, one per seed."""

    variant: Variant
    gains: dict[str, float]
    condition: Condition
    rig: Played
    supply: float
    reference: Reference
    seeds: tuple[int, ...]
    kept: bool

    @property
    def key(self) -> str:
        """Hash of all that decides the results."""
        rig = (self.rig.truth, self.rig.hidden, self.rig.sensors)
        return key_of(self.variant.key, self.gains, rig, self.supply, self.reference, self.seeds, self.kept)


_BUILT = threading.local()
"""Controllers of this thread by the key of their variant: each works in memory of its own and takes a second to build."""


def _built() -> dict[str, Controller]:
    return _BUILT.__dict__.setdefault("controllers", {})


def tuned(variant: Variant) -> dict[str, float]:
    """Gains of a variant, refined on its own model where the study asks for it."""
    model = ControlModel(variant.candidate.plant, variant.candidate.theta)
    # from the formulas' gains, never from those that a controller of this thread was left with
    controller = build(variant.controller, model, variant.design, variant.refined)
    _built()[variant.key] = controller
    return {name: float(value) for name, value in vars(controller.gains).items()}


def _with_gains(variant: Variant, gains: dict[str, float]) -> Controller:
    known, key = _built(), variant.key
    if key not in known:
        model = ControlModel(variant.candidate.plant, variant.candidate.theta)
        known[key] = build(variant.controller, model, variant.design, refined=False)
    known[key].retune(type(known[key].gains)(**gains))
    return known[key]


def played(batch: Batch) -> list[dict[str, Any]]:
    """Metrics, signature and, if kept, signals of the batch's loops, as the store holds them."""
    controller = _with_gains(batch.variant, batch.gains)
    plant = ServoPlant(batch.rig.truth, batch.rig.hidden, batch.rig.sensors)
    found: list[dict[str, Any]] = []
    for seed in batch.seeds:
        try:
            run = loop.run(controller, plant, batch.reference, batch.supply, seed)
        except ComputationError:
            # the rig itself diverged; the other loops still count
            found.append({"seed": seed, "metrics": None, "signature": "", "run": None})
            continue
        signature = hashlib.sha256(run.x.tobytes() + run.u.tobytes()).hexdigest()
        signals = {name: values.tolist() for name, values in vars(run).items()} if batch.kept else None
        found.append({"seed": seed, "metrics": plain(loop.metrics(run)), "signature": signature, "run": signals})
    return found


def run_study(
    scenario: Scenario,
    candidates: Sequence[Candidate],
    truth: TruthServo,
    hidden: Hidden = NOTHING,
    *,
    pool: Pool | None = None,
    store: Store | None = None,
    on_result: Callable[[int, int, str], None] | None = None,
) -> list[Result]:
    """Run every controller of the scenario, made from every candidate, on the virtual rig.

    pool : where, in this process when left out; store : what is known already and where new results go; on_result : told
    (loops done, loops in all, words). Results come in the order of candidates, controllers, conditions, supplies,
    references, seeds, whoever computed them.
    """
    pool, store = pool or InProcess(), store or Store()
    told = on_result or (lambda _done, _all, _words: None)
    variants = list(variants_of(scenario, candidates))
    total = sum(len(conditions_of(scenario, v.candidate)) for v in variants) * _each(scenario)
    told(0, total, f"tuning {len(variants)} controllers")
    gains = _tuned_all(variants, pool, store, lambda words: told(0, total, words))
    batches = [
        batch
        for variant, own in zip(variants, gains, strict=True)
        for batch in batches_of(scenario, variant, own, Played(truth, hidden, scenario.sensors))
    ]
    missing = [batch for batch in batches if batch.key not in store]
    done = sum(len(batch.seeds) for batch in batches) - sum(len(batch.seeds) for batch in missing)
    told(done, total, f"{done} of {total} loops were known")
    for place, content in pool.each(played, missing):
        batch = missing[place]
        store.put(batch.key, content)
        done += len(batch.seeds)
        told(done, total, f"{batch.variant.controller}, {batch.condition.name}, {batch.reference.name}")
    return [result for batch in batches for result in _results(batch, store[batch.key])]


def variants_of(scenario: Scenario, candidates: Sequence[Candidate]) -> Iterator[Variant]:
    """Every controller with every model it is made from."""
    for candidate in candidates:
        for name in scenario.controllers:
            if candidate.controllers is None or name in candidate.controllers:
                yield Variant(candidate, name, scenario.design, scenario.refined)


def conditions_of(scenario: Scenario, candidate: Candidate) -> list[Condition]:
    """The conditions that controllers made from ``candidate`` are played under."""
    wanted = candidate.conditions
    return [own for own in scenario.conditions if wanted is None or own.name in wanted]


def _each(scenario: Scenario) -> int:
    return len(scenario.supplies) * len(scenario.references) * len(scenario.seeds)


def _tuned_all(
    variants: Sequence[Variant], pool: Pool, store: Store, told: Callable[[str], None]
) -> list[dict[str, float]]:
    """Gains of all variants. The predictive controllers take longest and stand last, so they begin first."""
    missing = [variant for variant in reversed(variants) if variant.key not in store]
    for place, content in pool.each(tuned, missing):
        store.put(missing[place].key, content)
        told(f"tuned {missing[place].controller}, {missing[place].candidate.label}")
    return [store[variant.key] for variant in variants]


def batches_of(scenario: Scenario, variant: Variant, gains: dict[str, float], rig: Played) -> Iterator[Batch]:
    """The loops of one variant. Signals are kept of the first condition, the supply nearest the design's and the
    reference with the most jerk, for the overlay."""
    supply_drawn = min(scenario.supplies, key=lambda value: abs(value - scenario.design.supply))
    drawn = max(scenario.references, key=lambda own: float(np.sum(np.abs(own.over(1e-2)[:, 3]))))
    for condition in conditions_of(scenario, variant.candidate):
        here = rig.under(condition)
        for supply in scenario.supplies:
            for reference in scenario.references:
                kept = condition is scenario.conditions[0] and supply == supply_drawn and reference is drawn
                yield Batch(variant, gains, condition, here, supply, reference, scenario.seeds, kept)


def _results(batch: Batch, content: list[dict[str, Any]]) -> Iterator[Result]:
    variant = batch.variant
    for i, entry in enumerate(content):
        metrics = None if entry["metrics"] is None else loop.Metrics(**numbers(entry["metrics"]))
        signals = entry["run"] if i == 0 else None
        run = None if signals is None else loop.Run(**{name: np.array(own) for name, own in signals.items()})
        yield Result(
            variant.candidate.label, variant.controller, batch.condition.name, batch.supply, batch.reference.name,
            entry["seed"], metrics, batch.gains, entry["signature"], run,
        )  # fmt: skip
