"""What noise alone would give: the metrics of a prediction on data simulated from the model itself with the sensors' noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import Prediction, ahead_of, free_run, rmse, used, windows
from pneuid.criticism.prediction.window_starts import start_states
from pneuid.estimation.motion import Speed, refined_motion
from pneuid.estimation.preparation import Run
from pneuid.interval import IntervalFunction
from pneuid.simulate import simulate

FLOOR_SEEDS = 3
"""Noise seeds over which the floor is averaged and its spread taken."""


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
    function = model.function([run])
    return (_drawn_servo if model.plant.servo else _drawn_bench)(model, function, run)


def _drawn_servo(model: Frozen, function: IntervalFunction, run: Run) -> Draw:
    """Each window is simulated from its own estimated start, so that the operating points are those of the data."""
    plant, ny = model.plant, len(model.plant.outputs)
    before, ahead, first = windows(run, function.samples)
    predicted, start = ahead_of(model, function, run, run.data)
    if first.size == 0:
        return lambda _: predicted
    cut = np.stack([run.data[:, k : k + before + ahead] for k in first])
    theta = np.tile(model.theta(run), (first.size, 1))
    clean = simulate(function, start.states, cut, theta).outputs
    sigma = np.array([model.noise[name] for name in plant.outputs])[:, None]
    index, counted = (first[:, None] + before + np.arange(ahead)).ravel(), used(run, before, ahead, first)

    def draw(rng: np.random.Generator) -> Prediction:
        """Prediction of the windows where they are measured with noise of this generator."""
        noisy, data, guess = clean + sigma * rng.standard_normal(clean.shape), cut.copy(), start.states.copy()
        data[:, -2 * ny : -ny] = noisy
        for i, name in enumerate(plant.outputs):
            guess[:, plant.states.index(name)] = noisy[:, i, :5].mean(axis=1)
        again = start_states(model, function, guess, data[:, :, :before], theta, start.prior)
        found = simulate(function, again, data, theta).outputs[:, :, before:]
        measured = noisy[:, :, before:].transpose(1, 0, 2).reshape(ny, -1)
        return Prediction(run, index, found.transpose(1, 0, 2).reshape(ny, -1), measured, counted)

    return draw


def _drawn_bench(model: Frozen, function: IntervalFunction, run: Run) -> Draw:
    """Force of the model on its own smoothed motion, then the whole chain again on a noisy copy of that motion."""
    plant, ny, nw = model.plant, len(model.plant.outputs), len(model.plant.inputs)
    clean = free_run(model, function, run, run.data)[0].predicted

    def draw(rng: np.random.Generator) -> Prediction:
        """Prediction of the run where motion and force are measured with noise of this generator."""
        moved, spread = run.motion.x + model.noise["x"] * rng.standard_normal(run.n), run.motion.speed_noise
        speed = None if spread is None else Speed(run.motion.v + spread * rng.standard_normal(run.n), spread)
        again = refined_motion(run.t, moved, model.noise["x"], speed)
        data = run.data.copy()
        for name, value in (("x", again.x), ("v", again.v), ("a", again.a)):
            data[1 + plant.inputs.index(name)] = value
        data[1 + nw : 1 + 2 * nw] = np.diff(data[1 : 1 + nw], axis=1, append=data[1 : 1 + nw, -1:]) / data[0]
        data[-2 * ny : -ny] = clean + model.noise["F"] * rng.standard_normal(clean.shape)
        return free_run(model, function, run, data)[0]

    return draw
