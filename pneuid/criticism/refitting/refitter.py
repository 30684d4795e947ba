"""Who makes the refits of a diagnosis: this process, several, or a cluster; none is made twice where a store keeps them."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from typing import Any

from pneuid.ahead import Ahead
from pneuid.criticism.refitting.refits import (
    Asked,
    Standing,
    begin_refit,
    by_sliding,
    led,
    moved,
    on_runs,
    refit,
    without,
)
from pneuid.effects import CATALOGUE, LAW_STEPS, effects_by_name
from pneuid.effects._own_file import own_effects
from pneuid.estimation.fit import Fit, completed, sharper
from pneuid.estimation.preparation import Run
from pneuid.estimation.solution import Solution
from pneuid.estimation.solver import Monitor
from pneuid.plant import Plant
from pneuid.pool import InProcess, Pool
from pneuid.rig import Rig
from pneuid.store import Store, key_of


@dataclass(frozen=True)
class _Task:
    """One refit, free of anything that another process could not hold: effects go by their names."""

    rig: Rig
    law: str
    present: tuple[str, ...]
    runs: tuple[Run, ...]
    values: Mapping[str, float]
    nodes: Mapping[str, Any]
    noise: Mapping[str, float]
    cost: float
    tight: bool
    effect: str
    start: Mapping[str, float]
    gain: float
    thorough: bool
    way: float
    anew: bool
    cold: bool
    order: tuple[str, ...]
    effect_files: tuple[str, ...]


def _made(task: _Task) -> dict[str, Any]:
    """The refit of a task, in a process of its own; side by side with others it takes one thread."""
    os.environ.setdefault("PNEUID_THREADS", "1")
    own = own_effects(task.effect_files, CATALOGUE | LAW_STEPS)
    plant = Plant(task.rig, task.law, effects_by_name(task.present, own))
    base = Standing(plant, task.runs, task.values, task.nodes, task.noise, task.cost, task.tight)
    effect = LAW_STEPS[task.effect] if task.effect in LAW_STEPS else effects_by_name([task.effect], own)[0]
    asked = Asked(effect, task.start, task.gain, task.thorough, task.way, task.anew, task.cold)
    return Solution.of(refit(base, asked, task.order)).to_dict()


@dataclass
class Refitter:
    """Makes refits.

    order : effect names in the order of maps at a shared port; monitor : told of iterations of fits in this process;
    effect_files : the user's own, read again by other processes; until : time by ``time.monotonic`` from which nothing more
    should be looked for.
    """

    order: Sequence[str]
    monitor: Monitor | None = None
    pool: Pool = field(default_factory=InProcess)
    store: Store = field(default_factory=Store)
    effect_files: Sequence[str] = ()
    until: float = math.inf
    _ended: dict[int, tuple[Fit, Fit]] = field(default_factory=dict)

    def late(self) -> bool:
        """Whether what was begun should be finished, and nothing more looked for."""
        return time.monotonic() > self.until

    def each(self, base: Fit, asked: Sequence[Asked]) -> Iterator[tuple[Asked, Callable[[], Fit]]]:
        """What is asked for, in its order, each with a function that makes its fit or waits for it.

        With several processes all of them are begun at once, and one that is not waited for is made in vain; in this one the
        first is made alone, and from the second in a row on as many as there are cores.
        """
        standing = Standing.of(base)
        keys = [self._key(standing, one) for one in asked]
        if isinstance(self.pool, InProcess):
            for one, make in zip(asked, self._made_here(base, standing, asked, keys), strict=True):
                yield one, make
            return
        missing = [i for i, key in enumerate(keys) if key not in self.store]
        tasks = [self._task(standing, asked[i]) for i in missing]
        coming = self.pool.each(_made, tasks)

        def wait(i: int) -> Fit:
            while keys[i] not in self.store:
                place, content = next(coming)
                self.store.put(keys[missing[place]], content)
            return self._rebuilt(base, asked[i], self.store[keys[i]])

        for i, one in enumerate(asked):
            yield one, partial(wait, i)

    def sharper(self, found: Fit) -> Fit:
        """The fit, or a cheaper one of the same model from fresh readings of break-away."""
        return sharper(found, self.monitor)

    def by_sliding(self, base: Fit) -> list[Fit]:
        """The same model from the laws of sliding friction, where its break-away has laws."""
        return by_sliding(Standing.of(base), self.monitor)

    def completed(self, found: Fit) -> Fit:
        """The fit followed to hard continuity, itself where that leads nowhere: that takes long, and is found out once."""
        if id(found) not in self._ended:
            self._ended[id(found)] = found, completed(found, self.monitor)
        return self._ended[id(found)][1]

    def led(self, base: Fit, there: Fit, asked: Asked) -> Fit:
        """The base model with what is asked for, from the values of a fit ``there``."""
        return led(base, there, asked, self.order, self.monitor)

    def moved(self, base: Fit, there: Fit) -> Fit:
        """The same model from the values of a larger one's fit ``there``."""
        return moved(base, there, self.monitor)

    def without(self, base: Fit, name: str) -> Fit:
        """The fit without one of the effects."""
        return without(base, name, self.monitor)

    def on(self, base: Fit, runs: Sequence[Run]) -> Fit:
        """The same model fitted to other runs."""
        return on_runs(Standing.of(base), runs, self.monitor)

    def _made_here(
        self, base: Fit, standing: Standing, asked: Sequence[Asked], keys: Sequence[str]
    ) -> list[Callable[[], Fit]]:
        """What makes the fits on this machine, while the next ones are begun, or compiled."""
        left = [i for i, key in enumerate(keys) if key not in self.store]
        jobs = [partial(self._solution, standing, asked[i]) for i in left]
        ahead = Ahead(jobs, coming=lambda place: begin_refit(standing, asked[left[place]], self.order))

        def wait(i: int) -> Fit:
            if keys[i] not in self.store:
                self.store.put(keys[i], ahead.result(left.index(i)))
            return self._rebuilt(base, asked[i], self.store[keys[i]])

        return [partial(wait, i) for i in range(len(asked))]

    def _solution(self, standing: Standing, asked: Asked) -> dict[str, Any]:
        """The refit that is asked for, as the store keeps it."""
        return Solution.of(refit(standing, asked, self.order, self.monitor)).to_dict()

    def _rebuilt(self, base: Fit, asked: Asked, content: Mapping[str, Any]) -> Fit:
        solution = Solution.from_dict(content)
        every = {effect.name: effect for effect in (*base.plant.effects, asked.effect)}
        plant = Plant(base.plant.rig, solution.law, [every[name] for name in solution.effects])
        return solution.fit(plant, base.runs, base.noise)

    def _task(self, base: Standing, asked: Asked) -> _Task:
        present = tuple(effect.name for effect in base.plant.effects)
        return _Task(
            base.plant.rig, base.plant.law.name, present, base.runs, dict(base.values), dict(base.nodes), dict(base.noise),
            base.cost, base.tight, asked.effect.name, dict(asked.start), asked.gain, asked.thorough, asked.way, asked.anew,
            asked.cold, tuple(self.order), tuple(map(str, self.effect_files)),
        )  # fmt: skip

    def _key(self, base: Standing, asked: Asked) -> str:
        """Hash of all that decides the fit: recordings, rig, what it starts from, and what is asked for."""
        plant = base.plant
        runs = tuple((run.recording.sha256, run.data.tobytes()) for run in base.runs)
        nodes = tuple((name, row.tobytes()) for name, row in base.nodes.items())
        effects = tuple((effect.name, repr(effect.origin)) for effect in (*plant.effects, asked.effect))
        return key_of(
            version("pneuid"), repr(plant.rig.raw), plant.law.name, effects, runs, sorted(base.values.items()), nodes,
            sorted(base.noise.items()), asked.start, asked.gain, asked.thorough, asked.way, asked.anew, asked.cold,
            tuple(self.order),
        )  # fmt: skip
