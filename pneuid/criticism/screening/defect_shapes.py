"""What an effect would take away of the measured defect, over the signal that its contribution follows.

The relaxed fit leaves a force and two pressure rates between intervals that no equation explains (on a bench: a driving
force). An effect at its screened size changes them; its column, orthogonal to the fitted parameters and nodes as in
``screening``, is on the scale of the defect itself, which shows a missing term at a fraction of its size. So the two may be
laid over one another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.screening.fitted import Fitted
from pneuid.criticism.screening.scores import Change, screened
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit

BALANCES = (("force", "v", "N"), ("pressure_1", "p1", "Pa/s"), ("pressure_2", "p2", "Pa/s"))
"""Equation of a servo rig, the state whose jump it leaves, and the unit of what is unexplained."""

BINS, FEWEST = 24, 8
"""Bins over a signal, of equal count, and the fewest intervals in one."""

SLIDING = 2e-3
"""Speed above which the direction of motion is known, m/s."""


@dataclass(frozen=True)
class DefectShape:
    """Measured defect and what an effect takes of it, in bins ``(k,)`` over ``signal``.

    ``at``: mean of the signal in SI (pressures absolute; ``dp`` is p1 - p2); ``measured`` with standard error ``spread``, and
    ``taken``, in ``unit``; ``against_motion``: the force is counted against the motion, sliding intervals only; ``share``:
    part of the squared defect of all intervals shown that the effect takes away.
    """

    effect: str
    equation: str
    unit: str
    signal: str
    against_motion: bool
    at: np.ndarray
    measured: np.ndarray
    spread: np.ndarray
    taken: np.ndarray
    share: float


@dataclass(frozen=True)
class _Balance:
    """Unexplained and taken ``(n,)`` of one equation in ``unit``; ``weight`` makes balances comparable."""

    equation: str
    unit: str
    measured: np.ndarray
    taken: np.ndarray
    weight: float


def defect_shapes(fit: Fit, effects: Sequence[Effect], order: Sequence[str]) -> list[DefectShape]:
    """The shapes of ``effects`` over the defects of ``fit``; one that changes no balance of these data is left out.

    ``order`` is the catalogue's order of effect names, which is the order of maps at a shared port.
    """
    fitted = Fitted(fit)
    signals = _signals(fitted)
    found = []
    for change in screened(fitted, effects, order):
        balances = _balances(fitted, change)
        leading = max(balances, key=lambda item: item.weight * float(np.sum(item.taken**2)))
        if np.any(leading.taken):
            found.append(_shape(change.effect.name, leading, signals))
    return found


def _balances(fitted: Fitted, change: Change) -> list[_Balance]:
    """What every equation leaves per linked interval, and what the change takes of it."""
    problem, projected = fitted.fit.problem, fitted.projected(change.raw, change.base)
    if not fitted.fit.plant.servo:
        rows, j = (problem.nint, problem.samples, len(problem.plant.outputs)), problem.plant.outputs.index("F")
        weight = problem.data[-rows[2] :].T.reshape(rows)[problem.linked, :, j]
        total = np.maximum(np.sum(weight**2, axis=1), 1e-300)

        def mean(stacked: np.ndarray) -> np.ndarray:
            own = stacked[: np.prod(rows)].reshape(rows)[problem.linked, :, j]
            return np.asarray(np.sum(own * weight, axis=1) / total)

        return [_Balance("force", "N", -mean(fitted.residual), mean(projected), 1.0)]
    split = fitted.residual.size - problem.linked.size * problem.ns
    length = float(np.median(problem.data[0])) * problem.samples
    theta = dict(zip(fitted.fit.plant.theta_names, fitted.fit.plant.theta(fitted.fit.values, fitted.fit.ranges), strict=True))
    mass = theta.get("mass", theta["mass_run"])
    found = []
    for equation, state, unit in BALANCES:
        i = problem.plant.states.index(state)
        factor = problem.relaxation * problem.state_scale[i] / length * (mass if unit == "N" else 1.0)
        own = [part[split:].reshape(-1, problem.ns)[:, i] for part in (fitted.residual, projected)]
        found.append(_Balance(equation, unit, -factor * own[0], factor * own[1], float(factor) ** -2))
    return found


def _signals(fitted: Fitted) -> Mapping[str, np.ndarray]:
    """Mean over every linked interval of what an effect may follow, SI."""
    problem = fitted.fit.problem
    names = problem.plant.inputs
    inputs = problem.data[1 : 1 + len(names)].reshape(len(names), problem.nint, problem.samples).mean(axis=2)
    found = dict(zip(names, inputs[:, problem.linked], strict=True))
    for name, row in zip(problem.plant.states, fitted.nodes, strict=True):
        if name in ("x", "v", "p1", "p2"):
            found[name] = 0.5 * (row[problem.linked] + row[problem.linked + 1])
    if "p1" in found and "p2" in found:
        found["dp"] = found["p1"] - found["p2"]
    lengths = problem.data[0].reshape(problem.nint, problem.samples).sum(axis=1)
    starts = [np.cumsum(own) - own for own in np.split(lengths, problem.first[1:-1])]
    found["t"] = np.concatenate(starts)[problem.linked]
    return {name: found[name] for name in ("v", "x", "p1", "p2", "dp", "u", "psup", "t") if name in found}


def _shape(effect: str, balance: _Balance, signals: Mapping[str, np.ndarray]) -> DefectShape:
    """Over the signal, and counted against the motion or not, in which bins hold most of what the effect takes."""
    v = signals["v"]
    plain = np.ones(v.size), np.ones(v.size, dtype=bool)
    signs = [(False, *plain)]
    if balance.unit == "N":
        signs.append((True, -np.sign(v), np.abs(v) > SLIDING))
    best: tuple[float, bool, str] = (-1.0, False, "v")
    for against, sign, chosen in signs:
        for name, values in signals.items():
            held = 0.0
            for members in _bins(values[chosen]):
                taken = (sign * balance.taken)[chosen][members]
                held += taken.size * float(taken.mean()) ** 2
            # a signed picture of all there is before one of a part that says no more
            if held > best[0] * (1.0 + 1e-9):
                best = held, against, name
    _, against, signal = best
    _, sign, chosen = signs[against]
    at, measured, taken = (part[chosen] for part in (signals[signal], sign * balance.measured, sign * balance.taken))
    bins = _bins(at)
    rest = float(np.sum((measured - taken) ** 2) / max(float(np.sum(measured**2)), 1e-300))
    return DefectShape(
        effect, balance.equation, balance.unit, signal, bool(against),
        np.array([at[own].mean() for own in bins]), np.array([measured[own].mean() for own in bins]),
        np.array([measured[own].std() / np.sqrt(own.size) for own in bins]), np.array([taken[own].mean() for own in bins]),
        1.0 - rest,
    )  # fmt: skip


def _bins(values: np.ndarray) -> list[np.ndarray]:
    """Members of bins of equal count, in order of the value; equal values stay together."""
    order = np.argsort(values, kind="stable")
    count = max(1, min(BINS, values.size // FEWEST))
    edges = np.searchsorted(values[order], values[order][np.linspace(0, values.size, count, endpoint=False).astype(int)])
    return [part for part in np.split(order, np.unique(edges)[1:]) if part.size]
