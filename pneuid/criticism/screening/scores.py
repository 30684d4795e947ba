"""Screening: what each effect of the catalogue would gain, without fitting any of them.

Every candidate is an extra column of the relaxed cost at its off-value: how the weighted outputs and the defects change
with each of its amplitudes. Projected orthogonal to the fitted parameters and the nodes, the columns predict each
one's drop of the cost (a score test; Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50). Candidates whose predicted changes
are collinear cannot be told apart. The columns are differences of forward simulations, which compile in a fraction
of the time that derivatives by every effect of the catalogue take.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import lsq_linear

from pneuid.cores import threads
from pneuid.effect import Effect, Parameter
from pneuid.estimation.assembly import relaxed_system
from pneuid.estimation.factor import factorised
from pneuid.estimation.fit import Fit
from pneuid.estimation.settled import starting_states
from pneuid.estimation.shooting import Scaling
from pneuid.interval import begin, trajectory_function
from pneuid.mapped import Mapped
from pneuid.plant import Plant

COLLINEAR = 0.9
"""Correlation of predicted changes above which two effects are one group."""

BATCH_COLUMNS, BATCH_STATES = 12, 4
"""Amplitudes and states of the effects that share one compiled plant."""

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
        begin(_plant_with(fit.plant, batch, order), (), problem.samples, ("trajectory",))
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


class Fitted:
    """What was fitted: residuals, their Jacobian and a solver for the Hessian of the free variables.

    Residuals are stacked: weighted outputs of every interval, sample by sample, then the defects in units of their
    allowed spread.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        problem, X = fit.problem, fit.relaxed.X
        q = X[: problem.nq]
        width = problem.scaling.upper - problem.scaling.lower
        held = (q - problem.scaling.lower < 1e-3 * width) | (problem.scaling.upper - q < 1e-3 * width)
        self.free = np.concatenate([np.flatnonzero(~held), np.arange(problem.nq, problem.size)])
        gradient, hessian = relaxed_system(problem, X)
        H = hessian[self.free][:, self.free]
        self.gradient = gradient[self.free]
        self.solver = factorised(H, int((~held).sum()))
        self.rows, self.ends = problem.jacobian(X)
        self.ends = self.ends[problem.linked] / problem.relaxation
        values = dict(zip(problem.free, problem.scaling.to_values(q), strict=True))
        self.values = problem.values | values
        self.nodes = problem.split(X)[1]
        shown = self.response(self.runner(problem.plant), problem.plant, self.nodes, self.values)
        ny = len(problem.plant.outputs)
        measured = problem.data[-2 * ny : -ny] * problem.data[-ny:]
        defect = -(self.nodes / problem.state_scale[:, None])[:, problem.linked + 1].T / problem.relaxation
        self.residual = shown + np.concatenate([-measured.T.ravel(), defect.ravel()])

    def runner(self, plant: Plant) -> Mapped:
        """Trajectories of ``plant`` over all intervals."""
        problem = self.fit.problem
        return Mapped(trajectory_function(plant, problem.samples, problem.substeps), problem.nint, threads())

    def response(self, run: Mapped, plant: Plant, nodes: np.ndarray, values: dict[str, float]) -> np.ndarray:
        """Weighted outputs and end states of ``plant``, stacked; states that the fitted plant lacks are left out."""
        problem = self.fit.problem
        outputs, states = run(nodes, problem.data, problem.theta_of(values, plant))
        with np.errstate(invalid="ignore"):  # what runs away over a masked sample is not finite, and promises nothing
            shown = outputs * problem.data[-len(plant.outputs) :]
        own = [plant.states.index(name) for name in problem.plant.states]
        ends = states[own, problem.samples :: problem.samples + 1] / problem.state_scale[:, None]
        return np.concatenate([shown.T.ravel(), ends[:, problem.linked].T.ravel() / problem.relaxation])

    def cross(self, change: np.ndarray) -> np.ndarray:
        """Inner products ``(free, k)`` of stacked changes ``(m, k)`` with the columns of the free variables."""
        problem = self.fit.problem
        k, split = change.shape[1], self.rows.shape[0] * self.rows.shape[1]
        defects = change[split:].reshape(problem.linked.size, problem.ns, k)
        blocks = self.rows.transpose(0, 2, 1) @ change[:split].reshape(problem.nint, -1, k)
        blocks[problem.linked] += self.ends.transpose(0, 2, 1) @ defects
        nodes = blocks[:, problem.nq :]
        nodes[problem.linked + 1] -= defects / problem.relaxation
        found = np.concatenate([blocks[:, : problem.nq].sum(axis=0), nodes.reshape(-1, k)])
        return np.asarray(found[self.free])

    def projected(self, change: Change) -> np.ndarray:
        """The stacked change orthogonal to the fitted parameters and nodes: what is left of it once they have followed."""
        problem = self.fit.problem
        follow = np.zeros(problem.size)
        follow[self.free] = -self.solver.solve(change.base)
        nodes = follow[problem.nq :].reshape(problem.nint, problem.ns)
        local = np.hstack([np.tile(follow[: problem.nq], (problem.nint, 1)), nodes])
        rows = np.einsum("ikw,iw->ik", self.rows, local)
        ends = np.einsum("ikw,iw->ik", self.ends, local[problem.linked]) - nodes[problem.linked + 1] / problem.relaxation
        return np.asarray(change.raw + np.concatenate([rows.ravel(), ends.ravel()]))


def batches(plant: Plant, chosen: Sequence[Effect]) -> Iterator[list[Effect]]:
    """The candidates in their order, a few amplitudes and states at a time."""
    batch: list[Effect] = []
    columns = states = 0
    for effect in chosen:
        own = len(_amplitudes(plant, effect))
        if batch and (columns + own > BATCH_COLUMNS or states + len(effect.states) > BATCH_STATES):
            yield batch
            batch, columns, states = [], 0, 0
        batch.append(effect)
        columns, states = columns + own, states + len(effect.states)
    if batch:
        yield batch


def _amplitudes(plant: Plant, effect: Effect) -> list[Parameter]:
    """Parameters that are zero while the effect is off; shapes mean nothing then."""
    return [item for item in effect.parameters(plant.rig, plant.law) if item.off is not None]


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


class Batch:
    """The fitted plant with some effects more, all of them off: how it responds when they are not."""

    def __init__(self, fitted: Fitted, chosen: Sequence[Effect], order: Sequence[str]) -> None:
        self.fitted, self.chosen, self.plant = fitted, list(chosen), _plant_with(fitted.fit.plant, chosen, order)
        self.amplitudes = [item for effect in chosen for item in _amplitudes(self.plant, effect)]
        self.off = {item.name: float(item.off or 0.0) for item in self.amplitudes}
        self.values = self.plant.starts() | fitted.values | self.off
        self.nodes, *_ = self.followed([{}])
        self._run = fitted.runner(self.plant)
        self.before = fitted.response(self._run, self.plant, self.nodes, self.values)

    def of(self, effect: Effect) -> list[Parameter]:
        """The amplitudes of one effect."""
        own = self.plant.own_parameters(effect.name)
        return [item for item in self.amplitudes if item.name in own]

    def followed(self, moved: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        """Nodes ``(ns, nint)`` with the effects' own states as they come out with each of the values ``moved``."""
        return _rolled_out(self.fitted, self.plant, [self.values | dict(one) for one in moved])

    def change(self, moved: Mapping[str, float], nodes: np.ndarray) -> np.ndarray:
        """Change of the stacked residuals when some values (SI) are moved."""
        return self.fitted.response(self._run, self.plant, nodes, self.values | dict(moved)) - self.before


def _plant_with(plant: Plant, effects: Sequence[Effect], order: Sequence[str]) -> Plant:
    return Plant(plant.rig, plant.law.name, in_order([*plant.effects, *effects], order))


def in_order(effects: Iterable[Effect], order: Sequence[str]) -> list[Effect]:
    """The effects in the catalogue's ``order`` of names, those that it does not hold last."""
    position = {name: i for i, name in enumerate(order)}
    return sorted(effects, key=lambda effect: position.get(effect.name, len(position)))


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


def _rolled_out(fitted: Fitted, plant: Plant, values: Sequence[dict[str, float]]) -> list[np.ndarray]:
    """Nodes of ``plant`` with each of some ``values``: the fitted states, and the candidates' own filled in by following the
    fitted trajectory."""
    problem, many = fitted.fit.problem, len(values)
    nodes = np.zeros((len(plant.states), many, problem.nint))
    for name, row in zip(problem.plant.states, fitted.nodes, strict=True):
        nodes[plant.states.index(name)] = row
    fresh = [i for i, name in enumerate(plant.states) if name not in problem.plant.states]
    if not fresh or not many:
        return list(nodes.transpose(1, 0, 2))
    counts = np.diff(problem.first)
    step = Mapped(trajectory_function(plant, problem.samples, problem.substeps), many * counts.size)
    theta = np.stack([problem.theta_of(one, plant) for one in values], axis=1)
    data = problem.data.reshape(problem.data.shape[0], problem.nint, -1)
    first, inputs = problem.first[:-1], data[1 : 1 + len(plant.inputs), problem.first[:-1], 0]
    starts = [starting_states(plant, nodes[:, j, first], inputs, theta[:, j, first]) for j in range(many)]
    own = np.stack(starts, axis=1)[np.array(fresh) - len(plant.states)]
    for k in range(counts.max()):
        # all runs with all values at once; a run that has ended stays at its last interval
        at = problem.first[:-1] + np.minimum(k, counts - 1)
        nodes[np.ix_(fresh, range(many), at)] = own
        measured = np.tile(data[:, at], (1, many, 1)).reshape(data.shape[0], -1)
        _, states = step(nodes[:, :, at].reshape(len(nodes), -1), measured, theta[:, :, at].reshape(len(theta), -1))
        ended = states[fresh, problem.samples :: problem.samples + 1].reshape(own.shape)
        own = np.where(k + 1 < counts, ended, own)
    return list(nodes.transpose(1, 0, 2))


def _best_step(M: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Step of one effect's amplitudes (scaled) that lowers the quadratic model most, between ``low`` and ``high``."""
    size = np.sqrt(np.maximum(np.diag(M), 1e-300))
    # a direction that the data do not feel at all keeps a step of zero
    root = np.linalg.cholesky(M / np.outer(size, size) + 1e-8 * np.eye(size.size))
    target = -np.linalg.solve(root, g / size)
    found = lsq_linear(root.T, target, (low * size - 1e-12, high * size + 1e-12))
    return np.asarray(found.x / size)
