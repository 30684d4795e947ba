"""Controllers times models times supplies times references: the closed loops of a study and their results."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field

import numpy as np

from controllers import loop
from controllers.control_model import ControlModel
from controllers.registry import build
from controllers.scenario import Scenario
from pneuid.errors import ComputationError
from pneuid.plant import Plant
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.servo import ServoPlant
from pneuid.virtual_rig.truth import TruthServo

Models = Mapping[str, tuple[Plant, np.ndarray]]
"""Models by label: the plant and its theta column."""


@dataclass(frozen=True)
class Result:
    """One closed loop: which, how good, and its signals (None where the rig's state diverged).

    supply : Pa absolute; gains : what the controller ran with.
    """

    model: str
    controller: str
    supply: float
    reference: str
    seed: int
    metrics: loop.Metrics | None
    gains: object
    run: loop.Run | None = field(repr=False)


@dataclass(frozen=True)
class _Job:
    """All loops of one controller with one model: built and refined once."""

    label: str
    plant: Plant
    theta: np.ndarray
    controller: str
    scenario: Scenario
    truth: TruthServo
    hidden: Hidden


def run_study(
    scenario: Scenario,
    models: Models,
    truth: TruthServo,
    hidden: Hidden = NOTHING,
    *,
    workers: int | None = None,
    on_result: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Run every controller of the scenario, made from every model, on the virtual rig.

    models : label -> (plant, theta), for instance ``{"before": (...), "after": (...)}``; workers : processes, None for
    one per core, 1 runs in this process; on_result : told (loops done, loops in all). Results come in the order
    of models, controllers, supplies, references, seeds, whatever the number of workers.
    """
    jobs = [
        _Job(label, plant, np.asarray(theta, dtype=float), controller, scenario, truth, hidden)
        for label, (plant, theta) in models.items()
        for controller in scenario.controllers
    ]
    each = len(scenario.supplies) * len(scenario.references) * len(scenario.seeds)
    found: dict[int, list[Result]] = {}
    told = on_result or (lambda _done, _all: None)
    told(0, each * len(jobs))
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        for i, job in enumerate(jobs):
            found[i] = _run_job(job)
            told(each * len(found), each * len(jobs))
    else:
        with ProcessPoolExecutor(count) as pool:
            # the predictive controllers take longest and stand last in the registry
            pending = {pool.submit(_run_job, jobs[i]): i for i in reversed(range(len(jobs)))}
            try:
                for future in as_completed(pending):
                    found[pending[future]] = future.result()
                    told(each * len(found), each * len(jobs))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)  # an interrupt waits for no loop that has not begun
                raise
    return [result for i in range(len(jobs)) for result in found[i]]


def _run_job(job: _Job) -> list[Result]:
    scenario = job.scenario
    controller = build(job.controller, ControlModel(job.plant, job.theta), scenario.design, scenario.refined)
    plant = ServoPlant(job.truth, job.hidden, scenario.sensors)
    results = []
    for supply in scenario.supplies:
        for reference in scenario.references:
            for seed in scenario.seeds:
                run: loop.Run | None = None
                try:
                    run = loop.run(controller, plant, reference, supply, seed)
                except ComputationError:
                    # the rig itself diverged; the other loops still count
                    run = None
                scores = None if run is None else loop.metrics(run)
                name = job.controller
                results.append(Result(job.label, name, supply, reference.name, seed, scores, controller.gains, run))
    return results
