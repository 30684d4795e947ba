"""Refits of a model with an effect more or less, started so that they do not end worse than what they came from."""

from __future__ import annotations

from collections.abc import Sequence

from pneuid.effect import Effect
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.solver import Monitor
from pneuid.plant import Plant

ENOUGH, OVER = 0.8, 1.2
"""Share of the predicted gain that a warm refit must reach, and the cost over the predicted one that it may leave, before it is
believed without another start."""


def refit(
    base: Fit,
    effects: Sequence[Effect],
    start: dict[str, float],
    order: Sequence[str],
    monitor: Monitor | None,
    gain: float = 1.0,
    thorough: bool = True,
) -> Fit:
    """Fit the base model's effects plus ``effects``; ``start`` and ``gain`` (relative drop of the cost) as screened.

    First warm, from the base's values and nodes and half way to the screened values: what the base is linear in gets there
    in one step anyway, and beyond the linear range the whole way may overshoot into another minimum. Where that falls short
    of what screening predicts, again from the data's own guess, and on a bench always: there a base model that lacks
    something often ends with a friction from which no step leads back. The better one is kept.
    """
    position = {name: i for i, name in enumerate(order)}
    law, values = base.plant.law.name, {**base.values, **start}
    for step in (effect for effect in effects if effect.richer_law):
        law, values = str(step.richer_law), values | step.law_start(base.values, start, base.plant.rig)
    standing = [*base.plant.effects, *(effect for effect in effects if not effect.richer_law)]
    every = sorted(standing, key=lambda effect: position.get(effect.name, len(position)))
    plant = Plant(base.plant.rig, law, every)
    off = {item.name: item.off for item in plant.parameters if item.off is not None}
    halfway = {name: 0.5 * (value + off[name]) for name, value in start.items() if name in off}
    values = {name: value for name, value in values.items() if name in plant.parameter_names}
    recordings = [run.recording for run in base.runs]
    if law != base.plant.law.name:
        return fit(plant, recordings, values, base.noise, monitor, exact=False, prepared=base.runs)
    warm = _warm(base, plant, values | halfway, monitor)
    predicted = base.loose_cost * (1.0 - gain)
    enough = warm.loose_cost < base.loose_cost * (1.0 - ENOUGH * gain) and warm.loose_cost < OVER * predicted
    if plant.servo and (enough or not thorough):
        return warm
    effect_values = {name: value for name, value in values.items() if plant.owner[name] is not None}
    cold = fit(plant, recordings, effect_values, base.noise, monitor, exact=False, prepared=base.runs)
    return min(warm, cold, key=lambda found: found.loose_cost)


def _warm(base: Fit, plant: Plant, values: dict[str, float], monitor: Monitor | None) -> Fit:
    """Fit of ``plant`` from ``values`` and the base's nodes."""
    nodes = dict(zip(base.plant.states, base.problem.split(base.relaxed.X)[1], strict=True))
    known = {name: row for name, row in nodes.items() if name in plant.states}
    recordings = [run.recording for run in base.runs]
    return fit(plant, recordings, values, base.noise, monitor, exact=False, prepared=base.runs, nodes=known)


def without(base: Fit, name: str, monitor: Monitor | None) -> Fit:
    """Fit without one of the effects, warm from the values that remain."""
    plant = Plant(base.plant.rig, base.plant.law.name, [effect for effect in base.plant.effects if effect.name != name])
    return _warm(base, plant, {key: base.values[key] for key in plant.parameter_names}, monitor)
