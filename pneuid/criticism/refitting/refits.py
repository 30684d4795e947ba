"""Refits of a model with an effect more or less, started so that they do not end worse than what they came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import predict, typical
from pneuid.criticism.screening.batches import in_order
from pneuid.effect import Effect
from pneuid.estimation.first_guess import BREAK_AWAY, first_guess, motions
from pneuid.estimation.fit import Fit, comparable_costs, fit, near
from pneuid.estimation.preparation import Run
from pneuid.estimation.shooting import TIGHT
from pneuid.estimation.sliding import sliding_starts
from pneuid.estimation.solver import Monitor
from pneuid.estimation.task import begin_fit
from pneuid.plant import Plant

ENOUGH, OVER = 0.8, 1.2
"""Share of the predicted gain that a warm refit must reach, and the cost over the predicted one that it may leave, before it is
believed without another start."""

NEXT_TO_OFF = 0.02
"""Share of the way to the start values from which a refit begins again that ended dearer than what it came from: with the
effect next to off that model is within reach, and cannot be lost."""

HOPELESS = 3.0
"""Times the standing model's cost at which a refit with tight defects is not worth finer time steps. The right one of seven
effects beside models that loose ones carried ended at 0.2 to 1.1 times; of a pair three wrong ones at 4.5 to 7.3 times, each
solved up to three times over, for 20 to 40 s."""


@dataclass(frozen=True)
class Standing:
    """What a refit needs of the fit it starts from: parameters (SI), node states ``(nint,)`` by name, relaxed cost and whether
    its defects are ``tight``."""

    plant: Plant
    runs: tuple[Run, ...]
    values: Mapping[str, float]
    nodes: Mapping[str, np.ndarray]
    noise: Mapping[str, float]
    cost: float
    tight: bool

    @classmethod
    def of(cls, base: Fit) -> Standing:
        """The relaxed solution of ``base``, with its final parameters."""
        nodes = dict(zip(base.plant.states, base.problem.split(base.relaxed.X)[1], strict=True))
        tight = base.problem.relaxation == TIGHT
        return cls(base.plant, base.runs, base.values, nodes, base.noise, base.relaxed_cost, tight)


@dataclass(frozen=True)
class Asked:
    """An effect to add: start values (SI) and relative drop of the cost as screened; ``thorough``: on a bench a cold start too.

    way : share of the way from off to ``start`` from which the refit begins; anew : with break-away from the data's guess,
    for what the base model's break-away excuses now; cold : from the data's own guess alone.
    """

    effect: Effect
    start: Mapping[str, float]
    gain: float = 1.0
    thorough: bool = True
    way: float = 0.5
    anew: bool = False
    cold: bool = False


def refit(base: Standing, asked: Asked, order: Sequence[str], monitor: Monitor | None = None) -> Fit:
    """Fit the base model's effects plus the one asked for; ``order`` is that of maps at a shared port.

    From the base's values and nodes and ``asked.way`` to the start values: what the base is linear in gets there in one step
    anyway, and beyond the linear range the whole way may overshoot into another minimum. On a servo rig with tight defects at
    once; beside a base that only loose ones carry, with loose ones as well where that falls short of what screening predicts.
    What ends dearer than the base begins again next to off. On a bench, where a base model that lacks something often ends with
    a friction from which no step leads back, a ``thorough`` refit starts from the data's own guess as well, and another one
    where the first start falls short. The best one is kept.
    """
    plant, values = _plant_with(base, asked, order)
    if plant.law is not base.plant.law:
        return _fitted(base, plant, values, monitor)
    effect_values = {name: value for name, value in values.items() if plant.owner[name] is not None}
    if asked.cold:
        return _fitted(base, plant, effect_values, monitor)
    begun = _on_the_way(plant, values, asked.start, asked.way) | (_break_away(base) if asked.anew else {})
    next_to_off = _on_the_way(plant, values, asked.start, NEXT_TO_OFF)
    limit = base.cost * min(1.0 - ENOUGH * asked.gain, OVER * (1.0 - asked.gain))
    if plant.servo and not plant.law.static:
        found = _at_once(base, plant, begun, monitor)
        if asked.anew or (found.relaxed_cost < (base.cost if base.tight else limit)):
            return found
        if base.tight:
            return _cheapest(found, _at_once(base, plant, next_to_off, monitor))
        found = _cheapest(found, _warm(base, plant, begun, monitor))
    else:
        found = _warm(base, plant, begun, monitor)
    if not asked.anew and not _below(base.cost, found, base):
        found = _cheapest(found, _warm(base, plant, next_to_off, monitor))
    if plant.servo or (not asked.thorough and _below(limit, found, base)):
        return found
    return min(found, _fitted(base, plant, effect_values, monitor), key=_force_error)


def _on_the_way(plant: Plant, values: Mapping[str, float], start: Mapping[str, float], way: float) -> dict[str, float]:
    """``values`` (SI) with the effect's amplitudes that part of their way from off to their ``start``."""
    off = {item.name: item.off for item in plant.parameters if item.off is not None}
    moved = {name: off[name] + way * (value - off[name]) for name, value in start.items() if name in off}
    return {**values, **moved}


def _below(limit: float, found: Fit, base: Standing) -> bool:
    """Whether a refit costs less than ``limit``, with defects like the base's; loose ones never cost more than tight ones."""
    if base.tight and found.problem.relaxation != TIGHT:
        return False
    return found.relaxed_cost < limit or (not base.tight and found.loose_cost < limit)


def _cheapest(*ends: Fit) -> Fit:
    return ends[int(np.argmin(comparable_costs(*ends)))]


def _force_error(found: Fit) -> float:
    """Error of the simulated force over whole training runs, N, by which the ends of a bench's model are compared.

    There the motion is imposed, and continuity defects of an effect's own state may buy a lower cost.
    """
    return typical(predict(Frozen.of(found), found.runs), found.plant.outputs)["F"]


def begin_refit(base: Standing, asked: Asked, order: Sequence[str]) -> None:
    """Start compiling what ``refit`` will need."""
    begin_fit(_plant_with(base, asked, order)[0], base.runs)


def by_sliding(base: Standing, monitor: Monitor | None = None) -> list[Fit]:
    """The same model fitted from its own values, but friction from the laws of sliding read off the data; none where its
    break-away has no laws."""
    plant = base.plant
    friction = set(plant.law.fitted)
    friction.update(name for one in plant.effects if one.equation == "friction" for name in plant.own_parameters(one.name))
    starts = [
        {**base.values, **{name: value for name, value in start.items() if name in friction}}
        for start in sliding_starts(plant, base.runs)
    ]
    return [_fitted(base, plant, start, monitor) for start in starts]


def _break_away(base: Standing) -> dict[str, float]:
    """What the data first suggest for the parameters of break-away that the model has, SI."""
    guess = first_guess(base.plant, base.runs, motions(base.runs))
    return {name: guess[name] for name in BREAK_AWAY if name in base.values}


def led(base: Fit, there: Fit, asked: Asked, order: Sequence[str], monitor: Monitor | None = None) -> Fit:
    """Fit the base model's effects plus the one asked for, from the values of a fit ``there``: another effect's or the base.

    With tight defects at once, and nodes read anew.
    """
    standing = Standing.of(base)
    plant, values = _plant_with(standing, asked, order)
    known = {name: there.values[name] for name in values if name in there.values}
    return near(plant, base.runs, values | known, base.noise, monitor=monitor)


def moved(base: Fit, there: Fit, monitor: Monitor | None = None) -> Fit:
    """The same model from the values of a fit ``there`` of a larger one, with tight defects at once, and nodes read anew."""
    values = {name: there.values[name] for name in base.plant.parameter_names if name in there.values}
    return near(base.plant, base.runs, values, base.noise, monitor=monitor)


def without(base: Fit, name: str, monitor: Monitor | None = None) -> Fit:
    """Fit without one of the effects, warm from the values that remain; from an exact fit with tight defects at once as well.

    The nodes at hand are those of the relaxed fit, which may have ended elsewhere: a skew of the channels led a rig that lacks
    nothing to its exact fit and shrank to nothing there; without it loose defects ended at 75 floors, tight ones at 1.1.
    """
    plant = Plant(base.plant.rig, base.plant.law.name, [effect for effect in base.plant.effects if effect.name != name])
    values = {key: base.values[key] for key in plant.parameter_names}
    warm = _warm(Standing.of(base), plant, values, monitor)
    if base.exact is None:
        return warm
    tight = near(plant, base.runs, values, base.noise, monitor=monitor)
    loosely, tightly = comparable_costs(warm, tight)
    return tight if tightly < loosely else warm


def on_runs(base: Standing, runs: Sequence[Run], monitor: Monitor | None = None) -> Fit:
    """The same model fitted to other runs, from its own values."""
    return _fitted(replace(base, runs=tuple(runs)), base.plant, base.values, monitor)


def _plant_with(base: Standing, asked: Asked, order: Sequence[str]) -> tuple[Plant, dict[str, float]]:
    """The plant with the effect, or with the richer law that it stands for, and the values to start from."""
    law, values = base.plant.law.name, {**base.values, **asked.start}
    standing = list(base.plant.effects)
    if asked.effect.richer_law:
        law = str(asked.effect.richer_law)
        values |= asked.effect.law_start(base.values, asked.start, base.plant.rig)
    else:
        standing.append(asked.effect)
    plant = Plant(base.plant.rig, law, in_order(standing, order))
    return plant, {name: value for name, value in values.items() if name in plant.parameter_names}


def _at_once(base: Standing, plant: Plant, values: Mapping[str, float], monitor: Monitor | None) -> Fit:
    """Fit of ``plant`` with tight defects at once, from ``values`` and the base's nodes.

    Loose ones take up what the base follows already, a break-away above all, and may not come back to it.
    """
    return near(plant, base.runs, values, base.noise, _known(base, plant), monitor, HOPELESS * base.cost)


def _warm(base: Standing, plant: Plant, values: Mapping[str, float], monitor: Monitor | None) -> Fit:
    """Fit of ``plant`` from ``values`` and the base's nodes."""
    return _fitted(base, plant, values, monitor, _known(base, plant))


def _known(base: Standing, plant: Plant) -> dict[str, np.ndarray]:
    return {name: row for name, row in base.nodes.items() if name in plant.states}


def _fitted(
    base: Standing, plant: Plant, start: Mapping[str, float], monitor: Monitor | None,
    nodes: Mapping[str, np.ndarray] | None = None,
) -> Fit:  # fmt: skip
    """Relaxed fit of ``plant`` to the base's runs, which the base model has followed before."""
    recordings = [run.recording for run in base.runs]
    return fit(plant, recordings, start, base.noise, monitor, exact=False, prepared=base.runs, nodes=nodes, again=True)
