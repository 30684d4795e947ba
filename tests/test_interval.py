"""The compiled interval function, and what simulation and the solver build on it: all against slower ways to the same."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, TRUTH, rig, servo_run, values_of

import pneuid.compiled
import pneuid.interval
from pneuid.compiled import compile_functions
from pneuid.effects import effects_by_name
from pneuid.estimation.assembly import Assembly, relaxed_system
from pneuid.estimation.first_guess import first_nodes
from pneuid.estimation.preparation import Run, data_ranges, noise_of, prepare
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import _Evaluator
from pneuid.estimation.thinning import section
from pneuid.interval import IntervalFunction, data_rows, interval_function
from pneuid.mapped import Mapped
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant, structure_key
from pneuid.simulate import estimate_start, simulate

K, SUBSTEPS = 5, 2


@dataclass(frozen=True)
class Stretch:
    """A plant, its compiled interval function, the same interpreted, and one interval of a real recording."""

    plant: Plant
    run: Run
    function: IntervalFunction
    interpreted: tuple[ca.Function, ca.Function, ca.Function]
    start: np.ndarray
    data: np.ndarray
    theta: np.ndarray

    @property
    def arguments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.start, self.data, self.theta

    @property
    def selected(self) -> list[int]:
        return [self.plant.theta_names.index(name) for name in self.plant.parameter_names]

    @property
    def scales(self) -> np.ndarray:
        """Typical sizes of ``[selected, s]``."""
        return np.concatenate([np.abs(self.theta[self.selected]) + 1e-12, self.plant.state_scales])


@cache
def stretch(*effects: str) -> Stretch:
    recording = servo_run("multisine", 5, 11)
    plant = Plant(rig(), "lugre", effects_by_name(effects))
    run = prepare(recording, plant, noise_of(plant.rig, [recording]))
    values = values_of(plant)
    nodes = first_nodes(plant, [run], [run.motion], values, 1)
    # a sample at which the piston slides slowly, so that every parameter is felt
    first = int(np.flatnonzero((np.abs(run.motion.v[500:]) > 6e-3) & (np.abs(run.motion.v[500:]) < 1e-2))[0]) + 500
    chains = pneuid.interval._chains(plant, plant.parameter_names, K, SUBSTEPS)
    return Stretch(
        plant, run, interval_function(plant, plant.parameter_names, K, SUBSTEPS),
        (chains["values"](), chains["derivatives"](), chains["trajectory"]()),
        nodes[:, first], run.data[:, first : first + K], plant.theta(values, data_ranges([recording], plant)),
    )  # fmt: skip


def _plain(items: Iterable) -> list[np.ndarray]:
    return [np.asarray(item) for item in items]


def _unpacked(packed: np.ndarray, width: int) -> np.ndarray:
    """The full symmetric matrix from its upper triangle by columns."""
    full = np.zeros((width, width))
    at = 0
    for j in range(width):
        full[: j + 1, j] = packed[at : at + j + 1]
        at += j + 1
    return full + np.triu(full, 1).T


# --- compiled code ---


@pytest.mark.parametrize("effects", [(), ("supply_droop",)])
def test_compiled_equals_interpreted(effects):
    at = stretch(*effects)
    assert at.function.compiled, "this machine has no C compiler: the speed of pneuid is not there"
    for one, other in zip(
        (at.function.values, at.function.derivatives, at.function.trajectory), at.interpreted, strict=True
    ):
        for a, b in zip(Mapped(one, 1)(*at.arguments), _plain(other(*at.arguments)), strict=True):
            # fused multiply-add and reordered sums: some hundred roundings of the largest term
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * np.abs(b).max())


def test_values_trajectory_and_derivatives_tell_one_story():
    at = stretch()
    end, cost = _plain(at.function.values(*at.arguments))
    again, sensitivity, packed = _plain(at.function.derivatives(*at.arguments))
    shown, passed = _plain(at.function.trajectory(*at.arguments))
    width = at.function.width
    assert sensitivity.shape == (5, width) and width == 8 + 5
    np.testing.assert_allclose(again, end, rtol=1e-12)
    np.testing.assert_allclose(passed[:, -1:], end, rtol=1e-12)
    np.testing.assert_allclose(passed[:, 0], at.start, rtol=1e-15)
    residual = at.data[-3:] * (shown - at.data[-6:-3])
    assert cost.item() == pytest.approx(np.sum(residual**2), rel=1e-10)
    assert _unpacked(packed.ravel(), width + 1)[-1, -1] == pytest.approx(np.sum(residual**2), rel=1e-10)


def test_sensitivities_agree_with_differences():
    at = stretch("supply_droop")
    _, sensitivity, _ = _plain(at.function.derivatives(*at.arguments))
    names = [*at.plant.parameter_names, *at.plant.states]
    for j, name in enumerate(names):
        h = 1e-5 * at.scales[j]
        ends = []
        for way in (1.0, -1.0):
            start, theta = at.start.copy(), at.theta.copy()
            if j < len(at.selected):
                theta[at.selected[j]] += way * h
            else:
                start[j - len(at.selected)] += way * h
            ends.append(np.asarray(at.function.values(start, at.data, theta)[0]).ravel())
        central = (ends[0] - ends[1]) / (2 * h)
        # the step's second order, and the rounding of states (1e-16 of 5 bar, of 0.3 m) over it
        allowed = 1e-4 * np.abs(sensitivity[:, j]) + 1e-14 * np.abs(at.start).clip(at.plant.state_scales) / h
        assert np.all(np.abs(central - sensitivity[:, j]) <= allowed), f"d end / d {name}"


def test_sensitivities_and_gram_are_those_of_casadi():
    """Against the Jacobian of the chain by CasADi itself: exact up to rounding."""
    at = stretch()
    values, _, trajectory = at.interpreted
    s, theta = ca.MX.sym("s", at.start.size), ca.MX.sym("theta", at.theta.size)
    both = ca.vertcat(theta[at.selected], s)
    outputs = ca.vec(trajectory(s, at.data, theta)[0])
    jacobians = ca.Function(
        "jacobians", [s, theta],
        [ca.horzcat(ca.jacobian(item, theta)[:, at.selected], ca.jacobian(item, s))
         for item in (values(s, at.data, theta)[0], outputs)] + [outputs],
    )  # fmt: skip
    assert both.numel() == at.function.width
    S, J, shown = _plain(jacobians(at.start, at.theta))
    _, sensitivity, packed = _plain(at.function.derivatives(*at.arguments))
    size = np.abs(S).max(axis=0)
    np.testing.assert_allclose(sensitivity / size, S / size, rtol=1e-8, atol=1e-12)
    weight, measured = at.data[-3:].T.ravel(), at.data[-6:-3].T.ravel()
    explicit = np.column_stack([weight[:, None] * J, weight * (shown.ravel() - measured)])
    gram = _unpacked(packed.ravel(), at.function.width + 1)
    size = np.sqrt(np.diag(explicit.T @ explicit))
    assert np.all(size > 0.0)
    np.testing.assert_allclose(gram / np.outer(size, size), explicit.T @ explicit / np.outer(size, size), atol=1e-10)


def test_a_masked_sample_counts_for_nothing_but_moves_on():
    at = stretch()
    masked = at.data.copy()
    masked[-3:, 2:] = 0.0
    masked[-6:-3, 2:] = 9.9e9
    end, cost = _plain(at.function.values(at.start, masked, at.theta))
    shown, _ = _plain(at.function.trajectory(*at.arguments))
    first = at.data[-3:, :2] * (shown[:, :2] - at.data[-6:-3, :2])
    assert cost.item() == pytest.approx(np.sum(first**2), rel=1e-10)
    np.testing.assert_allclose(end, np.asarray(at.function.values(*at.arguments)[0]), rtol=1e-13)


@pytest.mark.parametrize("place", [1, 2, 4])
def test_a_state_that_is_not_a_number_is_not_made_into_one(place):
    # the compiler may assume finite numbers in its shortcuts; a diverged window must be seen all the same
    at = stretch()
    lost = at.start.copy()
    lost[place] = np.nan
    end, cost = _plain(at.function.values(lost, at.data, at.theta))
    assert not np.all(np.isfinite(end)) and not np.isfinite(cost.item())


def test_compiled_code_leaves_small_numbers_alone():
    # a library linked with -ffast-math makes the whole process flush them to zero (gcc up to 12)
    at = stretch()
    at.function.values(*at.arguments)
    assert np.all(np.array([4e-310, 2e-320]) * 0.5 > 0.0)


@pytest.fixture
def forget_builds():
    """Interval functions built in the test are forgotten after it."""
    yield
    pneuid.interval._build.forget()


@pytest.mark.parametrize("tool", [None, ("/bin/false", "a compiler that fails")])
def test_without_a_working_compiler_the_same_function_runs_interpreted(tool, monkeypatch, tmp_path, forget_builds):
    at = stretch()
    pneuid.interval._build.forget()
    monkeypatch.setattr(pneuid.compiled, "compiler", lambda: tool)
    monkeypatch.setenv("PNEUID_CACHE", str(tmp_path / "cache"))
    slow = interval_function(at.plant, at.plant.parameter_names, K, SUBSTEPS)
    assert not slow.compiled and slow is not at.function
    assert not list(tmp_path.rglob("*.so"))
    for one, other in (
        (slow.values, at.function.values),
        (slow.derivatives, at.function.derivatives),
        (slow.trajectory, at.function.trajectory),
    ):
        for a, b in zip(_plain(one(*at.arguments)), _plain(other(*at.arguments)), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * np.abs(b).max())


def test_a_library_is_built_once_for_one_content(monkeypatch, tmp_path):
    monkeypatch.setenv("PNEUID_CACHE", str(tmp_path / "cache"))
    x = ca.SX.sym("x")
    one, other = (ca.Function("pneuid_tiny", [x], [factor * ca.sin(x)]) for factor in (2.0, 3.0))
    (built,), done = compile_functions([one], "pneuid")
    assert done and float(built(0.5)) == pytest.approx(2 * np.sin(0.5), rel=1e-15)
    folder = tmp_path / "cache"
    assert folder.stat().st_mode & 0o077 == 0  # private to the user
    assert len(list(folder.iterdir())) == 1
    (changed,), _ = compile_functions([other], "pneuid")
    assert float(changed(0.5)) == pytest.approx(3 * np.sin(0.5), rel=1e-15)
    assert len(list(folder.iterdir())) == 2

    def refuse(*_):
        raise AssertionError("built again")

    monkeypatch.setattr(pneuid.compiled, "_build", refuse)
    (cached,), done = compile_functions([one], "pneuid")
    assert done and float(cached(0.5)) == float(built(0.5))


def test_rigs_of_one_structure_share_the_code_and_keep_their_numbers():
    at = stretch()
    heavy = Plant(rig("servo", {"load": {"mass": "4.8 kg"}}), "lugre")
    assert structure_key(heavy) == structure_key(at.plant)
    shared = [interval_function(plant, plant.parameter_names, K, SUBSTEPS) for plant in (heavy, at.plant)]
    assert shared[0] is shared[1]
    ends = []
    for plant in (heavy, at.plant):
        theta = plant.theta(values_of(plant), RANGES)
        own = pneuid.interval._chains(plant, plant.parameter_names, K, SUBSTEPS)["values"]()
        ends.append(np.asarray(shared[0].values(at.start, at.data, theta)[0]))
        np.testing.assert_allclose(ends[-1], np.asarray(own(at.start, at.data, theta)[0]), rtol=1e-9)
    assert abs(ends[0][1] - ends[1][1]) > 1e-3  # twice the mass is felt


def test_other_effects_laws_and_rigs_are_other_structures():
    plants = [
        Plant(rig(), "lugre"), Plant(rig(), "dahl"), Plant(rig("bench"), "lugre"),
        Plant(rig(), "lugre", effects_by_name(["gravity"])), Plant(rig(), "lugre", effects_by_name(["load_mass"])),
    ]  # fmt: skip
    assert len({structure_key(plant) for plant in plants}) == len(plants)
    assert [data_rows(plant) for plant in plants] == [11, 11, 13, 11, 11]


# --- simulation ---


def test_windows_side_by_side_are_windows_one_by_one():
    at = stretch()
    function = interval_function(at.plant, (), K, SUBSTEPS)
    first = [600, 800, 1100]
    data = np.stack([at.run.data[:, k : k + 4 * K] for k in first])
    nodes = first_nodes(at.plant, [at.run], [at.run.motion], values_of(at.plant), 1).T
    start, theta = nodes[first], np.tile(at.theta, (3, 1))
    theta[1, at.selected[0]] *= 1.5
    together = simulate(function, start, data, theta)
    for w in range(3):
        alone = simulate(function, start[w : w + 1], data[w : w + 1], theta[w : w + 1])
        np.testing.assert_allclose(together.outputs[w], alone.outputs[0], rtol=1e-13)
        np.testing.assert_allclose(together.states[w], alone.states[0], rtol=1e-13)
        np.testing.assert_allclose(together.end[w], alone.end[0], rtol=1e-13)
        # and four intervals in a row are one of four times the length
        longer = pneuid.interval._chains(at.plant, (), 4 * K, SUBSTEPS)["trajectory"]()
        outputs, states = _plain(longer(start[w], data[w], theta[w]))
        np.testing.assert_allclose(together.outputs[w], outputs, rtol=1e-9)
        np.testing.assert_allclose(together.end[w], states[:, -1], rtol=1e-8, atol=1e-12)


def test_the_start_of_a_window_is_found_from_its_measurements():
    at = stretch()
    function = interval_function(at.plant, (), K, SUBSTEPS)
    first = np.array([600, 800])
    data = np.stack([at.run.data[:, k : k + 60] for k in first])
    truth = first_nodes(at.plant, [at.run], [at.run.motion], values_of(at.plant), 1).T[first]
    theta = np.tile(at.theta, (2, 1))
    data[:, -6:-3] = simulate(function, truth, data, theta).outputs
    guess = truth + at.plant.state_scales * [[3.0, -2.0, 1.0, -1.0, 0.0], [-1.0, 2.0, -2.0, 1.0, 0.0]]
    prior = np.array([np.inf, np.inf, np.inf, np.inf, 1e-4])
    found, cost = estimate_start(function, guess, data, theta, prior, at.plant.state_scales, iterations=30)
    # noise-free: what is left is the stopping rule and the prior's pull on the bristle
    assert np.all(np.abs(found - truth)[:, :4] < 1e-2 * at.plant.state_scales[:4])
    assert np.all(cost < 1e-2 * 3 * data.shape[2])


def test_a_window_that_diverges_is_infinitely_bad_and_no_warning():
    at = stretch()
    function = interval_function(at.plant, (), K, SUBSTEPS)
    data = np.stack([at.run.data[:, 600:660]] * 2)
    guess = at.start * np.array([[1.0], [1e4]])
    prior = np.array([np.inf, np.inf, np.inf, np.inf, 1e-4])
    _, cost = estimate_start(function, guess, data, np.tile(at.theta, (2, 1)), prior, at.plant.state_scales)
    assert np.isfinite(cost[0]) and cost[1] == np.inf


# --- the relaxed problem ---


def _small_problem(effects: tuple[str, ...] = ()) -> tuple[Shooting, np.ndarray]:
    """Two runs of 47 and 33 samples, a masked stretch, a payload in one, away from the optimum."""
    runs = []
    plant = Plant(rig("servo", {"runs": {"s7.csv": {"mass": "3 kg"}}}), "lugre", effects_by_name(effects))
    recordings = [servo_run("multisine", 5, 11), servo_run("steps", 7, 12)]
    for recording, piece in zip(recordings, ((790, 837), (500, 533)), strict=True):
        part = section(prepare(recording, plant, noise_of(plant.rig, recordings)), *piece)
        data = part.data.copy()
        data[-3:, 5:8] = 0.0
        runs.append(replace(part, data=data))
    values = {item.name: item.start if item.off is None else item.off + 0.1 * item.scale for item in plant.parameters}
    values |= {name: value * 1.1 for name, value in TRUTH.items()} | {"n": 1.15}
    problem = Shooting(plant, runs, plant.parameter_names, values, RANGES, SUBSTEPS, node_every=10)
    rng = np.random.default_rng(4)
    nodes = np.hstack([run.data[-6:-3, ::10] for run in runs])
    states = np.zeros((problem.ns, problem.nint))
    states[[0, 2, 3]] = nodes
    states[1] = np.concatenate([run.motion.v[::10] for run in runs])
    states[4] = 12.0 / 4e5 * np.sign(states[1])
    states += 0.3 * problem.state_scale[:, None] * rng.standard_normal(states.shape)
    q = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    return problem, problem.join(q, states)


def _residuals(problem: Shooting, X: np.ndarray) -> np.ndarray:
    """Every residual of the relaxed cost, from plain simulations: weighted outputs, defects, priors."""
    q, nodes = problem.split(X)
    theta = problem.theta(q)
    ny = len(problem.plant.outputs)
    parts, ends = [], []
    for i in range(problem.nint):
        data = problem.data[:, i * problem.samples : (i + 1) * problem.samples]
        shown, passed = _plain(problem.function.trajectory(nodes[:, i], data, theta[:, i]))
        parts.append((data[-ny:] * (shown - data[-2 * ny : -ny])).ravel())
        ends.append(passed[:, -1])
    jumps = [
        (ends[i] - nodes[:, i + 1]) / problem.state_scale / problem.relaxation
        for k in range(len(problem.runs))
        for i in range(problem.first[k], problem.first[k + 1] - 1)
    ]
    return np.concatenate([*parts, *jumps, problem.prior_residual(X)])


@pytest.mark.parametrize("effects", [(), ("supply_droop", "friction_pressure")])
def test_gradient_and_hessian_of_the_relaxed_cost_agree_with_differences(effects):
    problem, X = _small_problem(effects)
    assert problem.nint == 5 + 4 and problem.linked.size == 7
    gradient, hessian = relaxed_system(problem, X)
    residual = _residuals(problem, X)
    J = np.empty((residual.size, problem.size))
    for j in range(problem.size):
        h = 1e-5
        up, down = X.copy(), X.copy()
        up[j] += h
        down[j] -= h
        J[:, j] = (_residuals(problem, up) - _residuals(problem, down)) / (2 * h)
    # central differences of residuals of up to some hundred sigmas: eight digits of the largest column
    size = np.sqrt(np.sum(J**2, axis=0)) + 1e-12
    np.testing.assert_allclose(gradient / size, J.T @ residual / size, atol=1e-5 * float(np.linalg.norm(residual)))
    np.testing.assert_allclose(hessian.toarray() / np.outer(size, size), (J.T @ J) / np.outer(size, size), atol=2e-5)
    end, cost = problem.evaluate_values(X)
    total = cost + 0.5 * np.sum((problem.defects(end, X) / problem.relaxation) ** 2)
    total += 0.5 * np.sum(problem.prior_residual(X) ** 2)
    assert total == pytest.approx(0.5 * np.sum(residual**2), rel=1e-9)


def test_a_trial_point_far_out_is_refused_by_the_solver_and_no_warning():
    problem, X = _small_problem()
    X[problem.nq :] *= 1e160
    cost, _ = _Evaluator(problem, True, "relaxed", 1e-4, None, np.inf).value(X)
    assert not np.isfinite(cost)


def test_the_continuity_jacobian_agrees_with_differences():
    problem, X = _small_problem()
    assembly = Assembly(problem, relaxed=False)
    _, slope = problem.constraints(X[: problem.nq])
    jacobian = assembly.jacobian_matrix(assembly.jacobian(problem.evaluate(X), slope))[: assembly.pattern.ndef]
    dense = jacobian.toarray()
    assert dense.shape == (problem.linked.size * problem.ns, problem.size)
    for j in (*range(problem.nq), problem.nq + 1, problem.nq + 7, problem.size - 1):
        h = 1e-5
        ends = []
        for way in (1.0, -1.0):
            moved = X.copy()
            moved[j] += way * h
            ends.append(problem.defects(problem.evaluate_values(moved)[0], moved).ravel())
        np.testing.assert_allclose(dense[:, j], (ends[0] - ends[1]) / (2 * h), rtol=1e-4, atol=1e-5)


def test_constraints_of_the_search_agree_with_differences():
    problem, X = _small_problem(("friction_direction", "friction_pressure"))
    q = X[: problem.nq]
    value, slope = problem.constraints(q)
    assert value.size == slope.shape[0] > 10
    for j in range(problem.nq):
        h = 1e-6
        up, down = q.copy(), q.copy()
        up[j] += h
        down[j] -= h
        central = (problem.constraints(up)[0] - problem.constraints(down)[0]) / (2 * h)
        np.testing.assert_allclose(slope[:, j], central, rtol=1e-6, atol=1e-7)


def test_variables_survive_scaling_and_splitting():
    problem, X = _small_problem(("gravity", "load_mass"))
    q, nodes = problem.split(X)
    np.testing.assert_allclose(problem.join(q, nodes), X, rtol=1e-15)
    values = problem.scaling.to_values(q)
    np.testing.assert_allclose(problem.scaling.to_q(values), q, rtol=1e-12, atol=1e-12)
    h = 1e-6
    central = (problem.scaling.to_values(q + h) - problem.scaling.to_values(q - h)) / (2 * h)
    np.testing.assert_allclose(problem.scaling.slope(q), central, rtol=1e-6)
    # each run keeps its own mass in its own intervals
    row = problem.theta(q)[problem.plant.theta_names.index("mass_run")]
    np.testing.assert_array_equal(row, [2.4] * 5 + [3.0] * 4)


def test_the_tail_of_a_runs_last_interval_counts_for_nothing():
    problem, _ = _small_problem()
    weights = problem.data[-3:]
    for k, run in enumerate(problem.runs):
        columns = slice(problem.first[k] * problem.samples, problem.first[k + 1] * problem.samples)
        np.testing.assert_array_equal(weights[:, columns][:, : run.n], run.weights)
        assert not weights[:, columns][:, run.n :].any() and weights[:, columns].shape[1] > run.n
    assert problem.weighted == np.count_nonzero(weights) and problem.total_samples == 47 + 33


def test_smoothing_is_a_number_not_other_code():
    problem, X = _small_problem()
    problem.set_smoothing(FINE)
    fine = problem.evaluate_values(X)[1]
    problem.set_smoothing(type(FINE)(speed=1e-2, opening=1e-2, laminar=1e-2))
    assert problem.evaluate_values(X)[1] != fine
    problem.set_smoothing(FINE)
    assert problem.evaluate_values(X)[1] == fine


def test_a_jump_of_an_effects_own_state_counts_ten_times():
    """With the freedom of position and pressure between intervals, a spool would be an unknown input that explains anything."""
    at = stretch("valve_lag")
    plant, values = at.plant, values_of(at.plant)
    problem = Shooting(plant, [at.run], plant.parameter_names, values, RANGES, SUBSTEPS, node_every=10)
    nodes = first_nodes(plant, [at.run], [at.run.motion], values, 10)
    X = problem.join(np.zeros(problem.nq), nodes)
    end, _ = problem.evaluate_values(X)
    counts = {}
    for i, name in enumerate(plant.states):
        jumped = nodes.copy()
        jumped[i, 7] += plant.state_scales[i]
        moved = problem.defects(end, problem.join(np.zeros(problem.nq), jumped)) - problem.defects(end, X)
        counts[name] = np.abs(moved).max()
    own = list(plant.states[plant.explicit_count + 1 :])
    assert own, "valve_lag has a spool"
    assert all(np.isclose(counts[name], 10.0 if name in own else 1.0) for name in counts), counts
