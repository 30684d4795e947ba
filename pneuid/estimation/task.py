"""What is to be fitted, and its relaxed problem from a start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pneuid.errors import UserError
from pneuid.estimation.first_guess import BREAK_AWAY, first_guess, first_nodes, motions
from pneuid.estimation.own import declared
from pneuid.estimation.preparation import Run, data_ranges
from pneuid.estimation.shooting import NODE_EVERY, Shooting, differentiated, relaxed_smoothing
from pneuid.estimation.solver import INTERRUPTED, USUAL, Monitor, Settling
from pneuid.estimation.stages import DEFECT_GATE, Relaxed, relaxed_stage
from pneuid.interval import begin
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.step import LARGEST_SUBSTEPS, substeps_needed

NODE_SECONDS = 0.02
"""Length of an interval between nodes, s, where the sample rate allows."""

WORTH_STEPS = 0.01
"""Relative fall of the cost from one time step to a finer one, below which a model that is too wrong for the exact stage gets
none finer still: beside an end cushion, which slows the piston as friction does, the bristle's damping grew with every step
that it was given, from 3 substeps to 20, the last ten for 0.7 % of the cost, and every refit begins with as many."""


@dataclass(frozen=True)
class Task:
    """What every start of one fit shares.

    known : node states ``(nint,)`` by name that replace the first guess's; loosely : when loose defects have settled; again :
    whether a model was fitted to these runs before, so that they are known to be sampled fast enough; finest : substeps per
    sample at most; hopeless : cost of a relaxed solution from which it is not solved again with finer time steps.
    """

    plant: Plant
    recordings: Sequence[Recording]
    runs: tuple[Run, ...]
    known: Mapping[str, np.ndarray]
    monitor: Monitor | None
    loosely: Settling = USUAL
    again: bool = False
    finest: int = LARGEST_SUBSTEPS
    hopeless: float = np.inf

    @cached_property
    def guess(self) -> dict[str, float]:
        """The data's own first guess of the parameters, SI."""
        return first_guess(self.plant, self.runs, motions(self.runs))

    def substeps(self, values: Mapping[str, float]) -> int:
        """Substeps per sample that the parameters ``values`` (SI) need.

        Raises ``UserError`` where they are too many and no model was fitted to these runs before: then it is the start that is
        too stiff, from which a fit moves on with as many as there may be.
        """
        # the slowest run decides the step, so that no run is integrated too coarsely
        dt = max(float(np.median(run.data[0])) for run in self.runs)
        needed = substeps_needed(self.plant, self.plant.theta(values, self.ranges), dt)
        if needed > LARGEST_SUBSTEPS and not self.again:
            raise UserError(
                f"sample rate of {1 / dt:.0f} Hz is too low: this friction and these chambers need {needed} substeps per "
                f"sample (at most {LARGEST_SUBSTEPS}); check the unit of t and the sizes and mass in rig.toml; if they are "
                'right, record faster or choose friction = "stribeck"'
            )
        return min(needed, self.finest)

    @property
    def ranges(self) -> dict[str, float]:
        """Ranges of the data that laws are clamped to, SI."""
        return data_ranges(self.recordings, self.plant)

    def problem(self, values: Mapping[str, float], substeps: int) -> Shooting:
        """The relaxed problem at the parameters ``values`` (SI)."""
        free = [parameter.name for parameter in declared(self.plant, [run.own for run in self.runs])]
        problem = Shooting(self.plant, self.runs, free, values, self.ranges, substeps, samples_of(self.runs))
        problem.set_smoothing(relaxed_smoothing(self.plant))
        return problem

    def nodes(self, values: dict[str, float], every: int) -> np.ndarray:
        """Node states ``(ns, nint)`` from the measurements and what is known, a node after ``every`` samples."""
        nodes = first_nodes(self.plant, self.runs, motions(self.runs), values, every)
        for name, row in self.known.items():
            nodes[self.plant.states.index(name)] = row
        return nodes

    def fresh_starts(self, problem: Shooting, X: np.ndarray) -> list[np.ndarray]:
        """``X`` with the break-away of the data's own guess, and all nodes read anew at it; none for a law without any.

        The relaxed fit hardly sees a break-away: its jumps between intervals take up what a peak of friction does.
        """
        guess, values = self.guess, values_at(problem, X)
        fresh = {name: guess[name] for name in BREAK_AWAY if name in values}
        if not fresh:
            return []
        nodes = self.nodes(guess | values | fresh, problem.samples)
        return [problem.join(inside(problem, values | fresh), nodes)]


def begin_fit(plant: Plant, runs: Sequence[Run]) -> None:
    """Start compiling what a fit of ``plant`` to these runs will need, and predictions by what it finds."""
    free = differentiated([parameter.name for parameter in declared(plant, [run.own for run in runs])])
    for selected in (free, ()):
        begin(plant, selected, samples_of(runs))


def samples_of(runs: Sequence[Run]) -> int:
    """Samples between nodes in these runs."""
    return node_every(float(np.median(np.concatenate([run.data[0] for run in runs]))))


def node_every(dt: float) -> int:
    """Samples between nodes for a sampling interval ``dt`` in s."""
    return int(np.clip(round(NODE_SECONDS / dt), 2, NODE_EVERY))


Stage = Callable[[Shooting, np.ndarray, Monitor | None, Settling], Relaxed]
"""How a relaxed problem is solved from a point."""


def relaxed_fit(task: Task, start: Mapping[str, float], stage: Stage = relaxed_stage) -> tuple[Shooting, Relaxed]:
    """The relaxed problem and its solution by a ``stage``, with as many substeps as the parameters found need.

    With a model that leaves too much for an exact fit, only while finer steps lower the cost.
    """
    before = np.inf
    problem, X = _begun(task, task.guess | dict(start))
    while True:
        soft = stage(problem, X, task.monitor, task.loosely)
        cost = soft.outcome.cost + soft.outcome.penalty
        values, nodes = values_at(problem, soft.outcome.X), problem.split(soft.outcome.X)[1]
        needed = task.substeps(values)
        in_vain = soft.level > DEFECT_GATE and cost > (1.0 - WORTH_STEPS) * before
        if needed <= problem.substeps or cost > task.hopeless or in_vain or soft.outcome.status == INTERRUPTED:
            return problem, soft
        problem, before = task.problem(values, needed), cost
        X = problem.join(inside(problem, values), nodes)


def _begun(task: Task, start: Mapping[str, float]) -> tuple[Shooting, np.ndarray]:
    """The relaxed problem at ``start`` (SI) and its point there, from which every interval can be simulated.

    Where the states run away it is at the data's own guess, or with time steps as fine as may be. A model without an end
    cushion had braked by a static friction of 9.8 kN; its values read anew ran away in 16 of 825 intervals, and with the
    finest steps that ended at fifteen times the cost of a fit from the guess.
    """
    for values, finest in ((start, False), (task.guess, False), (start, True)):
        problem = task.problem(values, task.finest if finest else task.substeps(values))
        X = problem.join(inside(problem, values), task.nodes(dict(values), problem.samples))
        if np.isfinite(problem.evaluate_values(X)[1]):
            break
    return problem, X


def values_at(problem: Shooting, X: np.ndarray) -> dict[str, float]:
    """Parameters at ``X``, SI."""
    found = problem.scaling.to_values(X[: problem.nq])
    return {name: float(value) for name, value in zip(problem.free, found, strict=True)}


def inside(problem: Shooting, values: Mapping[str, float]) -> np.ndarray:
    """Search variables ``(nq,)`` of ``values`` (SI), within their bounds."""
    q = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    return np.asarray(np.clip(q, problem.scaling.lower, problem.scaling.upper))
