"""What a notebook user types: ``pneuid.fit``, and the verbs on the model it returns."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pneuid import model as model_file
from pneuid.cores import small_matrices
from pneuid.criticism.comparison.comparison import Comparison, compare, frozen
from pneuid.criticism.comparison.trust import trust
from pneuid.criticism.decision import rounds, verdict
from pneuid.criticism.decision.diagnosis import Diagnosis
from pneuid.criticism.decision.rest import explained
from pneuid.criticism.decision.zeros import Zeros
from pneuid.criticism.frames import notebook_html
from pneuid.criticism.next_experiment.proposal import for_verdict
from pneuid.criticism.prediction.horizons import predict_free
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.effect import Effect
from pneuid.effects import CATALOGUE, LAW_STEPS, effects_by_name
from pneuid.effects._by_name import canonical
from pneuid.effects._own_file import own_effects
from pneuid.errors import UserError
from pneuid.estimation.fit import Fit, completed
from pneuid.estimation.fit import fit as estimate
from pneuid.estimation.preparation import prepare
from pneuid.estimation.profile import Profile, profile
from pneuid.estimation.solver import Monitor
from pneuid.model import Estimate, Model, model_of
from pneuid.own_plant import checked_plant
from pneuid.physics.friction import LAWS
from pneuid.plant import Plant
from pneuid.pool import InProcess, Pool
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.store import Store
from pneuid.zero_reading import ZeroReading

MINUTES = 15.0
"""Minutes after which a diagnosis finishes what it has begun and looks for nothing more."""


@dataclass(frozen=True)
class IdentifiedModel:
    """An identified model and, when it was fitted in this session, the fit behind it."""

    content: Model
    fitted: Fit | None = None

    @property
    def parameters(self) -> tuple[Estimate, ...]:
        """Parameters with values, standard errors and verdicts, SI."""
        return self.content.parameters

    @property
    def values(self) -> dict[str, float]:
        """Parameter values by name, SI."""
        return dict(self.content.values)

    def compare(self, runs: Sequence[Recording], hold_out: Sequence[Recording] = ()) -> Comparison:
        """Errors per signal on ``runs`` and ``hold_out``, where they are, and which balance leaves a defect."""
        return compare(self.content, runs, hold_out, self.fitted if _same_runs(self.fitted, runs) else None)

    def diagnose(
        self, runs: Sequence[Recording], hold_out: Sequence[Recording] = (), monitor: Monitor | None = None,
        minutes: float = MINUTES, zero: ZeroReading | None = None,
    ) -> Diagnosis:  # fmt: skip
        """Which effects of the catalogue are missing; the last run is held out where ``hold_out`` is empty.

        minutes : after these what was begun is finished, nothing more is looked for, and the diagnosis says so; zero : what
        the sensors show with both chambers vented and nothing pulling, which tells a shifted sensor from a constant force.
        """
        return diagnose(self, runs, hold_out, monitor, minutes=minutes, zero=zero).diagnosis

    def simulate(self, run: Recording) -> dict[str, np.ndarray]:
        """Outputs ``(N,)`` of a free run over the recorded inputs, SI, absolute pressures."""
        still = frozen(self.content)
        found = predict_free(still, [prepare(run, still.plant, self.content.noise)])[0]
        return dict(zip(still.plant.outputs, found.predicted, strict=True))

    def profile(self, name: str, monitor: Monitor | None = None) -> Profile:
        """Profile likelihood of one parameter, all others fitted again at every value; needs a fit of this session.

        Raises ``UserError`` for a model that was loaded, a relaxed fit or a parameter that is not fitted.
        """
        if self.fitted is None:
            raise UserError(f"{self.content.name}: a profile needs the data of the fit; identify again with --profile {name}")
        return profile(self.fitted, name, monitor)

    def save(self, path: str | Path) -> None:
        """Write model.json."""
        self.content.save(path)

    def to_pandas(self) -> pd.DataFrame:
        """Parameters, a row each by name (``name@run`` for those of one run): value, std, 95 % interval, bounds in SI ``unit``.

        ``record`` names the recording that would help a parameter that is not well determined.
        """
        rows = [
            {
                "parameter": name, "value": item.estimate.value, "std": item.estimate.std, "low_95": item.low,
                "high_95": item.high, "unit": item.estimate.unit, "verdict": item.estimate.verdict,
                "effect": item.estimate.effect, "lower": item.estimate.lower, "upper": item.estimate.upper,
                "record": item.record,
            }
            for name, item in zip(self.values, trust(self.content), strict=True)
        ]  # fmt: skip
        numbers = ["value", "std", "low_95", "high_95", "lower", "upper"]
        return pd.DataFrame(rows).set_index("parameter").astype(dict.fromkeys(numbers, float))

    def _repr_html_(self) -> str:
        """The parameters, as a notebook shows them."""
        model = self.content
        effects = f" with {', '.join(model.effects)}" if model.effects else ""
        words = f"{model.name}: {model.rig.kind} rig, {model.friction} friction{effects}; {model.fit.status}"
        return notebook_html(words, self.to_pandas().drop(columns=["lower", "upper"]))


@small_matrices
def fit(
    rig: Rig,
    runs: Sequence[Recording],
    *,
    add: Sequence[str] = (),
    drop: Sequence[str] = (),
    effect_files: Sequence[str | Path] = (),
    friction: str | None = None,
    start: Mapping[str, float] | None = None,
    name: str = "model",
    hold_out: Sequence[Recording] = (),
    parent: str | None = None,
    monitor: Monitor | None = None,
) -> IdentifiedModel:
    """Identify a model of ``rig`` from ``runs``.

    add, drop : effects beside the rig's ``base_effects``: the catalogue's, ``spline:EQUATION(SIGNAL)``, and those of the
    user's own ``effect_files``, which are run; friction : law instead of the rig's; start : parameter values (SI) to
    start from. Raises ``UserError`` for unknown names or unusable data.
    """
    plant = plant_of(rig, add, drop, friction, effect_files)
    found = estimate(plant, runs, start, monitor=monitor)
    return IdentifiedModel(model_of(found, name, hold_out, parent), found)


def own_of(effect_files: Sequence[str | Path]) -> tuple[Effect, ...]:
    """The effects in a user's own files, which are run. Raises ``UserError`` naming file and line."""
    return own_effects(effect_files, CATALOGUE | LAW_STEPS)


def plant_of(
    rig: Rig,
    add: Sequence[str] = (),
    drop: Sequence[str] = (),
    friction: str | None = None,
    effect_files: Sequence[str | Path] = (),
) -> Plant:
    """The symbolic system of a rig with its base effects, plus ``add``, less ``drop``."""
    own, add, drop = own_of(effect_files), [canonical(name) for name in add], [canonical(name) for name in drop]
    law = friction or rig.friction
    if law not in LAWS:
        raise UserError(f"friction law '{law}' is not known; choose one of {', '.join(LAWS)}")
    for name in add:
        if name in LAW_STEPS:
            law = _richer(law, LAW_STEPS[name])
    names = list(dict.fromkeys(name for name in [*rig.base_effects, *add] if name not in LAW_STEPS))
    for name in drop:
        if name not in names:
            raise UserError(f"effect '{name}' cannot be dropped: the model has {', '.join(names) or 'no effects'}")
    chosen = effects_by_name([name for name in names if name not in drop], own)
    for effect in chosen:
        if rig.kind not in effect.rigs:
            raise UserError(
                f"effect '{effect.name}' cannot show on a {rig.kind} rig; it needs {' or '.join(effect.rigs)}"
            )
        if law not in effect.laws:
            raise UserError(
                f"effect '{effect.name}' cannot show with friction law '{law}'; it needs {' or '.join(effect.laws)}"
            )
    return checked_plant(rig, law, chosen)


def _richer(law: str, step: Effect) -> str:
    """The law that ``step`` leads to from ``law``, which may have been reached already."""
    richer = str(step.richer_law)
    if law != richer and law not in step.laws:
        raise UserError(f"'{step.name}' leads from {' or '.join(step.laws)}; the friction law here is '{law}'")
    return richer


def load(path: str | Path, effect_files: Sequence[str | Path] = ()) -> IdentifiedModel:
    """Read model.json; a model with a user's own effects needs their ``effect_files``, unchanged since, which are run.

    Raises ``UserError`` for anything else, and where a file is missing or has changed.
    """
    return IdentifiedModel(model_file.load(path, own_of(effect_files)))


def refitted(model: IdentifiedModel, runs: Sequence[Recording], monitor: Monitor | None = None) -> Fit:
    """The fit behind a model, made again from its own values where the model came from a file.

    Relaxed, which is quick; but where the first fit showed that the model lacks something, by the way that showed it: the
    break-away of such a model comes from there, and a relaxed fit alone loses it.
    """
    if model.fitted is not None:
        return model.fitted
    content = model.content
    return estimate(content.plant, runs, model.values, content.noise or None, monitor, exact=content.fit.lacking)


@small_matrices
def diagnose(
    model: IdentifiedModel,
    runs: Sequence[Recording],
    hold_out: Sequence[Recording] = (),
    monitor: Monitor | None = None,
    say: rounds.Say = lambda _: None,
    effect_files: Sequence[str | Path] = (),
    pool: Pool | None = None,
    store: Store | None = None,
    minutes: float = MINUTES,
    zero: ZeroReading | None = None,
) -> verdict.Verdict:
    """As ``IdentifiedModel.diagnose``, with the rungs climbed; ``say`` receives a sentence per step.

    effect_files : the user's own, whose effects are candidates beside the catalogue's; pool : where refits are made, this
    process if left out; store : keeps them, and those in it are not made again; minutes : after these what was begun is
    finished, nothing more is looked for, and the verdict says so; zero : a zero reading, see ``IdentifiedModel.diagnose``.
    """
    until = time.monotonic() + 60.0 * minutes
    train, held = list(runs), list(hold_out)
    fitted = model.fitted
    if not held:
        train, held = _held_back(train)
        say(f"no held-out run given: {', '.join(run.name for run in held)} is held back from the fit")
        fitted = None
    if not _same_runs(fitted, train):
        fitted = None
    base = fitted or completed(refitted(IdentifiedModel(model.content), train, monitor), monitor)
    own = {effect.name: effect for effect in (*model.content.own, *own_of(effect_files))}
    candidates = CATALOGUE | own | LAW_STEPS
    files = tuple(map(str, effect_files))
    refitter = Refitter(tuple(candidates), monitor, pool or InProcess(), store or Store(), files, until)
    found = explained(verdict.diagnose(base, held, candidates, refitter, say, Zeros(zero)), held, say)
    if found.diagnosis.verdict == "ambiguous":
        say("looking for the recording that tells the candidates apart")
    experiment = for_verdict(found, base, candidates, refitter)
    if experiment is None:
        return found
    proposed = {"why": experiment.why, "file": None, "power": experiment.power, "zero_reading": list(experiment.read)}
    return replace(found, diagnosis=replace(found.diagnosis, next_experiment=proposed, command=experiment.command))


def _same_runs(fitted: Fit | None, runs: Sequence[Recording]) -> bool:
    """Whether a fit was made on exactly these recordings."""
    return fitted is not None and [run.recording.sha256 for run in fitted.runs] == [run.sha256 for run in runs]


def _held_back(runs: list[Recording]) -> tuple[list[Recording], list[Recording]]:
    """Keep the last run back; a single run is cut in two with a gap of a twentieth between."""
    if len(runs) > 1:
        return runs[:-1], runs[-1:]
    run = runs[0]
    first, second = int(0.65 * run.n), int(0.7 * run.n)
    # the name stays, so that what the rig says of this run goes on to hold
    parts = [
        replace(
            run,
            t=run.t[cut] - run.t[cut][0],
            signals={name: values[cut] for name, values in run.signals.items()},
            weights={name: values[cut] for name, values in run.weights.items()},
        )
        for cut in (slice(0, first), slice(second, None))
    ]
    return parts[:1], parts[1:]
