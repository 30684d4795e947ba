"""The fitted plant with a few candidates more, all of them off, and batches of candidates that share such a plant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from pneuid.criticism.screening.fitted import Fitted
from pneuid.effect import Effect, Parameter
from pneuid.estimation.settled import starting_states
from pneuid.interval import trajectory_function
from pneuid.mapped import Mapped
from pneuid.plant import Plant

BATCH_COLUMNS, BATCH_STATES = 12, 4
"""Amplitudes and states of the effects that share one compiled plant."""


def batches(plant: Plant, chosen: Sequence[Effect]) -> Iterator[list[Effect]]:
    """The candidates in their order, a few amplitudes and states at a time."""
    batch: list[Effect] = []
    columns = states = 0
    for effect in chosen:
        own = len(amplitudes(plant, effect))
        if batch and (columns + own > BATCH_COLUMNS or states + len(effect.states) > BATCH_STATES):
            yield batch
            batch, columns, states = [], 0, 0
        batch.append(effect)
        columns, states = columns + own, states + len(effect.states)
    if batch:
        yield batch


def amplitudes(plant: Plant, effect: Effect) -> list[Parameter]:
    """Parameters that are zero while the effect is off; shapes mean nothing then."""
    return [item for item in effect.parameters(plant.rig, plant.law) if item.off is not None]


class Batch:
    """The fitted plant with some effects more, all of them off: how it responds when they are not."""

    def __init__(self, fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> None:
        self.fitted, self.chosen, self.plant = fitted, list(chosen), plant_with(fitted.fit.plant, chosen, order)
        self.amplitudes = [item for effect in chosen for item in amplitudes(self.plant, effect)]
        self.off = {item.name: float(item.off or 0.0) for item in self.amplitudes}
        self.values = self.plant.starts() | fitted.values | self.off
        self.nodes, *_ = self.followed([{}])
        self._run = fitted.runner(self.plant)
        self.before = fitted.response(self._run, self.plant, self.nodes, self.values)

    def of(self, effect: Effect) -> list[Parameter]:
        """The amplitudes of one effect."""
        own = self.plant.own_parameters(effect.name)
        return [item for item in self.amplitudes if item.name in own]

    def followed(self, moved: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """Nodes ``(ns, nint)`` with the effects' own states as they come out with each of the values ``moved``."""
        return _rolled_out(self.fitted, self.plant, [self.values | dict(one) for one in moved])

    def change(self, moved: Mapping[str, float], nodes: np.ndarray) -> np.ndarray:
        """Change of the stacked residuals when some values (SI) are moved."""
        return self.fitted.response(self._run, self.plant, nodes, self.values | dict(moved)) - self.before


def plant_with(plant: Plant, effects: Sequence[Effect], order: Sequence[str]) -> Plant:
    """``plant`` with the effects beside its own, in the catalogue's ``order`` of names."""
    return Plant(plant.rig, plant.law.name, in_order([*plant.effects, *effects], order))


def in_order(effects: Iterable[Effect], order: Sequence[str]) -> list[Effect]:
    """The effects in the catalogue's ``order`` of names, those that it does not hold last."""
    position = {name: i for i, name in enumerate(order)}
    return sorted(effects, key=lambda effect: position.get(effect.name, len(position)))


def _rolled_out(fitted: Fitted, plant: Plant, values: Sequence[dict[str, float]]) -> list[np.ndarray]:
    """Nodes of ``plant`` with each of some ``values``: the fitted states, and the candidates' own filled in by following the
    fitted trajectory."""
    problem, many = fitted.fit.problem, len(values)
    nodes = np.zeros((len(plant.states), many, problem.nint))
    for name, row in zip(problem.plant.states, fitted.nodes, strict=True):
        nodes[plant.states.index(name)] = row
    fresh = [i for i, name in enumerate(plant.states) if name not in problem.plant.states]
    if not fresh or not many:
        return list(nodes.transpose(1, 0, 2))
    counts = np.diff(problem.first)
    step = Mapped(trajectory_function(plant, problem.samples, problem.substeps), many * counts.size)
    theta = np.stack([problem.theta_of(one, plant) for one in values], axis=1)
    data = problem.data.reshape(problem.data.shape[0], problem.nint, -1)
    first, inputs = problem.first[:-1], data[1 : 1 + len(plant.inputs), problem.first[:-1], 0]
    starts = [starting_states(plant, nodes[:, j, first], inputs, theta[:, j, first]) for j in range(many)]
    own = np.stack(starts, axis=1)[np.array(fresh) - len(plant.states)]
    for k in range(counts.max()):
        # all runs with all values at once; a run that has ended stays at its last interval
        at = problem.first[:-1] + np.minimum(k, counts - 1)
        nodes[np.ix_(fresh, range(many), at)] = own
        measured = np.tile(data[:, at], (1, many, 1)).reshape(data.shape[0], -1)
        _, states = step(nodes[:, :, at].reshape(len(nodes), -1), measured, theta[:, :, at].reshape(len(theta), -1))
        ended = states[fresh, problem.samples :: problem.samples + 1].reshape(own.shape)
        own = np.where(k + 1 < counts, ended, own)
    return list(nodes.transpose(1, 0, 2))
