"""The identification: first guess, relaxed fit, exact fit, uncertainty."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pneuid.errors import UserError
from pneuid.estimation.by_sections import by_sections
from pneuid.estimation.exact_end import better, exact_end, likely_end
from pneuid.estimation.preparation import Run, noise_of, prepare
from pneuid.estimation.reread import reread
from pneuid.estimation.shooting import TIGHT, Shooting
from pneuid.estimation.simulated import Simulated, simulated
from pneuid.estimation.sliding import sliding_starts
from pneuid.estimation.solver import INTERRUPTED, Monitor, Outcome
from pneuid.estimation.stages import (
    DEFECT_GATE,
    MISFIT,
    End,
    Relaxed,
    loose_cost,
    tight_stage,
)
from pneuid.estimation.starts import from_far, softer
from pneuid.estimation.task import Task, begin_fit, relaxed_fit, values_at
from pneuid.estimation.tightly import SURE, tightly
from pneuid.estimation.uncertainty import Uncertainty, verdicts
from pneuid.plant import Plant
from pneuid.recording import Recording

BEYOND_CHANCE = (
    "residual {:.1%} above the sensors' noise, more than chance leaves: what causes it (something missing, the sample rate, a "
    "noise stated too low, on a bench noise of the motion and the pressures) may shift parameters by more than their standard "
    "errors"
)
"""Of 112 exact fits to random rigs seven have a parameter more than four standard errors off, six of them such a residual."""

LACKING = (
    "relaxed: no parameters of the model follow the runs without jumps, whatever the fit starts from, so something is most "
    "likely missing from it; no standard errors"
)


FINER = 2
"""Times that a refit's time step may be finer than what it starts from needs: a bristle that stiffens more leads nowhere, and
takes minutes to get there."""


@dataclass(frozen=True)
class Fit:
    """Result of an identification.

    stage : ``exact`` or ``relaxed``; values : all parameters, SI, on a bench those of ``simulated`` where it is not exact;
    ``relaxed`` and ``problem`` are the relaxed solution, on which effects are screened; cost_per_sample : mean squared weighted
    residual (1 when only noise is left);
    defect_level : mean square of the relaxed defects in their own spread; loose : ``loose_cost`` where it is known; lacking :
    whether the exact stage showed that no parameters of the model follow the data (False where it was not asked for).
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
    loose: float | None
    problem: Shooting
    exact: Outcome | None
    exact_problem: Shooting | None
    spread: Uncertainty | None
    verdicts: dict[str, str]
    notes: tuple[str, ...]
    lacking: bool = False
    simulated: Simulated | None = None

    @property
    def relaxed_values(self) -> dict[str, float]:
        """Parameters of the relaxed solution, SI."""
        found = self.problem.scaling.to_values(self.relaxed.X[: self.problem.nq])
        return {name: float(value) for name, value in zip(self.problem.free, found, strict=True)}

    @cached_property
    def loose_cost(self) -> float:
        """Relaxed cost with loose defects, comparable between models; found when asked for where the fit did without."""
        return loose_cost(self.problem, Relaxed(self.relaxed, self.defect_level, self.loose))

    @property
    def relaxed_cost(self) -> float:
        """Relaxed cost: half the sum of squares of residuals and defects."""
        return self.relaxed.cost + self.relaxed.penalty


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
    again: bool = False,
) -> Fit:
    """Identify the parameters of ``plant`` from ``recordings``.

    start : values (SI) that replace the first guess; noise : 1-sigma per signal (SI), else from rig and data; exact :
    whether to go on to hard continuity where the relaxed fit allows it; nodes : node states ``(nint,)`` by name that
    replace the first guess's; prepared : ``recordings``, prepared already; again : whether a model was fitted to them before,
    so that they are known to be sampled fast enough. Raises ``UserError`` for data that cannot identify the model,
    ``Interrupted`` with the best so far after a ctrl-C.
    """
    began = time.monotonic()
    _check_runs(plant, recordings)
    levels = dict(noise) if noise is not None else noise_of(plant.rig, recordings)
    runs = tuple(prepared) if prepared is not None else tuple(prepare(run, plant, levels) for run in recordings)
    begin_fit(plant, runs)
    task = Task(plant, recordings, runs, nodes or {}, monitor, again=again)
    ends = _ends(task, start or {}, exact)
    _, best = min(zip(comparable_costs(*ends), ends, strict=True), key=lambda item: _order(*item))
    best = replace(best, lacking=best.hard is None and any(end.lacking for end in ends))
    return _result(best, levels, began, monitor, interrupted=ends[-1].interrupted)


def completed(found: Fit, monitor: Monitor | None = None) -> Fit:
    """``found`` followed from its relaxed solution to the exact fit, by the likeliest ways; itself where they lead to none.

    Raises ``Interrupted`` with ``found`` after a ctrl-C.
    """
    if found.exact is not None:
        return found
    began = time.monotonic()
    task = Task(found.plant, [run.recording for run in found.runs], found.runs, {}, monitor, again=True)
    try:
        end = likely_end(task, found.problem, Relaxed(found.relaxed, found.defect_level, found.loose))
    except KeyboardInterrupt:
        raise Interrupted(replace(found, converged=False, status=f"interrupted, best so far; {found.status}")) from None
    return found if end.hard is None else result_of(end, found.noise, found.seconds + time.monotonic() - began)


def sharper(found: Fit, monitor: Monitor | None = None) -> Fit:
    """``found``, or a cheaper relaxed fit of the same model with break-away read anew: see ``tightly``.

    Raises ``Interrupted`` with the best so far after a ctrl-C.
    """
    began = time.monotonic()
    finest = FINER * found.problem.substeps
    task = Task(found.plant, [run.recording for run in found.runs], found.runs, {}, monitor, again=True, finest=finest)
    before = (found.problem, Relaxed(found.relaxed, found.defect_level, found.loose))
    problem, soft = tightly(task, before)
    if soft is before[1]:
        return found
    return _result(End(problem, soft), found.noise, began - found.seconds, monitor)


def near(
    plant: Plant, runs: Sequence[Run], start: Mapping[str, float], noise: Mapping[str, float],
    nodes: Mapping[str, np.ndarray] | None = None, monitor: Monitor | None = None, hopeless: float = np.inf,
) -> Fit:  # fmt: skip
    """Relaxed fit of ``plant`` to ``runs`` from a ``start`` (SI) that is near its end: with tight defects at once.

    ``nodes`` as in ``fit``; from the cost ``hopeless`` on the time step is left as coarse as it was. Raises ``Interrupted``
    with what it had reached after a ctrl-C.
    """
    began = time.monotonic()
    begin_fit(plant, runs)
    task = Task(plant, [run.recording for run in runs], tuple(runs), nodes or {}, monitor, again=True)
    task = replace(task, finest=FINER * task.substeps(task.guess | dict(start)), hopeless=hopeless)
    problem, soft = relaxed_fit(task, start, tight_stage)
    return _result(End(problem, soft), dict(noise), began, monitor)


def _result(end: End, noise: dict[str, float], began: float, monitor: Monitor | None, interrupted: bool = False) -> Fit:
    """What the stages found, on a bench without an exact fit with the parameters whose simulation follows the runs best.

    Raises ``Interrupted`` with it where they, or that simulation, were stopped.
    """
    path = None
    interrupted = interrupted or end.soft.outcome.status == INTERRUPTED
    if end.hard is None and not interrupted:
        try:
            path = simulated(end.problem, end.soft, monitor)
        except KeyboardInterrupt:
            interrupted = True
    found = result_of(end, noise, time.monotonic() - began, path)
    if interrupted:
        raise Interrupted(replace(found, converged=False, status=f"interrupted, best so far; {found.status}"))
    return found


def _ends(task: Task, start: Mapping[str, float], exact: bool) -> list[End]:
    """Where one start after the other leads, until one is settled."""
    ends = []
    if exact and (known := by_sections(task, start)) is not None:
        ends.append(known)
        if known.interrupted or known.settled:
            return ends
    for one in _starts(task, start, exact):
        ends.append(_end(task, one, exact, ends))
        if ends[-1].interrupted or ends[-1].settled or ends[-1].lacking or (not one and not ends[-1].near):
            break  # from the data's own guess, and another one, a model that ends far off is wrong, not badly started
    return ends


def _end(task: Task, start: Mapping[str, float], exact: bool, before: Sequence[End]) -> End:
    """Where one start leads: the data's own guess (empty) by a detour too, where it does not lead to an exact fit.

    The exact stage is long where it fails, and is spared where the relaxed fit is no better than one that went ``before``.
    """
    found, *others = (_by_sliding(task, start) if exact else []) or [relaxed_fit(task, start)]
    if exact:
        found = reread(task, found)
    exact = exact and all(_cheaper(found, (end.problem, end.soft)) for end in before)
    end = exact_end(task, *found) if exact else End(*found)
    for other in others if exact else ():
        if end.interrupted or end.lacking or not end.doubtful:
            break
        # relaxed costs do not tell a wrong break-away from the right one where both are near: the exact residual does
        end = better(end, exact_end(task, *other))
    if start or end.interrupted or end.lacking or end.near:
        return end  # the exact stage has looked at other break-aways already
    found = end.problem, end.soft
    other = _doubted(task, found)
    if other is found:
        return end
    return exact_end(task, *other) if exact else End(*other)


def _by_sliding(task: Task, start: Mapping[str, float]) -> list[tuple[Shooting, Relaxed]]:
    """Relaxed fits from the laws of sliding read off the data, under ``start``, cheapest first; none without such laws."""
    starts = [one | dict(start) for one in sliding_starts(task.plant, task.runs)]
    ends: list[tuple[Shooting, Relaxed]] = []
    for one in starts[: 1 if starts[:1] == starts[1:] else None]:  # what is given may leave nothing to start differently
        found = relaxed_fit(task, one)
        ends.insert(0 if not ends or _cheaper(found, ends[0]) else 1, found)
        if found[1].outcome.status == INTERRUPTED:
            problem, best = ends[0]
            return [(problem, replace(best, outcome=replace(best.outcome, status=INTERRUPTED)))]
    return ends


def _doubted(task: Task, found: tuple[Shooting, Relaxed]) -> tuple[Shooting, Relaxed]:
    """The best of some relaxed fits: ``found`` from the data's own guess, far off, and others from starts made for that."""
    best = found
    for turn in range(2):
        if best[1].outcome.status == INTERRUPTED or (turn and best is found):
            break
        start = from_far(task.plant, task.guess, values_at(best[0], best[1].outcome.X), turn)
        if not start:
            break
        again = relaxed_fit(task, start)
        if again[1].outcome.status == INTERRUPTED:
            return best[0], replace(best[1], outcome=replace(best[1].outcome, status=INTERRUPTED))
        if _cheaper(again, best):
            best = again
    return best


def _cheaper(one: tuple[Shooting, Relaxed], other: tuple[Shooting, Relaxed]) -> bool:
    """Whether the first relaxed fit costs clearly less."""
    first, second = comparable_costs(End(*one), End(*other))
    return first < second - SURE


def comparable_costs(*ends: Fit | End) -> list[float]:
    """Relaxed costs of fits to the same runs that can be compared, infinite where one diverged.

    With tight defects, which see more, where all have those.
    """
    alike = len({end.problem.relaxation for end in ends}) == 1
    costs = [end.relaxed_cost if alike else end.loose_cost for end in ends]
    return [cost if np.isfinite(cost) else np.inf for cost in costs]


def _order(cost: float, end: End) -> tuple[bool, float]:
    """Exact ends first, the cheapest of them; else the cheapest relaxed one."""
    return (True, cost) if end.hard is None else (False, end.hard.outcome.cost)


def _starts(task: Task, start: Mapping[str, float], exact: bool) -> Iterator[Mapping[str, float]]:
    """Values to start from: the given ones over the data's guess; where they do not lead to an exact fit, others.

    A bad start ends in a local minimum, mostly of the pre-sliding parameters, from which no step leads out. Warm refits, which
    do not ask for the exact stage, start near their end already.
    """
    yield start
    if not exact:
        return
    if start:
        yield {}
    soft = softer(task.plant, task.guess | dict(start))
    if soft:
        yield dict(start) | soft


def result_of(end: End, noise: dict[str, float], seconds: float, path: Simulated | None = None) -> Fit:
    """What the stages found, in one; ``seconds`` is how long it took, ``path`` what a simulation follows best."""
    problem, soft, hard = end.problem, end.soft, end.hard
    final = hard.outcome if hard else soft.outcome
    solved = hard.problem if hard else problem
    misfit = 2 * (final.cost if path is None else path.cost) / max(problem.weighted, 1)
    spread, words = None, {}
    if hard is not None:
        spread = hard.spread
        if misfit > MISFIT:
            # the sensors' noise does not explain the residual: what does is unknown, its size is not
            spread = replace(spread, std=spread.std * np.sqrt(misfit))
        words = dict(zip(problem.free, verdicts(hard.problem, final.X, spread), strict=True))
    return Fit(
        plant=problem.plant, runs=problem.runs, values=dict(path.values) if path else values_at(solved, final.X),
        ranges=problem.ranges, noise=noise, substeps=solved.substeps, stage="exact" if hard else "relaxed",
        converged=final.success, status=_words(end, misfit, path), cost_per_sample=misfit,
        defect_level=soft.level, iterations=soft.outcome.iterations + (final.iterations if hard else 0), seconds=seconds,
        relaxed=soft.outcome, loose=soft.loose_cost, problem=problem, exact=final if hard else None,
        exact_problem=solved if hard else None, spread=spread, verdicts=words,
        notes=tuple(note for run in problem.runs for note in run.notes), lacking=end.lacking, simulated=path,
    )  # fmt: skip


def _words(end: End, misfit: float, path: Simulated | None = None) -> str:
    """How a fit has ended, in words."""
    if path is not None:
        return f"{_words(end, misfit)}; the parameters are those whose simulation follows whole runs best"
    if end.hard is not None:
        outcome = end.hard.outcome
        words = "exact: continuity holds everywhere" + ("" if outcome.success else f" ({outcome.status})")
        if misfit > MISFIT:
            words += f"; residual {np.sqrt(misfit):.1f} times the sensors' noise, standard errors widened by as much"
        elif end.doubtful:
            words += f"; {BEYOND_CHANCE.format(misfit - 1.0)}"
        return words
    level = end.soft.level
    jump = np.sqrt(level) * end.problem.relaxation / TIGHT
    if jump**2 >= DEFECT_GATE:
        return (
            f"relaxed: the model leaves jumps of {jump:.1f} times their allowance between intervals, "
            "so something is most likely missing from it; no standard errors"
        )
    if end.lacking:
        return LACKING
    return (
        "relaxed: little is unexplained where the model may jump a little between intervals, but no fit without jumps stands "
        "behind it; no standard errors, predictions at break-away may be off"
    )
