"""Prediction errors as the user reads them: 200 ms ahead and free run.

Servo rigs: each window of 200 ms starts from a state estimated from the 100 ms before it, parameters frozen. Bench rigs:
the force over whole runs, the motion being imposed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.window_starts import (
    Starts,
    guessed,
    loose_prior,
    start_states,
    starts_of,
    stiffness,
    stretched,
)
from pneuid.errors import UserError
from pneuid.estimation.preparation import Run
from pneuid.interval import IntervalFunction
from pneuid.simulate import simulate

AHEAD_SECONDS = 0.2
TRIMMED = 0.1
"""Share of the windows, the worst, that the typical error leaves out."""

BEFORE_SECONDS = 0.1


@dataclass(frozen=True)
class Prediction:
    """Predicted outputs of one run beside the measured ones.

    predicted, measured : ``(ny, N)`` at the predicted samples; index ``(N,)`` of those samples in the run; start states
    are behind it. NaN where a window diverged.
    """

    run: Run
    index: np.ndarray
    predicted: np.ndarray
    measured: np.ndarray
    used: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Measured minus predicted ``(ny, N)``, NaN where masked."""
        return np.where(self.used, self.measured - self.predicted, np.nan)


def windows(run: Run, samples: int) -> tuple[int, int, np.ndarray]:
    """Samples before and ahead (multiples of the interval) and the first sample of every estimation stretch."""
    dt = float(np.median(run.data[0]))
    before = max(1, round(BEFORE_SECONDS / dt / samples)) * samples
    ahead = max(1, round(AHEAD_SECONDS / dt / samples)) * samples
    return before, ahead, np.arange(0, run.n - before - ahead + 1, ahead)


def used(run: Run, before: int, ahead: int, first: np.ndarray) -> np.ndarray:
    """``(ny, W * ahead)``: predicted samples that count, not those behind a contact with an end stop in their window."""
    window = first[:, None] + np.arange(before + ahead)
    struck = np.logical_or.accumulate(run.contact[window], axis=1)[:, before:].ravel()
    return (run.weights[:, window[:, before:].ravel()] > 0) & ~struck


def predict_ahead(model: Frozen, runs: Sequence[Run]) -> list[Prediction]:
    """Servo: 200 ms windows of every run (contract's ``rmse``)."""
    function = model.function(runs)
    return [ahead_of(model, function, run, run.data)[0] for run in runs]


def ahead_of(
    model: Frozen, function: IntervalFunction, run: Run, data: np.ndarray, start: Starts | None = None
) -> tuple[Prediction, Starts]:
    """The prediction of every window, and the start states it took: those given, else estimated ones."""
    plant = model.plant
    before, ahead, first = windows(run, function.samples)
    ny = len(plant.outputs)
    if first.size == 0:
        empty, none = np.zeros((ny, 0)), np.zeros((0, len(plant.states)))
        return Prediction(run, np.zeros(0, dtype=int), empty, empty, empty.astype(bool)), Starts(none, none)
    cut = np.stack([data[:, k : k + before + ahead] for k in first])
    theta = np.tile(model.theta(run), (first.size, 1))
    if start is None:
        start = starts_of(model, function, run, first, cut[:, :, :before], theta)
    found = simulate(function, start.states, cut, theta)
    index = (first[:, None] + before + np.arange(ahead)).ravel()
    predicted = found.outputs[:, :, before:].transpose(1, 0, 2).reshape(ny, -1)
    measured = data[-2 * ny : -ny][:, index]
    return Prediction(run, index, predicted, measured, used(run, before, ahead, first)), start


def predict_free(model: Frozen, runs: Sequence[Run]) -> list[Prediction]:
    """Whole runs from a start estimated on their first 100 ms, on a bench with an effect's states on all of the run
    (contract's ``free_run_rmse``; a bench's ``rmse``)."""
    function = model.function(runs)
    return [free_run(model, function, run, run.data)[0] for run in runs]


def free_run(
    model: Frozen, function: IntervalFunction, run: Run, data: np.ndarray, start: np.ndarray | None = None
) -> tuple[Prediction, np.ndarray]:
    """The prediction of a run, and the start state it took: the one given, else an estimated one."""
    _plant, K, ny = model.plant, function.samples, len(model.plant.outputs)
    missing = -run.n % K
    padded = np.concatenate([data, np.repeat(data[:, -1:], missing, axis=1)], axis=1)[None]
    before, _, _ = windows(run, K)
    theta = model.theta(run)[None]
    if start is None:
        head = padded[:, :, : min(before, padded.shape[2] // K * K)]
        start = start_states(model, function, guessed(model, run)[:1], head, theta, loose_prior(model))
        if not model.plant.servo and model.plant.effect_states:
            # what a seal remembers shows later; the motion is imposed, so no prediction ahead is won by it
            start = start_states(model, function, start, padded, theta, loose_prior(model))
    found = simulate(function, start, padded, theta)
    index = np.arange(run.n)
    return Prediction(run, index, found.outputs[0, :, : run.n], data[-2 * ny : -ny], data[-ny:] > 0), start


def predict(model: Frozen, runs: Sequence[Run]) -> list[Prediction]:
    """The prediction behind the contract's ``rmse``: 200 ms ahead on a servo rig, whole runs on a bench."""
    return predict_ahead(model, runs) if model.plant.servo else predict_free(model, runs)


def predict_apart(model: Frozen, runs: Sequence[Run], others: Iterable[Frozen]) -> Iterator[list[Prediction]]:
    """What models with other numbers predict beside what ``model`` predicts, both from its start states.

    A bristle starts with the same force, which the measurements tell, not with the same deflection. In each prediction
    ``measured`` is that of ``model``.
    """
    function, z = model.function(runs), model.plant.explicit_count
    one = ahead_of if model.plant.servo else free_run
    known: list[tuple[Prediction, Any]] = [one(model, function, run, run.data) for run in runs]
    for other in others:
        softer, found = stiffness(model) / stiffness(other), []
        for run, (here, start) in zip(runs, known, strict=True):
            found.append(replace(one(other, function, run, run.data, stretched(start, z, softer))[0], measured=here.predicted))
        yield found


def rmse(predictions: Sequence[Prediction], outputs: Sequence[str]) -> dict[str, float]:
    """Root mean square error per signal over all runs, SI. Raises ``UserError`` where nothing can be predicted."""
    found = {}
    for i, name in enumerate(outputs):
        errors = np.concatenate([p.measured[i][p.used[i]] - p.predicted[i][p.used[i]] for p in predictions])
        if errors.size == 0:
            raise UserError(
                f"{', '.join(item.run.name for item in predictions)}: no stretch to judge {name} by; "
                "record at least 0.4 s with valid samples"
            )
        # a window that diverged counts as an error of the signal's whole range
        span = float(np.ptp(np.concatenate([p.measured[i][p.used[i]] for p in predictions])))
        errors = np.where(np.isfinite(errors) & (np.abs(errors) < 10 * span), errors, 10 * span)
        found[name] = float(np.sqrt(np.mean(errors**2)))
    return found


def typical(predictions: Sequence[Prediction], outputs: Sequence[str]) -> dict[str, float]:
    """Root mean square error per signal over windows of 200 ms, the worst tenth of them left out, SI.

    A window in which the piston breaks away, or does not, within a hair of the limit is an error of millimetres for any model;
    a few of them outweigh all others in the plain mean. Trimmed mean: Huber, Robust Statistics (1981), section 3.3.
    """
    found = {}
    for i, name in enumerate(outputs):
        squares = []
        for item in predictions:
            dt = float(np.median(item.run.data[0]))
            block = np.arange(item.index.size) // max(1, round(AHEAD_SECONDS / dt))
            error = np.where(item.used[i], item.measured[i] - item.predicted[i], 0.0)
            with np.errstate(over="ignore", invalid="ignore"):
                total = np.bincount(block, weights=np.nan_to_num(error**2, nan=np.inf, posinf=np.inf))
            count = np.bincount(block, weights=item.used[i])
            squares.append((total / np.maximum(count, 1))[count > 0])
        ordered = np.sort(np.concatenate(squares)) if squares else np.zeros(0)
        if ordered.size == 0:
            raise UserError(f"no stretch to judge {name} by; record at least 0.4 s with valid samples")
        found[name] = float(np.sqrt(np.mean(ordered[: max(1, ordered.size - int(TRIMMED * ordered.size))])))
    return found
