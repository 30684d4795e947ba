"""Computations in copies of this process: the same results in the same order, and nothing left behind."""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import signal
import threading
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from pneuid import ahead, compiled
from pneuid.ahead import Ahead, in_turn, is_copy, may_begin
from pneuid.cores import threads
from pneuid.errors import UserError
from pneuid.estimation.exact_end import likely_end
from pneuid.estimation.fit import Fit, sharper
from pneuid.estimation.solver import solve_relaxed_again
from pneuid.estimation.stages import Relaxed
from pneuid.estimation.task import Task
from tests.helpers import base_fit

needs_copies = pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no process has copies here")


@pytest.fixture
def two_cores(monkeypatch):
    """What is asked for is made in copies of this process."""
    monkeypatch.setenv("PNEUID_THREADS", "2")
    if not may_begin():
        pytest.skip("no process has copies here")


def _of(number: int, seconds: float = 0.0) -> tuple[int, int, bool]:
    time.sleep(seconds)
    return number, os.getpid(), is_copy()


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def _ended_soon(process: int) -> bool:
    until = time.monotonic() + 10.0
    while _alive(process) and time.monotonic() < until:
        time.sleep(0.01)
    return not _alive(process)


def test_results_come_in_the_order_of_the_jobs_from_copies(two_cores):
    # the first takes longest
    found = list(in_turn([partial(_of, k, 0.3 if k == 0 else 0.0) for k in range(5)]))
    assert [number for number, _, _ in found] == list(range(5))
    assert all(there for _, _, there in found[:-1]) and os.getpid() not in {process for _, process, _ in found[:-1]}
    assert not is_copy()


def test_on_one_core_everything_is_made_here_when_it_is_asked_for(monkeypatch):
    monkeypatch.setenv("PNEUID_THREADS", "1")
    made = []
    jobs = [partial(lambda k: made.append(k) or _of(k), k) for k in range(3)]
    every = in_turn(jobs)
    assert next(every) == (0, os.getpid(), False) and made == [0]
    every.close()
    assert made == [0]


def test_a_copy_begins_none_itself(two_cores):
    assert next(in_turn([may_begin, may_begin])) is False


def test_copies_share_the_cores(monkeypatch):
    monkeypatch.setenv("PNEUID_THREADS", "4")
    if not may_begin():
        pytest.skip("no process has copies here")
    assert next(in_turn([threads, threads])) == 2
    assert list(in_turn([threads] * 9))[:-1] == [1] * 8


@pytest.mark.parametrize(("largest", "most"), [(0.6, 0), (0.4, 2), (0.3, 3), (0.01, 4)])
def test_no_more_copies_are_begun_than_fit_into_memory(largest, most, two_cores, monkeypatch):
    """Each may grow as large as this process has been; ``largest`` is that, in units of what all may take together."""
    monkeypatch.setenv("PNEUID_THREADS", "8")
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 2**20}.__getitem__)
    kilobytes = largest * ahead.SHARE_OF_MEMORY * 4 * 2**20
    monkeypatch.setattr("resource.getrusage", lambda _: SimpleNamespace(ru_maxrss=kilobytes))
    assert Ahead([_refused] * 4)._most == most


def test_a_daemon_begins_none(two_cores, monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)  # as it is in the workbench's worker
    assert not may_begin()


def _refused() -> int:
    raise UserError("run_1.csv: no column 'p1'")


def test_the_error_of_a_job_is_raised_where_its_result_is_asked_for(two_cores):
    every = Ahead([partial(_of, 0), _refused, partial(_of, 2)])
    every.begin()
    assert every.result(0)[0] == 0
    with pytest.raises(UserError, match="no column 'p1'"):
        every.result(1)
    assert every.result(2)[0] == 2


def _dies() -> int:
    if is_copy():
        os.kill(os.getpid(), signal.SIGKILL)
    return 7


def _cannot_come() -> int:
    return (lambda: 7) if is_copy() else 7  # type: ignore[return-value]


@pytest.mark.parametrize("job", [_dies, _cannot_come])
def test_what_a_copy_cannot_bring_is_made_here(job, two_cores):
    if job is _cannot_come:
        with pytest.raises((pickle.PicklingError, AttributeError)):
            next(in_turn([job, job]))
    else:
        assert next(in_turn([job, job])) == 7


def _one(shared: object) -> tuple[object, str]:
    return shared, "found"


def test_what_both_sides_have_stays_what_it_is(two_cores):
    shared = lambda: None  # noqa: E731 - such a thing cannot be pickled
    found, word = next(in_turn([partial(_one, shared), partial(_one, shared)], [shared]))
    assert found is shared and word == "found"


def test_one_job_alone_is_made_here_and_those_that_follow_in_copies(two_cores):
    told = []
    every = Ahead([partial(_of, k) for k in range(5)], coming=told.append)
    assert every.result(0) == (0, os.getpid(), False) and told == [1]
    assert every.result(1)[2] and every.result(2)[2] and told[1:4] == [1, 2, 3]
    leaped = Ahead([partial(_of, k) for k in range(5)])
    assert not leaped.result(0)[2] and not leaped.result(3)[2]


def test_what_nobody_asks_for_is_given_up(two_cores):
    every = Ahead([partial(_of, 0), partial(_of, 1, 60.0), partial(_of, 2, 60.0)])
    every.begin()
    every.result(0)
    begun = [one._process.pid for one in every._begun.values()]
    assert begun and all(_alive(process) for process in begun)
    del every
    assert all(_ended_soon(process) for process in begun)


def test_jobs_before_the_one_that_is_asked_for_are_given_up(two_cores):
    every = Ahead([partial(_of, 0, 60.0), partial(_of, 1, 60.0), partial(_of, 2), partial(_of, 3)])
    every.begin()
    begun = [one._process.pid for one in every._begun.values()]
    assert every.result(2)[0] == 2
    assert len(begun) == 2 and all(_ended_soon(process) for process in begun)


def _forgets(every: list[Ahead[tuple[int, int, bool]]]) -> bool:
    every.clear()
    return is_copy()


def test_a_copy_leaves_other_copies_alone(two_cores):
    held = [Ahead([partial(_of, k, 60.0) for k in range(2)])]
    held[0].begin()
    begun = [one._process for one in held[0]._begun.values()]
    assert next(in_turn([partial(_forgets, held), partial(_forgets, held)]))
    assert all(process.is_alive() for process in begun)
    held.clear()
    assert not any(process.is_alive() for process in begun)


def test_one_job_needs_no_copy(two_cores):
    assert list(in_turn([partial(_of, 0)])) == [(0, os.getpid(), False)]


def test_an_interrupt_ends_the_copies(two_cores):
    every = Ahead([partial(_of, k, 60.0) for k in range(3)])
    every.begin()

    def stop(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            every.result(0)
        begun = [one._process.pid for one in every._begun.values()]
        every.close()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert begun and all(_ended_soon(process) for process in begun)


# --- what fits do with them ---


def test_a_problem_goes_to_another_process_and_comes_back():
    problem = base_fit("leakage_internal").problem
    shared = [problem.plant, *problem.runs]
    content = ahead.io.BytesIO()
    ahead._Pickler(content, shared).dump(problem)
    again = ahead._Unpickler(content.getvalue(), shared).load()
    assert again.plant is problem.plant and again.runs == problem.runs and again.free == problem.free
    assert (again.smoothing, again.relaxation, again.substeps) == (problem.smoothing, problem.relaxation, problem.substeps)
    X = base_fit("leakage_internal").relaxed.X
    assert again.evaluate_values(X)[1] == problem.evaluate_values(X)[1]
    assert len(content.getvalue()) < 20_000  # recordings stay where they are


def test_a_copy_of_a_problem_shares_what_it_holds():
    problem = base_fit("leakage_internal").problem
    other = copy.copy(problem)
    other.relaxation = 7.0
    assert other.data is problem.data and other.function is problem.function and problem.relaxation != 7.0


def _on(cores: int, monkeypatch, make):
    monkeypatch.setenv("PNEUID_THREADS", str(cores))
    return make()


@needs_copies
def test_a_fit_is_the_same_on_one_core_and_on_two(monkeypatch):
    base = base_fit("leakage_internal")
    alone, beside = (_on(cores, monkeypatch, partial(sharper, base)) for cores in (1, 2))
    assert alone.values == beside.values and alone.relaxed_cost == beside.relaxed_cost
    assert (alone is base) == (beside is base)


@needs_copies
@pytest.mark.parametrize("directly", [True, False])
def test_the_way_to_the_exact_fit_is_the_same_on_one_core_and_on_two(directly, monkeypatch):
    """Straight, and where that leads nowhere by paths that are cut and windows that merge."""
    base = base_fit()
    task = Task(base.plant, [run.recording for run in base.runs], base.runs, {}, None, again=True)
    soft = Relaxed(base.relaxed, base.defect_level, base.loose)
    if not directly:
        monkeypatch.setattr("pneuid.estimation.exact_end.exact_directly", lambda *_: None)
    alone, beside = (_on(cores, monkeypatch, partial(likely_end, task, base.problem, soft)) for cores in (1, 2))
    assert alone.hard is not None and beside.hard is not None
    np.testing.assert_array_equal(alone.hard.outcome.X, beside.hard.outcome.X)
    np.testing.assert_array_equal(alone.hard.spread.std, beside.hard.spread.std)


def test_a_copy_waits_for_what_its_parent_compiles(tmp_path, monkeypatch):
    source, began = "int nothing;", time.monotonic()
    tool = compiled.compiler()
    if tool is None:
        pytest.skip("no compiler here")
    monkeypatch.setenv("PNEUID_CACHE", str(tmp_path))
    library = compiled._library(source, "waited", tool)
    monkeypatch.setattr(compiled, "_BEGUN", {(os.getppid(), library): None})
    monkeypatch.setattr(compiled, "_build", lambda *_: pytest.fail("compiled twice"))
    threading.Timer(0.3, library.touch).start()
    assert compiled.compiled_library(source, "waited") == library
    assert time.monotonic() - began < 0.5 * compiled._PATIENCE_SECONDS


def _told(base: Fit) -> int:
    told = []
    solve_relaxed_again(base.problem, base.relaxed.X, lambda *_: told.append(1))
    return len(told)


def test_a_copy_reports_to_nobody(two_cores):
    """Its monitor would be the progress bar of the process that it was copied from."""
    base = base_fit("leakage_internal")
    assert _told(base) > 0
    assert next(in_turn([partial(_told, base), partial(_told, base)])) == 0
