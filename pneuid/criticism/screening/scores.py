"""Screening: what each effect of the catalogue would gain, without fitting any of them.

Every candidate is an extra column of the relaxed cost at its off-value: how the weighted outputs and the defects change
with each of its amplitudes. Projected orthogonal to the fitted parameters and the nodes, the columns predict each
one's drop of the cost (a score test; Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50). Candidates whose predicted changes
are collinear cannot be told apart. The columns are differences of forward simulations, which compile in a fraction
of the time that derivatives by every effect of the catalogue take.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from pneuid.criticism.screening.batches import Batch, batches, plant_with
from pneuid.criticism.screening.fitted import Fitted
from pneuid.effect import Effect, Parameter
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Scaling
from pneuid.interval import begin
from pneuid.plant import Plant

COLLINEAR = 0.9
"""Correlation of predicted changes above which two effects are one group."""

TELLABLE = 3.0
"""Predicted drop below which an effect's change is noise and is grouped with nothing."""

LEADING = 0.05
"""Share of the largest predicted drop below which an effect is not looked at for its group."""

BEHIND, SHAPED = 0.5, 1.5
"""Share of the largest predicted drop below which an effect is looked at with other shapes, and times its own drop that another
shape must promise to be started from."""

STEP = 1e-8
"""Step of an amplitude, in units of its scale, by which a column is taken as a difference: stick makes the response curve
within 1e-6, rounding disturbs it by 1e-4 of a sensor's noise at this step."""

RUNS_AWAY = 1e12
"""Change of a residual, in noise levels, from which an effect leads where nothing can be followed, and promises nothing."""


@dataclass(frozen=True)
class Score:
    """Predicted gain of one effect: drop of half the sum of squares, degrees of freedom, amplitudes for a refit (SI).

    shapes : those of its shapes (SI) that should start elsewhere than usual; ahead : times the drop of the best effect outside
    its group.
    """

    effect: Effect
    drop: float
    gain: float
    freedom: int
    start: dict[str, float]
    group: tuple[str, ...]
    shapes: Mapping[str, float] = field(default_factory=dict)
    ahead: float = 0.0

    @property
    def whole_start(self) -> dict[str, float]:
        """Where a refit starts: amplitudes and shapes."""
        return {**self.start, **self.shapes}


@dataclass(frozen=True)
class Change:
    """What one effect's best step does.

    raw : change of the stacked residuals; base : its inner products with the fitted columns (parameters and nodes).
    """

    effect: Effect
    drop: float
    start: dict[str, float]
    raw: np.ndarray
    base: np.ndarray
    shapes: Mapping[str, float] = field(default_factory=dict)


def screen(fit: Fit, candidates: Sequence[Effect], order: Sequence[str]) -> list[Score]:
    """Scores of ``candidates`` on the relaxed solution of ``fit``, best first.

    ``order`` is the catalogue's order of effect names, which is the order of maps at a shared port.
    """
    present = {effect.name for effect in fit.plant.effects}
    chosen = [
        effect
        for effect in candidates
        if fit.plant.rig.kind in effect.rigs and fit.plant.law.name in effect.laws and effect.name not in present
    ]
    if not chosen:
        return []
    problem = fit.problem
    begin(fit.plant, problem.function.selected, problem.samples, ("jacobian",))
    for batch in batches(fit.plant, chosen):
        begin(plant_with(fit.plant, batch, order), (), problem.samples, ("trajectory",))
    fitted = Fitted(fit)
    changes = screened(fitted, chosen, order)
    groups = _groups(fitted, changes)
    found = [
        Score(change.effect, change.drop, float(change.drop / max(fit.relaxed_cost, 1e-12)), len(change.start),
              change.start, groups[change.effect.name], change.shapes, _ahead(change, changes, groups[change.effect.name]))
        for change in changes
    ]  # fmt: skip
    return sorted(found, key=lambda score: -score.drop)


def _ahead(change: Change, changes: Sequence[Change], group: Sequence[str]) -> float:
    """Times the drop of the best effect outside the group."""
    others = [one.drop for one in changes if one is not change and one.effect.name not in group]
    return float(change.drop / max([1e-12, *others]))


def screened(fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> list[Change]:
    """Predicted changes by every effect, in batches that share a compiled plant.

    By one that promises far less than another, also at other values of its shapes: a cushion that is shorter than usual shows
    little of itself as a long one.
    """
    every = [Batch(fitted, batch, order) for batch in batches(fitted.fit.plant, chosen)]
    usual = [_screened(batch) for batch in every]
    little = max(TELLABLE, BEHIND * max(change.drop for changes in usual for change in changes))
    return [change for batch, changes in zip(every, usual, strict=True) for change in _at_best_shapes(batch, changes, little)]


def _screened(batch: Batch) -> list[Change]:
    """Predicted changes by the effects of one batch, their shapes as usual."""
    every = _Columns(batch, batch.amplitudes)
    return [every.change(effect) for effect in batch.chosen]


def _at_best_shapes(batch: Batch, usual: Sequence[Change], little: float) -> list[Change]:
    """The changes by the effects of one batch; by one that promises less than ``little``, or names shapes to look at, with
    those that promise most."""
    asked = [
        (one.effect, shapes) for one in usual
        for shapes in one.effect.looks or (_shapes(batch.plant, one.effect) if one.drop < little else ())
    ]  # fmt: skip
    followed = iter(batch.followed([shapes for effect, shapes in asked if effect.states]))
    found = {one.effect.name: one for one in usual}
    worth = {one.effect.name: max(TELLABLE, SHAPED * one.drop) for one in usual}
    for effect, shapes in asked:
        nodes = next(followed) if effect.states else batch.nodes
        change = _Columns(batch, batch.of(effect), shapes, nodes).change(effect)
        if change.drop > max(worth[effect.name], found[effect.name].drop):
            found[effect.name] = change
    return list(found.values())


def _shapes(plant: Plant, effect: Effect) -> Iterator[dict[str, float]]:
    """Values (SI) of an effect's shapes one prior deviation off, one at a time.

    A spring that only pulls promises nothing where it would have to push: it takes another position without force.
    """
    for item in effect.parameters(plant.rig, plant.law):
        if item.off is None and item.prior is not None:
            for sign in (-1.0, 1.0):
                value = item.start * np.exp(sign * item.prior) if item.positive else item.start + sign * item.prior
                yield {item.name: float(np.clip(value, item.lower, item.upper))}


class _Columns:
    """What amplitudes ``items`` of a batch do to the residuals at first order, orthogonal to the fitted variables.

    ``shapes`` are values (SI) that differ from the start's, with which the effects' own states take the values in ``nodes``.
    """

    def __init__(
        self, batch: Batch, items: Sequence[Parameter], shapes: Mapping[str, float] | None = None,
        nodes: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.shapes = shapes = dict(shapes or {})
        fitted, self.plant, self.items = batch.fitted, batch.plant, list(items)
        self.scaling = Scaling(self.items)
        self.at = self.scaling.to_q(np.array([batch.off[item.name] for item in self.items]))
        nodes = batch.nodes if nodes is None else nodes
        self.raw = np.empty((batch.before.size, len(self.items)))
        for j, item in enumerate(self.items):
            q = self.at.copy()
            q[j] += STEP
            moved = {item.name: float(self.scaling.to_values(q)[j])}
            column = batch.change(shapes | moved, nodes) / STEP
            # states with shapes too fast for the sampling of these records run away
            self.raw[:, j] = column if np.abs(column).max() < RUNS_AWAY else 0.0
        self.base = fitted.cross(self.raw)
        prior = np.array([_prior(item) for item in self.items]).reshape(-1, 2)
        solved = fitted.solver.solve(self.base)
        self.matrix = self.raw.T @ self.raw - self.base.T @ solved + np.diag(prior[:, 0] ** 2)
        pull = prior[:, 0] ** 2 * (self.at - prior[:, 1])
        self.slope = self.raw.T @ fitted.residual - solved.T @ fitted.gradient + pull

    def change(self, effect: Effect) -> Change:
        """The change by the best step of one effect's amplitudes."""
        own = self.plant.own_parameters(effect.name)
        rows = [j for j, item in enumerate(self.items) if item.name in own]
        low, high, at = self.scaling.lower[rows], self.scaling.upper[rows], self.at[rows]
        M, g = self.matrix[np.ix_(rows, rows)], self.slope[rows]
        step = _best_step(M, g, low - at, high - at)
        q = self.at.copy()
        q[rows] = np.clip(at + step, low, high)
        values = self.scaling.to_values(q)
        start = {self.items[j].name: float(values[j]) for j in rows}
        drop = float(max(0.0, -(g @ step + 0.5 * step @ M @ step)))
        return Change(effect, drop, start, self.raw[:, rows] @ step, self.base[:, rows] @ step, self.shapes)


def _prior(item: Parameter) -> tuple[float, float]:
    """Inverse spread (0 where there is none) and centre of a parameter's prior in search units."""
    centre = float(Scaling([item]).to_q(np.array([item.start]))[0])
    if item.prior is None:
        return 0.0, centre
    return 1.0 / (item.prior if item.positive else item.prior / item.scale), centre


def _groups(fitted: Fitted, changes: Sequence[Change]) -> dict[str, tuple[str, ...]]:
    """For every leading effect those whose predicted changes are collinear with its own, orthogonal to what is fitted."""
    groups: dict[str, tuple[str, ...]] = {change.effect.name: () for change in changes}
    least = max(TELLABLE, LEADING * max(change.drop for change in changes))
    leading = [change for change in changes if change.drop > least]
    if len(leading) < 2:
        return groups
    base = np.column_stack([change.base for change in leading])
    raw = np.column_stack([change.raw for change in leading])
    M = raw.T @ raw - base.T @ fitted.solver.solve(base)
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    near = np.abs(M / np.outer(size, size)) > COLLINEAR
    for i, change in enumerate(leading):
        groups[change.effect.name] = tuple(
            other.effect.name for j, other in enumerate(leading) if j != i and near[i, j]
        )
    return groups


def _best_step(M: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Step of one effect's amplitudes (scaled) that lowers the quadratic model most, between ``low`` and ``high``."""
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    # a direction that the data do not feel at all keeps a step of zero
    root = np.linalg.cholesky(M / np.outer(size, size) + 1e-8 * np.eye(size.size))
    target = -np.linalg.solve(root, g / size)
    found = lsq_linear(root.T, target, (low * size - 1e-12, high * size + 1e-12))
    return np.asarray(found.x / size)
