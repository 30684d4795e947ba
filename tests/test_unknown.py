"""The unknown rest: probes screen and fit every spline, the right equation and signal come first, shapes become formulas."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import rig

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import Diagnosis, Unknown
from pneuid.criticism.decision.verdict import Verdict
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.noise_floor import noise_floor
from pneuid.criticism.prediction.uncovered import outside, uncovered
from pneuid.criticism.unknown.distil import _fitted, distilled
from pneuid.criticism.unknown.function_search import Found, _with_second, judged, ranking, refitted, search
from pneuid.criticism.unknown.probes import Probing
from pneuid.criticism.unknown.rest import _unknown, explained
from pneuid.effects import CATALOGUE
from pneuid.effects._formula import SHAPES
from pneuid.effects._spline import Term, curve, spline
from pneuid.estimation.curves import Curve
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import (
    ATMOSPHERE,
    OUTSIDE_EFFECTS,
    Friction,
    Hidden,
    TruthBench,
    TruthServo,
    record_bench,
    record_servo,
    sine,
)

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})


@cache
def magnet_runs() -> tuple[Recording, Recording]:
    """Two runs of a bench with a magnet towards mid-stroke, which no effect of the catalogue is."""
    runs = []
    for seed, frequency in ((3, 0.5), (4, 0.4)):
        record = record_bench(
            TruthBench(friction=Friction()), 3e5 + ATMOSPHERE, 2e5 + ATMOSPHERE,
            sine(amplitude=0.09, frequency=frequency, cycles=2), Hidden(magnetic_detent=15.0), seed,
        )  # fmt: skip
        runs.append(Recording.from_arrays(f"b{seed}.csv", STAND, **record))
    return runs[0], runs[1]


@cache
def magnet() -> tuple[Fit, Probing]:
    """The base model fitted to the first run, and its probes."""
    found = fit(Plant(STAND, "lugre"), [magnet_runs()[0]], exact=False)
    return found, Probing(found)


def test_the_right_equation_and_signal_come_first():
    ranked = ranking(magnet()[1])
    (leader,) = ranked[0][1]
    assert (leader.equation, leader.signal) == ("force", "x")
    assert ranked[0][0] > 1.2 * ranked[1][0]


def test_the_joint_fit_finds_what_a_compiled_spline_finds():
    found, probing = magnet()
    term = Term("force", "x", knots=24)
    joint = probing.fitted([term])
    assert joint.cost < 0.2 * probing.start_cost
    # what it is: the same spline as an effect of the plant, whose value follows x within an interval too
    again = fit(Plant(STAND, "lugre", [spline(term)]), [magnet_runs()[0]], found.values, found.noise, exact=False)
    part = np.array([again.values[name] for name in spline(term).amplitudes])
    at = np.linspace(0.17, 0.33, 81)
    both = [curve(term, list(values), {**found.ranges, "patm": STAND.patm}, at) for values in (joint.amplitudes[0], part)]
    mine, exact = (values - values.mean() for values in both)
    assert np.sqrt(np.mean((mine - exact) ** 2)) < 0.15 * np.sqrt(np.mean(exact**2))
    assert probing.problem.added.max() == 0.0


@pytest.mark.parametrize(("hidden", "named"), [("encoder_bow", "sensor_x"), ("cogging", "force")])
def test_an_encoder_that_is_wrong_over_x_is_told_from_a_force_and_from_a_valve_over_x(hidden, named):
    """The piston moves 10 mm within an interval, over which the error of the encoder changes and looks like a speed."""
    record = record_servo(TruthServo(), OUTSIDE_EFFECTS[hidden].strong, "multisine", 4.0, 5, supply=7e5 + ATMOSPHERE)
    base = fit(Plant(rig(), "lugre"), [Recording.from_arrays("s7.csv", rig(), **record)], exact=False)
    probing = Probing(base)
    drop, (term,) = ranking(probing)[0]
    assert (term.equation, term.signal) == (named, "x")
    joint = probing.fitted([term])
    assert probing.start_cost - joint.cost == pytest.approx(drop, rel=0.2)
    stays = {name: joint.values[name] == pytest.approx(base.relaxed_values[name]) for name in ("Fs", "vs", "sigma0", "sigma1")}
    assert all(stays.values()) and joint.values["Fc"] != base.relaxed_values["Fc"], "loose jumps say nothing of break-away"


def test_a_parameter_that_the_runs_do_not_see_stops_no_search():
    """On a printed cylinder at three pressures nothing was left to divide by."""
    probing = Probing(magnet()[0])
    at = probing._start
    blocks, slope, following = at.blocks.copy(), at.slope.copy(), at.following.copy()
    blocks[:, 0], blocks[:, :, 0], slope[:, 0], following[:, :, 0] = 0.0, 0.0, 0.0, 0.0
    probing._start = replace(at, blocks=blocks, slope=slope, following=following)
    assert not probing.problem.fixed[0]
    assert probing.screened(Term("force", "x", knots=24)) > 0.8 * Probing(magnet()[0]).screened(Term("force", "x", knots=24))


@cache
def searched() -> Found:
    """What the search finds on the magnet's runs."""
    found, _ = magnet()
    held = magnet_runs()[1]
    model = Frozen(found.plant, found.values, found.ranges, found.noise, found.substeps)
    floor = noise_floor(model, [prepare(held, found.plant, found.noise)], 1)
    return search(found, [held], floor.value)


@pytest.mark.parametrize("before", [0.98, 1.0, 1.0 + 1e-6])
def test_of_a_rest_that_is_noise_no_share_is_told(before):
    """A film that lags, named by all runs together: a function removed 3e13 % of nothing."""
    nothing = replace(searched(), before=before, after=0.9)
    assert nothing.explained == 0.0 and not nothing.explains


def test_search_names_it_and_judges_on_held_out_runs():
    named = searched()
    assert named.explains and named.explained > 0.8
    rest = _unknown(named)
    assert rest.equation == "force" and rest.depends_on == ("x",) and rest.unit == "N" and 1.0 < rest.rms < 15.0
    assert rest.effect is not None and rest.effect.startswith("spline:force(x")
    raw = rest.to_dict()
    assert raw["curve"]["unit"] == "N" and len(raw["curve"]["at"]) == len(raw["curve"]["std"])


STOOD_IN = [
    ("friction_position", 0.3, 0.95, "unknown"), ("friction_position", 0.3, 0.6, "effect"),
    ("friction_position", 0.7, 0.99, "unknown"), ("friction_position", 0.8, 0.99, "unknown"),
    ("friction_position", 0.8, 0.88, "effect"), ("friction_position", 0.97, 0.999, "effect"),
    # clearly more: nearly all and more than an effect that does not, or half of what it leaves
    ("friction_position", 0.85, 0.92, "unknown"), ("friction_position", 0.94, 0.96, "effect"),
    ("friction_position", 0.94, 0.98, "unknown"), ("friction_position", 0.94, 0.92, "effect"),
    ("friction_position", 0.6, 0.81, "unknown"), ("friction_position", 0.6, 0.79, "effect"),
    # a force over x beside a force over x: what the effect's form lacks, while it explains most
    ("load_spring", 0.8, 0.99, "effect"), ("load_spring", 0.7, 0.99, "unknown"),
    # a constant has no form: what leaves next to nothing of what it leaves holds it
    ("gravity", 0.97, 0.999, "unknown"), ("gravity", 0.97, 0.99, "effect"), ("load_spring", 0.97, 0.999, "effect"),
    # one function for several effects of several equations
    ("load_spring friction_position", 0.8, 0.99, "unknown"), ("load_spring friction_position", 0.97, 0.99, "effect"),
]  # fmt: skip


@pytest.mark.parametrize(("effect", "explains", "alone", "verdict"), STOOD_IN)
def test_an_effect_that_stood_in_for_the_unknown_gives_way_to_it(effect, explains, alone, verdict, monkeypatch):
    """The named effect explains a share of the held-out excess of 99 floors, the unknown force over x alone another.

    Of what that takes of the training cost the effect takes half.
    """
    found = _stood_in(effect, explains, alone, 0.5, monkeypatch)
    names = tuple(effect.split())
    assert found.verdict == verdict
    assert (found.effects, found.beside) == (((), ()) if verdict == "unknown" else (names, names[1:]))
    assert found.unknown is not None and found.unknown.curve is not None


@pytest.mark.parametrize(("near", "verdict"), [(False, "unknown"), (True, "effect")])
def test_effects_that_leave_little_are_not_asked_to_give_way(near, verdict, monkeypatch):
    assert _stood_in("friction_position", 0.94, 0.98, 0.5, monkeypatch, near).verdict == verdict
    assert _stood_in("gravity", 0.97, 0.999, 0.5, monkeypatch, near).verdict == "unknown", "a constant is, as it has no form"


def test_of_an_ambiguous_verdict_that_becomes_unknown_no_choice_is_left():
    named = ("gravity", "load_spring", "load_mass")
    doubted = Diagnosis("ambiguous", named, (), beside=named[2:], one_of=(named[:2],))
    assert doubted.choices == (named[:2],)
    unknown = replace(doubted, verdict="unknown")
    assert unknown.choices == () and unknown.to_dict()["one_of"] == []


@pytest.mark.parametrize(("took", "verdict"), [(0.01, "unknown"), (0.3, "unknown"), (0.36, "effect")])
def test_effects_that_the_training_runs_hardly_show_give_way_to_what_they_show(took, verdict, monkeypatch):
    """A clamped rod seal: viscous friction took 0.1 % of the training cost and 54 % of the held-out excess, friction over dp
    12 % and 77 %."""
    assert _stood_in("friction_viscous_nonlinear", 0.54, 0.76, took, monkeypatch).verdict == verdict
    assert _stood_in("friction_viscous_nonlinear", 0.54, 0.53, took, monkeypatch).verdict == "effect"


@pytest.mark.parametrize(
    ("names", "excess", "verdict"),
    [("load_spring friction_position", 28_000.0, "unknown"), ("load_spring friction_position", 700.0, "effect"),
     ("friction_position", 28_000.0, "effect")],
)  # fmt: skip
def test_effects_of_several_equations_that_leave_many_floors_give_way_though_they_explain_most(
    names, excess, verdict, monkeypatch
):
    """In place of a relief valve a leak and heat at the walls left 4.6 %, but 36 floors; a function over p1 a thousandth."""
    assert _stood_in(names, 0.954, 0.999, 0.5, monkeypatch, excess=excess).verdict == verdict


def _stood_in(
    effect: str, explains: float, alone: float, took: float, monkeypatch, near: bool = False, fitted=lambda found, *_: found,
    excess: float = 99.0,
) -> Diagnosis:  # fmt: skip
    monkeypatch.setattr("pneuid.criticism.unknown.rest.refitted", fitted)
    names = tuple(effect.split())
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    monkeypatch.setattr(
        "pneuid.criticism.unknown.rest.search",
        lambda *_: replace(named, before=1.0 + excess, after=1.0 + excess * (1.0 - alone)),
    )
    rungs = [
        Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6)
        for effects, error in (((), np.sqrt(1.0 + excess)), (names, np.sqrt(1.0 + excess * (1.0 - explains))))
    ]
    diagnosis = Diagnosis("effect", names, (), Unknown("force", ("x",), 1.0, "N"), beside=names[1:])
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[name] for name in names]))
    best = replace(best, relaxed=replace(base.relaxed, cost=base.relaxed.cost - took * named.gain))
    return explained(Verdict(diagnosis, best, base, rungs, near=near), [held]).diagnosis


@pytest.mark.parametrize(
    ("names", "gain", "verdict"),
    [
        ("load_spring friction_direction", 1.01, "unknown"),
        ("load_spring friction_direction", 0.99, "effect"),
        ("load_spring", 1.01, "effect"),  # one effect stands where no more than that is gained
    ],
)
def test_one_function_that_is_fitted_takes_the_place_of_two_effects_that_took_as_much(names, gain, verdict, monkeypatch):
    """By the joint fit alone it took a tenth less than they, and left more."""

    def fitted(found, *_):
        return replace(found, after=2.0, gain=gain / 0.9 * found.gain)

    assert _stood_in(names, 0.9, 0.95, 1.0 / 0.9, monkeypatch, fitted=fitted).verdict == verdict


def test_a_fit_with_the_function_found_keeps_what_is_better():
    base, (_, held) = magnet()[0], magnet_runs()
    found, floor = searched(), {"F": 1.0}
    rough = replace(found, after=0.9 * found.before, gain=0.1 * found.gain)
    better = refitted(rough, base, [held], floor)
    assert better.after < 0.2 * found.before and better.gain > 0.9 * found.gain
    assert better.joint is rough.joint
    assert refitted(replace(found, after=0.0), base, [held], floor).after == 0.0


@pytest.mark.parametrize(
    ("beyond", "took", "stays"), [(0.5, 0.5, True), (0.5, 0.1, False), (0.0, 0.5, False), (0.0, 1.0, True)]
)
def test_a_function_that_has_not_seen_what_is_held_out_takes_no_effects_place(beyond, took, stays, monkeypatch):
    """A force by the pressure difference from runs at 3, 5 and 7 bar says nothing of one at 1 bar.

    Unless the training runs show it far more: of what it takes of their cost the effect takes the share ``took``. One that has
    seen it must take more of their cost as well.
    """
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    assert named.beyond == 0.0
    term, best = named.joint.terms[0], replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["friction_position"]]))
    best = replace(best, relaxed=replace(base.relaxed, cost=base.relaxed.cost - took * named.gain))
    x = held.signals["x"]
    monkeypatch.setattr("pneuid.criticism.prediction.uncovered.visited", lambda *_: (x.min(), np.quantile(x, 0.7)))
    assert 0.15 < outside(base, term, [prepare(held, base.plant, base.noise)]) <= 0.3
    strange = replace(named, before=100.0, after=1.5, beyond=beyond)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda *_: strange)
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in (((), 10.0), (("one",), 7.0))]
    diagnosis = Diagnosis("effect", ("friction_position",), (), Unknown("force", ("x",), 1.0, "N"))
    found = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert found.effects == (("friction_position",) if stays else ())


def test_what_held_out_runs_ask_beyond_the_training_runs_is_said(monkeypatch):
    base, (_, held) = magnet()[0], magnet_runs()
    runs = [prepare(held, base.plant, base.noise)]
    assert uncovered(base, runs) == []
    slow = {"v": (-0.1, 0.1)}
    visited = "pneuid.criticism.prediction.uncovered.visited"
    monkeypatch.setattr(visited, lambda _runs, term, _fit: slow.get(term.signal, (0.0, 9e5)))
    (words,) = uncovered(base, runs)
    assert words.endswith("% by v (-0.1 to 0.1 m/s in training)")


@pytest.mark.parametrize(
    ("effect", "explains", "of_the_rest", "verdict"),
    [("friction_position", 0.5, 0.95, "unknown"), ("friction_position", 0.5, 0.85, "effect"),
     ("friction_position", 0.8, 0.95, "effect"), ("load_spring", 0.5, 0.95, "effect")],
)  # fmt: skip
def test_what_explains_the_larger_part_beside_an_effect_makes_it_unknown(effect, explains, of_the_rest, verdict, monkeypatch):
    """No function alone explains more than the effect does; beside it one explains a share of what it leaves."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    left = 99.0 * (1.0 - explains)
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[effect]]))
    nothing = replace(named, before=100.0, after=90.0)
    found_rest = replace(named, before=1.0 + left, after=1.0 + left * (1.0 - of_the_rest))
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda fit, *_: found_rest if fit is best else nothing)
    rungs = [
        Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6)
        for effects, error in (((), 10.0), ((effect,), np.sqrt(1.0 + left)))
    ]
    diagnosis = Diagnosis("effect", (effect,), (), Unknown("force", ("x",), 1.0, "N"))
    found = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (found.verdict, found.effects) == (verdict, (effect,))
    assert found.unknown is not None and found.unknown.effect is not None


@pytest.mark.parametrize(("beyond", "verdict"), [(0.14, "unknown"), (0.3, "effect")])
def test_what_explains_nearly_all_beside_an_effect_may_reach_a_little_beyond_the_training_runs(beyond, verdict, monkeypatch):
    """A relief valve opens most where the pressure is highest: 98 % of what is left, 14 % of the samples beyond."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["friction_position"]]))
    nothing, rest = replace(named, before=100.0, after=90.0), replace(named, before=41.0, after=1.8, beyond=beyond)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda fit, *_: rest if fit is best else nothing)
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in (((), 10.0), (("one",), 6.4))]
    diagnosis = Diagnosis("effect", ("friction_position",), (), Unknown("force", ("x",), 1.0, "N"))
    found = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (found.verdict, found.effects) == (verdict, ("friction_position",))


@pytest.mark.parametrize(("alone", "named"), [(0.87, True), (0.75, False)])
def test_a_form_that_explains_more_than_an_effect_in_its_place_is_shown(alone, named, monkeypatch):
    """An offset of a sensor whose gain drifts explains 78 %; beside it no function helps."""
    base, (_, held), found = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["load_spring"]]))
    left = 99.0 * (1.0 - 0.78)
    in_place = replace(found, before=100.0, after=1.0 + 99.0 * (1.0 - alone))
    beside = replace(found, before=1.0 + left, after=10.0 * left, gain=0.0)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda fit, *_: beside if fit is best else in_place)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.comparable_costs", lambda *_: [2.0, 1.0])
    rungs = [
        Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6)
        for effects, error in (((), 10.0), (("load_spring",), np.sqrt(1.0 + left)))
    ]
    diagnosis = Diagnosis("effect", ("load_spring",), (), Unknown("force", (), 1.0, "N"))
    said = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (said.verdict, said.effects) == ("effect", ("load_spring",))
    assert said.unknown is not None
    assert (said.unknown.effect is not None) is named


@pytest.mark.parametrize(
    ("gain", "brought", "after", "verdict"),
    [(0.08, 0.002, 1.9, "unknown"), (0.04, 0.002, 1.9, "effect"), (0.08, 0.03, 1.9, "effect"), (0.08, 0.002, 1.3, "effect")],
)  # fmt: skip
def test_what_the_training_runs_show_far_more_than_the_effect_named_is_missing_too(gain, brought, after, verdict, monkeypatch):
    """The held-out runs, beyond where it was seen, bear out an effect that the training runs hardly ask for."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["friction_viscous_nonlinear"]]))
    seen = replace(named, before=3.7, after=10.0, gain=gain * base.relaxed_cost, beyond=0.14)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda *_: seen)
    costs = base.relaxed_cost / (1.0 - brought), base.relaxed_cost
    monkeypatch.setattr("pneuid.criticism.unknown.rest.comparable_costs", lambda *_: list(costs))
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in (((), 2.6), (("one",), after))]
    diagnosis = Diagnosis("effect", ("friction_viscous_nonlinear",), (), Unknown("force", (), 1.0, "N"))
    found = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (found.verdict, found.effects) == (verdict, ("friction_viscous_nonlinear",))
    assert found.unknown is not None
    assert (found.unknown.depends_on == ("x",)) is (verdict == "unknown")
    assert found.unknown.effect is None
    assert any("outside its range" in words for words in found.sentences) is (verdict == "unknown")


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("gain", [14.0, 16.0])
def test_what_the_runs_fitted_to_show_most_is_said_where_no_effect_is_named(gain, together, monkeypatch):
    """Teeth over x, where the held-out runs reach beyond the training runs: a bench's runs together show them."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    lost = replace(named, before=3.7, after=10.0, gain=gain, beyond=0.14)
    every = replace(base) if together else None
    beside = replace(lost, gain=0.0)
    monkeypatch.setattr("pneuid.criticism.unknown.rest.search", lambda fit, *_: lost if fit is (every or base) else beside)
    diagnosis = Diagnosis("unknown", (), (), Unknown("force", (), 1.0, "N"))
    rungs = [Rung((), None, True, {}, {"F": 1.9}, {"F": 1.0}, 6)]
    found = explained(Verdict(diagnosis, base, base, rungs, every), [held]).diagnosis
    assert found.verdict == "unknown" and found.unknown is not None and found.unknown.effect is None
    assert found.unknown.depends_on == (("x",) if gain > 15.0 else ())
    assert len([words for words in found.sentences if "show spline:force(x" in words and "14 %" in words]) == (gain > 15.0)


class _Probes:
    """A search's probes with scripted predictions and costs: a leak of both chambers, of which one half leads."""

    start_cost = 32_000.0

    def __init__(self, pair_cost: float) -> None:
        self.pair_cost = pair_cost

    def screened(self, *terms: Term) -> float:
        pair = {term.equation for term in terms} == {"flow_1", "flow_2"} and {term.signal for term in terms} == {"x"}
        return 6000.0 if pair else 4600.0

    def fitted(self, terms: list[Term]) -> SimpleNamespace:
        return SimpleNamespace(terms=tuple(terms), cost=self.pair_cost if len(terms) > 1 else 27_500.0)


VALVE, LEAK = (Term("valve", "psup"),), (Term("flow_1", "x", "dp"), Term("flow_2", "x", "dp"))
HALF, ENCODER = (LEAK[1],), (Term("sensor_x", "x"),)


def _judged(monkeypatch, ranked, costs, errors, before=100.0):
    """What the search keeps: costs of the joint fits and held-out errors (squared, in floors) by their terms."""
    asked = []

    def fitted(terms):
        asked.append(tuple(terms))
        return SimpleNamespace(terms=tuple(terms), cost=costs[tuple(terms)])

    probes = SimpleNamespace(start_cost=1000.0, fitted=fitted)
    monkeypatch.setattr("pneuid.criticism.unknown.function_search._with_second", lambda _probing, _ranked, joint: joint)
    best, after, ties = judged(probes, ranked, before, lambda joint: errors[joint.terms])  # type: ignore[arg-type]
    return best.terms, after, ties, asked


def test_the_held_out_runs_choose_among_what_the_training_runs_show(monkeypatch):
    """A leak at a place over the stroke: a gain of the valve over the supply takes nearly as much of the training cost."""
    costs, errors = {VALVE: 690.0, LEAK: 670.0, HALF: 760.0}, {VALVE: 6000.0, LEAK: 40.0, HALF: 48.0}
    best, after, ties, _ = _judged(monkeypatch, [(330.0, LEAK), (310.0, VALVE), (240.0, HALF)], costs, errors)
    assert (best, after, ties) == (LEAK, 40.0, ())
    costs[VALVE], costs[LEAK] = 670.0, 690.0
    assert _judged(monkeypatch, [(330.0, VALVE), (310.0, LEAK), (240.0, HALF)], costs, errors)[0] == LEAK


def test_what_takes_far_less_of_the_cost_than_the_leader_is_not_asked_of_the_held_out_runs(monkeypatch):
    costs, errors = {VALVE: 690.0, ENCODER: 820.0}, {VALVE: 99.0, ENCODER: 10.0}
    best, _, _, asked = _judged(monkeypatch, [(310.0, VALVE), (180.0, ENCODER)], costs, errors)
    assert best == VALVE and asked == [VALVE]
    assert _judged(monkeypatch, [(310.0, VALVE), (190.0, ENCODER)], costs, errors)[0] == ENCODER


def test_no_more_than_three_of_an_equation_and_six_in_all_are_fitted(monkeypatch):
    names = ["flow_2(p1)", "flow_2(p2)", "flow_2(dp)", "flow_2(x)", "valve(p1)", "valve(p2)", "flow_1(p1)", "flow_1(p2)"]
    parts = [name.rstrip(")").split("(") for name in names]
    ranked = [(300.0 - k, (Term(equation, signal),)) for k, (equation, signal) in enumerate(parts)]
    same = {terms: 700.0 for _, terms in ranked}
    asked = _judged(monkeypatch, ranked, same, same)[3]
    assert [f"{term.equation}({term.signal})" for (term,) in asked] == [*names[:3], *names[4:7]]


def test_where_none_is_borne_out_the_training_runs_choose(monkeypatch):
    costs, errors = {VALVE: 690.0, ENCODER: 660.0}, {VALVE: 90.0, ENCODER: 99.0}
    assert _judged(monkeypatch, [(310.0, VALVE), (300.0, ENCODER)], costs, errors)[:2] == (ENCODER, 99.0)


@pytest.mark.parametrize(("cost", "error", "tied"), [(672.0, 55.0, True), (672.0, 58.0, False), (685.0, 46.0, False)])
def test_what_explains_both_kinds_of_runs_alike_is_said(monkeypatch, cost, error, tied):
    """At 3 % of the drop of the cost and four fifths of the excess that the best one explains."""
    ranked = [(330.0, ENCODER), (330.0, VALVE)]
    found = _judged(monkeypatch, ranked, {ENCODER: 670.0, VALVE: cost}, {ENCODER: 45.0, VALVE: error})
    assert found[0] == ENCODER and found[2] == (VALVE if tied else ())


@pytest.mark.parametrize(("then", "kept"), [(30.0, True), (50.0, False)])
def test_a_second_term_must_help_held_out(monkeypatch, then, kept):
    costs = {ENCODER: 700.0, (*ENCODER, *VALVE): 500.0}
    errors = {ENCODER: 40.0, (*ENCODER, *VALVE): then}
    one = lambda terms: SimpleNamespace(terms=tuple(terms), cost=costs[tuple(terms)])  # noqa: E731
    monkeypatch.setattr("pneuid.criticism.unknown.function_search._with_second", lambda *_: one((*ENCODER, *VALVE)))
    probes = SimpleNamespace(start_cost=1000.0, fitted=one)
    best, after, _ = judged(probes, [(300.0, ENCODER)], 100.0, lambda joint: errors[joint.terms])  # type: ignore[arg-type]
    assert (best.terms, after) == (((*ENCODER, *VALVE), 30.0) if kept else (ENCODER, 40.0))


@pytest.mark.parametrize(("together", "leads"), [(6000.0, True), (5500.0, False)])
def test_a_leak_across_the_piston_leads_where_both_halves_promise_more_than_one(together, leads):
    """A valve over the supply 5900, either half of a leak 4600: both must promise a fifth more than one, and their splines."""

    def screened(*terms):
        names = {f"{term.equation}({term.signal}*{term.factor})" for term in terms}
        if names == {"flow_1(x*dp)", "flow_2(x*dp)"}:
            return together
        return 4600.0 if names & {"flow_1(x*dp)", "flow_2(x*dp)"} else 5900.0 if names == {"valve(psup*)"} else 100.0

    scope = SimpleNamespace(psup=np.array([3e5, 7e5]))
    probes = SimpleNamespace(problem=SimpleNamespace(plant=SimpleNamespace(servo=True)), scope=scope, screened=screened)
    ranked = ranking(probes)  # type: ignore[arg-type]
    assert (len(ranked[0][1]) == 2) == leads and any(len(terms) == 2 for _, terms in ranked) == leads
    probes.problem.plant.servo = False
    assert all(len(terms) == 1 for _, terms in ranking(probes))  # type: ignore[arg-type]


@pytest.mark.parametrize(("pair_cost", "both"), [(26_200.0, True), (26_900.0, False)])
def test_the_other_half_is_found_however_low_it_ranks_and_kept_where_it_is_worth_it(pair_cost, both):
    first, other = Term("flow_2", "x", "dp"), Term("flow_1", "x", "dp")
    crowd = [Term("valve", signal) for signal in ("psup", "x", "p1", "p2")] + [Term("flow_2", "p1"), Term("flow_2", "p2")]
    ranked = [(4600.0 - 100.0 * k, (term,)) for k, term in enumerate([first, *crowd, other])]
    probes = _Probes(pair_cost)
    found = _with_second(probes, ranked, probes.fitted([first]))  # type: ignore[arg-type]
    assert found.terms == ((first, other) if both else (first,))


def test_a_curve_through_a_few_pressures_has_no_formula():
    """Four runs, each at its own pressure: a wave goes through any four points."""
    at = np.linspace(1e5, 7e5, 101)
    value = np.sin(2 * np.pi * at / 1e5)
    shape = Curve("spline:force(p1)", "force", "p1", "", "N", tuple(at), tuple(value), tuple(0.1 + 0.0 * at), provisional=True)
    for levels, known in (((1e5, 3e5, 4e5, 7e5), False), (tuple(at), True)):
        runs = [
            SimpleNamespace(recording=SimpleNamespace(signals={"p1": np.full(50, level)}), n=50, inputs=()) for level in levels
        ]
        found = SimpleNamespace(runs=runs, plant=SimpleNamespace(rig=STAND))
        assert (distilled(Term("force", "p1"), shape, found) is not None) is known  # type: ignore[arg-type]


AT = np.linspace(0.1, 0.4, 121)
SHAPED = {
    "period": 3.0 * np.sin(2 * np.pi * AT / 0.025 + 0.3), "bump": 2.0 * np.exp(-(((AT - 0.22) / 0.02) ** 2)),
    "above": 4.0 * np.maximum(0.0, AT - 0.31), "saturation": np.tanh((AT - 0.2) / 0.03),
    "pull": -(AT - 0.25) / 0.02 * np.exp(-(((AT - 0.25) / 0.02) ** 2)),
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPED)
def test_a_shape_is_recognised(shape):
    value, weight = SHAPED[shape], np.full(AT.size, 1.0 / AT.size)
    spread = float(np.std(value))
    error, numbers, _ = _fitted(Term("force", "x"), SHAPES[shape], AT, value, weight)
    assert error < 0.08 * spread
    expected = {"period": 0.025, "bump": 0.22, "above": 0.31, "saturation": 0.2, "pull": 0.25}[shape]
    assert numbers[0] == pytest.approx(expected, abs=0.004)
    if shape != "saturation":
        other = _fitted(Term("force", "x"), SHAPES["parabola"], AT, value, weight)[0]
        assert other > 2.0 * error
