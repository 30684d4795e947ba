"""The identification: first guess, relaxed fit, exact fit, uncertainty."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneuid.errors import UserError
from pneuid.estimation.first_guess import first_guess, first_nodes, motions
from pneuid.estimation.preparation import Run, data_ranges, noise_of, prepare
from pneuid.estimation.shooting import LOOSE, NODE_EVERY, TIGHT, Shooting
from pneuid.estimation.solver import Monitor, Outcome, solve_exact, solve_relaxed
from pneuid.estimation.uncertainty import Uncertainty, uncertainty, verdicts
from pneuid.physics.smoothing import COARSE, FINE
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.step import LARGEST_SUBSTEPS, substeps_needed

NODE_SECONDS = 0.02
"""Length of an interval between nodes, s, where the sample rate allows."""

TIGHTEN_BELOW = 0.15
"""Mean square of the loose defects, in their own spread, below which the tight relaxed problem is worth solving."""

DEFECT_GATE = 0.6
"""Mean square of the relaxed defects, in their own spread, above which the exact stage is not tried: the model is too
wrong for it. A right model leaves about 0.15, a missing effect of twice the noise more than 1."""


MISFIT = 1.2
"""Mean squared weighted residual above which standard errors are widened by its root, and the status says so."""


@dataclass(frozen=True)
class Fit:
    """Result of an identification.

    stage : ``exact`` or ``relaxed``; values : all parameters, SI; ``relaxed`` and ``problem`` are the relaxed solution, on
    which effects are screened; loose_cost : relaxed cost with loose defects, comparable between models;
    cost_per_sample : mean squared weighted residual (1 when only noise is left); defect_level : mean square of the
    relaxed defects in their own spread.
    """

    plant: Plant
    runs: tuple[Run, ...]
    values: dict[str, float]
    ranges: dict[str, float]
    noise: dict[str, float]
    substeps: int
    stage: str
    converged: bool
    status: str
    cost_per_sample: float
    defect_level: float
    iterations: int
    seconds: float
    relaxed: Outcome
    loose_cost: float
    problem: Shooting
    exact: Outcome | None
    spread: Uncertainty | None
    verdicts: dict[str, str]
    notes: tuple[str, ...]

    @property
    def relaxed_values(self) -> dict[str, float]:
        """Parameters of the relaxed solution, SI."""
        found = self.problem.scaling.to_values(self.relaxed.X[: self.problem.nq])
        return {name: float(value) for name, value in zip(self.problem.free, found, strict=True)}

    @property
    def relaxed_cost(self) -> float:
        """Relaxed cost: half the sum of squares of residuals and defects."""
        return self.relaxed.cost + self.relaxed.penalty


def node_every(dt: float) -> int:
    """Samples between nodes for a sampling interval ``dt`` in s."""
    return int(np.clip(round(NODE_SECONDS / dt), 2, NODE_EVERY))


def _substeps(plant: Plant, values: Mapping[str, float], ranges: Mapping[str, float], dt: float) -> int:
    needed = substeps_needed(plant, plant.theta(values, ranges), dt)
    if needed > LARGEST_SUBSTEPS:
        raise UserError(
            f"sample rate of {1 / dt:.0f} Hz is too low: this friction and these chambers need {needed} substeps per sample "
            f'(at most {LARGEST_SUBSTEPS}); record faster or choose friction = "stribeck" in rig.toml'
        )
    return needed


def _check_runs(plant: Plant, recordings: Sequence[Recording]) -> None:
    for run in recordings:
        if plant.rig.run(run.name).free:
            raise UserError(
                f'{plant.rig.where}: runs."{run.name}".free: fitting a quantity for one run alone is not available yet; '
                "remove the line"
            )
    samples, unknown = sum(run.n for run in recordings), len(plant.parameters)
    if samples < 3 * unknown:
        names = ", ".join(run.name for run in recordings)
        raise UserError(
            f"{names}: {samples} samples are fewer than {unknown} parameters need; record at least {3 * unknown}"
        )


def fit(
    plant: Plant,
    recordings: Sequence[Recording],
    start: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    monitor: Monitor | None = None,
    exact: bool = True,
    prepared: Sequence[Run] | None = None,
) -> Fit:
    """Identify the parameters of ``plant`` from ``recordings``.

    start : values (SI) that replace the first guess; noise : 1-sigma per signal (SI), else from rig and data; exact :
    whether to go on to hard continuity where the relaxed fit allows it. Raises ``UserError`` for data that cannot
    identify the model.
    """
    began = time.monotonic()
    _check_runs(plant, recordings)
    levels = dict(noise) if noise is not None else noise_of(plant.rig, recordings)
    runs = tuple(prepared) if prepared is not None else tuple(prepare(run, plant, levels) for run in recordings)
    ranges = data_ranges(recordings, plant)
    moved = motions(runs)
    guess = first_guess(plant, runs, moved) | dict(start or {})
    # the slowest run decides the step, so that no run is integrated too coarsely
    dt = max(float(np.median(run.data[0])) for run in runs)
    every = node_every(float(np.median(np.concatenate([run.data[0] for run in runs]))))
    nodes = first_nodes(plant, runs, moved, guess, every)
    free = plant.parameter_names

    def problem_at(values: Mapping[str, float], substeps: int) -> Shooting:
        made = Shooting(plant, runs, free, values, ranges, substeps, every)
        made.set_smoothing(COARSE)
        return made

    substeps = _substeps(plant, guess, ranges, dt)
    problem = problem_at(guess, substeps)
    X0 = problem.join(_inside(problem, guess), nodes)
    soft, level, loose = _relaxed_stage(problem, X0, monitor)
    values = dict(zip(free, problem.scaling.to_values(soft.X[: problem.nq]), strict=True))
    again = _substeps(plant, values, ranges, dt)
    if again > substeps:
        substeps = again
        problem = problem_at(values, substeps)
        soft, level, loose = _relaxed_stage(
            problem, problem.join(_inside(problem, values), problem.split(soft.X)[1]), monitor
        )
        values = dict(zip(free, problem.scaling.to_values(soft.X[: problem.nq]), strict=True))
    tight = problem.relaxation == TIGHT
    hard = _exact_stage(problem, soft, monitor) if exact and tight and level < DEFECT_GATE else None
    spread, words = None, {}
    if hard is not None:
        problem.set_smoothing(FINE)
        spread = uncertainty(problem, hard.X)
        misfit = 2 * hard.cost / max(problem.weighted, 1)
        if misfit > MISFIT:
            # the sensors' noise does not explain the residual: what does is unknown, its size is not
            spread = replace(spread, std=spread.std * np.sqrt(misfit))
        words = dict(zip(free, verdicts(problem, hard.X, spread), strict=True))
        values = dict(zip(free, problem.scaling.to_values(hard.X[: problem.nq]), strict=True))
        problem.set_smoothing(COARSE)
    final = hard or soft
    misfit = 2 * final.cost / max(problem.weighted, 1)
    return Fit(
        plant=plant, runs=runs, values={name: float(value) for name, value in values.items()}, ranges=ranges,
        noise=levels, substeps=substeps, stage="exact" if hard else "relaxed", converged=final.success,
        status=_words(hard, level, problem.relaxation, misfit), cost_per_sample=misfit, defect_level=level,
        iterations=soft.iterations + (hard.iterations if hard else 0), seconds=time.monotonic() - began, relaxed=soft,
        loose_cost=loose, problem=problem, exact=hard, spread=spread, verdicts=words,
        notes=tuple(note for run in runs for note in run.notes),
    )  # fmt: skip


def _inside(problem: Shooting, values: Mapping[str, float]) -> np.ndarray:
    q = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    return np.clip(q, problem.scaling.lower, problem.scaling.upper)


def _relaxed_stage(problem: Shooting, X0: np.ndarray, monitor: Monitor | None) -> tuple[Outcome, float, float]:
    """Loose defects first; tight ones where the model is near enough. Also the mean square of the defects."""
    links = max(problem.linked.size * problem.ns, 1)
    problem.relaxation = LOOSE
    soft = solve_relaxed(problem, X0, monitor)
    level, loose = 2 * soft.penalty / links, soft.cost + soft.penalty
    if level < TIGHTEN_BELOW:
        problem.relaxation = TIGHT
        soft = solve_relaxed(problem, soft.X, monitor)
        level = 2 * soft.penalty / links
    return soft, level, loose


def _exact_stage(problem: Shooting, soft: Outcome, monitor: Monitor | None) -> Outcome | None:
    """The exact fit, or None where it does not converge to a solution of about the relaxed cost."""
    problem.set_smoothing(FINE)
    try:
        # where a break-away makes the step from the relaxed nodes too long, a continuous start often is near enough
        for start in (soft.X, _continuous(problem, soft.X)):
            hard = solve_exact(problem, start, monitor)
            if hard.success and np.isfinite(hard.cost) and hard.cost < 2.0 * (soft.cost + soft.penalty):
                return hard
    finally:
        problem.set_smoothing(COARSE)
    return None


def _continuous(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """The nodes of a simulation of every run from its first node, parameters as in ``X``."""
    q, nodes = problem.split(X)
    theta = problem.theta(q)
    for first, last in zip(problem.first[:-1], problem.first[1:], strict=True):
        for i in range(first, last - 1):
            data = problem.data[:, i * problem.samples : (i + 1) * problem.samples]
            nodes[:, i + 1] = np.asarray(problem.function.values(nodes[:, i], data, theta[:, i])[0]).ravel()
    return problem.join(q, nodes)


def _words(hard: Outcome | None, level: float, relaxation: float, misfit: float) -> str:
    if hard is not None:
        words = f"exact: continuity holds everywhere ({hard.status})"
        if misfit > MISFIT:
            words += f"; residual {np.sqrt(misfit):.1f} times the sensors' noise, standard errors widened by as much"
        return words
    jump = np.sqrt(level) * relaxation / TIGHT
    if jump**2 >= DEFECT_GATE:
        return (
            f"relaxed: the model leaves jumps of {jump:.1f} times their allowance between intervals, "
            "so something is missing from it; no standard errors"
        )
    return (
        "relaxed: little is unexplained, but the exact fit was not asked for or did not converge; "
        "no standard errors, predictions at break-away may be off"
    )
