"""The decision: screen, refit the leading effects, judge on held-out runs, and again on the new model.

Forward: the effect that lowers the held-out error most is accepted when the fall is more than noise alone would give, at
least a tenth of the excess over the noise floor, and its parameters are inside their bounds. Backward: an accepted
effect that later turns out to be unneeded is dropped. What is left over at the end decides between ``effect`` and
``unknown``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from pneuid.criticism.defects import equation_defects, node_jumps
from pneuid.criticism.diagnosis import Candidate, Diagnosis, Unknown
from pneuid.criticism.ladder import Rung
from pneuid.criticism.prediction import Frozen, NoiseFloor, noise_floors, predict, rmse, typical
from pneuid.criticism.refits import refit, without
from pneuid.criticism.screening import Score, screen
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run, prepare
from pneuid.estimation.solver import Monitor
from pneuid.recording import Recording

LEAST_DROP = 15.0
"""Predicted drop of half the sum of squares below which an effect is not refitted; null data stay below 5."""

REFITS = 3
"""Leading effects refitted per round, their group mates besides."""

WORTH_REFITTING = 0.15
"""Share of the leading effect's predicted drop below which another is not refitted."""

WORTH_ADDING = 0.01
"""Predicted relative drop of the cost below which a later effect is not refitted: the right effect in the catalogue's form
leaves up to that much to others where the rig's own form differs."""

LEAST_SHARE = 0.10
"""Share of the excess over the noise floor that an effect must remove on held-out runs."""

CLEAR_SHARE = 0.50
"""Share of what is left that a later, weaker effect must remove when it is less than LEAST_SHARE of the first excess."""

TELLING = 0.03
"""Share of the held-out excess, or of the gain on the training runs, by which the better of two effects of one group must lead
to be told from the other: the error 200 ms ahead has heavy tails, at break-away, that make smaller leads accidental."""

ADEQUATE_EXCESS = 0.15
"""Held-out excess, relative to the squared noise floor, that counts as none."""

DEFECT_RATIO = 1.5
"""Defect of a balance over what noise alone leaves, below which nothing unknown can be named in any equation."""

MOSTLY, MINOR = 0.9, 0.25
"""Shares of the excess explained: below the first a rest is reported, below the second the rest is the verdict."""

MOST_EFFECTS = 4

Say = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """One fitted model on the held-out runs.

    error : weighted typical error that decides, squared, 1 = noise only; whole : the same of all windows, as reported;
    train, hold_out : rmse per signal, SI; usual : typical error per signal, SI.
    """

    fit: Fit
    error: float
    whole: float
    train: dict[str, float]
    hold_out: dict[str, float]
    usual: dict[str, float]
    added: str | None = None


@dataclass
class Verdict:
    """What ``diagnose`` returns: the diagnosis, the model it ends with, and the rungs climbed or rejected."""

    diagnosis: Diagnosis
    best: Fit
    rungs: list[Rung] = field(default_factory=list)


@dataclass(frozen=True)
class _Judge:
    """Held-out runs and the noise floor that errors are measured by."""

    held: tuple[Run, ...]
    floor: NoiseFloor
    usual: NoiseFloor

    def trial(self, found: Fit, added: str | None = None) -> Trial:
        model = frozen_fit(found)
        ahead = predict(model, self.held)
        on_held, usual = rmse(ahead, found.plant.outputs), typical(ahead, found.plant.outputs)
        on_train = rmse(predict(model, found.runs), found.plant.outputs)
        return Trial(
            found, _weighted(usual, self.usual), _weighted(on_held, self.floor), on_train, on_held, usual, added
        )

    @property
    def spread(self) -> float:
        """1-sigma of the weighted typical error from noise alone, relative to 1."""
        ratios = [self.usual.spread[name] / self.usual.value[name] for name in self.usual.value]
        return float(2.0 * np.sqrt(np.mean(np.square(ratios))))


def _weighted(errors: dict[str, float], floor: NoiseFloor) -> float:
    """Mean over the signals of squared errors in noise floors; infinite where one diverges."""
    error = float(np.mean([(errors[name] / floor.value[name]) ** 2 for name in errors]))
    return error if np.isfinite(error) else np.inf


def frozen_fit(found: Fit) -> Frozen:
    """What prediction needs of a fit."""
    return Frozen(found.plant, found.values, found.ranges, found.noise, found.substeps)


def diagnose(
    base: Fit,
    hold_out: Sequence[Recording],
    catalogue: dict[str, Effect],
    monitor: Monitor | None = None,
    say: Say = lambda _: None,
) -> Verdict:
    """Which effects of ``catalogue`` the ``base`` fit lacks, judged on ``hold_out`` runs not used in the fit.

    ``say`` receives one sentence per step. The catalogue's order is the order of maps at shared ports.
    """
    order = list(catalogue)
    held = tuple(prepare(run, base.plant, base.noise) for run in hold_out)
    judge = _Judge(held, *noise_floors(frozen_fit(base), held, (rmse, typical)))
    current = judge.trial(base)
    # a model that is far off has a floor of its own (larger) one; the best model's floor is the fair one
    first, rungs = current, [_rung(current, judge, True)]
    ranking: dict[str, Candidate] = {}
    accepted: list[str] = []
    ambiguous: dict[str, tuple[str, ...]] = {}
    for _ in range(MOST_EFFECTS):
        scores = list(screen(current.fit, list(catalogue.values()), order))
        for score in scores:
            ranking.setdefault(score.effect.name, _screened(score))
        say(_leading(scores))
        trials = _refits(current, scores, judge, order, WORTH_ADDING if accepted else 0.0, monitor, say)
        judge, current, first, trials = _same_floor(judge, current, first, trials)
        for score, trial in trials:
            _record(ranking, score, trial, current, first, keep=bool(accepted))
        chosen = _accepted(trials, current, first, judge)
        rungs += [_rung(trial, judge, False) for _, trial in trials if chosen is None or trial is not chosen[1]]
        if chosen is None:
            break
        rungs.append(_rung(chosen[1], judge, True))
        accepted.append(chosen[0].effect.name)
        ambiguous[accepted[-1]] = _rivals(chosen, trials, current)
        say(
            f"{accepted[-1]} accepted: held-out error {np.sqrt(current.error):.1f} -> {np.sqrt(chosen[1].error):.1f} floors"
        )
        current = chosen[1]
        if current.error - 1.0 < max(ADEQUATE_EXCESS, 4 * judge.spread):
            break  # what is left is what an adequate model leaves
    accepted, current = _backward(accepted, current, first, judge, monitor, say)
    found = _verdict(accepted, ambiguous, current, first, judge, ranking)
    return Verdict(found, current.fit, rungs)


def _screened(score: Score) -> Candidate:
    return Candidate(score.effect.name, score.effect.equation, score.gain, indistinguishable_from=score.group)


def _leading(scores: Sequence[Score]) -> str:
    shown = ", ".join(f"{score.effect.name} {100 * score.gain:.1f} %" for score in scores[:3])
    return f"screening predicts these drops of the cost: {shown}" if scores else "no candidate left to screen"


def _refits(
    current: Trial, scores: Sequence[Score], judge: _Judge, order: Sequence[str], least_gain: float,
    monitor: Monitor | None, say: Say,
) -> list[tuple[Score, Trial]]:  # fmt: skip
    """Refit the leading effects and their group mates."""
    least = max(LEAST_DROP, WORTH_REFITTING * scores[0].drop) if scores else LEAST_DROP
    worth = [score for score in scores if score.drop > least and score.gain >= least_gain]
    chosen = worth[:REFITS]
    names = {score.effect.name for score in chosen}
    mates = {name for score in chosen[:1] for name in score.group} - names
    chosen += [score for score in scores if score.effect.name in mates and score.drop > LEAST_DROP]
    found = []
    for score in chosen:
        say(f"refitting with {score.effect.name}")
        fitted = refit(current.fit, [score.effect], score.start, order, monitor, score.gain)
        trial = judge.trial(fitted, score.effect.name)
        say(f"with {score.effect.name}: held-out error {np.sqrt(current.error):.2f} -> {np.sqrt(trial.error):.2f} floors")
        found.append((score, trial))
    return found


def _same_floor(
    judge: _Judge, current: Trial, first: Trial, trials: list[tuple[Score, Trial]]
) -> tuple[_Judge, Trial, Trial, list[tuple[Score, Trial]]]:
    """Measure everything by the floor of the best model so far: a poor model's own floor is too high."""
    if not trials:
        return judge, current, first, trials
    best = min((trial for _, trial in trials), key=lambda trial: trial.error)
    if best.error >= 0.8 * current.error:
        return judge, current, first, trials
    floors = noise_floors(frozen_fit(best.fit), judge.held, (rmse, typical))
    floor, usual = (
        NoiseFloor({name: min(value, before.value[name]) for name, value in found.value.items()}, found.spread)
        for found, before in zip(floors, (judge.floor, judge.usual), strict=True)
    )
    judge = _Judge(judge.held, floor, usual)

    def again(trial: Trial) -> Trial:
        return replace(trial, error=_weighted(trial.usual, usual), whole=_weighted(trial.hold_out, floor))

    return judge, again(current), again(first), [(score, again(trial)) for score, trial in trials]


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


def _inside_bounds(score: Score, trial: Trial) -> bool:
    """At least one amplitude of the effect has left its off-value, and none but shapes lies on a bound."""
    names = set(score.start)
    problem = trial.fit.problem
    q = trial.fit.relaxed.X[: problem.nq]
    width = problem.scaling.upper - problem.scaling.lower
    on_bound = (q - problem.scaling.lower < 1e-4 * width) | (problem.scaling.upper - q < 1e-4 * width)
    amplitudes = [j for j, item in enumerate(problem.declared) if item.name in names]
    return not all(on_bound[j] for j in amplitudes)


def _accepted(
    trials: Sequence[tuple[Score, Trial]], current: Trial, first: Trial, judge: _Judge
) -> tuple[Score, Trial] | None:
    """The trial to accept, None where none qualifies."""
    excess, original = current.error - 1.0, first.error - 1.0
    good = []
    for score, trial in trials:
        fall = current.error - trial.error
        share = fall / original >= LEAST_SHARE or fall / max(excess, 1e-12) >= CLEAR_SHARE
        drop = current.fit.loose_cost - trial.fit.loose_cost
        significant = drop > LEAST_DROP
        if excess > 0 and fall > 3 * judge.spread and share and significant and _inside_bounds(score, trial):
            good.append((score, trial))
    return min(good, key=lambda item: item[1].error) if good else None


def _rivals(chosen: tuple[Score, Trial], trials: Sequence[tuple[Score, Trial]], current: Trial) -> tuple[str, ...]:
    """Members of the chosen effect's group that explain the held-out runs and the training runs about as well."""
    excess = max(current.error - 1.0, 1e-12)
    best = chosen[1].error
    gain = max(current.fit.loose_cost - chosen[1].fit.loose_cost, 1e-12)
    return tuple(
        score.effect.name
        for score, trial in trials
        if score is not chosen[0]
        and (trial.error - best) / excess < TELLING
        and (trial.fit.loose_cost - chosen[1].fit.loose_cost) / gain < TELLING
        and (score.effect.name in chosen[0].group or chosen[0].effect.name in score.group)
    )


def _backward(
    accepted: list[str], current: Trial, first: Trial, judge: _Judge, monitor: Monitor | None, say: Say
) -> tuple[list[str], Trial]:
    """Try to drop each accepted effect but the last; keep the smaller model where the held-out error hardly rises."""
    for name in list(accepted[:-1]):
        if name not in {effect.name for effect in current.fit.plant.effects}:
            continue  # a richer friction law took the simple one's place; without it the model is another
        smaller = judge.trial(without(current.fit, name, monitor))
        rise = smaller.error - current.error
        if rise < max(3 * judge.spread, 0.02 * (first.error - 1.0)):
            say(f"{name} dropped again: without it the held-out error stays")
            accepted = [other for other in accepted if other != name]
            current = smaller
    return accepted, current


def _rung(trial: Trial, judge: _Judge, accepted: bool) -> Rung:
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
    accepted: list[str],
    ambiguous: dict[str, tuple[str, ...]],
    current: Trial,
    first: Trial,
    judge: _Judge,
    ranking: dict[str, Candidate],
) -> Diagnosis:
    order = sorted(ranking.values(), key=lambda item: (-(item.excess_explained or 0.0), -item.screen_gain))
    lead = [item for name in accepted for item in order if item.effect == name]
    ordered = tuple(lead + [item for item in order if item.effect not in accepted])
    left = current.error - 1.0
    small = max(ADEQUATE_EXCESS, 4 * judge.spread)
    started, ended = np.sqrt(first.whole), np.sqrt(current.whole)
    usual = f"{np.sqrt(first.error):.2f} and {np.sqrt(current.error):.2f} without the worst tenth of the windows"
    words = [f"held-out error: {started:.2f} times the noise floor before, {ended:.2f} after ({usual})"]
    if not accepted:
        if left < small:
            return Diagnosis("adequate", (), ordered, sentences=(*words, "nothing is missing above the noise"))
        if _loudest(current) < DEFECT_RATIO:
            quiet = "no balance leaves a defect above noise; what the predictions lose, they lose at break-away"
            return Diagnosis("adequate", (), ordered, sentences=(*words, quiet))
        return Diagnosis(
            "unknown", (), ordered, _rest(current), sentences=(*words, "the catalogue does not explain it")
        )
    removed = (first.error - current.error) / max(first.error - 1.0, 1e-12)
    explained = _explained(first, current, first)
    words.append(f"{', '.join(accepted)}: {100 * explained:.1f} % of the base model's held-out excess explained")
    rivals = tuple(name for name in ambiguous.get(accepted[0], ()) if name not in accepted)
    if rivals:
        return Diagnosis("ambiguous", (accepted[0], *rivals, *accepted[1:]), ordered, sentences=tuple(words))
    rest = _rest(current) if left > small and removed < MOSTLY else None
    if rest is not None:
        words.append("a part of the error remains that no effect of the catalogue explains")
    # little of the excess gone: what was found stands beside something larger that the catalogue does not hold
    verdict = "unknown" if rest is not None and removed < MINOR else "effect"
    return Diagnosis(verdict, tuple(accepted), ordered, rest, sentences=tuple(words))


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
