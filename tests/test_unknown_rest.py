"""The unknown rest in a verdict: when a function is named beside the effects, in their place, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from magnet import STAND, magnet, magnet_runs, searched

from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import Diagnosis, Unknown
from pneuid.criticism.decision.rest import explained
from pneuid.criticism.decision.verdict import Verdict
from pneuid.criticism.prediction.uncovered import outside, uncovered
from pneuid.effects import CATALOGUE
from pneuid.effects._spline import Term
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant

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


@pytest.mark.parametrize(
    ("searched_for", "refit", "last", "verdict"),
    [(600.0, 300.0, 1.5, "unknown"), (600.0, 300.0, 150.0, "effect"), (600.0, 35.0, 1.5, "effect"),
     (6000.0, 3000.0, 1.5, "effect")],
)  # fmt: skip
def test_a_function_beside_a_model_that_is_far_off_is_identified_from_the_data(searched_for, refit, last, verdict, monkeypatch):
    """Beside a gain of p1 7 % too high it left 103 floors as searched for, 28 fitted from there, 3 from the data; an offset,
    which was named, 37. It is not asked for where little is left, or where it explains less than nine tenths."""
    monkeypatch.setattr("pneuid.criticism.decision.rest.identified", lambda found, *_: replace(found, after=last))

    def fitted(found, *_):
        return replace(found, after=refit)

    alone = 1.0 - searched_for / 10_000.0
    assert _stood_in("gravity", 0.97, alone, 0.5, monkeypatch, fitted=fitted, excess=10_000.0).verdict == verdict


@pytest.mark.parametrize(("shown", "after", "verdict"), [(0.6, 5.0, "unknown"), (0.6, 80.0, "effect"), (0.4, 5.0, "effect")])
@pytest.mark.parametrize("names", [("friction_position",), ()])
def test_what_takes_half_of_the_training_cost_is_fitted_though_held_out_runs_do_not_bear_it_out(
    names, shown, after, verdict, monkeypatch
):
    """A seal that chatters at some speeds: the joint fit made the held-out excess larger, one from there took 79 % of it.

    In the place of an effect that explains a third, and where none is named.
    """
    monkeypatch.setattr("pneuid.criticism.decision.rest.refitted", lambda found, *_: replace(found, after=after))
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    found = replace(named, before=100.0, after=83.0, gain=shown * base.relaxed_cost)
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda *_: found)
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[name] for name in names])) if names else base
    costs = [base.relaxed_cost, base.relaxed_cost * (0.7 if names else 1.0)]
    monkeypatch.setattr("pneuid.criticism.decision.rest.comparable_costs", lambda *_: costs)
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in (((), 10.0), (names, 8.1))]
    diagnosis = Diagnosis("effect" if names else "unknown", names, (), Unknown("force", (), 1.0, "N"))
    said = explained(Verdict(diagnosis, best, base, rungs if names else rungs[:1]), [held]).diagnosis
    assert said.verdict == (verdict if names else "unknown")
    assert said.unknown is not None and (said.unknown.effect is not None) is (verdict == "unknown")


def _stood_in(
    effect: str, explains: float, alone: float, took: float, monkeypatch, near: bool = False, fitted=lambda found, *_: found,
    excess: float = 99.0,
) -> Diagnosis:  # fmt: skip
    monkeypatch.setattr("pneuid.criticism.decision.rest.refitted", fitted)
    names = tuple(effect.split())
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    monkeypatch.setattr(
        "pneuid.criticism.decision.rest.search",
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
    ("name", "equation", "signal", "by_all_runs", "said"),
    [
        ("friction_pressure", "friction", "p2", True, "effect"),
        ("friction_pressure", "friction", "dp", True, "effect"),
        ("friction_pressure", "friction", "x", True, "unknown"),  # on what its friction does not turn
        ("friction_pressure", "force", "p2", True, "unknown"),
        ("friction_direction", "friction", "v", True, "unknown"),  # on what the base model's friction turns as well
        ("friction_pressure", "friction", "p2", False, "unknown"),
    ],
)
def test_a_function_of_its_kind_confirms_what_all_runs_show(name, equation, signal, by_all_runs, said, monkeypatch):
    """Friction by pressure on slow runs predicted what was left out no better than nothing; ``friction(p2)`` left noise."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    joint = replace(named.joint, terms=(Term(equation, signal),))
    found = replace(named, joint=joint, formula=None, ties=(), before=1.9, after=1.01)
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda *_: found)
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[name]]))
    best = replace(best, relaxed=replace(base.relaxed, cost=base.relaxed.cost - 0.2 * named.gain))
    rungs = [Rung(of, None, True, {}, {"F": error}, {"F": 1.0}, 6) for of, error in (((), 1.39), ((name,), 1.63))]
    diagnosis = Diagnosis("unknown", (name,), (), Unknown("force", (), 1.0, "N"), by_all_runs=by_all_runs)
    diagnosis = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (diagnosis.verdict, diagnosis.effects) == (said, (name,) if said == "effect" else ())
    assert diagnosis.unknown is not None and diagnosis.unknown.effect == f"spline:{equation}({signal})"


@pytest.mark.parametrize(
    ("names", "gain", "verdict"),
    [
        ("load_spring friction_direction", 1.01, "unknown"),
        ("load_spring friction_direction", 0.98, "unknown"),  # the training runs do not tell, and it leaves an eighth
        ("load_spring friction_direction", 0.96, "effect"),
        ("friction_position friction_direction", 0.98, "unknown"),  # of one equation, another than its own
        ("load_spring gravity", 1.01, "effect"),  # of its own: what their form lacks
        ("load_spring", 1.01, "effect"),  # one effect stands where no more than that is gained
    ],
)
def test_one_function_that_is_fitted_takes_the_place_of_two_effects_that_took_as_much(names, gain, verdict, monkeypatch):
    """By the joint fit alone it took a tenth less than they, and left more."""

    def fitted(found, *_):
        return replace(found, after=2.0, gain=gain / 0.9 * found.gain)

    assert _stood_in(names, 0.9, 0.95, 1.0 / 0.9, monkeypatch, fitted=fitted).verdict == verdict


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
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda *_: strange)
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
    monkeypatch.setattr("pneuid.criticism.decision.rest.refitted", lambda found, *_: found)
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    left = 99.0 * (1.0 - explains)
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[effect]]))
    nothing = replace(named, before=100.0, after=90.0)
    found_rest = replace(named, before=1.0 + left, after=1.0 + left * (1.0 - of_the_rest))
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda fit, *_: found_rest if fit is best else nothing)
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
    monkeypatch.setattr("pneuid.criticism.decision.rest.refitted", lambda found, *_: found)
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["friction_position"]]))
    nothing, rest = replace(named, before=100.0, after=90.0), replace(named, before=41.0, after=1.8, beyond=beyond)
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda fit, *_: rest if fit is best else nothing)
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in (((), 10.0), (("one",), 6.4))]
    diagnosis = Diagnosis("effect", ("friction_position",), (), Unknown("force", ("x",), 1.0, "N"))
    found = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (found.verdict, found.effects) == (verdict, ("friction_position",))


SPRING = ("load_spring", Term("force", "x", "p1"), 0.6, Term("force", "x", "p1"), 0.99, 0.5, "unknown")


@pytest.mark.parametrize(
    ("effect", "beside", "of_the_rest", "alone", "explains", "took", "verdict"),
    [
        SPRING,
        ("load_spring", Term("force", "x"), 0.6, Term("force", "x"), 0.99, 0.5, "effect"),  # what the spring's form lacks
        ("friction_dwell", Term("friction", "x"), 0.6, Term("friction", "x"), 0.99, 0.5, "effect"),  # has a state of its own
        ("load_spring", Term("friction", "p1"), 0.6, Term("friction", "p1"), 0.99, 0.5, "effect"),  # acts elsewhere
        (*SPRING[:2], 0.4, *SPRING[3:6], "effect"),  # takes less than half of the rest
        (*SPRING[:3], Term("force", "p1"), *SPRING[4:6], "effect"),  # another function leads where the spring is left out
        (*SPRING[:4], 0.977, SPRING[5], "effect"),  # leaves more than half of what the spring leaves
        (*SPRING[:5], 0.95, "effect"),  # takes hardly more of the training cost
    ],
)  # fmt: skip
def test_what_acts_where_the_effect_does_on_other_signals_is_tried_in_its_place(
    effect, beside, of_the_rest, alone, explains, took, verdict, monkeypatch
):
    """In place of a rolling diaphragm on a bench a spring left 4 % of the excess and 3.8 floors, ``force(x*p1)`` noise."""
    base, (_, held), named = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE[effect]]))
    left, excess = 0.04 * 300.0, 300.0

    def found(term, excess, explained):
        joint = replace(named.joint, terms=(term,))
        return replace(named, joint=joint, before=1.0 + excess, after=1.0 + excess * (1.0 - explained))

    rest, lone = found(beside, left, of_the_rest), found(alone, excess, explains)
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda fit, *_: rest if fit is best else lone)
    monkeypatch.setattr("pneuid.criticism.decision.rest.comparable_costs", lambda *_: [named.gain, (1.0 - took) * named.gain])
    errors = (((), np.sqrt(1.0 + excess)), ((effect,), np.sqrt(1.0 + left)))
    rungs = [Rung(effects, None, True, {}, {"F": error}, {"F": 1.0}, 6) for effects, error in errors]
    diagnosis = Diagnosis("effect", (effect,), (), Unknown("force", (), 1.0, "N"))
    said = explained(Verdict(diagnosis, best, base, rungs), [held]).diagnosis
    assert (said.verdict, said.effects) == (("unknown", ()) if verdict == "unknown" else ("effect", (effect,)))


@pytest.mark.parametrize(("alone", "named"), [(0.87, True), (0.75, False)])
def test_a_form_that_explains_more_than_an_effect_in_its_place_is_shown(alone, named, monkeypatch):
    """An offset of a sensor whose gain drifts explains 78 %; beside it no function helps."""
    monkeypatch.setattr("pneuid.criticism.decision.rest.refitted", lambda found, *_: found)
    base, (_, held), found = magnet()[0], magnet_runs(), searched()
    best = replace(base, plant=Plant(STAND, "lugre", [CATALOGUE["load_spring"]]))
    left = 99.0 * (1.0 - 0.78)
    in_place = replace(found, before=100.0, after=1.0 + 99.0 * (1.0 - alone))
    beside = replace(found, before=1.0 + left, after=10.0 * left, gain=0.0)
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda fit, *_: beside if fit is best else in_place)
    monkeypatch.setattr("pneuid.criticism.decision.rest.comparable_costs", lambda *_: [2.0, 1.0])
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
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda *_: seen)
    costs = base.relaxed_cost / (1.0 - brought), base.relaxed_cost
    monkeypatch.setattr("pneuid.criticism.decision.rest.comparable_costs", lambda *_: list(costs))
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
    monkeypatch.setattr("pneuid.criticism.decision.rest.search", lambda fit, *_: lost if fit is (every or base) else beside)
    diagnosis = Diagnosis("unknown", (), (), Unknown("force", (), 1.0, "N"))
    rungs = [Rung((), None, True, {}, {"F": 1.9}, {"F": 1.0}, 6)]
    found = explained(Verdict(diagnosis, base, base, rungs, every), [held]).diagnosis
    assert found.verdict == "unknown" and found.unknown is not None and found.unknown.effect is None
    assert found.unknown.depends_on == (("x",) if gain > 15.0 else ())
    assert len([words for words in found.sentences if "show spline:force(x" in words and "14 %" in words]) == (gain > 15.0)
