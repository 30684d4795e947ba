"""Screening and diagnosis: the hidden effect is named, and nothing is named where nothing hides."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from helpers import base_fit, held_runs, rig, scores, values_of
from scipy.sparse.linalg import spsolve

from pneuid.criticism.decision.verdict import Verdict, diagnose
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import Prediction, predict, rmse, typical
from pneuid.criticism.prediction.noise_floor import noise_floor
from pneuid.criticism.screening import scores as module
from pneuid.criticism.screening.batches import Batch, _rolled_out
from pneuid.criticism.screening.defect_shapes import defect_shapes
from pneuid.criticism.screening.fitted import Fitted
from pneuid.criticism.screening.scores import Change, Score, screen, screened
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.first_guess import first_nodes
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.thinning import section
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import HIDDEN_EFFECTS, Friction, TruthBench, record_bench, sine, strokes

ON_A_SERVO = {name for name, effect in CATALOGUE.items() if "servo" in effect.rigs}
HIDDEN = ["leakage_internal", "valve_dead_zone", "supply_droop", "friction_direction"]


def by_name(hidden: str = "") -> dict[str, Score]:
    return {score.effect.name: score for score in scores(hidden)}


@cache
def leak_verdict() -> tuple[Verdict, list[str]]:
    """The whole diagnosis of the rig with a leak, and what it said on the way."""
    said: list[str] = []
    return diagnose(base_fit("leakage_internal"), held_runs("leakage_internal"), CATALOGUE, say=said.append), said


# --- screening ---


@pytest.mark.parametrize("hidden", HIDDEN)
def test_the_hidden_effect_or_its_group_comes_first(hidden):
    found = scores(hidden)
    assert found[0].effect.name == hidden or hidden in found[0].group
    assert found[0].drop > 500.0
    # those that the data can tell from it are clearly behind
    for other in found[1:]:
        if other.effect.name not in found[0].group and hidden not in other.group:
            assert other.drop < 0.95 * found[0].drop, other.effect.name
    outside = [one.drop for one in found[1:] if one.effect.name not in found[0].group]
    assert found[0].ahead == pytest.approx(found[0].drop / max(outside))
    assert found[-1].ahead < 1.0


def test_states_of_effects_follow_every_run_as_if_it_were_alone():
    """Runs of 12, 30 and 7 intervals, with two time constants at once: each ends as it does alone, whatever is beside it."""
    base, plant = base_fit(), Plant(rig(), "lugre", effects_by_name(["friction_warmup", "heat_transfer"]))
    whole = base.runs[0]
    runs = [section(whole, first, last) for first, last in ((0, 240), (500, 1100), (2000, 2140))]
    several = [values_of(plant, {"w_warm": 0.3, "tau_warm": tau}) for tau in (1.0, 3.0)]

    def followed(some, values):
        problem = Shooting(base.plant, some, list(base.plant.parameter_names), base.values, base.ranges, base.substeps)
        nodes = first_nodes(base.plant, some, [run.motion for run in some], base.values, problem.samples)
        return _rolled_out(SimpleNamespace(fit=SimpleNamespace(problem=problem), nodes=nodes), plant, values)

    together = followed(runs, several)
    for one, found in zip(several, together, strict=True):
        alone = np.hstack([followed([run], [one])[0] for run in runs])
        assert alone.shape[1] == 12 + 30 + 7 and np.all(np.ptp(alone[-3:], axis=1) > 0.0)
        # a run alone is stepped by other code than runs side by side, which rounds otherwise
        np.testing.assert_allclose(found, alone, rtol=1e-10, atol=1e-12)
    assert not np.allclose(*together)


@pytest.mark.parametrize("seed", [1, 3])
def test_where_nothing_hides_no_effect_promises_anything(seed):
    found = scores("", seed)
    assert {score.effect.name for score in found} == ON_A_SERVO
    # half a chi-square of 1 to 8 degrees: above 10 once in 10^3 at most, some 35 effects x 2 seeds
    assert max(score.drop for score in found) < 10.0
    assert all(score.drop >= 0.0 and 0.0 <= score.gain < 1e-2 for score in found)


@pytest.mark.parametrize("hidden", ["", *HIDDEN])
def test_groups_are_mutual_and_scores_are_ordered(hidden):
    found = by_name(hidden)
    for name, score in found.items():
        assert name not in score.group
        assert all(name in found[mate].group for mate in score.group), f"{name} in {score.group}"
        own = score.effect.parameters(rig(), base_fit(hidden).plant.law)
        amplitudes = {item.name for item in own if item.off is not None}
        assert set(score.start) == amplitudes and score.freedom == len(amplitudes)
        for item in own:
            if item.name in amplitudes:
                slack = 1e-9 * item.scale  # the step is bounded up to rounding
                assert item.lower - slack <= score.start[item.name] <= item.upper + slack
    drops = [score.drop for score in scores(hidden)]
    assert drops == sorted(drops, reverse=True)


def test_direction_of_friction_and_a_constant_force_are_one_group_while_sliding():
    found = by_name("friction_direction")
    assert "gravity" in found["friction_direction"].group


def _extended_system(found: Fit, name: str) -> tuple[Shooting, np.ndarray, np.ndarray, sp.csc_matrix, np.ndarray]:
    """The relaxed problem with the effect's amplitudes among the parameters, differentiated symbolically."""
    plant = Plant(found.plant.rig, found.plant.law.name, [CATALOGUE[name]])
    off = {item.name: item.off for item in plant.parameters if item.off is not None}
    values = plant.starts() | found.relaxed_values | off
    old = found.problem
    problem = Shooting(plant, found.runs, [*old.free, *off], values, found.ranges, old.substeps, old.samples)
    problem.set_smoothing(old.smoothing)
    problem.relaxation = old.relaxation
    q = problem.scaling.to_q(np.array([values[name] for name in problem.free]))
    X = np.concatenate([q, found.relaxed.X[old.nq :]])
    gradient, hessian = relaxed_system(problem, X)
    return problem, X, gradient, hessian.tocsc(), np.arange(old.nq, problem.nq)


@pytest.mark.parametrize("name", ["gravity", "friction_direction", "load_mass"])
def test_the_predicted_drop_is_that_of_one_full_newton_step(name):
    """The projection against the plain difference of two Gauss-Newton steps, with and without the effect's columns."""
    problem, X, gradient, hessian, extra = _extended_system(base_fit("friction_direction"), name)
    # a parameter on its bound would be held by the projection
    q, scaling = X[: problem.nq], problem.scaling
    assert np.all(np.minimum(q - scaling.lower, scaling.upper - q) > 1e-3 * (scaling.upper - scaling.lower))
    base = np.setdiff1d(np.arange(problem.size), extra)

    def drop(index: np.ndarray) -> float:
        return 0.5 * float(gradient[index] @ spsolve(hessian[index][:, index], gradient[index]))

    expected = drop(np.arange(problem.size)) - drop(base)
    assert expected > 0.1
    assert by_name("friction_direction")[name].drop == pytest.approx(expected, rel=1e-3, abs=1e-4)


@pytest.mark.slow
def test_the_predicted_drop_is_about_what_a_refit_finds():
    before, after = base_fit("leakage_internal"), leak_verdict()[0].best
    best = by_name("leakage_internal")["leakage_internal"]
    assert [effect.name for effect in after.plant.effects] == ["leakage_internal"]
    # the two fits may have stopped at different spreads of the defects: costs are compared at the loose one
    assert 0.5 < best.drop / (before.loose_cost - after.loose_cost) < 2.0
    assert after.values["G_leak"] == pytest.approx(best.start["G_leak"], rel=0.5)


@pytest.mark.slow
def test_effects_of_the_model_itself_and_of_the_other_kind_of_rig_are_not_screened():
    richer = leak_verdict()[0].best
    names = {score.effect.name for score in screen(richer, list(CATALOGUE.values()), list(CATALOGUE))}
    assert names == ON_A_SERVO - {"leakage_internal"}
    assert screen(richer, [CATALOGUE["leakage_internal"]], list(CATALOGUE)) == []
    bench_only = type("BenchOnly", (type(CATALOGUE["gravity"]),), {"rigs": ("bench",)})()
    assert screen(base_fit(), [bench_only], list(CATALOGUE)) == []


# --- prediction ---


def test_a_right_model_predicts_down_to_the_noise_floor():
    found = base_fit("", 3)
    model = Frozen.of(found)
    runs = [prepare(run, found.plant, found.noise) for run in held_runs("", 3)]
    ahead, floor = rmse(predict(model, runs), found.plant.outputs), noise_floor(model, runs)
    for name, sigma in (("x", 20e-6), ("p1", 500.0), ("p2", 500.0)):
        # the floor holds the sensor's own noise and the error of the start state
        assert floor.value[name] > 0.95 * sigma
        # two runs of a dozen windows: the floor itself scatters by a few per cent
        assert ahead[name] == pytest.approx(floor.value[name], rel=0.12), name
        assert 0.0 < floor.spread[name] < 0.2 * floor.value[name]


def test_a_wrong_model_predicts_far_above_it_and_the_floor_stays():
    found = base_fit("leakage_internal")
    model = Frozen.of(found)
    runs = [prepare(run, found.plant, found.noise) for run in held_runs("leakage_internal")]
    predictions = predict(model, runs)
    ahead = rmse(predictions, found.plant.outputs)
    assert ahead["p1"] > 5 * 500.0 and ahead["p2"] > 5 * 500.0
    for item in predictions:
        assert item.error.shape == item.predicted.shape == (3, item.index.size)
        assert np.all(np.diff(item.index) == 1)
        np.testing.assert_array_equal(item.measured[1], item.run.measured("p1")[item.index])


def test_the_typical_error_forgets_a_tenth_of_the_windows_and_no_more():
    found = base_fit("", 3)
    ahead = predict(Frozen.of(found), [prepare(held_runs("", 3)[0], found.plant, found.noise)])
    outputs, (item,) = found.plant.outputs, ahead
    window = 200  # samples of 200 ms at 1 kHz
    count = item.index.size // window
    assert count >= 10

    def with_millimetres_in(windows: int) -> list[Prediction]:
        measured = item.measured.copy()
        measured[0, : windows * window] += 5e-3
        return [replace(item, measured=measured)]

    before = typical(ahead, outputs)["x"]
    few, many = with_millimetres_in(count // 10), with_millimetres_in(count // 10 + 1)
    assert rmse(few, outputs)["x"] > 20 * rmse(ahead, outputs)["x"]
    assert typical(few, outputs)["x"] == pytest.approx(before, rel=0.3)
    assert typical(many, outputs)["x"] > 20 * before
    # the other signals do not move
    assert typical(many, outputs)["p1"] == typical(ahead, outputs)["p1"]


def test_a_window_that_diverged_counts_as_one_window():
    found = base_fit("", 3)
    ahead = predict(Frozen.of(found), [prepare(held_runs("", 3)[0], found.plant, found.noise)])
    predicted = ahead[0].predicted.copy()
    predicted[0, 50] = np.nan
    assert np.isfinite(typical([replace(ahead[0], predicted=predicted)], found.plant.outputs)["x"])
    predicted[0] = np.nan
    assert not np.isfinite(typical([replace(ahead[0], predicted=predicted)], found.plant.outputs)["x"])


def test_the_floor_is_the_same_every_time():
    found = base_fit("", 3)
    runs = [prepare(held_runs("", 3)[0], found.plant, found.noise)]
    assert noise_floor(Frozen.of(found), runs, seeds=2) == noise_floor(Frozen.of(found), runs, seeds=2)


# --- the whole diagnosis ---


def _assert_complete(verdict: Verdict, hidden: str) -> None:
    """What the contract promises of diagnosis.json and the ladder, whatever was found."""
    found = verdict.diagnosis
    assert found.verdict in ("adequate", "effect", "ambiguous", "unknown")
    assert [item.effect for item in found.ranking[: len(found.effects)]] == list(found.effects)
    assert {item.effect for item in found.ranking} == ON_A_SERVO
    for item in found.ranking:
        assert item.equation == CATALOGUE[item.effect].equation
        assert item.p_value is None or 0.0 <= item.p_value <= 1.0
    raw = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert raw["schema"] == 1 and raw["verdict"] == found.verdict and raw["effects"] == list(found.effects)
    assert {"effect", "equation", "screen_gain", "hold_out_error_ratio", "excess_explained", "p_value",
            "indistinguishable_from"} == set(raw["ranking"][0])  # fmt: skip
    first = verdict.rungs[0]
    assert first.effects == () and first.added is None and first.accepted and first.parameters == 8
    assert set(first.hold_out) == set(first.noise_floor) == {"x", "p1", "p2"}
    assert [effect.name for effect in verdict.best.plant.effects] == sorted(
        found.effects, key=list(CATALOGUE).index
    ) or (found.verdict == "ambiguous")
    assert hidden in (*found.effects, "")


@pytest.mark.slow
def test_a_hidden_leak_is_diagnosed():
    verdict, said = leak_verdict()
    _assert_complete(verdict, "leakage_internal")
    found = verdict.diagnosis
    assert found.verdict == "effect" and found.effects[0] == "leakage_internal"
    lead = found.ranking[0]
    assert lead.excess_explained is not None and lead.excess_explained > 0.9
    assert lead.hold_out_error_ratio is not None and lead.hold_out_error_ratio < 0.5
    assert lead.p_value is not None and lead.p_value < 1e-9
    assert verdict.rungs[-1].accepted or any(
        rung.accepted and rung.added == "leakage_internal" for rung in verdict.rungs
    )
    assert any("leakage_internal accepted" in sentence for sentence in said)


@pytest.mark.slow
def test_a_constant_load_on_a_bench_is_diagnosed():
    stand = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})
    steps = ((strokes(speeds=(0.002, 0.01, 0.05), longest=0.4), 3e5, 2e5), (sine(cycles=2), 5e5, 4e5))
    truth, load = TruthBench(friction=Friction()), HIDDEN_EFFECTS["gravity"]["strong"]
    train, held = (
        [
            Recording.from_arrays(f"bench_{i}.csv", stand, **record_bench(truth, p1, p2, motion, load, 10 * seed + i))
            for i, (motion, p1, p2) in enumerate(steps)
        ]
        for seed in (1, 2)
    )
    found = diagnose(fit(Plant(stand, "lugre"), train, exact=False), held, CATALOGUE).diagnosis
    # on a bench a constant load and an offset of the force sensor are the same constant
    assert {"gravity", "sensor_offset_F"} <= set(found.effects) and found.verdict == "ambiguous"
    assert found.ranking[0].excess_explained is not None and found.ranking[0].excess_explained > 0.95


def test_nothing_is_diagnosed_where_nothing_hides():
    verdict = diagnose(base_fit("", 3), held_runs("", 3), CATALOGUE)
    _assert_complete(verdict, "")
    assert verdict.diagnosis.verdict == "adequate" and verdict.diagnosis.effects == ()
    assert verdict.best is base_fit("", 3)
    assert len(verdict.rungs) == 1


# --- over the measured defect ---


@pytest.mark.parametrize(("hidden", "name"), [("leakage_internal", "leakage_internal"), ("friction_direction", "gravity")])
def test_what_an_effect_changes_lowers_the_cost_by_the_predicted_drop(hidden, name):
    """The stacked residuals with the projected change beside them, against the drop from the projected products."""
    fitted = Fitted(base_fit(hidden))
    (change,) = screened(fitted, [CATALOGUE[name]], tuple(CATALOGUE))
    after = fitted.residual + fitted.projected(change.raw, change.base)
    drop = 0.5 * float(fitted.residual @ fitted.residual - after @ after)
    # the weak priors of the fitted parameters and nodes stand beside the residuals
    assert drop == pytest.approx(change.drop, rel=0.05)


def test_the_leak_follows_the_measured_defect_and_a_spring_does_not():
    chosen = [CATALOGUE[name] for name in ("leakage_internal", "load_spring")]
    leak, spring = defect_shapes(base_fit("leakage_internal"), chosen, tuple(CATALOGUE))
    assert (leak.effect, leak.unit) == ("leakage_internal", "Pa/s") and leak.equation in ("pressure_1", "pressure_2")
    assert leak.at.size == leak.measured.size == leak.taken.size and np.all(np.diff(leak.at) > 0)
    assert np.corrcoef(leak.measured, leak.taken)[0, 1] > 0.8
    assert leak.share > 0.25
    assert spring.share < 0.1


def test_an_effect_whose_states_run_away_promises_nothing(monkeypatch):
    whole = Batch.change

    def change(self: Batch, moved: dict[str, float], nodes: np.ndarray) -> np.ndarray:
        own = self.plant.own_parameters("friction_lag") if "friction_lag" in {e.name for e in self.plant.effects} else ()
        found = whole(self, moved, nodes)
        return np.full_like(found, np.inf) if set(moved) & set(own) else found

    chosen = [CATALOGUE[name] for name in ("leakage_internal", "friction_lag")]
    usual = {score.effect.name: score.drop for score in screen(base_fit("leakage_internal"), chosen, list(CATALOGUE))}
    monkeypatch.setattr(Batch, "change", change)
    found = {score.effect.name: score.drop for score in screen(base_fit("leakage_internal"), chosen, list(CATALOGUE))}
    assert found["friction_lag"] == 0.0 and found["leakage_internal"] == pytest.approx(usual["leakage_internal"])


@pytest.mark.parametrize(
    ("long", "short", "start"), [(400.0, 3_400.0, "short"), (400.0, 500.0, "usual"), (4_500.0, 9_000.0, "usual")]
)
def test_what_promises_far_less_than_another_is_looked_at_with_other_shapes(long, short, start, monkeypatch):
    """A cushion, usually 25 mm long, promises ``long``, at half the length ``short``, beside a lag that promises 8000."""

    class Promising:
        def __init__(self, _batch, _items, shapes=None, nodes=None) -> None:
            self.shapes = shapes or {}
            assert nodes == shapes, "the ring's pressure follows with the shapes that are looked at"

        def change(self, effect):
            half = self.shapes.get("L_cushion", 0.025) < 0.02
            drop = 8_000.0 if effect.name == "friction_lag" else short if half else long
            return Change(effect, drop, {}, np.zeros(1), np.zeros(1), self.shapes)

    effects = [CATALOGUE["friction_lag"], CATALOGUE["end_cushion"]]
    monkeypatch.setattr(type(effects[1]), "looks", ())  # those it names are looked at whatever it promises
    batch = SimpleNamespace(chosen=effects, amplitudes=[], of=lambda _: [], nodes=None, plant=Plant(rig(), "lugre", effects))
    batch.followed = lambda moved: moved
    monkeypatch.setattr(module, "_Columns", Promising)
    monkeypatch.setattr(module, "Batch", lambda *_: batch)
    monkeypatch.setattr(module, "batches", lambda *_: [effects])
    lag, cushion = screened(SimpleNamespace(fit=SimpleNamespace(plant=None)), effects, [])
    assert not lag.shapes and lag.drop == 8_000.0
    assert cushion.drop == (short if start == "short" else long)
    assert list(cushion.shapes) == (["L_cushion"] if start == "short" else [])


@pytest.mark.parametrize("little", [0.0, 1e9])
def test_a_mount_is_looked_for_at_every_frequency(little):
    """A tenth beside its natural frequency a mount promises next to nothing; the position is read on the machine here."""
    fitted, mount = Fitted(base_fit("mounting_compliance")), CATALOGUE["mounting_compliance"]
    batch = Batch(fitted, [mount], list(CATALOGUE))
    usual = module._screened(batch)
    (found,) = module._at_best_shapes(batch, usual, little)
    assert found.drop > 2.0 * usual[0].drop
    assert dict(found.shapes) in mount.looks and found.shapes["read_mount"] == 1.0
