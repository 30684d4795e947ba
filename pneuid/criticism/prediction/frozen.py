"""A model with its numbers: what prediction needs and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run
from pneuid.estimation.task import samples_of
from pneuid.interval import IntervalFunction, interval_function
from pneuid.plant import Plant


@dataclass(frozen=True)
class Frozen:
    """A model with its numbers: what prediction needs and nothing else (SI)."""

    plant: Plant
    values: Mapping[str, float]
    ranges: Mapping[str, float]
    noise: Mapping[str, float]
    substeps: int

    @classmethod
    def of(cls, found: Fit) -> Frozen:
        """The model of a fit."""
        return cls(found.plant, found.values, found.ranges, found.noise, found.substeps)

    def theta(self, run: Run) -> np.ndarray:
        """The theta column of one run."""
        mass, shift = run.own.constants(self.values)
        return self.plant.theta(self.values, self.ranges, mass, supply_shift=shift)

    def function(self, runs: Sequence[Run]) -> IntervalFunction:
        """The interval function of these runs' sample time, without derivatives."""
        return interval_function(self.plant, (), samples_of(runs), self.substeps)
