"""Intervals in the lanes of a vector: the same numbers as one interval after the other, for every operation and every chain."""

from __future__ import annotations

import ctypes
import math
import multiprocessing

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, rig, servo_run, values_of
from hypothesis import given, settings
from hypothesis import strategies as st

import pneuid.interval
import pneuid.mapped
from pneuid.compiled import compiled_library
from pneuid.effects import CATALOGUE
from pneuid.estimation.preparation import noise_of, prepare
from pneuid.interval import interval_function, jacobian_function
from pneuid.lanes import Body, SideBySide, side_by_side, source
from pneuid.mapped import Ends, Mapped, Slopes, Trajectories
from pneuid.plant import Plant
from pneuid.vectors import OPERATIONS, NoLanesError

K, SUBSTEPS = 5, 2
WIDTHS = (4, 8)


def entry(part: ca.Function, lanes: int) -> SideBySide:
    """One function of ``s`` (n) and ``theta`` (m) over lanes, without samples."""
    sizes = {"start": part.numel_in(0), "theta": part.numel_in(1)}
    body = Body("part(start, theta, part_constant, found_);", ("part",), sizes, {"found": part.numel_out(0)})
    library = compiled_library(source({"part": part}, {"one": body}, lanes), "pneuid_lanes_test")
    assert library is not None, "this machine's compiler has no vectors: the speed of pneuid is not there"
    return SideBySide(library, "one", body, lanes, 1)


def run(part: ca.Function, s: np.ndarray, theta: np.ndarray, lanes: int, threads: int = 1) -> np.ndarray:
    """``(count, rows)`` found for ``s`` and ``theta``, a row each."""
    found = np.full((len(s), part.numel_out(0)), np.nan)
    edges = np.arange(len(s) + 1, dtype=ctypes.c_long)
    entry(part, lanes)([np.ascontiguousarray(s), np.ascontiguousarray(theta)], [found.reshape(-1)], edges, threads)
    return found


def part(result, s: ca.SX, theta: ca.SX) -> ca.Function:
    return ca.Function("part", [s, theta], [ca.densify(ca.vertcat(*result))], ["s", "theta"], ["r"])


# --- operations ---

UNARY = {
    "exp": ca.exp, "expm1": ca.expm1, "log": lambda x: ca.log(ca.fabs(x)), "log1p": lambda x: ca.log1p(ca.fabs(x)),
    "sqrt": lambda x: ca.sqrt(ca.fabs(x)), "sin": ca.sin, "cos": ca.cos, "tan": ca.tan, "asin": lambda x: ca.asin(ca.tanh(x)),
    "acos": lambda x: ca.acos(ca.tanh(x)), "atan": ca.atan, "sinh": ca.sinh, "cosh": ca.cosh, "tanh": ca.tanh, "erf": ca.erf,
    "floor": ca.floor, "ceil": ca.ceil, "fabs": ca.fabs, "sign": ca.sign, "square": lambda x: x * x, "twice": lambda x: x + x,
    "inverse": lambda x: 1.0 / x, "negative": lambda x: -x, "cube": lambda x: x**3, "root": lambda x: ca.fabs(x) ** 1.7,
    "not": lambda x: ca.logic_not(x > 0.5),
}  # fmt: skip
BINARY = {
    "add": lambda x, y: x + y, "subtract": lambda x, y: x - y, "times": lambda x, y: x * y, "divide": lambda x, y: x / y,
    "power": lambda x, y: ca.fabs(x) ** y, "fmod": ca.fmod, "atan2": ca.atan2, "hypot": ca.hypot, "copysign": ca.copysign,
    "fmin": ca.fmin, "fmax": ca.fmax, "less": lambda x, y: x < y, "at most": lambda x, y: x <= y, "equal": lambda x, y: x == y,
    "other": lambda x, y: x != y, "and": lambda x, y: ca.logic_and(x > 0.0, y > 0.0),
    "or": lambda x, y: ca.logic_or(x > 0.0, y > 0.0), "truth of numbers": ca.logic_and,
    "if": lambda x, y: ca.if_else(x > 0.0, y, x), "if a number": lambda x, y: ca.if_else(x, y, -y),
}  # fmt: skip


@pytest.mark.parametrize("lanes", WIDTHS)
def test_every_operation_gives_casadis_number(lanes):
    s, theta = ca.SX.sym("s", 2), ca.SX.sym("theta", 2)
    x, y = s[0], theta[1]
    function = part([make(x) for make in UNARY.values()] + [make(x, y) for make in BINARY.values()], s, theta)
    used = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert set(OPERATIONS) - used <= {ca.OP_ASSIGN}, "an operation that no line of this test makes"
    rng = np.random.default_rng(5)
    given_s, given_theta = rng.normal(0.0, 3.0, (37, 2)), rng.normal(0.0, 3.0, (37, 2))
    given_s[:3, 0], given_theta[3:6, 1] = (0.0, 1.0, -1.0), given_s[3:6, 0]
    found = run(function, given_s, given_theta, lanes)
    for i, (one, other) in enumerate(zip(given_s, given_theta, strict=True)):
        expected = np.asarray(function(one, other)).ravel()
        fine = np.isfinite(expected)
        np.testing.assert_allclose(found[i][fine], expected[fine], rtol=2e-14, atol=1e-300)


@settings(deadline=None)
@given(st.lists(st.one_of(st.floats(-745.0, 709.0), st.floats(-1e-3, 1e-3)), min_size=1, max_size=40))
def test_the_exponential_is_right_to_some_units_in_the_last_place(numbers):
    s, theta = ca.SX.sym("s"), ca.SX.sym("theta")
    found = run(part([ca.exp(s), ca.expm1(s)], s, theta), np.array(numbers)[:, None], np.zeros((len(numbers), 1)), 4)
    for x, (whole, less) in zip(numbers, found, strict=True):
        assert whole == pytest.approx(math.exp(x), rel=1e-15, abs=1e-300)
        assert less == pytest.approx(math.expm1(x), rel=1e-15, abs=1e-300)


def test_a_lane_that_overflows_leaves_the_others_alone():
    s, theta = ca.SX.sym("s"), ca.SX.sym("theta")
    numbers = np.array([[1.0], [np.inf], [2.0], [np.nan], [3.0]])
    found = run(part([ca.exp(s) * ca.exp(s)], s, theta), numbers, np.zeros((5, 1)), 4)[:, 0]
    np.testing.assert_allclose(found[[0, 2, 4]], np.exp([2.0, 4.0, 6.0]), rtol=1e-14)
    assert not np.isfinite(found[[1, 3]]).any()


@pytest.mark.parametrize("lanes", WIDTHS)
@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 33])
def test_any_number_of_intervals_on_any_number_of_threads(lanes, threads, count):
    s, theta = ca.SX.sym("s", 2), ca.SX.sym("theta", 3)
    function = part([s[0] / theta[0] + s[1] / theta[0], ca.exp(theta[1]) * s[1], theta[2]], s, theta)
    rng = np.random.default_rng(count)
    given_s, given_theta = rng.normal(size=(count, 2)), rng.normal(size=(count, 3))
    expected = np.column_stack([
        given_s.sum(axis=1) / given_theta[:, 0], np.exp(given_theta[:, 1]) * given_s[:, 1], given_theta[:, 2]
    ])  # fmt: skip
    np.testing.assert_allclose(run(function, given_s, given_theta, lanes, threads), expected, rtol=1e-13)


def test_an_operation_without_c_leaves_the_intervals_one_by_one(monkeypatch):
    monkeypatch.setattr("pneuid.vectors.OPERATIONS", {})
    s, theta = ca.SX.sym("s"), ca.SX.sym("theta")
    with pytest.raises(NoLanesError):
        source({"part": part([ca.sin(s)], s, theta)}, {"one": Body("", ("part",), {}, {})}, 4)
    assert side_by_side({"part": part([ca.sin(s)], s, theta)}, {"one": Body("", ("part",), {}, {})}, 1, "pneuid") == {}


# --- chains ---


def inputs(plant: Plant, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start states, data and parameters of ``count`` intervals of a recording, each with numbers of its own."""
    recording = servo_run("multisine", 5, 11)
    held = prepare(recording, plant, noise_of(plant.rig, [recording]))
    rng = np.random.default_rng(7)
    first = rng.integers(500, held.n - K, count)
    data = np.hstack([held.data[:, k : k + K] for k in first])
    given = {"x": held.motion.x[first], "v": held.motion.v[first]}
    measured = dict(zip(plant.outputs, held.data[-2 * len(plant.outputs) : -len(plant.outputs)][:, first], strict=True))
    nodes = np.zeros((len(plant.states), count))
    for i, name in enumerate(plant.states):
        nodes[i] = given.get(name, measured.get(name, 1e-6 * rng.normal(size=count)))
    theta = np.tile(plant.theta(values_of(plant), RANGES)[:, None], (1, count))
    return nodes, data, theta * (1.0 + 1e-3 * rng.random(count))


@pytest.mark.parametrize("effects", [(), *((name,) for name in CATALOGUE)], ids=lambda names: "+".join(names) or "none")
def test_every_effect_runs_side_by_side_like_one_by_one(effects):
    chosen = [CATALOGUE[name] for name in effects]
    plant = Plant(rig(), "lugre", chosen)
    if any("servo" not in effect.rigs or plant.law.name not in effect.laws for effect in chosen):
        pytest.skip("no effect of a servo rig with this friction law")
    count, free = 11, plant.parameter_names
    arguments = inputs(plant, count)
    function = interval_function(plant, free, K, SUBSTEPS)
    chains = pneuid.interval._chains(plant, free, K, SUBSTEPS)
    built = {
        "values": function.values, "trajectory": function.trajectory, "derivatives": function.derivatives,
        "jacobian": jacobian_function(plant, free, K, SUBSTEPS),
    }  # fmt: skip
    for name, one in built.items():
        assert one in pneuid.mapped._TWINS, "this effect holds an operation that is not written for lanes"
        expected = chains[name]().map(count)(*arguments)
        for found, other in zip(Mapped(one, count, 2)(*arguments), expected, strict=True):
            wanted = np.asarray(other)
            blocks = np.abs(wanted).reshape(wanted.shape[0], count, -1).max(axis=(0, 2))
            size = np.repeat(blocks, wanted.shape[1] // count)
            assert np.all(np.abs(found - wanted) <= 1e-9 * np.abs(wanted) + 1e-11 * size), name


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("kind", "name", "free"),
    [(Ends, "values", 0), (Trajectories, "trajectory", 0), (Slopes, "derivatives", 0), (Slopes, "derivatives", 8)],
)
def test_windows_of_any_length_run_side_by_side_like_one_by_one(kind, name, free, threads, monkeypatch):
    plant = Plant(rig(), "lugre")
    lengths = np.array([*range(1, 20), *range(30, 3, -1)])
    _, data, theta = inputs(plant, lengths.sum())
    start, _, _ = inputs(plant, lengths.size)
    theta = np.repeat(theta[:, : lengths.size], lengths, axis=1)
    chain = getattr(interval_function(plant, plant.parameter_names[:free], K, SUBSTEPS), name)
    beside = kind(chain, lengths, threads)(start, data, theta)
    monkeypatch.delitem(pneuid.mapped._TWINS, chain)
    for found, wanted in zip(beside, kind(chain, lengths)(start, data, theta), strict=True):
        size = np.abs(wanted).max(axis=0) + 1e-300
        np.testing.assert_allclose(found / size, wanted / size, rtol=1e-8, atol=1e-9)


def _in_a_child(queue) -> None:
    plant = Plant(rig(), "lugre")
    arguments = inputs(plant, 64)
    queue.put(Mapped(interval_function(plant, (), K, SUBSTEPS).values, 64, 2)(*arguments)[0])


@pytest.mark.parametrize("way", ["fork", "spawn"])
def test_a_child_process_has_threads_of_its_own(way):
    if way not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {way} here")
    plant = Plant(rig(), "lugre")
    here = Mapped(interval_function(plant, (), K, SUBSTEPS).values, 64, 2)(*inputs(plant, 64))[0]
    context = multiprocessing.get_context(way)
    queue = context.Queue()
    child = context.Process(target=_in_a_child, args=(queue,))
    child.start()
    try:
        np.testing.assert_array_equal(queue.get(timeout=120), here)
    finally:
        child.kill()


def test_without_vectors_the_chains_are_compiled_one_by_one(monkeypatch):
    plant = Plant(rig(), "lugre")
    monkeypatch.setattr("pneuid.interval.side_by_side", lambda *_: {})
    pneuid.interval._build.forget()
    try:
        plain = interval_function(plant, plant.parameter_names, K, SUBSTEPS)
        assert plain.compiled and plain.derivatives.is_a("External", True) and plain.derivatives not in pneuid.mapped._TWINS
        arguments = inputs(plant, 20)
        alone = Mapped(plain.values, 20)(*arguments)
    finally:
        pneuid.interval._build.forget()
    monkeypatch.undo()
    beside = Mapped(interval_function(plant, plant.parameter_names, K, SUBSTEPS).values, 20)(*arguments)
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9)
