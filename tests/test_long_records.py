"""Long records: fitted from sections of themselves, with the same result as from the whole at once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers import BENCH, SERVO, TRUTH, rig, servo_run
from scipy.interpolate import make_smoothing_spline

from pneuid.estimation import by_sections, solver, thinning
from pneuid.estimation.chained import Chained
from pneuid.estimation.differentiate import spline_motion
from pneuid.estimation.first_guess import first_nodes, motions
from pneuid.estimation.fit import Fit, Interrupted, fit
from pneuid.estimation.own import declared
from pneuid.estimation.preparation import Run, data_ranges, noise_of, prepare
from pneuid.estimation.refined import Refined
from pneuid.estimation.shooting import TIGHT, Shooting
from pneuid.estimation.solver import Outcome
from pneuid.estimation.stages import Exact, Relaxed, loose_cost
from pneuid.estimation.task import Task, values_at
from pneuid.estimation.thinning import LONG, section, sections
from pneuid.mapped import Trajectories
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import (
    ATMOSPHERE,
    NOTHING,
    Friction,
    Sensors,
    TruthBench,
    TruthServo,
    record_bench,
    record_servo,
    sine,
    strokes,
)

PLAN = (("multisine", 5, 14.0), ("slow", 7, 6.0), ("steps", 3, 11.0))
"""Excitation, gauge supply in bar and seconds of the runs of a long servo record, at 1 kHz."""


def long_runs(stand: Rig) -> list[Recording]:
    """A servo record of 31 000 samples, the second run with 0.8 kg more than the sheet says."""
    found = []
    for i, (kind, bar, seconds) in enumerate(PLAN):
        truth = TruthServo(mass=TruthServo().mass + 0.8 * (i == 1))
        record = record_servo(truth, NOTHING, kind, seconds, 70 + i, supply=bar * 1e5 + ATMOSPHERE)
        found.append(Recording.from_arrays(f"s{bar}.csv", stand, **record))
    return found


@cache
def servo_fit(long: int) -> Fit:
    """The servo record's fit, records being long from so many samples; the mass of a run is a parameter of its own."""
    runs = {name: dict(entry) for name, entry in SERVO["runs"].items()}
    runs["s7.csv"]["free"] = ["mass"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thinning, "LONG", long)
        return fit(Plant(rig(changes={"runs": runs}), "lugre"), long_runs(rig(changes={"runs": runs})))


@cache
def bench_fit(long: int) -> Fit:
    """The same of a bench with a record of 36 000 samples."""
    stand, truth = Rig.from_dict(BENCH), TruthBench(friction=Friction())
    fine = Sensors(x_noise=1e-9, x_grid=0.0, p_noise=1.0, p_grid=0.0, F_noise=0.2, F_grid=0.0)
    cases = ((strokes(), 3e5, 2e5), (sine(cycles=6), 5e5, 2e5))
    runs = [
        Recording.from_arrays(f"b{i}.csv", stand, **record_bench(truth, p1, p2, motion, seed=i, sensors=fine))
        for i, (motion, p1, p2) in enumerate(cases)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thinning, "LONG", long)
        return fit(Plant(stand, "lugre"), runs)


def prepared(recordings: list[Recording], stand: Rig) -> tuple[Run, ...]:
    plant = Plant(stand, "lugre")
    noise = noise_of(stand, recordings)
    return tuple(prepare(run, plant, noise) for run in recordings)


# --- the result ---


@pytest.mark.parametrize("fitted", [servo_fit, bench_fit])
def test_a_long_record_ends_where_it_ends_without_sections(fitted):
    few, whole = fitted(LONG), fitted(10**9)
    assert (few.stage, whole.stage) == ("exact", "exact")
    assert few.loose is None and whole.loose is not None, "only the first goes by sections"
    assert few.cost_per_sample == pytest.approx(whole.cost_per_sample, rel=1e-5)
    assert few.problem.total_samples == whole.problem.total_samples
    for j, name in enumerate(few.problem.free):
        off = (few.values[name] - whole.values[name]) / whole.spread.std[j]
        assert abs(off) < 0.05, f"{name} is {off:.3f} standard errors off"
    assert few.spread.std == pytest.approx(whole.spread.std, rel=0.03)
    # both stop where some iterations gain less than 1e-4, the first in fact lower
    assert few.relaxed_cost < 1.001 * whole.relaxed_cost
    assert few.relaxed_cost == pytest.approx(whole.relaxed_cost, rel=5e-3)


def test_what_one_run_has_for_itself_is_found_from_sections_too():
    found = servo_fit(LONG)
    j = found.problem.free.index("mass@s7.csv")
    assert abs(found.values["mass@s7.csv"] - 3.2) < 4 * found.spread.std[j] < 0.05
    assert abs(found.values["Fc"] / TRUTH["Fc"] - 1) < 2e-3


def test_the_loose_cost_is_found_when_asked_for():
    for fitted in (servo_fit, bench_fit):
        assert fitted(LONG).loose_cost == pytest.approx(fitted(10**9).loose_cost, rel=2e-3)
    assert servo_fit(LONG).problem.relaxation == TIGHT, "asking changes nothing"


@pytest.mark.parametrize(("away", "ends"), [(0.005, True), (0.1, True), (3.0, False)])
def test_a_path_close_to_its_optimum_ends_a_step_further_without_slopes_there(away, ends):
    found = servo_fit(10**9)
    path = Chained(found.exact_problem)
    X = path.from_base(found.exact.X)
    j = found.problem.free.index("Fc")
    X[j] += away * found.spread.std[j] / path.scaling.slope(X[: path.nq])[j]
    at = solver._Evaluator(path, True, "continuous", solver.CLOSE, None, np.inf)
    cost, g = at.value(X)
    at.derivatives(X)
    assert at.after_iteration(X, cost, g) is ends
    if away == 0.1:
        assert at.best[0] < cost and abs(at.best[1][j] - X[j]) > 0, "the step's end is the best point"


def test_sections_that_end_badly_are_forgotten(monkeypatch):
    stand = rig()
    monkeypatch.setattr(by_sections, "sharpened", lambda *_: None)
    monkeypatch.setattr(thinning, "LONG", 9000)
    monkeypatch.setattr(thinning, "ENOUGH", 4000)
    runs = [servo_run(kind, bar, 5 + bar) for kind, bar in (("multisine", 5), ("steps", 7), ("slow", 3))]
    stages: list[tuple[str, int]] = []
    found = fit(Plant(stand, "lugre"), runs, monitor=lambda stage, k, _cost: stages.append((stage, k)))
    assert found.stage == "exact" and found.loose is not None
    assert stages.count(("relaxed", 1)) == 6, "two relaxed stages of the sections, of others, and of the whole"


@pytest.mark.parametrize("stage", ["relaxed", "continuous"])
def test_a_fit_stopped_in_its_sections_hands_back_the_whole_record(stage, monkeypatch):
    monkeypatch.setattr(thinning, "LONG", 9000)
    monkeypatch.setattr(thinning, "ENOUGH", 4000)
    runs = [servo_run(kind, bar, 5 + bar) for kind, bar in (("multisine", 5), ("steps", 7), ("slow", 3))]

    def stop(now: str, _iteration: int, _cost: float) -> None:
        if now == stage:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as stopped:
        fit(Plant(rig(), "lugre"), runs, monitor=stop)
    best = stopped.value.best
    assert best.problem.total_samples == 9000 and best.stage == "relaxed" and best.status.startswith("interrupted")
    assert all(np.isfinite(value) for value in best.values.values())


@pytest.mark.parametrize(("stage", "ended"), [("continuous", "relaxed"), ("relaxed", "exact")])
def test_a_fit_stopped_on_the_whole_record_keeps_what_its_sections_found(stage, ended, monkeypatch):
    monkeypatch.setattr(thinning, "LONG", 9000)
    monkeypatch.setattr(thinning, "ENOUGH", 4000)
    known: list[dict[str, float]] = []
    whole = by_sections._whole

    def from_here(task: Task, problem: Shooting, soft: Relaxed, sharp: Exact) -> object:
        known.append(values_at(sharp.problem, sharp.outcome.X))
        return whole(task, problem, soft, sharp)

    def stop(now: str, iteration: int, _cost: float) -> None:
        if known and now == stage and iteration > 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(by_sections, "_whole", from_here)
    runs = [servo_run(kind, bar, 5 + bar) for kind, bar in (("multisine", 5), ("steps", 7), ("slow", 3))]
    with pytest.raises(Interrupted) as stopped:
        fit(Plant(rig(), "lugre"), runs, monitor=stop)
    best = stopped.value.best
    assert best.stage == ended and best.problem.total_samples == 9000 and best.status.startswith("interrupted")
    if ended == "relaxed":
        assert {name: best.values[name] for name in known[0]} == pytest.approx(known[0])
    else:
        assert best.values["Fc"] == pytest.approx(TRUTH["Fc"], rel=0.01)


# --- sections ---


@cache
def struck() -> tuple[Run, ...]:
    """Prepared runs of 31 000 samples: contacts marked in the first, the second half masked."""
    runs = prepared(long_runs(rig()), rig())
    touching = np.zeros(runs[0].n, dtype=bool)
    touching[500:600] = True
    masked = runs[1].data.copy()
    masked[-3:, : runs[1].n // 2] = 0.0
    return replace(runs[0], contact=touching), replace(runs[1], data=masked), runs[2]


def test_a_point_where_nothing_sees_a_variable_does_not_end_a_fit(monkeypatch):
    """How far the optimum is cannot be told there; the solver goes on without."""

    def singular(*_: object) -> None:
        raise RuntimeError("Factor is exactly singular")

    plant = Plant(rig("servo"), "lugre")
    usual = fit(plant, [servo_run("multisine", 5, 1)])
    monkeypatch.setattr("pneuid.estimation.solver.factorised", singular)
    found = fit(plant, [servo_run("multisine", 5, 1)])
    assert usual.stage == found.stage == "exact"
    assert found.cost_per_sample == pytest.approx(usual.cost_per_sample, rel=1e-5)


def test_a_section_is_cut_from_everything_that_a_run_has():
    run = struck()[0]
    part = section(run, 400, 700)
    assert part.n == part.t.size == part.contact.size == part.recording.n == part.motion.a.size == 300
    assert np.array_equal(part.contact, run.contact[400:700]) and part.contact.sum() == 100
    assert np.array_equal(part.weights, run.weights[:, 400:700])
    assert np.array_equal(part.measured("p1"), run.measured("p1")[400:700])
    assert np.array_equal(part.recording.signals["p1"], run.recording.signals["p1"][400:700])
    assert (part.name, part.own, part.t[0]) == (run.name, run.own, run.t[400])
    problem = Shooting(Plant(rig(), "lugre"), [part], ["Fc"], _values([part]), _ranges(), 2)
    assert problem.stretches.tolist() == [0, 10], "the model starts anew behind the contact"


def test_sections_are_spread_over_all_runs_and_leave_out_what_is_masked():
    runs = struck()
    few = sections(runs)
    first = {run.name: [one.t[0] for one in few if one.name == run.name] for run in runs}
    assert first["s5.csv"][0] == 0.0 and first["s3.csv"][0] == 0.0
    assert len(first["s5.csv"]) > len(first["s7.csv"]) > 0, "a longer run gives more"
    assert min(first["s7.csv"]) > 2.0, "the first half of that run is masked"
    assert few[-1].t[-1] == runs[-1].t[-1]
    others = sections(runs, 1)
    assert not {(one.name, one.t[0]) for one in few} & {(one.name, one.t[0]) for one in others}
    assert 0.15 < sum(one.n for one in few) / sum(run.n for run in runs) < 0.35
    twice = replace(runs[0].own, free=("mass",))
    assert [item.name for item in declared(Plant(rig(), "lugre"), [twice, twice])][-1] == "mass@s5.csv"
    assert len(declared(Plant(rig(), "lugre"), [twice, twice])) == len(Plant(rig(), "lugre").parameters) + 1


def test_a_short_record_has_no_sections():
    run = struck()[0]
    assert sections([run, run]) == ()
    pieces = [section(run, first, first + 400) for first in range(0, 12_000, 400)] * 3
    assert sections(pieces) == (), "a section of each of so many runs would be the whole record"


def _values(runs: list[Run]) -> dict[str, float]:
    return Task(Plant(rig(), "lugre"), [], tuple(runs), {}, None).guess | TRUTH


def _ranges() -> dict[str, float]:
    return data_ranges([run.recording for run in struck()], Plant(rig(), "lugre"))


# --- slopes of a coarser step ---


def test_a_refined_path_has_the_fine_residual_and_nearly_the_fine_slopes():
    runs = [section(struck()[0], 1000, 3000)]
    plant, values = Plant(rig(), "lugre"), _values(runs)
    fine, coarse = (Shooting(plant, runs, list(TRUTH), values, _ranges(), substeps) for substeps in (16, 2))
    nodes = first_nodes(plant, runs, motions(runs), values, 20)
    X = fine.join(fine.scaling.to_q(np.array([values[name] for name in TRUTH])), nodes)
    exact, refined = Chained(fine), Refined(fine, coarse)
    at = exact.from_base(X)
    true, near = exact.evaluate(at), refined.evaluate(at)
    assert np.array_equal(true.end, near.end)
    assert near.gram[0, -1, -1] == pytest.approx(true.gram[0, -1, -1], rel=1e-9)
    assert 0.5 * near.gram[0, -1, -1] == pytest.approx(exact.evaluate_values(at)[1], rel=1e-9)
    nq = len(TRUTH)
    information = np.diag(true.gram[0])[:nq]
    assert np.diag(near.gram[0])[:nq] == pytest.approx(information, rel=0.1)

    # data that the fine step explains to the last digit: there its fit is at the optimum, and the coarse one's is not
    run = Trajectories(fine.function.trajectory, exact.lengths)
    shown = run(exact.split(at)[1], fine.data, fine.theta(at[:nq]))[0].reshape(-1, len(plant.outputs)).T
    for problem in (fine, coarse):
        problem.data[-6:-3] = shown
    refined, rough = (problem.evaluate(at).gram[0, :nq, -1] for problem in (Refined(fine, coarse), Chained(coarse)))
    assert np.max(np.abs(refined) / np.sqrt(information)) < 1e-6
    assert np.max(np.abs(rough) / np.sqrt(information)) > 0.3


# --- the spline ---


@pytest.mark.parametrize("even", [True, False])
def test_the_smoothing_spline_is_the_one_of_least_curvature(even):
    rng = np.random.default_rng(4)
    t = 1e-3 * np.cumsum(np.ones(900) if even else rng.uniform(0.6, 1.4, 900))
    x = 0.2 + 0.05 * np.sin(9.0 * t) + 2e-5 * rng.standard_normal(t.size)
    found = spline_motion(t, x, 2e-5)
    step = float(np.median(np.diff(t)))
    lam = (1.0 / (2 * np.pi * step * found.bandwidth)) ** 4
    spline = make_smoothing_spline((t - t[0]) / step, x, lam=lam)
    s = (t - t[0]) / step
    for mine, of_scipy in ((found.x, spline(s)), (found.v * step, spline(s, 1)), (found.a * step**2, spline(s, 2))):
        assert np.max(np.abs(mine - of_scipy)) < 1e-7 * np.max(np.abs(of_scipy))


def test_a_relaxed_cost_that_is_known_is_not_sought_again(monkeypatch):
    monkeypatch.setattr("pneuid.estimation.stages.solve_relaxed", lambda *_: pytest.fail("solved"))
    assert loose_cost(None, Relaxed(None, 0.1, 12.0)) == 12.0


def test_the_whole_starts_from_the_parameters_of_its_sections_and_the_states_that_begin_a_run():
    runs, plant = struck(), Plant(rig(), "lugre")
    few = sections(runs)
    values, ranges = _values(list(runs)), _ranges()
    whole, part = (Shooting(plant, held, ["Fc", "C"], values, ranges, 2) for held in (runs, few))
    rng = np.random.default_rng(5)
    X, known = (problem.scaling.lower.mean() + rng.uniform(size=problem.size) for problem in (whole, part))
    X[:2], known[:2] = (whole.scaling.to_q(np.array(q)) for q in ((9.0, 1e-8), (12.0, 1.2e-8)))
    outcome = Outcome(known, 0.0, 0.0, "done", True, 0, 0.0)
    started = by_sections._starting(whole, X, Exact(outcome, part, None))
    q, nodes = whole.split(started)
    assert whole.scaling.to_values(q) == pytest.approx([12.0, 1.2e-8])
    first = {(one.name, one.t[0]): at for one, at in zip(few, part.first[:-1], strict=True)}
    own, found = whole.split(X)[1], part.split(known)[1]
    for run, at in zip(runs, whole.first[:-1], strict=True):
        same = found[:, first[run.name, 0.0]] if (run.name, 0.0) in first else own[:, at]
        assert nodes[:, at] == pytest.approx(same)
    assert nodes[:, 1] == pytest.approx(own[:, 1])
    assert ("s7.csv", 0.0) not in first, "that run begins masked"
