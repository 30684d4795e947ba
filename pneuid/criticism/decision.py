"""The decision: screen, refit the leading effects, judge on held-out runs, and again on the new model.

Forward: the effect that lowers the held-out error most is accepted when the fall is more than noise alone would give, at
least a tenth of the excess over the noise floor, and its parameters are inside their bounds. Backward: an accepted
effect that later turns out to be unneeded is dropped. What is left over at the end decides between ``effect`` and
``unknown``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from pneuid.criticism.defects import equation_defects, node_jumps
from pneuid.criticism.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.criticism.ladder import Rung
from pneuid.criticism.refitter import Refitter
from pneuid.criticism.rounds import (
    LEAST_DROP,
    Say,
    Tried,
    accepted,
    costs,
    leaves_much,
    refitted,
    same_floor,
    second_looks,
    settled,
)
from pneuid.criticism.screening import Score, screen
from pneuid.criticism.trial import Judge, Trial, judge_of
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import prepare
from pneuid.recording import Recording

TELLING = 0.03
"""Share of the held-out excess, or of the gain on the training runs, by which the better of two effects must lead
to be told from the other: the error 200 ms ahead has heavy tails, at break-away, that make smaller leads accidental."""

SURE = 5.0
"""Half the sum of squares by which it must lead on the training runs at least: 3 standard deviations."""

DEFECT_RATIO = 1.5
"""Defect of a balance over what noise alone leaves, below which nothing unknown can be named in any equation."""

MOSTLY, MINOR = 0.9, 0.25
"""Shares of the excess explained: below the first a rest is reported, below the second the rest is the verdict."""

MOST_EFFECTS = 4

OPEN = (
    "the held-out runs ask for what the training runs leave open of the parameters, and that explains the error; "
    "train on runs that cover the speeds and pressures of the held-out ones"
)

SHOWN = (
    "the training runs leave more than noise themselves, and {} is what shows in them most; "
    "hold out a run like them to judge it"
)

BETTER_START = (
    "the model that stood before fits better from another start ({:.2f} -> {:.2f} floors); all is measured against that"
)


@dataclass
class Verdict:
    """What ``diagnose`` returns: the diagnosis, the model it ends with, the base that it was measured against, and the rungs
    climbed or rejected."""

    diagnosis: Diagnosis
    best: Fit
    base: Fit
    rungs: list[Rung] = field(default_factory=list)


def diagnose(
    base: Fit,
    hold_out: Sequence[Recording],
    catalogue: dict[str, Effect],
    refitter: Refitter | None = None,
    say: Say = lambda _: None,
) -> Verdict:
    """Which effects of ``catalogue`` the ``base`` fit lacks, judged on ``hold_out`` runs not used in the fit.

    ``refitter`` makes the refits, in this process if left out; ``say`` receives one sentence per step. The catalogue's order is
    the order of maps at shared ports.
    """
    order = list(catalogue)
    refitter = refitter or Refitter(order)
    judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in hold_out])
    current = judge.trial(base)
    first, rungs = current, [_rung(current, judge, True)]
    ranking: dict[str, Candidate] = {}
    named: list[str] = []
    ambiguous: dict[str, tuple[str, ...]] = {}
    moved: list[str] = []
    for _ in range(MOST_EFFECTS):
        adequate = judge.explains(current)
        if named and adequate:
            break
        scores = list(screen(current.fit, list(catalogue.values()), order))
        for score in scores:
            ranking.setdefault(score.effect.name, _screened(score))
        say(_leading(scores))
        if adequate and (current.error - 1.0 < judge.small or judge.learned(current)):
            break  # the ranking is for the report
        judge, current, first, tried, chosen = _round(current, first, scores, judge, refitter, adequate, say)
        smaller = None if chosen is None else _better_without(chosen, current, judge, refitter)
        if smaller is not None:
            moved.append(BETTER_START.format(np.sqrt(current.whole), np.sqrt(smaller.whole)))
            say(moved[-1])
            first, current = (first if named else smaller), smaller
        for score, trial in tried:
            _record(ranking, score, trial, current, first, keep=bool(named))
        rungs += [_rung(trial, judge, False) for _, trial in tried if chosen is None or trial.added != chosen[1].added]
        if chosen is None:
            break
        if smaller is not None:
            rungs = [*rungs, _rung(smaller, judge, True)] if named else [_rung(smaller, judge, True), *rungs[1:]]
            if accepted([chosen], current, first, judge, judge.explains(current)) is None:
                rungs.append(_rung(chosen[1], judge, False))
                continue
        rungs.append(_rung(chosen[1], judge, True))
        named.append(chosen[0].effect.name)
        ambiguous[named[-1]] = _rivals(chosen, tried, current, judge)
        before, after = np.sqrt(current.error), np.sqrt(chosen[1].error)
        say(f"{named[-1]} accepted: held-out error {before:.1f} -> {after:.1f} floors without the worst tenth")
        current = chosen[1]
    named, current = _backward(named, current, first, judge, refitter, say)
    found = _verdict(named, ambiguous, current, first, judge, ranking)
    return Verdict(replace(found, sentences=(*found.sentences, *moved)), current.fit, first.fit, rungs)


def _round(
    current: Trial, first: Trial, scores: Sequence[Score], judge: Judge, refitter: Refitter, adequate: bool, say: Say
) -> tuple[Judge, Trial, Trial, Tried, tuple[Score, Trial] | None]:
    """Refits of one round and the effect accepted, if any, all by the floor of the best model so far."""
    tried = refitted(current, first, scores, judge, refitter, say)
    judge, current, first, tried = same_floor(judge, current, first, tried)
    chosen = accepted(tried, current, first, judge, adequate)
    if current.added is None and leaves_much(chosen, current) and _loudest(current) > DEFECT_RATIO:
        tried = second_looks(current, scores, tried, judge, refitter, say)
        judge, current, first, tried = same_floor(judge, current, first, tried)
        chosen = accepted(tried, current, first, judge, adequate)
    known: set[str] = set()
    while chosen is not None and chosen[0].effect.name not in known:
        # what fits the training runs better may predict worse; then another is the best, or none
        known.add(chosen[0].effect.name)
        better = settled(chosen[1], judge, refitter, say)
        tried = [(score, better if score is chosen[0] else trial) for score, trial in tried]
        chosen = accepted(tried, current, first, judge, adequate)
    return judge, current, first, tried, chosen


def _better_without(chosen: tuple[Score, Trial], current: Trial, judge: Judge, refitter: Refitter) -> Trial | None:
    """The standing model, fitted again from where the chosen effect led, where it is better there; else None.

    Any effect that leads out of a local optimum would get the credit for what a better start explains.
    """
    name, trial = chosen[0].effect.name, chosen[1]
    if name not in {effect.name for effect in trial.fit.plant.effects}:
        return None  # a richer friction law took the simple one's place; without it the model is another
    smaller = judge.trial(refitter.without(trial.fit, name), current.added)
    now, less = costs(current, smaller)
    return smaller if less < now - LEAST_DROP and smaller.error < current.error else None


def _leading(scores: Sequence[Score]) -> str:
    shown = ", ".join(f"{score.effect.name} {100 * score.gain:.1f} %" for score in scores[:3])
    return f"screening predicts these drops of the cost: {shown}" if scores else "no candidate left to screen"


def _screened(score: Score) -> Candidate:
    return Candidate(score.effect.name, score.effect.equation, score.gain, indistinguishable_from=score.group)


def _explained(before: Trial, after: Trial, first: Trial) -> float:
    """Share of the base model's excess that the step from ``before`` to ``after`` removes."""
    excess = first.whole - 1.0
    return float((before.whole - after.whole) / excess) if excess > 0 and np.isfinite(after.whole) else 0.0


def _record(
    ranking: dict[str, Candidate], score: Score, trial: Trial, current: Trial, first: Trial, keep: bool
) -> None:
    """Put a refit's evidence into the ranking; that of the first round stands."""
    name = score.effect.name
    if keep and ranking[name].hold_out_error_ratio is not None:
        return
    drop = current.fit.loose_cost - trial.fit.loose_cost
    ranking[name] = Candidate(
        effect=name, equation=score.effect.equation, screen_gain=score.gain,
        hold_out_error_ratio=float(np.sqrt(trial.whole / current.whole)) if np.isfinite(trial.whole) else None,
        excess_explained=_explained(current, trial, first), p_value=float(chi2.sf(max(2 * drop, 0.0), max(score.freedom, 1))),
        indistinguishable_from=score.group,
    )  # fmt: skip


def _rivals(chosen: tuple[Score, Trial], tried: Tried, current: Trial, judge: Judge) -> tuple[str, ...]:
    """Other effects that explain the held-out runs and the training runs about as well as the chosen one.

    Where that one leaves noise alone, so must they.
    """
    excess = max(current.error - 1.0, 1e-12)
    clean = chosen[1].error - 1.0 < judge.small

    def alike(trial: Trial) -> bool:
        before, best, other = costs(current, chosen[1], trial)
        ahead = (trial.error - chosen[1].error) / excess < TELLING
        ahead = ahead and (trial.error - 1.0 < judge.small or not clean)
        return ahead and other - best < max(TELLING * (before - best), SURE)

    return tuple(score.effect.name for score, trial in tried if score is not chosen[0] and alike(trial))


def _backward(
    named: list[str], current: Trial, first: Trial, judge: Judge, refitter: Refitter, say: Say
) -> tuple[list[str], Trial]:
    """Try to drop each accepted effect but the last; keep the smaller model where the held-out error hardly rises."""
    for name in list(named[:-1]):
        if name not in {effect.name for effect in current.fit.plant.effects}:
            continue  # a richer friction law took the simple one's place; without it the model is another
        smaller = judge.trial(refitter.without(current.fit, name))
        rise = smaller.error - current.error
        if rise < max(3 * judge.spread, 0.02 * (first.error - 1.0)):
            say(f"{name} dropped again: without it the held-out error stays")
            named = [other for other in named if other != name]
            current = smaller
    return named, current


def _rung(trial: Trial, judge: Judge, accepted: bool) -> Rung:
    names = tuple(effect.name for effect in trial.fit.plant.effects)
    return Rung(
        names,
        trial.added,
        accepted,
        trial.train,
        trial.hold_out,
        dict(judge.floor.value),
        len(trial.fit.plant.parameters),
    )


def _verdict(
    named: list[str],
    ambiguous: dict[str, tuple[str, ...]],
    current: Trial,
    first: Trial,
    judge: Judge,
    ranking: dict[str, Candidate],
) -> Diagnosis:
    # one that was refitted and made things worse stays where screening put it
    order = sorted(ranking.values(), key=lambda item: (-max(item.excess_explained or 0.0, 0.0), -item.screen_gain))
    lead = [item for name in named for item in order if item.effect == name]
    ordered = tuple(lead + [item for item in order if item.effect not in named])
    adequate = judge.explains(current)
    started, ended = np.sqrt(first.whole), np.sqrt(current.whole)
    usual = f"{np.sqrt(first.error):.2f} and {np.sqrt(current.error):.2f} without the worst tenth of the windows, which decides"
    words = [f"held-out error: {started:.2f} times the noise floor before, {ended:.2f} after ({usual})"]
    if not named:
        if current.error - 1.0 < judge.small:
            return Diagnosis("adequate", (), ordered, sentences=(*words, "nothing is missing above the noise"))
        if adequate:
            plain = not judge.learned(current) and ordered and ordered[0].screen_gain * current.fit.relaxed_cost > LEAST_DROP
            shown = (SHOWN.format(ordered[0].effect),) if plain else ()
            return Diagnosis("adequate", (), ordered, sentences=(*words, OPEN, *shown))
        if _loudest(current) < DEFECT_RATIO:
            quiet = "no balance leaves a defect above noise; what the predictions lose, they lose at break-away"
            return Diagnosis("adequate", (), ordered, sentences=(*words, quiet))
        return Diagnosis(
            "unknown", (), ordered, _rest(current), sentences=(*words, "the catalogue does not explain it")
        )
    removed = (first.error - current.error) / max(first.error - 1.0, 1e-12)
    explained = _explained(first, current, first)
    words.append(f"{', '.join(named)}: {100 * explained:.1f} % of the base model's held-out excess explained")
    rivals = tuple(name for name in ambiguous.get(named[0], ()) if name not in named)
    if rivals:
        return Diagnosis("ambiguous", (named[0], *rivals, *named[1:]), ordered, sentences=tuple(words))
    rest = _rest(current) if not adequate and removed < MOSTLY else None
    if rest is not None:
        words.append("a part of the error remains that no effect of the catalogue explains")
    elif adequate:
        words.append("what remains is noise" if current.error - 1.0 < judge.small else OPEN)
    else:
        words.append("what remains is above noise: these effects may act in a form that differs from the catalogue's")
    # little of the excess gone: what was found stands beside something larger that the catalogue does not hold
    verdict = "unknown" if rest is not None and removed < MINOR else "effect"
    return Diagnosis(verdict, tuple(named), ordered, rest, sentences=tuple(words))


def _loudest(trial: Trial) -> float:
    """Largest defect of a balance over what noise alone leaves; on a bench, which has no such defects, that of the force."""
    ratios = [item.rms / max(item.expected_rms, 1e-12) for item in equation_defects(trial.fit)]
    return max(ratios, default=float(np.sqrt(trial.error)))


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
