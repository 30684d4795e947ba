"""The shape of every unknown function of a fit, with its standard error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pneuid.effects._spline import DIFFERENCES, Spline, Term, curve_columns
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.preparation import Run
from pneuid.plant import Plant

POINTS = 121
"""Places along the signal at which a shape is stored."""


@dataclass(frozen=True)
class Curve:
    """One unknown function over the range that its data visit.

    at : values of the signal ``(n,)``, SI, pressures absolute, ``u`` as relative opening; value, std : of the function
    ``(n,)`` in ``unit``; times : the factor beside it, empty for none; provisional : from a relaxed fit.
    """

    effect: str
    equation: str
    signal: str
    times: str
    unit: str
    at: tuple[float, ...]
    value: tuple[float, ...]
    std: tuple[float, ...]
    provisional: bool

    def to_dict(self) -> dict[str, Any]:
        """As in model.json."""
        return {**vars(self), **{name: list(getattr(self, name)) for name in ("at", "value", "std")}}

    @classmethod
    def from_dict(cls, raw: dict[str, Any]) -> Curve:
        """From model.json. Raises ``TypeError`` for other keys and ``ValueError`` for what are not numbers."""
        lists = {name: tuple(float(value) for value in raw[name]) for name in ("at", "value", "std")}
        return cls(**{**raw, **lists})


def curves_of(fit: Fit) -> tuple[Curve, ...]:
    """The curves of a fit's splines; the band is that of the exact fit, else provisional, of the simulated or relaxed one."""
    splines = [effect for effect in fit.plant.effects if isinstance(effect, Spline)]
    if not splines:
        return ()
    names = [item.name for item in fit.problem.declared]
    if fit.spread is not None:
        covariance = fit.spread.correlation * np.outer(fit.spread.std, fit.spread.std)
    elif fit.simulated is not None:
        covariance = np.array(fit.simulated.covariance)
    else:
        covariance = relaxed_covariance(fit)
    return tuple(_curve(fit, effect, names, covariance) for effect in splines)


def known_ranges(plant: Plant, ranges: Mapping[str, float]) -> dict[str, float]:
    """What places a signal within its knots, SI: the ``ranges`` of the data, ambient pressure and the stated supply."""
    rig = plant.rig
    return {**ranges, "patm": rig.patm, "supply_nominal": rig.supply if plant.servo else rig.patm}


def _curve(fit: Fit, effect: Spline, names: Sequence[str], covariance: np.ndarray) -> Curve:
    term = effect.term
    low, high = visited(fit.runs, term, fit)
    at = np.linspace(low, high, POINTS)
    columns = np.array(curve_columns(term, known_ranges(fit.plant, fit.ranges), at))
    index = [names.index(name) for name in effect.amplitudes]
    value = np.array([fit.values[name] for name in effect.amplitudes]) @ columns
    std = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", columns, covariance[np.ix_(index, index)], columns), 0.0))
    return Curve(
        effect.name, term.equation, term.signal, term.factor, term.unit, _plain(at), _plain(value), _plain(std),
        fit.spread is None,
    )  # fmt: skip


def _plain(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def signal_of(run: Run, signal: str, fit: Fit) -> np.ndarray:
    """Samples ``(N,)`` of a spline's signal in one run: SI, absolute, ``u`` as relative opening."""
    rig, signals = fit.plant.rig, run.recording.signals
    if signal == "v":
        return np.asarray(run.input("v") if "v" in run.inputs else run.motion.v)
    if signal == "u":
        return np.asarray((run.input("u") - rig.null) / rig.full_scale)
    if signal == "t":
        return run.t
    if signal == "psup":
        return np.asarray(run.input("psup"))
    if signal in DIFFERENCES:
        first, second = (signal_of(run, one, fit) for one in DIFFERENCES[signal])
        return first - second
    return np.asarray(signals.get(signal, np.full(run.n, rig.patm)))


def visited(runs: Sequence[Run], term: Term, fit: Fit) -> tuple[float, float]:
    """Range of a term's signal that holds all but a thousandth of the samples at either end."""
    every = np.concatenate([signal_of(run, term.signal, fit) for run in runs])
    low, high = np.quantile(every, [0.001, 0.999])
    return float(low), float(max(high, low + 1e-9 * max(abs(low), 1.0)))


def relaxed_covariance(fit: Fit) -> np.ndarray:
    """Covariance ``(nq, nq)``, SI, of the relaxed solution's parameters, node states eliminated; zero on a bound."""
    problem, X = fit.problem, fit.relaxed.X
    _, hessian = relaxed_system(problem, X)
    q = X[: problem.nq]
    held = problem.scaling.on_bound(q)
    free = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
    H = hessian[free][:, free]
    count = int((~held).sum())
    right = np.zeros((free.size, count))
    right[:count] = np.eye(count)
    inverse = factorised(H, count, 1e-12).solve(right)[:count]
    found = np.zeros((problem.nq, problem.nq))
    found[np.ix_(~held, ~held)] = 0.5 * (inverse + inverse.T)
    slope = problem.scaling.slope(q)
    return np.asarray(found * np.outer(slope, slope))
