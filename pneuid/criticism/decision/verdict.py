"""The decision: the walk from model to model on held-out runs, and the verdict on where it ends.

Forward: the effect that lowers the held-out error most is accepted when the fall is more than noise alone would give, at
least a tenth of the excess over the noise floor, and its parameters are inside their bounds (`rounds`, `walk`). Backward: an
accepted effect that later turns out to be unneeded is dropped. What is left over at the end decides between ``effect`` and
``unknown``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pneuid.criticism.comparison.defects import ACTING_ON, equation_defects, node_jumps
from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.acceptance import LEAST_DROP, NEARLY_NOISE
from pneuid.criticism.decision.diagnosis import NOTHING_MISSING, Candidate, Diagnosis, Unknown
from pneuid.criticism.decision.leftover import DEFECT_RATIO, explained_away, explained_share, leaves_more, loudest
from pneuid.criticism.decision.roots import climb, from_another_root
from pneuid.criticism.decision.rounds import Say
from pneuid.criticism.decision.too_slow import too_slow
from pneuid.criticism.decision.walk import MINOR, Walk
from pneuid.criticism.decision.zeros import NOTHING_READ, Zeros
from pneuid.criticism.prediction.uncovered import uncovered
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.trial import Trial, judge_of
from pneuid.criticism.unknown.function_search import Found
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import prepare
from pneuid.recording import Recording

MOSTLY = 0.9
"""Share of the excess explained, below which a rest is reported; below ``MINOR`` the rest, then more, is the verdict."""

STILL_FAR = 3.0
"""Held-out error in floors from which a rest is reported however much was explained, and a fit without an exact end is not
called adequate."""

STILL_OFF = 1.5
"""Held-out error in floors from which a function is looked for beside the effects named: it shows where their form falls short,
or that a constant is none. A weight in place of a hose that pulls by the square of a pressure left 2.3; a viscous friction that
bends in place of a brake whose drag has a hump 1.96, and a leak in place of a spool that the pressures push 1.7. Of 135 right
effects seven left between this and two."""

SMALL_PART = 0.05
"""Share of the base model's excess below which a later effect on the balance of a weightier one may only mend that one's form:
beside a dead zone with rounded laps of unlike width a critical ratio took 1.8 %, and nothing else was hidden."""

MENDS = (
    "{} brings {:.1f} % of it: as it acts on the same balance as {}, it may only make up for a form of that effect that is not "
    "the catalogue's"
)

OPEN = (
    "the held-out runs ask for what the training runs leave open of the parameters, and that explains the error; "
    "train on runs that cover the speeds and pressures of the held-out ones"
)

AT_BREAK_AWAY = (
    "no balance leaves a defect above noise, but predictions are far off at break-away and no exact fit stands behind the "
    "model: something may be missing there, or this fit is not the best; the first of the ranking is what to try"
)

BEYOND = (
    "a function of a signal that the catalogue does not hold explains most of it, and takes far more of the training cost than "
    "any effect promises, so no more of these were tried"
)

OUT_OF_TIME = (
    "the time given was over: what was begun was finished, and more was not looked for; give more by --minutes (with --resume, "
    "which keeps what was done)"
)

CANNOT_FOLLOW = "whatever it starts from, a fit of the model cannot follow the training runs: something is missing"

WORST_TENTH = (
    "{}: {:.1f} % of the base model's held-out excess explained without the worst tenth of the windows; those are "
    "predicted worse than before, look at them in compare: mostly a piston that breaks away, or does not, at another time"
)

SHOWN = (
    "the training runs leave more than noise themselves, and {} is what shows most in all runs; "
    "hold out a run like the training runs to judge it"
)


@dataclass
class Verdict:
    """What ``diagnose`` returns: the diagnosis, the model it ends with, the base that it was measured against, and the rungs
    climbed or rejected.

    lacking : the model fitted to all runs where nothing was named although these show something; near : whether the effects
    named explain nine tenths and leave less than three floors, but for the worst windows; function : what a function of a
    signal explains of a fit, where that is known already.
    """

    diagnosis: Diagnosis
    best: Fit
    base: Fit
    rungs: list[Rung] = field(default_factory=list)
    lacking: Fit | None = None
    near: bool = False
    function: Found | None = None


def diagnose(
    base: Fit,
    hold_out: Sequence[Recording],
    catalogue: dict[str, Effect],
    refitter: Refitter | None = None,
    say: Say = lambda _: None,
    zeros: Zeros = NOTHING_READ,
) -> Verdict:
    """Which effects of ``catalogue`` the ``base`` fit lacks, judged on ``hold_out`` runs not used in the fit.

    ``refitter`` makes the refits, in this process if left out; ``say`` receives one sentence per step; ``zeros`` says what a
    zero reading rules out or shows. The catalogue's order is the order of maps at shared ports.
    """
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in hold_out])
    current, slow = judge.trial(base), too_slow(base)
    open_ones, refits = zeros.left(catalogue), refitter or Refitter(list(catalogue))
    judged = {name: one for name, one in open_ones.items() if slow is None or one.equation not in ACTING_ON["force"]}
    walk = Walk(judge, current, current, judged, refits, say, zeros=zeros, slow=slow is not None)
    walk.moved += [] if slow is None else [slow]
    walk.rungs.append(walk.rung(current, True))
    climb(walk)
    walk = from_another_root(walk)
    walk.moved += [OUT_OF_TIME] if walk.refitter.late() else []
    found = _verdict(walk, slow is not None)
    beyond = [] if found.verdict == "adequate" else uncovered(base, judge.held)
    read = zeros.said(catalogue, walk.current.fit, walk.refused)
    found = replace(found, sentences=(*found.sentences, *walk.moved, *read, *beyond), by_all_runs=walk.by_all_runs)
    lacking = None if walk.lacking is None else walk.lacking.fit
    ended = walk.current.error
    near = ended <= STILL_FAR**2 and walk.first.error - ended >= MOSTLY * (walk.first.error - 1.0)
    return Verdict(found, walk.current.fit, walk.first.fit, walk.rungs, lacking, near, walk.function)


def _verdict(walk: Walk, slow: bool = False) -> Diagnosis:
    """The verdict on where a walk ended, on runs that are too slow to judge what acts on the piston or not."""
    named, current, first, judge, ranking = walk.named, walk.current, walk.first, walk.judge, walk.ranking
    # one that was refitted and made things worse stays where screening put it
    order = sorted(ranking.values(), key=lambda item: (-max(item.excess_explained or 0.0, 0.0), -item.screen_gain))
    lead = [item for name in named for item in order if item.effect == name]
    ordered = tuple(lead + [item for item in order if item.effect not in named])
    excused = explained_away(current, judge)
    adequate = walk.by_all_runs or slow or excused
    started, ended = np.sqrt(first.whole), np.sqrt(current.whole)
    usual = f"{np.sqrt(first.error):.2f} and {np.sqrt(current.error):.2f} without the worst tenth of the windows, which decides"
    words = [f"held-out error: {started:.2f} times the noise floor before, {ended:.2f} after ({usual})"]
    if not named:
        return _nothing_named(walk, words, ordered, slow, adequate)
    removed = (first.error - current.error) / max(first.error - 1.0, 1e-12)
    explained = explained_share(first, current, first)
    if explained > 0.0:
        words.append(f"{', '.join(named)}: {100 * explained:.1f} % of the base model's held-out excess explained")
    elif not walk.by_all_runs:  # what all runs show may predict worse while the training runs leave it open
        words.append(WORST_TENTH.format(", ".join(named), 100 * removed))
    words += _mended(lead)
    # little of the excess gone: what was found stands beside something larger that the catalogue does not hold
    # parameters that the training runs leave open excuse only so much
    far = not walk.by_all_runs and current.error > STILL_FAR**2
    larger = walk.partly or (removed < MINOR and (far or not adequate))
    # what leaves noise alone of the training runs, which say too little of the held-out ones, need not lack anything more
    open_elsewhere = excused and judge.learned(current)
    larger = larger or (not (walk.by_all_runs or slow or open_elsewhere) and leaves_more(current, first))
    groups = _doubted(walk)
    much = removed < MOSTLY or current.error > STILL_OFF**2
    # parameters that the training runs leave open excuse neither a far error nor that much of it: a function may explain more
    very_much = removed < MOSTLY and far and excused and not slow
    rest = _rest(current) if larger or (not adequate and much) or very_much else None
    if groups and not larger:
        each = {group[0]: group for group in groups}
        every = dict.fromkeys(one for name in named for one in each.get(name, (name,)))
        beyond_doubt = tuple(name for name in named if name not in each)
        return Diagnosis(
            "ambiguous", tuple(every), ordered, rest, sentences=tuple(words), beside=beyond_doubt, one_of=groups
        )
    if rest is not None and not very_much:
        words.append("a part of the error remains that no effect of the catalogue explains")
    elif current.error - 1.0 < judge.small:
        words.append("what remains is noise")
    elif excused:
        words.append(OPEN)
    elif not adequate:
        words.append("what remains is above noise: these effects may act in a form that differs from the catalogue's")
    return Diagnosis("unknown" if larger else "effect", tuple(named), ordered, rest, sentences=tuple(words))


def _doubted(walk: Walk) -> tuple[tuple[str, ...], ...]:
    """Each of the named effects that others cannot be told from, with those, the weightiest first."""
    groups = ((name, *(one for one in walk.ambiguous.get(name, ()) if one not in walk.named)) for name in walk.named)
    return tuple(group for group in groups if len(group) > 1)


def _mended(named: Sequence[Candidate]) -> list[str]:
    """What is to be said of later effects that bring little and act where a weightier one does."""
    words = []
    for k, item in enumerate(named):
        acting = next((every for every in ACTING_ON.values() if item.equation in every), ())
        weightier = [other.effect for other in named[:k] if other.equation in acting]
        if weightier and item.excess_explained is not None and item.excess_explained < SMALL_PART:
            words.append(MENDS.format(item.effect, 100 * item.excess_explained, weightier[0]))
    return words


def _nothing_named(
    walk: Walk, words: Sequence[str], ordered: tuple[Candidate, ...], slow: bool, adequate: bool
) -> Diagnosis:
    """The verdict where no effect was accepted: nothing is missing, or something that the catalogue does not hold."""
    current, judge = walk.current, walk.judge
    if walk.lacking is not None or walk.beyond:
        said = (*words, BEYOND) if walk.beyond else tuple(words)
        return Diagnosis("unknown", (), ordered, _rest(walk.lacking or current), sentences=said)
    if current.error - 1.0 < judge.small:
        return _noise_in_usual_windows(walk, words, ordered, slow)
    if slow:
        return Diagnosis("adequate", (), ordered, sentences=tuple(words))
    if current.fit.lacking and current.error > NEARLY_NOISE**2:
        return Diagnosis("unknown", (), ordered, _rest(current), sentences=(*words, CANNOT_FOLLOW))
    if adequate:
        plain = not judge.learned(current) and ordered and ordered[0].screen_gain * current.fit.relaxed_cost > LEAST_DROP
        shown = (SHOWN.format(ordered[0].effect),) if plain else ()
        return Diagnosis("adequate", (), ordered, sentences=(*words, OPEN, *shown))
    if loudest(current) < DEFECT_RATIO:
        if current.fit.exact is None and current.error > STILL_FAR**2:
            return Diagnosis("unknown", (), ordered, _rest(current), sentences=(*words, AT_BREAK_AWAY))
        quiet = "no balance leaves a defect above noise; what the predictions lose, they lose at break-away"
        return Diagnosis("adequate", (), ordered, sentences=(*words, quiet))
    return Diagnosis("unknown", (), ordered, _rest(current), sentences=(*words, "the catalogue does not explain it"))


def _noise_in_usual_windows(walk: Walk, words: Sequence[str], ordered: tuple[Candidate, ...], slow: bool) -> Diagnosis:
    """Nothing is missing, unless both kinds of runs are far off in the other windows and the model has no exact fit."""
    current = walk.current
    if current.fit.exact is None and min(current.whole, walk.judge.fits(current)) > STILL_FAR**2 and not slow:
        return Diagnosis("unknown", (), ordered, _rest(current), sentences=(*words, AT_BREAK_AWAY))
    return Diagnosis("adequate", (), ordered, sentences=(*words, NOTHING_MISSING))


def _rest(trial: Trial) -> Unknown | None:
    """The balance with the largest defect relative to what noise leaves, and the signal it follows most."""
    defects = equation_defects(trial.fit)
    if not defects:
        return Unknown("force", (), trial.hold_out.get("F", 0.0), "N")
    worst = max(defects, key=lambda item: item.rms / max(item.expected_rms, 1e-12))
    return Unknown(worst.equation, _follows(trial.fit, worst.equation), worst.rms, worst.unit)


def _follows(found: Fit, equation: str) -> tuple[str, ...]:
    """Signal over whose quantiles the defect's mean varies most."""
    problem = found.problem
    state = {"force": "v", "pressure_1": "p1", "pressure_2": "p2"}[equation]
    jump = node_jumps(problem, found.relaxed.X)[:, problem.plant.states.index(state)]
    _, nodes = problem.split(found.relaxed.X)
    best, strength = "x", -1.0
    for name in ("x", "v", "p1", "p2"):
        signal = nodes[problem.plant.states.index(name)][problem.linked]
        edges = np.unique(np.quantile(signal, np.linspace(0, 1, 13)))
        place = np.clip(np.searchsorted(edges, signal) - 1, 0, edges.size - 2)
        means = np.array([jump[place == k].mean() if np.any(place == k) else 0.0 for k in range(edges.size - 1)])
        if means.var() > strength:
            best, strength = name, float(means.var())
    return (best,)
