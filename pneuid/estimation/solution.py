"""A relaxed fit as plain numbers, which another process or a file can hold, and the fit rebuilt from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np

from pneuid.estimation.fit import Fit, result_of
from pneuid.estimation.own import declared
from pneuid.estimation.preparation import Run
from pneuid.estimation.shooting import Shooting, relaxed_smoothing
from pneuid.estimation.simulated import Simulated
from pneuid.estimation.solver import Outcome
from pneuid.estimation.stages import End, Relaxed
from pneuid.plant import Plant

_MAY_DIVERGE = ("cost", "penalty", "level", "loose_cost")
"""Numbers that a diverged fit leaves infinite or undefined, as well as its variables."""

@dataclass(frozen=True)
class Solution:
    """What a relaxed fit found.

    started : parameters (SI) that the problem was set up with; X : its variables; samples : per interval; simulated : of a
    bench, as in ``Simulated``; the rest as in ``Outcome``, ``Relaxed`` and ``Shooting``.
    """

    law: str
    effects: tuple[str, ...]
    started: dict[str, float]
    ranges: dict[str, float]
    substeps: int
    samples: int
    relaxation: float
    X: tuple[float, ...]
    cost: float
    penalty: float
    status: str
    success: bool
    iterations: int
    seconds: float
    level: float
    loose_cost: float | None
    simulated: dict[str, Any] | None

    @classmethod
    def of(cls, fit: Fit) -> Self:
        """The numbers of a relaxed fit."""
        problem, soft = fit.problem, fit.relaxed
        return cls(
            fit.plant.law.name, tuple(effect.name for effect in fit.plant.effects), dict(problem.values), dict(fit.ranges),
            problem.substeps, problem.samples, problem.relaxation, tuple(soft.X.tolist()), soft.cost, soft.penalty, soft.status,
            soft.success, soft.iterations, soft.seconds, fit.defect_level, fit.loose,
            None if fit.simulated is None else asdict(fit.simulated),
        )  # fmt: skip

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """The reverse of ``to_dict``. Raises ``TypeError`` for other content."""
        numbers = {name: float(content[name]) for name in _MAY_DIVERGE if content[name] is not None}
        return cls(**{**content, **numbers, "effects": tuple(content["effects"]), "X": tuple(map(float, content["X"]))})

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, words and lists for JSON, which keeps every digit; what a diverged fit left as words (``nan``)."""
        content = asdict(self)
        return {**content, **{name: _plain(content[name]) for name in _MAY_DIVERGE}, "X": [_plain(x) for x in self.X]}

    def fit(self, plant: Plant, runs: Sequence[Run], noise: Mapping[str, float]) -> Fit:
        """The fit that has these numbers; ``plant`` and ``runs`` are those it was made with."""
        free = [item.name for item in declared(plant, [run.own for run in runs])]
        problem = Shooting(plant, tuple(runs), free, self.started, self.ranges, self.substeps, self.samples)
        problem.set_smoothing(relaxed_smoothing(plant))
        problem.relaxation = self.relaxation
        found = Outcome(
            np.array(self.X), self.cost, self.penalty, self.status, self.success, self.iterations, self.seconds
        )
        path = None if self.simulated is None else Simulated(**self.simulated)
        return result_of(End(problem, Relaxed(found, self.level, self.loose_cost)), dict(noise), self.seconds, path)


def _plain(number: float | None) -> float | str | None:
    """A number as JSON takes it: one that is not finite as a word."""
    return number if number is None or math.isfinite(number) else str(number)
