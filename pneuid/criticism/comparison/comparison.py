"""A model held against measurements: errors per signal, where they are, which balance leaves a defect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pneuid.criticism.comparison.defects import EquationDefect, equation_defects
from pneuid.criticism.comparison.regions import Region, find_regions
from pneuid.criticism.frames import notebook_html
from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.horizons import Prediction, predict, predict_free, rmse
from pneuid.criticism.prediction.noise_floor import noise_floor
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run, prepare
from pneuid.model import Model
from pneuid.recording import Recording
from pneuid.signals import SIGNALS


@dataclass(frozen=True)
class SignalError:
    """Errors of one signal over some runs, SI: contract's ``rmse``, free-run, fit in percent, floor and its spread."""

    unit: str
    rmse: float
    free_run_rmse: float
    fit_percent: float
    noise_floor: float
    floor_spread: float

    @property
    def excess(self) -> float:
        """``rmse^2 - noise_floor^2``."""
        return self.rmse**2 - self.noise_floor**2


@dataclass(frozen=True)
class Spread:
    """Joint uncertainty of an exact fit: names of the parameters (with ``@run`` for those of one run), 1-sigma in SI ``(nq,)``
    and correlation ``(nq, nq)``; both are zero where a bound or an inequality holds a parameter.
    """

    names: tuple[str, ...]
    std: np.ndarray
    correlation: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance ``(nq, nq)``, SI."""
        return np.asarray(self.correlation * np.outer(self.std, self.std))


@dataclass(frozen=True)
class Comparison:
    """Result of comparing a model with runs (roles ``train`` and ``hold_out``)."""

    model: Model
    train: dict[str, SignalError]
    hold_out: dict[str, SignalError]
    where: tuple[Region, ...]
    defects: tuple[EquationDefect, ...]
    predictions: tuple[Prediction, ...]
    free: tuple[Prediction, ...]
    roles: tuple[str, ...]
    """Role of each prediction, ``train`` or ``hold_out``."""
    spread: Spread | None = None
    """Joint uncertainty of the fit behind the model; None where it is not at hand (a model file does not hold it)."""

    def weighted_error(self, role: str = "hold_out") -> float:
        """Mean over signals of ``(rmse / noise_floor)^2``: 1 when only noise is left."""
        found = self.hold_out if role == "hold_out" and self.hold_out else self.train
        return float(np.mean([(item.rmse / item.noise_floor) ** 2 for item in found.values()]))

    def to_pandas(self) -> pd.DataFrame:
        """Errors, a row per role and signal: ``rmse``, ``noise_floor``, ``free_run_rmse`` (SI ``unit``), their ratio, fit."""
        rows = [
            {
                "role": role, "signal": name, "rmse": item.rmse, "noise_floor": item.noise_floor, "unit": item.unit,
                "ratio": item.rmse / item.noise_floor if item.noise_floor > 0 else float("nan"),
                "fit_percent": item.fit_percent, "free_run_rmse": item.free_run_rmse,
            }
            for role, errors in (("train", self.train), ("hold_out", self.hold_out))
            for name, item in errors.items()
        ]  # fmt: skip
        columns = ["role", "signal", "rmse", "noise_floor", "unit", "ratio", "fit_percent", "free_run_rmse"]
        return pd.DataFrame(rows, columns=columns).set_index(["role", "signal"])

    def _repr_html_(self) -> str:
        """The errors, as a notebook shows them, and the region that holds most of them."""
        words = f"{self.model.name} against {len(self.predictions)} runs; ratio: error over noise floor"
        if self.where:
            first = self.where[0]
            words += f"; {100 * first.share:.0f} % of the squared {first.signal} error sits where {first.region}"
        return notebook_html(words, self.to_pandas())


def frozen(model: Model) -> Frozen:
    """What prediction needs of a model."""
    return Frozen(model.plant, model.values, model.ranges, model.noise, model.substeps)


def signal_errors(
    model: Frozen, runs: Sequence[Run]
) -> tuple[dict[str, SignalError], list[Prediction], list[Prediction]]:
    """Errors per output signal over ``runs``, with the predictions behind them (ahead, free)."""
    ahead = predict(model, runs)
    free = predict_free(model, runs) if model.plant.servo else ahead
    floor = noise_floor(model, runs)
    near, far = rmse(ahead, model.plant.outputs), rmse(free, model.plant.outputs)
    found = {}
    for i, name in enumerate(model.plant.outputs):
        spread = float(np.std(np.concatenate([item.measured[i][item.used[i]] for item in ahead])))
        percent = 100.0 * (1.0 - near[name] / spread) if spread > 0 and np.isfinite(near[name]) else 0.0
        found[name] = SignalError(
            SIGNALS[name].unit, near[name], far[name], percent, floor.value[name], floor.spread[name]
        )
    return found, ahead, free


def spread_of(fit: Fit) -> Spread | None:
    """Joint uncertainty of an exact fit, None for a relaxed one."""
    if fit.spread is None:
        return None
    return Spread(tuple(item.name for item in fit.problem.declared), fit.spread.std, fit.spread.correlation)


def compare(
    model: Model,
    train: Sequence[Recording],
    hold_out: Sequence[Recording] = (),
    fit: Fit | None = None,
) -> Comparison:
    """Compare ``model`` with recordings; ``fit`` adds the defects of its relaxed solution and the joint uncertainty."""
    still = frozen(model)
    runs = [prepare(run, still.plant, model.noise) for run in train]
    held = [prepare(run, still.plant, model.noise) for run in hold_out]
    on_train, ahead, free = signal_errors(still, runs) if runs else ({}, [], [])
    on_hold, ahead_held, free_held = signal_errors(still, held) if held else ({}, [], [])
    every = [*ahead, *ahead_held]
    floors = {name: item.noise_floor for name, item in (on_hold or on_train).items()}
    return Comparison(
        model=model, train=on_train, hold_out=on_hold, where=tuple(find_regions(every, still.plant, floors)),
        defects=tuple(equation_defects(fit)) if fit is not None else (), predictions=tuple(every),
        free=(*free, *free_held), roles=("train",) * len(ahead) + ("hold_out",) * len(ahead_held),
        spread=spread_of(fit) if fit is not None else None,
    )  # fmt: skip
