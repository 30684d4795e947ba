"""Prediction errors as the user reads them: 200 ms ahead, free run, and what noise alone would give.

Servo rigs: each window of 200 ms starts from a state estimated from the 100 ms before it, parameters frozen. Bench rigs:
the force over whole runs, the motion being imposed. The noise floor is the same metric on data simulated from the
model itself with the sensors' noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pneuid.criticism.memory import carried
from pneuid.errors import UserError
from pneuid.estimation.first_guess import bristle, first_nodes, followed_effects
from pneuid.estimation.fit import Fit
from pneuid.estimation.motion import refined_motion
from pneuid.estimation.preparation import Run
from pneuid.estimation.task import node_every
from pneuid.interval import IntervalFunction, interval_function
from pneuid.plant import Plant
from pneuid.simulate import estimate_start, simulate

AHEAD_SECONDS = 0.2
TRIMMED = 0.1
"""Share of the windows, the worst, that the typical error leaves out."""

BEFORE_SECONDS = 0.1
FIRST_TRIES, LATER_TRIES = 20, 60
"""Iterations for a window's start, and for one that fits badly."""

OUTLYING = 1.25
"""Cost of a window over the median of its run above which other starts are tried."""

FLOOR_SEEDS = 3
"""Noise seeds over which the floor is averaged and its spread taken."""


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


def _function(model: Frozen, runs: Sequence[Run]) -> IntervalFunction:
    dt = float(np.median(np.concatenate([run.data[0] for run in runs])))
    return interval_function(model.plant, (), node_every(dt), model.substeps)


def _stiffness(model: Frozen) -> float:
    """Stiffness of the model's bristle, N/m."""
    if not model.plant.law.static:
        return float(model.values["sigma0"])
    theta = dict(zip(model.plant.theta_names, model.plant.theta(model.values, model.ranges), strict=True))
    return float(theta["carrier_stiffness"])


def _break_away(model: Frozen) -> float:
    """Bristle deflection in m at which the model breaks away: the scale of the bristle states that can occur."""
    return float(model.values.get("Fs", model.values["Fc"])) / _stiffness(model)


def _loose(model: Frozen) -> np.ndarray:
    """1-sigma ``(ns,)`` of a state of which nothing is known but what can occur; infinite where measurements tell it."""
    plant = model.plant
    prior = np.full(len(plant.states), np.inf)
    prior[plant.explicit_count] = _break_away(model)
    prior[plant.explicit_count + 1 :] = [state.spread for state in plant.effect_states]
    return prior


def _start_states(
    model: Frozen, function: IntervalFunction, guess: np.ndarray, data: np.ndarray, theta: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Start states ``(W, ns)`` of windows from their own measurements ``data`` (W, rows, N), parameters frozen; ``prior`` is
    the 1-sigma of the guess, ``(ns,)`` or ``(W, ns)``.

    A window that breaks away, or comes to rest, has several local optima in the bristle: windows that fit worse than
    the others of their run are tried again from rest with the bristle relaxed and near break-away on either side.
    """
    plant = model.plant
    z, spread, prior = plant.explicit_count, _break_away(model), np.broadcast_to(prior, guess.shape)
    best, cost = estimate_start(function, guess, data, theta, prior, plant.state_scales, FIRST_TRIES)
    poor = np.flatnonzero(~(cost < OUTLYING * np.median(cost)))
    if poor.size == 0:
        return best
    for deflection in (None, 0.0, 0.9, -0.9):
        again = guess[poor].copy()
        if plant.servo:
            again[:, plant.states.index("v")] = 0.0
        if deflection is not None:
            again[:, z] = deflection * spread
        tried, found = estimate_start(
            function, again, data[poor], theta[poor], prior[poor], plant.state_scales, LATER_TRIES
        )
        better = found < cost[poor]
        best[poor[better]], cost[poor[better]] = tried[better], found[better]
    return best


def _windows(run: Run, samples: int) -> tuple[int, int, np.ndarray]:
    """Samples before and ahead (multiples of the interval) and the first sample of every estimation stretch."""
    dt = float(np.median(run.data[0]))
    before = max(1, round(BEFORE_SECONDS / dt / samples)) * samples
    ahead = max(1, round(AHEAD_SECONDS / dt / samples)) * samples
    return before, ahead, np.arange(0, run.n - before - ahead + 1, ahead)


def _used(run: Run, before: int, ahead: int, first: np.ndarray) -> np.ndarray:
    """``(ny, W * ahead)``: predicted samples that count, not those behind a contact with an end stop in their window."""
    window = first[:, None] + np.arange(before + ahead)
    struck = np.logical_or.accumulate(run.contact[window], axis=1)[:, before:].ravel()
    return (run.weights[:, window[:, before:].ravel()] > 0) & ~struck


@dataclass(frozen=True)
class Starts:
    """Start states of windows ``(W, ns)``, and the 1-sigma ``(W, ns)`` of what was known of them before their own data."""

    states: np.ndarray
    prior: np.ndarray


def _starts(
    model: Frozen, function: IntervalFunction, run: Run, first: np.ndarray, data: np.ndarray, theta: np.ndarray
) -> Starts:
    """Start states of the windows that begin at the samples ``first``, slow effect states with what the windows before tell."""
    plant, loose = model.plant, _loose(model)
    guess, prior = _window_guess(model, run)[first], np.tile(loose, (first.size, 1))
    states = _start_states(model, function, guess, data, theta, prior)
    if not plant.effect_states:
        return Starts(states, prior)
    own, values = slice(plant.explicit_count + 1, None), dict(model.values)
    _, decay = followed_effects(plant, run, run.motion, bristle(plant, run, run.motion, values), values)
    forgotten = np.cumsum(decay * run.data[0], axis=1)[:, first].T
    guess[:, own], told = carried(states[:, own], guess[:, own], forgotten, loose[own])
    if np.array_equal(told, prior[:, own]):
        return Starts(states, prior)  # every state forgets from one window to the next
    prior[:, own] = told
    return Starts(_start_states(model, function, guess, data, theta, prior), prior)


def _window_guess(model: Frozen, run: Run) -> np.ndarray:
    """State guesses ``(N, ns)`` at every sample, from the measurements."""
    return first_nodes(model.plant, [run], [run.motion], dict(model.values), 1).T


def predict_ahead(model: Frozen, runs: Sequence[Run]) -> list[Prediction]:
    """Servo: 200 ms windows of every run (contract's ``rmse``)."""
    function = _function(model, runs)
    return [_ahead(model, function, run, run.data)[0] for run in runs]


def _ahead(
    model: Frozen, function: IntervalFunction, run: Run, data: np.ndarray, start: Starts | None = None
) -> tuple[Prediction, Starts]:
    """The prediction of every window, and the start states it took: those given, else estimated ones."""
    plant = model.plant
    before, ahead, first = _windows(run, function.samples)
    ny = len(plant.outputs)
    if first.size == 0:
        empty, none = np.zeros((ny, 0)), np.zeros((0, len(plant.states)))
        return Prediction(run, np.zeros(0, dtype=int), empty, empty, empty.astype(bool)), Starts(none, none)
    cut = np.stack([data[:, k : k + before + ahead] for k in first])
    theta = np.tile(model.theta(run), (first.size, 1))
    if start is None:
        start = _starts(model, function, run, first, cut[:, :, :before], theta)
    found = simulate(function, start.states, cut, theta)
    index = (first[:, None] + before + np.arange(ahead)).ravel()
    predicted = found.outputs[:, :, before:].transpose(1, 0, 2).reshape(ny, -1)
    measured = data[-2 * ny : -ny][:, index]
    return Prediction(run, index, predicted, measured, _used(run, before, ahead, first)), start


def predict_free(model: Frozen, runs: Sequence[Run]) -> list[Prediction]:
    """Whole runs from a start estimated on their first 100 ms, on a bench with an effect's states on all of the run
    (contract's ``free_run_rmse``; a bench's ``rmse``)."""
    function = _function(model, runs)
    return [_free(model, function, run, run.data)[0] for run in runs]


def _free(
    model: Frozen, function: IntervalFunction, run: Run, data: np.ndarray, start: np.ndarray | None = None
) -> tuple[Prediction, np.ndarray]:
    """The prediction of a run, and the start state it took: the one given, else an estimated one."""
    _plant, K, ny = model.plant, function.samples, len(model.plant.outputs)
    missing = -run.n % K
    padded = np.concatenate([data, np.repeat(data[:, -1:], missing, axis=1)], axis=1)[None]
    before, _, _ = _windows(run, K)
    theta = model.theta(run)[None]
    if start is None:
        head = padded[:, :, : min(before, padded.shape[2] // K * K)]
        start = _start_states(model, function, _window_guess(model, run)[:1], head, theta, _loose(model))
        if not model.plant.servo and model.plant.effect_states:
            # what a seal remembers shows later; the motion is imposed, so no prediction ahead is won by it
            start = _start_states(model, function, start, padded, theta, _loose(model))
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
    function, z = _function(model, runs), model.plant.explicit_count
    one = _ahead if model.plant.servo else _free
    known: list[tuple[Prediction, Any]] = [one(model, function, run, run.data) for run in runs]
    for other in others:
        softer, found = _stiffness(model) / _stiffness(other), []
        for run, (here, start) in zip(runs, known, strict=True):
            found.append(replace(one(other, function, run, run.data, _stretched(start, z, softer))[0], measured=here.predicted))
        yield found


def _stretched(start: Any, z: int, ratio: float) -> Any:
    """Start states with the bristle's deflection, state ``z``, times ``ratio``."""
    states = (start.states if isinstance(start, Starts) else start).copy()
    states[:, z] *= ratio
    return replace(start, states=states) if isinstance(start, Starts) else states


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


@dataclass(frozen=True)
class NoiseFloor:
    """Mean of a metric over noise seeds and the standard deviation between them, per signal, SI."""

    value: dict[str, float]
    spread: dict[str, float]


Metric = Callable[[Sequence[Prediction], Sequence[str]], dict[str, float]]


def noise_floor(model: Frozen, runs: Sequence[Run], seeds: int = FLOOR_SEEDS) -> NoiseFloor:
    """The metric of ``predict`` on data simulated from the model with the sensors' noise (seeds fixed)."""
    return noise_floors(model, runs, (rmse,), seeds)[0]


def noise_floors(
    model: Frozen, runs: Sequence[Run], metrics: Sequence[Metric], seeds: int = FLOOR_SEEDS
) -> list[NoiseFloor]:
    """Noise floors by several metrics of the same simulated data."""
    outputs = model.plant.outputs
    every: list[list[dict[str, float]]] = [[] for _ in metrics]
    draws = [_drawn(model, run) for run in runs]
    for seed in range(seeds):
        rng = np.random.default_rng([2011, seed])
        made = [draw(rng) for draw in draws]
        for found, metric in zip(every, metrics, strict=True):
            found.append(metric(made, outputs))
    return [_floor(found, outputs) for found in every]


def _floor(every: Sequence[dict[str, float]], outputs: Sequence[str]) -> NoiseFloor:
    seeds = len(every)
    return NoiseFloor(
        {name: float(np.mean([one[name] for one in every])) for name in outputs},
        {name: float(np.std([one[name] for one in every], ddof=1)) if seeds > 1 else 0.0 for name in outputs},
    )


Draw = Callable[[np.random.Generator], Prediction]
"""Prediction of one run simulated from the model itself, with noise drawn anew."""


def _drawn(model: Frozen, run: Run) -> Draw:
    function = _function(model, [run])
    return (_drawn_servo if model.plant.servo else _drawn_bench)(model, function, run)


def _drawn_servo(model: Frozen, function: IntervalFunction, run: Run) -> Draw:
    """Each window is simulated from its own estimated start, so that the operating points are those of the data."""
    plant, ny = model.plant, len(model.plant.outputs)
    before, ahead, first = _windows(run, function.samples)
    predicted, start = _ahead(model, function, run, run.data)
    if first.size == 0:
        return lambda _: predicted
    cut = np.stack([run.data[:, k : k + before + ahead] for k in first])
    theta = np.tile(model.theta(run), (first.size, 1))
    clean = simulate(function, start.states, cut, theta).outputs
    sigma = np.array([model.noise[name] for name in plant.outputs])[:, None]
    index, used = (first[:, None] + before + np.arange(ahead)).ravel(), _used(run, before, ahead, first)

    def draw(rng: np.random.Generator) -> Prediction:
        """Prediction of the windows where they are measured with noise of this generator."""
        noisy, data, guess = clean + sigma * rng.standard_normal(clean.shape), cut.copy(), start.states.copy()
        data[:, -2 * ny : -ny] = noisy
        for i, name in enumerate(plant.outputs):
            guess[:, plant.states.index(name)] = noisy[:, i, :5].mean(axis=1)
        again = _start_states(model, function, guess, data[:, :, :before], theta, start.prior)
        found = simulate(function, again, data, theta).outputs[:, :, before:]
        measured = noisy[:, :, before:].transpose(1, 0, 2).reshape(ny, -1)
        return Prediction(run, index, found.transpose(1, 0, 2).reshape(ny, -1), measured, used)

    return draw


def _drawn_bench(model: Frozen, function: IntervalFunction, run: Run) -> Draw:
    """Force of the model on its own smoothed motion, then the whole chain again on a noisy copy of that motion."""
    plant, ny, nw = model.plant, len(model.plant.outputs), len(model.plant.inputs)
    clean = _free(model, function, run, run.data)[0].predicted

    def draw(rng: np.random.Generator) -> Prediction:
        """Prediction of the run where motion and force are measured with noise of this generator."""
        again = refined_motion(run.t, run.motion.x + model.noise["x"] * rng.standard_normal(run.n), model.noise["x"])
        data = run.data.copy()
        replaced = {"x": again.x, "a": again.a}
        if "v" not in run.recording.recorded:
            replaced["v"] = again.v
        for name, value in replaced.items():
            data[1 + plant.inputs.index(name)] = value
        data[1 + nw : 1 + 2 * nw] = np.diff(data[1 : 1 + nw], axis=1, append=data[1 : 1 + nw, -1:]) / data[0]
        data[-2 * ny : -ny] = clean + model.noise["F"] * rng.standard_normal(clean.shape)
        return _free(model, function, run, data)[0]

    return draw
