"""The identification: first guess, relaxed fit, exact fit, uncertainty."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneuid.errors import UserError
from pneuid.estimation.first_guess import first_guess, first_nodes, follows_state, motions
from pneuid.estimation.own import declared
from pneuid.estimation.preparation import Run, data_ranges, noise_of, prepare
from pneuid.estimation.shooting import NODE_EVERY, TIGHT, Shooting, relaxed_smoothing
from pneuid.estimation.solver import INTERRUPTED, Monitor, Outcome
from pneuid.estimation.stages import DEFECT_GATE, Exact, Relaxed, exact_stage, relaxed_stage
from pneuid.estimation.starts import from_far, from_near, softer
from pneuid.estimation.uncertainty import Uncertainty, verdicts
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.step import LARGEST_SUBSTEPS, substeps_needed

NODE_SECONDS = 0.02
"""Length of an interval between nodes, s, where the sample rate allows."""

MISFIT = 1.2
"""Mean squared weighted residual above which standard errors are widened by its root, and the status says so."""


DOUBTFUL = 4.0
"""Standard deviations of the mean squared residual above 1 from which another start is tried."""

REREADS = 2
"""Times at most that the bristle is read again at the friction laws found."""

SURE = 5.0
"""Half the sum of squares by which another start's end must be better: 3 standard deviations of a parameter."""

REREAD_GAIN = 0.01
"""Relative fall of the relaxed cost that makes another reading worth it."""


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
    exact_problem: Shooting | None
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
    samples, unknown = sum(run.n for run in recordings), len(plant.parameters)
    if samples < 3 * unknown:
        names = ", ".join(run.name for run in recordings)
        raise UserError(
            f"{names}: {samples} samples are fewer than {unknown} parameters need; record at least {3 * unknown}"
        )


class Interrupted(KeyboardInterrupt):
    """A fit that was stopped: ``best`` is what it had reached, labelled so."""

    def __init__(self, best: Fit) -> None:
        super().__init__(best.status)
        self.best = best


def fit(
    plant: Plant,
    recordings: Sequence[Recording],
    start: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    monitor: Monitor | None = None,
    exact: bool = True,
    prepared: Sequence[Run] | None = None,
    nodes: Mapping[str, np.ndarray] | None = None,
) -> Fit:
    """Identify the parameters of ``plant`` from ``recordings``.

    start : values (SI) that replace the first guess; noise : 1-sigma per signal (SI), else from rig and data; exact :
    whether to go on to hard continuity where the relaxed fit allows it; nodes : node states ``(nint,)`` by name that
    replace the first guess's. Raises ``UserError`` for data that cannot
    identify the model, ``Interrupted`` with the best so far after a ctrl-C.
    """
    began = time.monotonic()
    _check_runs(plant, recordings)
    levels = dict(noise) if noise is not None else noise_of(plant.rig, recordings)
    runs = tuple(prepared) if prepared is not None else tuple(prepare(run, plant, levels) for run in recordings)
    task = _Task(plant, recordings, runs, nodes or {}, monitor)
    ends: list[_End] = []
    for one in _starts(task, start or {}, exact):
        ends.append(_end(task, one, exact, ends))
        if ends[-1].interrupted or ends[-1].settled or (not one and not ends[-1].near):
            break  # from the data's own guess, and another one, a model that ends far off is wrong, not badly started
    _, best = min(zip(comparable_costs(*ends), ends, strict=True), key=lambda item: _order(*item))
    found = result_of(best.problem, levels, best.soft, best.hard, time.monotonic() - began)
    if ends[-1].interrupted:
        raise Interrupted(replace(found, converged=False, status=f"interrupted, best so far; {found.status}"))
    return found


@dataclass(frozen=True)
class _Task:
    """What every start of one fit shares; known : node states ``(nint,)`` by name that replace the first guess's."""

    plant: Plant
    recordings: Sequence[Recording]
    runs: tuple[Run, ...]
    known: Mapping[str, np.ndarray]
    monitor: Monitor | None

    def guess(self) -> dict[str, float]:
        """The data's own first guess of the parameters, SI."""
        return first_guess(self.plant, self.runs, motions(self.runs))


def _end(task: _Task, start: Mapping[str, float], exact: bool, before: Sequence[_End]) -> _End:
    """Where one start leads: the data's own guess (empty) by a detour too, where it does not lead to an exact fit.

    The exact stage is long where it fails, and is spared where the relaxed fit is no better than one that went ``before``.
    """
    found = _relaxed_fit(task, start)
    if exact:
        found = _reread(task, found)
    exact = exact and all(_cheaper(found, (end.problem, end.soft)) for end in before)
    end = _exact_end(*found, task.monitor) if exact else _End(*found)
    if start or end.interrupted or end.hard is not None:
        return end
    other = _doubted(task, found)
    if other is found:
        return end
    return _exact_end(*other, task.monitor) if exact else _End(*other)


def _reread(task: _Task, found: tuple[Shooting, Relaxed]) -> tuple[Shooting, Relaxed]:
    """The relaxed fit again with the bristle read at the friction laws just found, until it is near or no longer comes down.

    Laws start at zero, so the first bristle is that of no pressure: a stick under another one then breaks away in the wrong
    interval, and no step leads out of that.
    """
    if not follows_state(task.plant):
        return found
    for _ in range(REREADS):
        problem, soft = found
        if soft.outcome.status == INTERRUPTED or _End(problem, soft).near:
            break
        again = _relaxed_fit(task, values_at(problem, soft.outcome.X))
        interrupted = again[1].outcome.status == INTERRUPTED
        if not (interrupted or _End(*again).near or again[1].loose_cost < (1.0 - REREAD_GAIN) * soft.loose_cost):
            break
        found = again
    return found


def _doubted(task: _Task, found: tuple[Shooting, Relaxed]) -> tuple[Shooting, Relaxed]:
    """The best of some relaxed fits: ``found`` from the data's own guess, and others from starts made for its weak points."""
    best, near = found, _End(*found).near
    for turn in range(2):
        if best[1].outcome.status == INTERRUPTED or (turn and best is found and not near):
            break
        values = values_at(best[0], best[1].outcome.X)
        start = from_near(task.guess(), values, turn) if near else from_far(task.plant, task.guess(), values, turn)
        if not start:
            break
        again = _relaxed_fit(task, start)
        if again[1].outcome.status == INTERRUPTED:
            return best[0], replace(best[1], outcome=replace(best[1].outcome, status=INTERRUPTED))
        if _cheaper(again, best):
            best = again
    return best


def _cheaper(one: tuple[Shooting, Relaxed], other: tuple[Shooting, Relaxed]) -> bool:
    """Whether the first relaxed fit costs clearly less."""
    first, second = comparable_costs(_End(*one), _End(*other))
    return first < second - SURE


def comparable_costs(*ends: Fit | _End) -> list[float]:
    """Relaxed costs of fits to the same runs that can be compared, infinite where one diverged.

    With tight defects, which see more, where all have those.
    """
    alike = len({end.problem.relaxation for end in ends}) == 1
    costs = [end.relaxed_cost if alike else end.loose_cost for end in ends]
    return [cost if np.isfinite(cost) else np.inf for cost in costs]


def _order(cost: float, end: _End) -> tuple[bool, float]:
    """Exact ends first, the cheapest of them; else the cheapest relaxed one."""
    return (True, cost) if end.hard is None else (False, end.hard.outcome.cost)


@dataclass(frozen=True)
class _End:
    """Where one start has led."""

    problem: Shooting
    soft: Relaxed
    hard: Exact | None = None
    interrupted: bool = False

    @property
    def loose_cost(self) -> float:
        """Cost of the relaxed fit with loose defects."""
        return self.soft.loose_cost

    @property
    def relaxed_cost(self) -> float:
        """Cost of the relaxed fit with the defects it ended with."""
        return self.soft.outcome.cost + self.soft.outcome.penalty

    @property
    def near(self) -> bool:
        """Whether the relaxed fit came near enough for the exact stage."""
        return self.problem.relaxation == TIGHT and self.soft.level < DEFECT_GATE

    @property
    def settled(self) -> bool:
        """Whether an exact fit was found that need not be doubted.

        One that leaves clearly more than the sensors' noise, but not so much that the model must be wrong, may be a
        local optimum of the pre-sliding parameters.
        """
        if self.hard is None:
            return False
        count = max(self.problem.weighted, 1)
        misfit = 2 * self.hard.outcome.cost / count
        return not 1.0 + DOUBTFUL * np.sqrt(2.0 / count) < misfit < MISFIT


def _exact_end(problem: Shooting, soft: Relaxed, monitor: Monitor | None) -> _End:
    """The exact stage, where the relaxed one came near enough."""
    if soft.outcome.status == INTERRUPTED:
        return _End(problem, soft, interrupted=True)
    end = _End(problem, soft)
    if not end.near:
        return end
    try:
        return replace(end, hard=exact_stage(problem, soft.outcome, monitor))
    except KeyboardInterrupt:
        return replace(end, interrupted=True)


def _starts(task: _Task, start: Mapping[str, float], exact: bool) -> Iterator[Mapping[str, float]]:
    """Values to start from: the given ones over the data's guess; where they do not lead to an exact fit, others.

    A bad start ends in a local minimum, mostly of the pre-sliding parameters, from which no step leads out. Warm refits, which
    do not ask for the exact stage, start near their end already.
    """
    yield start
    if not exact:
        return
    if start:
        yield {}
    soft = softer(task.plant, task.guess() | dict(start))
    if soft:
        yield dict(start) | soft


def _relaxed_fit(task: _Task, start: Mapping[str, float]) -> tuple[Shooting, Relaxed]:
    """The relaxed problem and its solution, with as many substeps as the parameters found need."""
    plant, runs = task.plant, task.runs
    ranges = data_ranges(task.recordings, plant)
    moved = motions(runs)
    guess = task.guess() | dict(start)
    # the slowest run decides the step, so that no run is integrated too coarsely
    dt = max(float(np.median(run.data[0])) for run in runs)
    every = node_every(float(np.median(np.concatenate([run.data[0] for run in runs]))))
    nodes = first_nodes(plant, runs, moved, guess, every)
    for name, row in task.known.items():
        nodes[plant.states.index(name)] = row
    free = [parameter.name for parameter in declared(plant, [run.own for run in runs])]
    values, substeps = guess, _substeps(plant, guess, ranges, dt)
    while True:
        problem = Shooting(plant, runs, free, values, ranges, substeps, every)
        problem.set_smoothing(relaxed_smoothing(plant))
        soft = relaxed_stage(problem, problem.join(_inside(problem, values), nodes), task.monitor)
        values, nodes = values_at(problem, soft.outcome.X), problem.split(soft.outcome.X)[1]
        needed = _substeps(plant, values, ranges, dt)
        if needed <= substeps or soft.outcome.status == INTERRUPTED:
            return problem, soft
        substeps = needed


def result_of(problem: Shooting, noise: dict[str, float], soft: Relaxed, hard: Exact | None, seconds: float) -> Fit:
    """What the stages found, in one; ``seconds`` is how long it took."""
    final = hard.outcome if hard else soft.outcome
    solved = hard.problem if hard else problem
    misfit = 2 * final.cost / max(problem.weighted, 1)
    spread, words = None, {}
    if hard is not None:
        spread = hard.spread
        if misfit > MISFIT:
            # the sensors' noise does not explain the residual: what does is unknown, its size is not
            spread = replace(spread, std=spread.std * np.sqrt(misfit))
        words = dict(zip(problem.free, verdicts(hard.problem, final.X, spread), strict=True))
    return Fit(
        plant=problem.plant, runs=problem.runs, values=values_at(solved, final.X), ranges=problem.ranges,
        noise=noise, substeps=solved.substeps, stage="exact" if hard else "relaxed", converged=final.success,
        status=_words(final if hard else None, soft.level, problem.relaxation, misfit), cost_per_sample=misfit,
        defect_level=soft.level, iterations=soft.outcome.iterations + (final.iterations if hard else 0), seconds=seconds,
        relaxed=soft.outcome, loose_cost=soft.loose_cost, problem=problem, exact=final if hard else None,
        exact_problem=solved if hard else None, spread=spread, verdicts=words,
        notes=tuple(note for run in problem.runs for note in run.notes),
    )  # fmt: skip


def values_at(problem: Shooting, X: np.ndarray) -> dict[str, float]:
    """Parameters at ``X``, SI."""
    found = problem.scaling.to_values(X[: problem.nq])
    return {name: float(value) for name, value in zip(problem.free, found, strict=True)}


def _inside(problem: Shooting, values: Mapping[str, float]) -> np.ndarray:
    q = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    return np.clip(q, problem.scaling.lower, problem.scaling.upper)


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
