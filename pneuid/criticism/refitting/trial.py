"""One fitted model on the held-out runs, its errors in units of what noise alone would leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pneuid.ahead import in_turn
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import Prediction, predict, rmse, typical
from pneuid.criticism.prediction.noise_floor import NoiseFloor, noise_floors
from pneuid.criticism.prediction.unseen import unseen
from pneuid.criticism.prediction.unsettled import unsettled
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run

ADEQUATE_EXCESS = 0.15
"""Held-out excess, relative to the squared noise floor, that counts as none whatever the noise: an error of 1.07 floors."""

BETTER = 0.8
"""Error of a trial, relative to the standing model's, from which its noise floor is measured anew."""


@dataclass(frozen=True)
class Trial:
    """One fitted model on the held-out runs.

    error : weighted typical error that decides, squared, 1 = noise only; whole : the same of all windows, as reported;
    train, hold_out : rmse per signal, SI; usual, usual_train : typical error per signal of held-out and training runs, SI.
    """

    fit: Fit
    error: float
    whole: float
    train: dict[str, float]
    hold_out: dict[str, float]
    usual: dict[str, float]
    usual_train: dict[str, float]
    added: str | None = None


@dataclass(frozen=True)
class Judge:
    """Held-out runs and the noise floor that errors are measured by."""

    held: tuple[Run, ...]
    floor: NoiseFloor
    usual: NoiseFloor

    def trial(self, found: Fit, added: str | None = None) -> Trial:
        """Predict the held-out runs and the training runs by a fit, to which the effect ``added`` was added last."""
        model = Frozen.of(found)
        each = in_turn([partial(predict, model, runs) for runs in (self.held, found.runs)], (*self.held, *found.runs))
        return self._trial(found, next(each), next(each), added)

    def across(self, found: Fit, others: Sequence[Fit], added: str | None = None) -> Trial:
        """The same of a fit to all runs, each held-out run predicted by that one of ``others`` which was not fitted to it."""
        ahead = [one for fit, run in zip(others, self.held, strict=True) for one in predict(Frozen.of(fit), [run])]
        return self._trial(found, ahead, predict(Frozen.of(found), found.runs), added)

    def unseen(self, trial: Trial) -> float:
        """The trial's error where a bench's held-out runs tell nothing of states that they do not forget."""
        if trial.fit.plant.servo or not trial.fit.plant.effect_states:
            return trial.error
        return _weighted(typical(unseen(trial.fit, self.held), trial.fit.plant.outputs), self.usual)

    def _trial(
        self, found: Fit, ahead: Sequence[Prediction], again: Sequence[Prediction], added: str | None
    ) -> Trial:
        on_held, usual = rmse(ahead, found.plant.outputs), typical(ahead, found.plant.outputs)
        on_train, usual_train = rmse(again, found.plant.outputs), typical(again, found.plant.outputs)
        errors = _weighted(usual, self.usual), _weighted(on_held, self.floor)
        return Trial(found, *errors, on_train, on_held, usual, usual_train, added)

    @property
    def spread(self) -> float:
        """1-sigma of the weighted typical error from noise alone, relative to 1."""
        ratios = [self.usual.spread[name] / self.usual.value[name] for name in self.usual.value]
        return float(2.0 * np.sqrt(np.mean(np.square(ratios))))

    @property
    def small(self) -> float:
        """Excess over the noise floor that counts as none."""
        return max(ADEQUATE_EXCESS, 4 * self.spread)

    def fits(self, trial: Trial) -> float:
        """Squared error on the training runs in the floors of the held-out ones."""
        return _weighted(trial.train, self.floor)

    def usually_fits(self, trial: Trial) -> float:
        """The same of typical errors: of two ends of one model the one with the smaller is the better one.

        A few windows in which the piston breaks away, or not, decide the error of all: of 24 ends with a mounting's compliance
        the one that was best by that left 1.5 floors of the held-out error, the best by this 1.14, the best there was 1.09.
        """
        return _weighted(trial.usual_train, self.usual)

    def learned(self, trial: Trial) -> bool:
        """Whether noise is enough to explain the trial's error on the training runs."""
        return self.fits(trial) - 1.0 < self.small

    def explains(self, trial: Trial) -> bool:
        """Whether noise, and what the fit leaves open of its parameters, are enough to explain the trial's error."""
        excess = trial.error - 1.0
        return excess < self.small or excess < self.small + unsettled(trial.fit, self.held, self.usual)

    def explains_across(self, trial: Trial, others: Sequence[Fit]) -> bool:
        """The same of a trial ``across`` its ``others``, which leave more open than the fit to all runs."""
        if trial.error - 1.0 < self.small:
            return True
        opened = [unsettled(fit, (run,), self.usual) for fit, run in zip(others, self.held, strict=True)]
        return bool(trial.error - 1.0 < self.small + np.mean(opened))

    def again(self, best: Trial, standing: Trial) -> Judge:
        """The judge by the floor of the best model so far: a poor model's own floor is too high."""
        if best.error >= BETTER * standing.error:
            return self
        floors = noise_floors(Frozen.of(best.fit), self.held, (rmse, typical))
        floor, usual = (
            NoiseFloor({name: min(value, before.value[name]) for name, value in found.value.items()}, found.spread)
            for found, before in zip(floors, (self.floor, self.usual), strict=True)
        )
        return Judge(self.held, floor, usual)

    def judged(self, trial: Trial) -> Trial:
        """The trial in units of this judge's floors."""
        return replace(trial, error=_weighted(trial.usual, self.usual), whole=_weighted(trial.hold_out, self.floor))


def judge_of(model: Fit, held: Sequence[Run]) -> Judge:
    """The judge by the floors of ``model``."""
    return Judge(tuple(held), *noise_floors(Frozen.of(model), held, (rmse, typical)))


def _weighted(errors: dict[str, float], floor: NoiseFloor) -> float:
    """Mean over the signals of squared errors in noise floors; infinite where one diverges."""
    error = float(np.mean([(errors[name] / floor.value[name]) ** 2 for name in errors]))
    return error if np.isfinite(error) else np.inf
