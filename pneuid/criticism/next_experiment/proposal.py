"""The next experiment: the recording that separates rival models best, and what it can be expected to decide.

Every excitation of the library is played on each rival. How far a rival can follow the noise-free recording of another,
when its parameters and states adapt as far as the data in hand and the sensors allow, is one Gauss-Newton step of the
relaxed problem; what it cannot follow is the separation (half the noncentrality of the likelihood ratio; Atkinson, Fedorov,
Biometrika 62 (1975) 57, linearised). What no excitation tells of a shifted sensor, a zero reading may. Rivals that nothing
separates are named as such.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.stats import norm

from pneuid.criticism.decision.diagnosis import Command
from pneuid.criticism.decision.verdict import Verdict
from pneuid.criticism.next_experiment.excitations import BENCH_LIBRARY, SERVO_LIBRARY, Excitation
from pneuid.criticism.next_experiment.playing import Scene, play
from pneuid.criticism.next_experiment.rival import Rival
from pneuid.criticism.next_experiment.zeros_to_read import Expected, asked_for, expected, told, would_show
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.screening.scores import screen
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit

SECONDS = 6.0
"""Length of a proposed recording."""

MOST_RIVALS = {"servo": 3, "bench": 5}
"""Candidates of an ambiguous verdict that are told apart; a bench's are cheap, and several are alike."""

NEEDED = 30.0
"""Likelihood ratio (twice the difference of costs) that decides: twice what an effect must gain to be refitted."""

ALIKE = 4.0
"""Separation below which two rivals act alike: they would differ by less than two standard deviations of the noise."""


@dataclass(frozen=True)
class Experiment:
    """A proposed recording, or that none of the library's helps (``excitation`` and ``command`` None).

    power : chance that it decides, 0 where nothing is proposed; separation in likelihood-ratio units; rivals : what is told
    apart, those that act alike together; advice : of each that has others like it, the experiment that its effect names;
    zeros : what a zero reading would show of each rival, empty where none is needed.
    """

    excitation: Excitation | None
    command: Command | None
    power: float
    separation: float
    rivals: tuple[tuple[str, ...], ...]
    advice: Mapping[str, str]
    zeros: Mapping[str, Expected | None] = field(default_factory=dict)

    @property
    def read(self) -> tuple[str, ...]:
        """Signals of a zero reading; none where it is not needed."""
        return tuple(item.signal for item in self.zeros.values() if item is not None)

    @property
    def why(self) -> str:
        """The reason in a sentence."""
        parts = [self._why_zero] if self.zeros else []
        return "; ".join([*parts, *([why] if (why := self._why_recording) else [])])

    @property
    def _why_zero(self) -> str:
        told = _listed(list(self.zeros), "or")
        return f"to tell {told}: {asked_for(self.read)}, and --zero FILE when diagnosed again; {would_show(self.zeros)}"

    @property
    def _why_recording(self) -> str:
        alike = "; ".join(
            f"{_listed(names, 'and')} act alike in every recording of the library (what would tell them: "
            + ", ".join(f"{name}: {self.advice[name]}" for name in names) + ")"
            for names in self.rivals
            if len(names) > 1
        )  # fmt: skip
        if self.excitation is None or self.command is None:
            return alike or ("" if self.zeros else "no excitation of the library stays within the limits")
        told = " from ".join(_listed(names, "or") for names in self.rivals)
        why = (
            f"to tell {told}: {self.excitation.name} of {float(self.command.t[-1]):.0f} s ({self.excitation.says}); of all "
            "in the library it makes the models differ most"
        )
        return f"{why}; {alike}" if alike else why


def _listed(names: Sequence[str], last: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def propose(fits: Sequence[Fit], effects: Sequence[Effect]) -> Experiment | None:
    """The experiment that tells rival ``fits`` apart best; None for fewer than two.

    effects : what each fit has that the others lack.
    """
    if len(fits) < 2:
        return None
    rivals = [Rival(fit) for fit in fits]
    library = SERVO_LIBRARY if fits[0].plant.servo else BENCH_LIBRARY
    scenes = [(item, scene) for item in library if (scene := play(rivals, item, SECONDS)) is not None]
    pairs = list(combinations(range(len(rivals)), 2))
    apart_by = np.array([_separations(rivals, scene, pairs) for _, scene in scenes]).reshape(len(scenes), len(pairs))
    best, seen = apart_by.max(axis=0, initial=0.0), expected(fits, effects)
    at_zero = np.array([told(seen[i], seen[j]) for i, j in pairs])
    by_reading = at_zero > NEEDED
    helped = {i for pair, read in zip(pairs, by_reading, strict=True) if read for i in pair}
    zeros = {effect.name: seen[i] for i, effect in enumerate(effects) if i in helped}
    left = np.where(by_reading, np.inf, best)
    groups = _groups(len(rivals), [pair for pair, value in zip(pairs, left, strict=True) if value < ALIKE])
    names = tuple(tuple(effects[i].name for i in group) for group in groups)
    advice = {effect.name: effect.experiment for effect in effects}
    group_of = {i: k for k, group in enumerate(groups) for i in group}
    # a reading costs seconds; what it tells need not be told again
    apart = [k for k, (i, j) in enumerate(pairs) if group_of[i] != group_of[j] and not by_reading[k]]
    sure = _power(float(at_zero[by_reading].min())) if zeros else 1.0
    if not scenes or not apart:
        return Experiment(None, None, sure if zeros else 0.0, 0.0, names, advice, zeros)
    found = []
    for (excitation, scene), values in zip(scenes, apart_by, strict=True):
        separation = float(values[apart].min())
        found.append(Experiment(excitation, scene.command, sure * _power(separation), separation, names, advice, zeros))
    return max(found, key=lambda item: item.separation)


def _power(separation: float) -> float:
    """Chance that a likelihood ratio of this noncentrality passes what is needed."""
    return float(norm.cdf((separation - NEEDED) / (2.0 * np.sqrt(max(separation, 1e-9)))))


def _separations(rivals: Sequence[Rival], scene: Scene, pairs: Sequence[tuple[int, int]]) -> list[float]:
    """For each pair the smaller of what either cannot follow of the other."""

    def unable(i: int, j: int) -> float:
        return rivals[j].unable(scene.command.t, scene.inputs, scene.played[i], scene.played[j])

    return [min(unable(i, j), unable(j, i)) for i, j in pairs]


def _groups(count: int, alike: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Rivals that are alike, directly or over others, together; in order of their first."""
    linked = np.eye(count)
    for i, j in alike:
        linked[i, j] = 1.0
    _, label = connected_components(linked, directed=False)
    return [np.flatnonzero(label == own).tolist() for own in dict.fromkeys(label.tolist())]


def for_verdict(
    verdict: Verdict, base: Fit, catalogue: Mapping[str, Effect], refitter: Refitter | None = None
) -> Experiment | None:
    """The experiment for an ambiguous verdict: its candidates are fitted and told apart; None for other verdicts.

    Of several groups the weightiest. What is missing whichever of them is, each of them is fitted with.
    """
    diagnosis = verdict.diagnosis
    if diagnosis.verdict != "ambiguous":
        return None
    order = list(catalogue)
    present = {effect.name for effect in verdict.best.plant.effects}
    most = MOST_RIVALS[base.plant.rig.kind]
    candidates = diagnosis.choices[0]
    effects = [catalogue[name] for name in candidates[:most] if not catalogue[name].richer_law]
    refits = refitter or Refitter(order)
    if (diagnosis.beside or diagnosis.choices[1:]) and candidates[0] in present:
        base = refits.without(verdict.best, candidates[0])
    starts = {score.effect.name: score.whole_start for score in screen(base, effects, order)}
    asked = [Asked(effect, starts.get(effect.name, {})) for effect in effects if effect.name not in present]
    made = {one.effect.name: fitted() for one, fitted in refits.each(base, asked)}
    fits = [made.get(effect.name, verdict.best) for effect in effects]
    return propose(fits, effects)
