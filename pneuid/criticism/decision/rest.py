"""The unknown rest in a verdict: whether a function that the search found is named, beside the effects or in their place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pneuid.criticism.decision.acceptance import LEAST_DROP
from pneuid.criticism.decision.diagnosis import Unknown
from pneuid.criticism.decision.leftover import FLOORS
from pneuid.criticism.decision.rounds import Say
from pneuid.criticism.decision.turns_on import own_signals
from pneuid.criticism.decision.verdict import Verdict
from pneuid.criticism.prediction.uncovered import MUCH as UNCOVERED
from pneuid.criticism.unknown.function_search import TIED, Found, identified, refitted, search
from pneuid.estimation.fit import Fit, comparable_costs
from pneuid.recording import Recording

SEEN, TIMES = 0.05, 3.0
"""Share of the relaxed cost that a term takes from the *training* runs, and times what the accepted effects took, from which it
is said to be missing although the held-out runs do not bear it out: what little the effects explain there is chance, or stands
in for it."""

MORE = 1.1
"""Times what an effect took of the training cost that a function must take to take its place: a tube's delay at a wrong
break-away left 11 % of the held-out excess and a valve's gain over u 3 %, but that took 0.99 of what the delay did. A function
in place of several effects need only take as much as they, or follow the training runs alike where it leaves less than half
held out: of valves whose gain falls as they open a delay and a leak at null took 0.997 of what a gain over u did, and left
five times as much, a delay and a critical ratio 1.0003 of it, and left 37 times as much."""

LITTLE, MUCH = 0.05, 0.25
"""Shares of the held-out excess left by accepted effects, above which a term of another equation may take their place, and
above which any may: below that, a term of their own equation is what their form lacks. Above the second a term of another
equation that explains nearly all of what they leave makes the verdict ``unknown``: the larger part is not in the catalogue.
Effects of several equations may leave less, where that is many floors: of a relief valve a leak and heat at the walls left
4.6 %, but 36 floors."""

NEARLY_ALL, HALF = 0.9, 0.5
"""To take their place it must alone explain more than the first share of the excess, and more than they do, or leave less than
the second of what they leave. Of nine rigs whose effect the catalogue holds, in another form, it leaves 2.4 times as much or
more, or explains nothing; of seven that it does not hold 0.00, 0.02, 0.29, 0.69 and 0.82, 1.1 and 1.2 times."""

STRANGE = 0.25
"""Share of the held-out samples outside the training runs' range, below which a function that explains nearly all there is
believed beside effects that leave much: a relief valve opens most where the pressure is highest."""

UNSEEN = (
    "most of all the training runs show {}: it takes {:.1f} % of what they leave, the named effects take {:.1f} %; the "
    "held-out runs do not bear it out"
)
ALONE = "most of all, {} show {}: it takes {:.1f} % of what they leave; the held-out runs alone do not bear it out"
BEYOND = ", and {:.0f} % of their samples lie outside its range in the training runs: train on runs that cover it"

CONFIRMS = (
    "{} is named: what predicts runs that were not fitted is of the same kind, where its own laws are left too open to do so"
)
"""Said where a function takes nearly all that an effect leaves which all runs together show, on what that effect turns on."""

IN_PLACE = "beside {0} nothing explains the rest; more than {0} does, in its place, a form that the catalogue lacks"
"""Said where the effect stands, since it explains most, and a function alone explains a little more."""


def explained(verdict: Verdict, hold_out: Sequence[Recording], say: Say = lambda _: None) -> Verdict:
    """The verdict with what is known of its unknown rest, unchanged where it has none or nothing explains it.

    A term that alone explains clearly more than the accepted effects takes their place; beside effects that leave much, one
    that explains it is what is missing above all.
    """
    diagnosis, climbed = verdict.diagnosis, [rung for rung in verdict.rungs if rung.accepted]
    if diagnosis.unknown is None:
        return verdict
    floor = climbed[-1].noise_floor
    excess, left = (
        float(np.mean([(rung.hold_out[name] / floor[name]) ** 2 for name in floor])) - 1.0 for rung in (climbed[0], climbed[-1])
    )
    standing = [item for item in verdict.best.plant.effects if item.name in diagnosis.effects]
    theirs, constant = {item.equation for item in standing}, bool(standing) and all(item.constant for item in standing)
    # effects that explain a good part of the held-out excess stand; what explains little may stand in for the rest
    minor, much, alone = diagnosis.verdict == "unknown", left > MUCH * excess, None
    several = len(standing) > 1
    worth = left > LITTLE * excess or (several and left > FLOORS**2)
    if diagnosis.effects and (minor or constant or (worth and not verdict.near)):

        def stood_in(function: Found) -> bool:
            # on its own signals it is what their form lacks; but one function for effects of several equations is plainer
            elsewhere = len(theirs) > 1 or _other(function, theirs) or _on_other_signals(function, verdict)
            taken = (minor or much or elsewhere) and _takes_place(verdict, function, left, excess, several)
            return function.explains and (taken or (constant and _holds_the_constant(verdict, function, left)))

        alone = _searched(verdict, verdict.base, hold_out, floor, say)
        if (alone.explained > HALF or _shown(alone)) and not stood_in(alone):
            alone = refitted(alone, verdict.base, hold_out, floor, say)
        if alone.explained > NEARLY_ALL and alone.after > FLOORS**2 and not stood_in(alone):
            alone = identified(alone, verdict.base, hold_out, floor, say)
        if stood_in(alone):
            return _in_their_place(verdict, alone)
    rest = _searched(verdict, verdict.best, hold_out, floor, say)
    if alone is None and not several and rest.explains and rest.explained > HALF and _on_other_signals(rest, verdict):
        alone = _searched(verdict, verdict.base, hold_out, floor, say)
        if _same(alone, rest) and alone.explains and _takes_place(verdict, alone, left, excess, several):
            return _in_their_place(verdict, alone)
    if not rest.explains and _shown(rest):
        rest = refitted(rest, verdict.best, hold_out, floor, say)
    if not rest.explains:
        if alone is not None and alone.explains and alone.beyond < UNCOVERED and alone.after - 1.0 < left:
            told = replace(diagnosis, sentences=(*diagnosis.sentences, IN_PLACE.format(", ".join(diagnosis.effects))))
            return _beside(replace(verdict, diagnosis=told), alone, diagnosis.verdict)
        return _not_borne_out(verdict, rest, hold_out, floor, much)
    larger = diagnosis.effects and much and _other(rest, theirs) and rest.beyond < STRANGE and rest.explained > NEARLY_ALL
    return _beside(verdict, rest, "unknown" if larger else diagnosis.verdict)


def _beside(verdict: Verdict, rest: Found, word: str) -> Verdict:
    """The verdict by its ``word`` with a function beside what it names."""
    diagnosis = verdict.diagnosis
    found = replace(diagnosis, verdict=word, unknown=_unknown(rest), sentences=(*diagnosis.sentences, *_said(rest)))
    return replace(verdict, diagnosis=found)


def _not_borne_out(
    verdict: Verdict, rest: Found, hold_out: Sequence[Recording], floor: Mapping[str, float], much: bool
) -> Verdict:
    """The verdict where no function helps on held-out runs, with what those fitted to show; much : whether much is left."""
    if not verdict.diagnosis.effects:
        together = verdict.lacking  # fitted to the held-out runs as well, so what it removes there is not told
        return _shown_alone(verdict, rest if together is None else search(together, hold_out, floor))
    return _seen_in_training(verdict, rest) if much else verdict


def _in_their_place(verdict: Verdict, alone: Found) -> Verdict:
    """The verdict with a function in the place of the effects, or beside one that all runs show and whose kind it is."""
    diagnosis, names = verdict.diagnosis, ", ".join(verdict.diagnosis.effects)
    if diagnosis.verdict == "unknown" and diagnosis.by_all_runs and _of_its_kind(alone, verdict):
        sentences = (*diagnosis.sentences, CONFIRMS.format(names), *_said(alone))
        return replace(verdict, diagnosis=replace(diagnosis, verdict="effect", unknown=_unknown(alone), sentences=sentences))
    words = f"{names} stood in for it and explained less"
    found = replace(
        diagnosis, verdict="unknown", effects=(), beside=(), unknown=_unknown(alone),
        sentences=(*diagnosis.sentences, words, *_said(alone)),
    )  # fmt: skip
    return replace(verdict, diagnosis=found, best=verdict.base)


def _searched(
    verdict: Verdict, fit: Fit, hold_out: Sequence[Recording], floor: Mapping[str, float], say: Say
) -> Found:
    """What a function explains of a fit's rest; the walk may have looked for it already."""
    known = verdict.function
    return known.by(floor) if known is not None and known.fit is fit else search(fit, hold_out, floor, say)


def _shown(found: Found) -> bool:
    """Whether the training runs show a function so much that it is fitted although the held-out runs do not bear it out yet.

    A joint fit that goes far along the base model's derivatives does not end where it should: of a seal that chatters at some
    speeds a function of speed took 92 % of the cost and tripled the held-out excess, refitted it took 97 and 79 %.
    """
    return found.gain > HALF * found.fit.relaxed_cost


def _seen_in_training(verdict: Verdict, rest: Found) -> Verdict:
    """The verdict, ``unknown`` where the training runs show the ``rest`` far more than the effects that were accepted."""
    term, standing = rest.joint.terms[0], verdict.best.relaxed_cost
    without, with_them = comparable_costs(verdict.base, verdict.best)
    if rest.gain < max(SEEN * standing, TIMES * (without - with_them)):
        return verdict
    words = UNSEEN.format(term.name, 100 * rest.gain / standing, 100 * (without - with_them) / without)
    return _by_training(verdict, rest, words)


def _shown_alone(verdict: Verdict, rest: Found) -> Verdict:
    """The verdict ``unknown`` that names no effect, with what the runs fitted to show most where that is more than chance."""
    if rest.gain < LEAST_DROP:
        return verdict
    runs, fitted = ("the training runs", verdict.best) if verdict.lacking is None else ("all runs together", verdict.lacking)
    words = ALONE.format(runs, rest.joint.terms[0].name, 100 * rest.gain / fitted.relaxed_cost)
    return _by_training(verdict, rest, words)


def _by_training(verdict: Verdict, rest: Found, words: str) -> Verdict:
    """The verdict ``unknown`` for a ``rest`` that the training runs show and the held-out runs do not bear out."""
    term = rest.joint.terms[0]
    words += BEYOND.format(100 * rest.beyond) if rest.beyond > UNCOVERED else ""
    unknown = Unknown(term.equation, term.depends_on, rest.rms, term.unit)
    sentences = (*verdict.diagnosis.sentences, words)
    return replace(verdict, diagnosis=replace(verdict.diagnosis, verdict="unknown", unknown=unknown, sentences=sentences))


def _other(found: Found, equations: set[str]) -> bool:
    """Whether what explains the rest acts in none of the ``equations``."""
    return found.joint.terms[0].equation not in equations


def _same(one: Found, other: Found) -> bool:
    """Whether two functions act in one equation, on the same signals."""
    first, second = one.joint.terms[0], other.joint.terms[0]
    return (first.equation, set(first.depends_on)) == (second.equation, set(second.depends_on))


def _of_its_kind(found: Found, verdict: Verdict) -> bool:
    """Whether a function of friction turns on nothing but what the named effects make it turn on.

    Of friction by pressure on slow runs, fitted to all but one, the laws of break-away ended with the wrong sign and made 1.6
    floors of 1.4; ``friction(p2)``, fitted to the training runs alone, left noise.
    """
    terms = found.joint.terms
    signals = {name for term in terms for name in term.depends_on}
    own = own_signals(verdict.best.plant, verdict.base.plant, "friction") or set()
    return {term.equation for term in terms} == {"friction"} and signals <= own - {"v"}


def _on_other_signals(found: Found, verdict: Verdict) -> bool:
    """Whether a function acts where the named laws do, on signals which these do not turn on.

    What a form lacks turns on its own signals. A law with states of its own may lack anything, and a constant has no signals.
    """
    standing = [item for item in verdict.best.plant.effects if item.name in verdict.diagnosis.effects]
    term = found.joint.terms[0]
    if any(item.constant or item.states or item.equation != term.equation for item in standing):
        return False
    own = own_signals(verdict.best.plant, verdict.base.plant, term.equation)
    return own is not None and not set(term.depends_on) <= own


def _takes_place(verdict: Verdict, alone: Found, left: float, excess: float, several: bool) -> bool:
    """Whether a term beside no effect explains clearly more than effects that leave that much of the squared ``excess``.

    several : whether these are more than one.

    What explains nearly all need only explain more, unless the effects do so as well, and so need what the training runs show
    far more than the effects: these may have helped by chance. Of a function whose signal leaves its range in the held-out runs
    the training runs must show far more, of any more.
    """
    without, with_them = comparable_costs(verdict.base, verdict.best)
    share = alone.gain / max(without - with_them, 1e-12)
    plainer = alone.explained > NEARLY_ALL and left > (1.0 - NEARLY_ALL) * excess
    if share > TIMES:
        return alone.after - 1.0 < left
    far_less = alone.after - 1.0 < HALF * left
    asked = (1.0 - TIED if far_less else 1.0) if several else MORE
    return alone.beyond < UNCOVERED and share > asked and (far_less or (plainer and alone.after - 1.0 < left))


def _holds_the_constant(verdict: Verdict, alone: Found, left: float) -> bool:
    """Whether a term beside no effect leaves next to nothing of what constants leave of the squared excess.

    A constant has no form that could differ from the catalogue's: it is the mean of that term. The square of a pressure was
    named a weight that explained 97 and 98 % on two rigs.
    """
    without, with_them = comparable_costs(verdict.base, verdict.best)
    return alone.after - 1.0 < (1.0 - NEARLY_ALL) * left and alone.gain > without - with_them


def _unknown(found: Found) -> Unknown:
    term, formula = found.joint.terms[0], found.formula
    every = (*found.joint.terms, *(item for item in found.ties if item.equation == term.equation))
    signals = tuple(dict.fromkeys(name for item in every for name in item.depends_on))
    return Unknown(
        term.equation, signals, found.rms, term.unit, formula.text if formula else None,
        effect=" ".join(item.name for item in found.joint.terms), formula_effect=formula.name if formula else None,
        formula_error=formula.error if formula else None, excess_explained=found.explained, curve=found.curve,
    )  # fmt: skip


def _said(found: Found) -> tuple[str, ...]:
    names = " ".join(f"'{term.name}'" for term in found.joint.terms)
    words = f"a smooth unknown function removes {100 * found.explained:.0f} % of what is left on held-out runs; --add {names}"
    said: tuple[str, ...] = (words,)
    if found.ties:
        said += (f"{', '.join(term.name for term in found.ties)} explains these data about as well",)
    if found.formula is None:
        return said
    formula = found.formula
    return *said, f"its shape is {formula.text} within {100 * formula.error:.0f} % of its size; --add '{formula.name}'"
