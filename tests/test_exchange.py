"""Of two accepted effects one that only stands in for another gives its place to that one."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trials import FIRST, JUDGE, score, stub, walking

from pneuid.criticism.decision import exchange, revision
from pneuid.criticism.decision.exchange import Exchange, exchanged
from pneuid.criticism.decision.zeros import NOTHING_READ
from pneuid.effects import CATALOGUE, LAW_STEPS

pytestmark = pytest.mark.usefixtures("amplitudes_inside")

BOTH = stub(15.0, 27_000.0, "leakage_internal")
"""A load spring whose force hardly changes, beside a leak: what is hidden is a weight."""

ALONE = stub(4900.0, 60_000.0, "leakage_internal")


def _asked(
    monkeypatch, end, current=BOTH, screened=("load_spring", "gravity"), inside=True, judge=JUDGE, mate=None, zeros=NOTHING_READ
):
    """What does better in the place of the spring where the weight ends at ``end``, in brackets where the runs do not tell the
    two; and what it was asked of. The same as the weight is an offset that ends at ``mate``, where there is one."""
    seen, group = [], () if mate is None else ("sensor_offset_F",)

    def beside(chosen, _scores, tried, standing, *_):
        seen.append((chosen[0].effect.name, chosen[1], [pair[0].effect.name for pair in tried], standing))
        return [] if end is None else [(score("gravity", 900.0, group), stub(*end, "gravity"))]

    monkeypatch.setattr(exchange, "screen", lambda *_: [score(name, 900.0) for name in (*screened, *group)])
    monkeypatch.setattr(exchange, "led_there", beside)
    monkeypatch.setattr(exchange, "inside_bounds", lambda *_: inside)
    judge = SimpleNamespace(**vars(judge) | {"trial": lambda end, name: stub(*end, name)})
    refitter = SimpleNamespace(order=(), led=lambda *_: mate)
    found = exchanged("load_spring", ALONE, current, judge, refitter, [], lambda _: None, zeros)
    rivals = ", ".join(one.effect.name for one, _ in found.rivals)
    return (found.taking[0].effect.name if found.taking else f"({rivals})" if rivals else None), seen


@pytest.mark.parametrize(
    ("end", "named"),
    [
        ((9.4, 26_500.0), "gravity"),
        ((9.4, 26_990.0), "(gravity)"),  # the training runs do not tell the two
        ((14.96, 26_500.0), "(gravity)"),  # nor do the held-out ones
        ((15.02, 27_010.0), "(gravity)"),  # it does as well, and no better
        ((40.0, 35_000.0), None),
        (None, None),
    ],
)
def test_both_kinds_of_runs_must_tell_the_other_from_the_one_that_stands(end, named, monkeypatch):
    found, seen = _asked(monkeypatch, end)
    assert found == named
    assert seen == [("load_spring", BOTH, ["load_spring"], ALONE)], "led from the model with both, beside the one that stays"


@pytest.mark.parametrize(
    ("end", "mate", "named"),
    [
        ((15.02, 27_010.0), (15.02, 27_010.0), "(gravity, sensor_offset_F)"),
        ((9.4, 26_990.0), (9.4, 26_990.0), "(gravity, sensor_offset_F)"),
        ((15.02, 27_010.0), (40.0, 35_000.0), "(gravity)"),
        ((40.0, 35_000.0), (15.02, 27_010.0), None),
    ],
)
def test_what_is_the_same_as_a_rival_is_a_rival(end, mate, named, monkeypatch):
    """In the place of a spring a weight was as good, and so is what was hidden, an offset of the force sensor."""
    ALONE.fit.plant = SimpleNamespace(effects=[])
    assert _asked(monkeypatch, end, mate=mate)[0] == named


def test_none_is_sought_where_noise_alone_is_left_or_the_effect_cannot_be_put_back(monkeypatch):
    assert _asked(monkeypatch, (1.0, 20_000.0), current=stub(1.1, 27_000.0)) == (None, [])
    assert _asked(monkeypatch, (9.4, 26_500.0), screened=("gravity",)) == (None, [])


class _Reading:
    """A zero reading that shows one effect, and contradicts others."""

    def __init__(self, shows="", contradicts=()):
        self.shows, self.wrong = shows, contradicts

    def confirms(self, _fit, effect):
        return effect.name == self.shows

    def possible(self, tried):
        return [pair for pair in tried if pair[0].effect.name not in self.wrong]


def test_what_a_zero_reading_shows_stays_and_none_is_sought(monkeypatch):
    assert _asked(monkeypatch, (9.4, 26_500.0), zeros=_Reading("load_spring")) == (None, [])


def test_what_a_zero_reading_contradicts_takes_no_place_and_is_no_rival(monkeypatch):
    ALONE.fit.plant = SimpleNamespace(effects=[])
    for end, error in (((9.4, 26_500.0), (9.4, 26_500.0)), ((15.02, 27_010.0), (15.02, 27_010.0))):
        assert _asked(monkeypatch, end, mate=error, zeros=_Reading(contradicts=("gravity",)))[0] is None
    mate, zeros = (15.02, 27_010.0), _Reading(contradicts=("sensor_offset_F",))
    assert _asked(monkeypatch, (15.02, 27_010.0), mate=mate, zeros=zeros)[0] == "(gravity)"


@pytest.mark.parametrize("shows", ["gravity", "sensor_offset_F"])
def test_of_rivals_the_one_that_a_zero_reading_shows_takes_the_place(shows, monkeypatch):
    ALONE.fit.plant = SimpleNamespace(effects=[])
    assert _asked(monkeypatch, (15.02, 27_010.0), mate=(15.02, 27_010.0), zeros=_Reading(shows))[0] == shows


def test_one_whose_amplitude_lies_on_a_bound_takes_no_place(monkeypatch):
    assert _asked(monkeypatch, (9.4, 26_500.0), inside=False)[0] is None


@pytest.mark.parametrize(
    ("error", "predicted", "named"),
    [(14.0, 45.0, "gravity"), (14.0, 50.0, None), (9.4, 50.0, "gravity"), (9.4, 68.0, None)],
)
def test_one_that_costs_less_and_predicts_the_training_runs_worse_takes_no_place(error, predicted, named, monkeypatch):
    """A little worse it may predict them if it predicts the held-out ones clearly better."""
    judge = SimpleNamespace(**{**vars(JUDGE), "usually_fits": lambda trial: 46.0 if trial is BOTH else predicted})
    assert _asked(monkeypatch, (error, 26_500.0), judge=judge)[0] == named


@pytest.mark.parametrize(("unseen", "named"), [(12.0, "gravity"), (14.0, "(gravity)"), (20.0, "(gravity)")])
def test_what_gains_by_a_level_read_off_each_held_out_run_takes_no_place(unseen, named, monkeypatch):
    """Of a seal with one pressure a run a warmth left 18 floors and not 24, by a warmth of the held-out run's own."""
    judge = SimpleNamespace(**{**vars(JUDGE), "unseen": lambda trial: 15.0 if trial is BOTH else unseen})
    assert _asked(monkeypatch, (9.4, 26_500.0), judge=judge)[0] == named


def _walk(monkeypatch, takes, late=False):
    """A walk that named a spring beside a leak, going backward, and the effects that another was sought for."""
    sought = []

    def other(name, _smaller, current, *_):
        sought.append((name, current))
        return takes.get(name, Exchange())

    monkeypatch.setattr(revision, "exchanged", other)
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda fit: fit)
    going = walking(judge, SimpleNamespace(late=lambda: late, without=lambda *_: ALONE), BOTH)
    monkeypatch.setattr(going, "rung", lambda trial, accepted: (trial, accepted))
    monkeypatch.setattr(going, "_record", lambda *_, **__: None)
    standing = [CATALOGUE[name] for name in ("load_spring", "leakage_internal")]
    BOTH.fit.plant = ALONE.fit.plant = SimpleNamespace(effects=standing)
    going.first, going.named = FIRST, ["load_spring", "leakage_internal"]
    going.ambiguous = {"load_spring": ("friction_position",)}
    return going, sought


def test_what_takes_the_place_is_named_and_is_the_model_that_the_next_round_starts_from(monkeypatch):
    weight = stub(9.4, 26_500.0, "gravity")
    weight.fit.plant = SimpleNamespace(effects=[CATALOGUE[name] for name in ("gravity", "leakage_internal")])
    going, sought = _walk(monkeypatch, {"load_spring": Exchange((score("gravity", 900.0), weight))})
    assert going.backward() and set(going.named) == {"gravity", "leakage_internal"} and going.current is weight
    assert going.rungs == [(weight, True)] and going.ambiguous == {"gravity": ()}
    assert sought == [("load_spring", BOTH), ("leakage_internal", weight)], "the leak is judged beside what stands now"
    assert not going.backward() and len(sought) == 2, "the same is not asked twice, nor the one that was replaced"


def test_once_the_time_is_over_nothing_is_sought_in_the_place_of_another(monkeypatch):
    weight = stub(9.4, 26_500.0, "gravity")
    going, sought = _walk(monkeypatch, {"load_spring": Exchange((score("gravity", 900.0), weight))}, late=True)
    assert not going.backward() and set(going.named) == {"load_spring", "leakage_internal"} and sought == []


def test_what_is_not_told_from_what_takes_the_place_is_its_rival(monkeypatch):
    """On a bench an offset of the force took the place of a friction by direction and was named alone; a weight is the same."""
    weight, offset = stub(9.4, 26_500.0, "gravity"), stub(9.4, 26_500.0, "sensor_offset_F")
    weight.fit.plant = SimpleNamespace(effects=[CATALOGUE[name] for name in ("gravity", "leakage_internal")])
    rivals = ((score("sensor_offset_F", 900.0), offset),)
    going, _ = _walk(monkeypatch, {"load_spring": Exchange((score("gravity", 900.0), weight), rivals)})
    assert going.backward() and going.ambiguous == {"gravity": ("sensor_offset_F",)}


@pytest.mark.parametrize(("group", "led"), [(("sensor_offset_F", "load_spring"), ["sensor_offset_F"]), ((), [])])
@pytest.mark.parametrize(("error", "rival"), [(9.4, True), (40.0, False)])
def test_group_mates_of_what_takes_the_place_are_led_there(group, led, error, rival, monkeypatch):
    scores = [score("load_spring", 900.0), score("gravity", 900.0, group), score("sensor_offset_F", 900.0)]
    monkeypatch.setattr(exchange, "screen", lambda *_: scores)
    monkeypatch.setattr(exchange, "led_there", lambda *_: [(scores[1], stub(9.4, 26_500.0, "gravity"))])
    monkeypatch.setattr(exchange, "inside_bounds", lambda *_: True)
    made = []
    ALONE.fit.plant = SimpleNamespace(effects=())
    judge = SimpleNamespace(**{**vars(JUDGE), "trial": lambda _fit, name: stub(error, 26_500.0 if rival else 40_000.0, name)})
    refitter = SimpleNamespace(order=(), led=lambda _base, _there, asked: made.append(asked.effect.name))
    found = exchanged("load_spring", ALONE, BOTH, judge, refitter, [], lambda _: None)
    assert found.taking is not None and made == led
    assert [one.effect.name for one, _ in found.rivals] == (led if rival else [])


def test_where_none_takes_the_place_nothing_changes(monkeypatch):
    going, sought = _walk(monkeypatch, {})
    assert not going.backward() and going.named == ["load_spring", "leakage_internal"] and going.current is BOTH
    assert [name for name, _ in sought] == going.named and going.ambiguous == {"load_spring": ("friction_position",)}


def test_what_does_better_and_is_not_told_from_the_one_that_stands_is_its_rival(monkeypatch):
    """Beside a sensor's lag inlet mixing was accepted; there a critical ratio, which was hidden, leaves 8.4 and not 8.6."""
    weight = stub(14.9, 26_990.0, "gravity")
    going, _ = _walk(monkeypatch, {"load_spring": Exchange(rivals=((score("gravity", 900.0), weight),))})
    assert not going.backward() and set(going.named) == {"load_spring", "leakage_internal"} and going.current is BOTH
    assert going.ambiguous["load_spring"] == ("friction_position", "gravity")
    assert going.rungs == []


# --- beside what does not help ---

OFFSET = stub(15.0, 27_000.0, "load_spring")
"""One effect, named alone, that stands in for another."""

WEIGHT = (score("gravity", 900.0), stub(3.0, 9_000.0, "gravity"))
LEAK = (score("leakage_internal", 900.0), stub(16.0, 10_000.0, "leakage_internal"))


@pytest.mark.parametrize(
    ("ends", "larger"),
    [
        ([(10_000.0, "leakage_internal"), (26_900.0, "dead_volume")], "leakage_internal"),
        ([(26_900.0, "dead_volume"), (9_000.0, "law:dahl"), (10_000.0, "leakage_internal")], "leakage_internal"),
        ([(12_000.0, "leakage_internal")], None),  # 15 000 for the 16 000 that the spring took
        ([], None),
    ],
    ids=["larger", "not a friction law", "smaller", "none"],
)
def test_what_takes_more_of_the_training_cost_than_the_named_one_is_the_larger_part(ends, larger):
    effects = CATALOGUE | LAW_STEPS
    tried = [(SimpleNamespace(effect=effects[name]), stub(16.0, cost, name)) for cost, name in ends]
    found = exchange.larger_part(tried, OFFSET, FIRST)
    assert (found and found[0].effect.name) == larger


def _alone(monkeypatch, current=OFFSET, found=None, accepts=True, late=False, inside=True, denied=False, mates=()):
    """A walk that named a spring alone, beside which a leak takes more of the training cost, and what it recorded."""
    found = Exchange(WEIGHT, (WEIGHT,)) if found is None else found
    monkeypatch.setattr(revision, "larger_part", lambda *_: LEAK)
    monkeypatch.setattr(revision, "exchanged", lambda *_: found)
    monkeypatch.setattr(revision, "accepted", lambda tried, *_: tried[0] if accepts else None)
    monkeypatch.setattr(revision, "inside_bounds", lambda *_: inside)
    judge = SimpleNamespace(**vars(JUDGE), trial=lambda *_: ALONE)
    going = walking(judge, SimpleNamespace(late=lambda: late, without=lambda *_: ALONE), current)
    going.zeros = SimpleNamespace(preferred=lambda chosen, _: chosen, deny=lambda _: denied)
    recorded = []
    monkeypatch.setattr(going, "rung", lambda trial, accepted: (trial, accepted))
    monkeypatch.setattr(going, "_rivals", lambda *_: list(mates))
    monkeypatch.setattr(going, "_record", lambda one, *_, **__: recorded.append((one.effect.name, going.current)))
    going.first, going.named, going.ambiguous = FIRST, ["load_spring"], {"load_spring": ("friction_position",)}
    return going, recorded


def test_both_are_named_then_and_measured_against_the_base_model(monkeypatch):
    going, recorded = _alone(monkeypatch)
    assert going._instead([]) and going.named == ["gravity", "leakage_internal"] and going.current is WEIGHT[1]
    assert going.ambiguous == {"gravity": ("gravity",), "leakage_internal": ()} and going.rungs == [(WEIGHT[1], True)]
    assert recorded == [("gravity", FIRST), ("leakage_internal", FIRST)]


def test_what_is_collinear_with_the_second_one_is_its_rival(monkeypatch):
    going, _ = _alone(monkeypatch, mates=[(score("dead_volume", 900.0), LEAK[1])])
    assert going._instead([]) and going.ambiguous["leakage_internal"] == ("dead_volume",)


@pytest.mark.parametrize(
    "stays",
    [{"current": stub(3.9, 27_000.0, "load_spring")}, {"found": Exchange()}, {"accepts": False}, {"late": True},
     {"inside": False}, {"denied": True}],
    ids=["two floors are little", "nothing takes its place", "not accepted", "late", "on a bound", "a zero reading denies it"],
)  # fmt: skip
def test_the_named_one_stays(stays, monkeypatch):
    going, recorded = _alone(monkeypatch, **stays)
    assert not going._instead([]) and going.named == ["load_spring"] and not recorded


def test_of_several_named_none_gives_its_place_that_way(monkeypatch):
    going, _ = _alone(monkeypatch)
    going.named.append("gravity")
    assert not going._instead([])


def test_without_a_larger_part_the_named_one_stays(monkeypatch):
    going, _ = _alone(monkeypatch)
    monkeypatch.setattr(revision, "larger_part", lambda *_: None)
    assert not going._instead([])
