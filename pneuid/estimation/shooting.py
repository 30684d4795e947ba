"""Multiple shooting: variables, intervals, and the Gauss-Newton model of the cost and the continuity defects.

Variables ``X = [q, nodes]``: ``q`` the scaled free parameters (logarithm where positive, else value/scale), then the node
states of every interval of every run, each divided by its scale. The cost is half the sum of squared weighted residuals
plus the weak priors; the defect of an interval is its end state minus the next node, in units of ``defect_scale``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from pneuid.cores import threads
from pneuid.effect import Parameter
from pneuid.estimation.end_stops import stretches
from pneuid.estimation.forgetting import renewed
from pneuid.estimation.own import QUANTITIES, declared, of_key
from pneuid.estimation.preparation import Run
from pneuid.interval import IntervalFunction, interval_function, jacobian_function
from pneuid.mapped import Mapped
from pneuid.physics.smoothing import COARSE, FINE, Smoothing
from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES, stable_upper_bounds

NODE_EVERY = 20
"""Samples per interval."""

BRISTLE_SPREAD = 1.0e-4
"""1-sigma of the bristle deflection at the start of a run, m: wide, only there where data say nothing."""

LOOSE = 1.0
"""Spread of the defects, in units of the state scale, with which a wrong model can still be fitted."""

TIGHT = 0.1
"""Spread of the defects of a model that lacks little: a tenth of 0.1 mm, 1 cm/s, 1 kPa and 10 um per interval."""

OWN_DEFECT = 0.1
"""Defects allowed to the states that effects bring, in units of their scale times the relaxation and of what is new in them
after an interval: with as much freedom as position or pressure have, such a state becomes an unknown input that explains
anything."""

ON_BOUND_SHARE, ON_BOUND = 1e-4, 1e-3
"""Distances within which a search variable counts as lying on its bound: a share of its range, and at most that much."""


class Scaling:
    """Between physical parameters (SI) and the search variables ``q``."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.names = tuple(parameter.name for parameter in parameters)
        self.positive = np.array([parameter.positive for parameter in parameters], dtype=bool)
        self.scale = np.array([1.0 if parameter.positive else parameter.scale for parameter in parameters])
        self.lower = self.to_q(np.array([parameter.lower for parameter in parameters]))
        self.upper = self.to_q(np.array([parameter.upper for parameter in parameters]))

    def to_q(self, values: np.ndarray) -> np.ndarray:
        """Search variables from physical values."""
        return np.where(self.positive, np.log(np.where(self.positive, values, 1.0)), values / self.scale)

    def to_values(self, q: np.ndarray) -> np.ndarray:
        """Physical values from search variables."""
        return np.where(self.positive, np.exp(np.where(self.positive, q, 0.0)), q * self.scale)

    def on_bound(self, q: np.ndarray) -> np.ndarray:
        """Which of the search variables lie on a bound: a wide range must not make a weak effect look absent."""
        close = np.minimum(ON_BOUND_SHARE * (self.upper - self.lower), ON_BOUND)
        return (q - self.lower < close) | (self.upper - q < close)

    def slope(self, q: np.ndarray) -> np.ndarray:
        """``d value / d q``."""
        return np.where(self.positive, self.to_values(q), self.scale)


@dataclass
class Evaluation:
    """Values and derivative blocks at one point, scaled.

    end : ``(ns, nint)``; cost : data cost; sensitivity : ``(nint, ns, width)`` of the scaled end state; gram :
    ``(nint, width+1, width+1)``.
    """

    end: np.ndarray
    sensitivity: np.ndarray
    gram: np.ndarray


def relaxed_smoothing(plant: Plant) -> Smoothing:
    """Widths of the relaxed problem: coarse where the speed is sought, fine where it is imposed.

    A bench needs no smooth derivative by the speed; with wide kinks its bristle would relax at rest by 4 % in 20 ms, which
    looks like friction that depends on the time at rest and moves Fc and sigma2.
    """
    return COARSE if plant.servo else FINE


@once_per_structure(STRUCTURES)
def _constraint_function(plant: Plant) -> ca.Function:
    """``theta`` to the values of the inequalities among the parameters and their derivatives by ``theta``."""
    theta = ca.SX.sym("theta", len(plant.theta_names))
    found = [item.value for item in plant.constraints(theta)]
    value = ca.vertcat(*found) if found else ca.SX(0, 1)
    return ca.Function("constraints", [theta], [ca.densify(value), ca.densify(ca.jacobian(value, theta))])


def differentiated(free: Sequence[str]) -> tuple[str, ...]:
    """Names that the interval function differentiates by, of ``free`` parameters: those of single runs share one a quantity."""
    shared = [name for name in free if of_key(name)[1] is None]
    return (*shared, *sorted({QUANTITIES[of_key(name)[0]] for name in free if of_key(name)[1] is not None}))


class Shooting:
    """The multiple-shooting problem of one plant, some runs and some free parameters.

    Parameters: ``free`` names the searched parameters, all others stay at ``values``; ``ranges`` as from
    ``data_ranges``; ``substeps`` per sample. Shapes: ``ns`` states, ``nint`` intervals over all runs, ``nq`` free.
    """

    def __init__(
        self,
        plant: Plant,
        runs: Sequence[Run],
        free: Sequence[str],
        values: Mapping[str, float],
        ranges: Mapping[str, float],
        substeps: int,
        node_every: int = NODE_EVERY,
    ) -> None:
        self.plant, self.runs, self.free = plant, tuple(runs), tuple(free)
        self.values, self.ranges, self.substeps = dict(values), dict(ranges), substeps
        by_name = {parameter.name: parameter for parameter in declared(plant, [run.own for run in runs])}
        self.declared = tuple(by_name[name] for name in self.free)
        interval = float(np.median(np.concatenate([run.data[0] for run in runs])))
        start = plant.theta(self.values, self.ranges)
        self.bounds = stable_upper_bounds(plant, start, interval, substeps)
        self.declared = tuple(
            replace(item, upper=min(item.upper, self.bounds.get(item.name, np.inf))) for item in self.declared
        )
        self.scaling = Scaling(self.declared)
        self.samples = node_every
        selected, self._place = self._columns()
        self.function: IntervalFunction = interval_function(plant, selected, node_every, substeps)
        self.ns, self.nq = len(plant.states), len(self.free)
        self.state_scale = plant.state_scales.copy()
        own = renewed(plant, self.runs, node_every * interval)
        self.state_scale[plant.explicit_count + 1 :] *= OWN_DEFECT * own
        counts = [-(-run.n // node_every) for run in self.runs]
        self.first = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        self.nint = int(self.first[-1])
        self.size = self.nq + self.ns * self.nint
        parts = [stretches(run.contact, node_every) for run in self.runs]
        held = [self._padded(run, count, own) for run, count, (_, own) in zip(self.runs, counts, parts, strict=True)]
        self.data = np.hstack(held)
        self.total_samples = sum(run.n for run in self.runs)
        self.weighted = int(np.count_nonzero(self.data[-len(plant.outputs) :]))
        self.stretches = np.concatenate([start + own for start, (own, _) in zip(self.first[:-1], parts, strict=True)])
        """Nodes where the state starts anew: at a run's first sample, and after the piston was at an end stop."""
        self.since = np.concatenate([run.t[own * node_every] for run, (own, _) in zip(self.runs, parts, strict=True)])
        """Time in s since the recording began at these."""
        self.linked = np.setdiff1d(np.arange(self.nint), np.append(self.stretches, self.nint) - 1)
        """Intervals whose end must meet the next node."""
        self._shared = [j for j, name in enumerate(self.free) if name in plant.theta_names]
        self._index = [plant.theta_names.index(self.free[j]) for j in self._shared]
        self.smoothing = FINE
        self.relaxation = TIGHT
        """Spread allowed to the defects of the relaxed problem, in units of the state scale."""

    def __reduce__(self) -> tuple[Any, ...]:
        """A problem goes to another process by what it is made of; its functions are built there."""
        made = self.plant, self.runs, self.free, self.values, self.ranges, self.substeps, self.samples
        return _made_again, (*made, self.smoothing, self.relaxation)

    def __copy__(self) -> Shooting:
        """Another problem that shares what this one holds; without this it would be made again from its arguments."""
        other = object.__new__(type(self))
        other.__dict__.update(vars(self))
        return other

    @cached_property
    def _map_values(self) -> Mapped:
        return Mapped(self.function.values, self.nint, threads())

    @cached_property
    def _map_derivatives(self) -> Mapped:
        return Mapped(self.function.derivatives, self.nint, threads())

    @cached_property
    def _map_constraints(self) -> Mapped:
        return Mapped(_constraint_function(self.plant), 1)

    def _padded(self, run: Run, count: int, held: np.ndarray) -> np.ndarray:
        missing = count * self.samples - run.n
        ny, nw = len(self.plant.outputs), len(self.plant.inputs)
        data = np.hstack([run.data, np.repeat(run.data[:, -1:], missing, axis=1)])
        data[-ny:] *= np.append(held, np.zeros(missing))
        data[1 + nw : 1 + 2 * nw, run.n :] = 0.0
        return data

    # --- variables ---

    def theta(self, q: np.ndarray) -> np.ndarray:
        """``(len(theta), nint)``: the theta column of every interval."""
        return self.theta_of(dict(zip(self.free, self.scaling.to_values(q), strict=True)))

    def theta_of(self, changed: Mapping[str, float], plant: Plant | None = None) -> np.ndarray:
        """The same from physical values of some parameters, for another ``plant`` on the same runs if one is given."""
        values = self.values | dict(changed)
        columns = [self._column(run, values, plant or self.plant) for run in self.runs]
        return np.repeat(np.array(columns).T, np.diff(self.first), axis=1)

    def _column(self, run: Run, values: Mapping[str, float], plant: Plant) -> np.ndarray:
        mass, shift = run.own.constants(values)
        return plant.theta(values, self.ranges, mass, self.smoothing, shift)

    def split(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``q`` and the physical node states ``(ns, nint)``."""
        nodes = X[self.nq :].reshape(self.nint, self.ns).T * self.state_scale[:, None]
        return X[: self.nq], nodes

    def join(self, q: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """The variable vector from ``q`` and physical nodes."""
        return np.concatenate([q, (nodes / self.state_scale[:, None]).T.ravel()])

    # --- evaluation ---

    def evaluate_values(self, X: np.ndarray) -> tuple[np.ndarray, float]:
        """Physical end states ``(ns, nint)`` and the data cost ``sum r^2 / 2``."""
        q, nodes = self.split(X)
        end, cost = self._map_values(nodes, self.data, self.theta(q))
        return end, 0.5 * float(np.sum(cost))

    def evaluate(self, X: np.ndarray) -> Evaluation:
        """End states, scaled sensitivities and scaled Gram blocks."""
        return self.evaluate_on(X, self.data)

    def evaluate_on(self, X: np.ndarray, data: np.ndarray) -> Evaluation:
        """The same on other ``data``, columns as ``self.data``."""
        q, nodes = self.split(X)
        end, sensitivity, packed = self._map_derivatives(nodes, data, self.theta(q))
        own = self.function.width
        S = sensitivity.reshape(self.ns, self.nint, own).transpose(1, 0, 2)
        rows, cols = self._triangle
        full = np.empty((self.nint, own + 1, own + 1))
        full[:, rows, cols] = full[:, cols, rows] = packed.T
        if self._place is not None:
            S, full = self._spread(S), self._spread_gram(full)
        scale = np.concatenate([self.scaling.slope(q), self.state_scale])
        both = np.append(scale, 1.0)
        return Evaluation(end, S * (scale / self.state_scale[:, None]), full * np.outer(both, both))

    def jacobian(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scaled derivatives by ``[q, node]`` of every interval: of its weighted outputs ``(nint, K * ny, width)``, sample
        by sample, and of its end state ``(nint, ns, width)``."""
        q, nodes = self.split(X)
        function = jacobian_function(self.plant, self.function.selected, self.samples, self.substeps)
        rows, ends = Mapped(function, self.nint, threads())(nodes, self.data, self.theta(q))
        own = self.function.width
        scale = np.concatenate([self.scaling.slope(q), self.state_scale])
        found = []
        for item in (rows, ends):
            blocks = item.reshape(-1, self.nint, own).transpose(1, 0, 2)
            found.append((blocks if self._place is None else self._spread(blocks)) * scale)
        return found[0], found[1] / self.state_scale[:, None]

    def _columns(self) -> tuple[tuple[str, ...], np.ndarray | None]:
        """Names that the interval function differentiates by, and where its columns go in every run.

        ``place`` is ``(runs, columns)``, the index among the free parameters or -1; None where both are the same.
        """
        columns = differentiated(self.free)
        if columns == self.free:
            return self.free, None
        shared = [name for name in self.free if of_key(name)[1] is None]
        local = columns[len(shared) :]
        place = np.full((len(self.runs), len(shared) + len(local)), -1)
        place[:, : len(shared)] = [self.free.index(name) for name in shared]
        for j, name in enumerate(self.free):
            quantity, of = of_key(name)
            for r, run in enumerate(self.runs):
                if run.name == of:
                    place[r, len(shared) + local.index(QUANTITIES[quantity])] = j
        return columns, place

    def _spread(self, S: np.ndarray) -> np.ndarray:
        """Rows ``(nint, rows, columns)`` in the columns of the interval function to rows in all free parameters."""
        wide = np.zeros((*S.shape[:2], self.nq + self.ns))
        for first, last, take, put in self._moves(0):
            wide[first:last][:, :, put] = S[first:last][:, :, take]
        return wide

    def _spread_gram(self, gram: np.ndarray) -> np.ndarray:
        """The same for Gram blocks, residual included."""
        width = self.nq + self.ns
        wide = np.zeros((self.nint, width + 1, width + 1))
        for first, last, take, put in self._moves(1):
            wide[first:last][:, put[:, None], put] = gram[first:last][:, take[:, None], take]
        return wide

    def _moves(self, more: int) -> Iterator[tuple[int, int, np.ndarray, np.ndarray]]:
        """Of every run: its intervals, the columns there and where they go; ``more`` columns follow the states."""
        for place, first, last in zip(self._place_of_runs, self.first[:-1], self.first[1:], strict=True):
            known = np.flatnonzero(place >= 0)
            take = np.concatenate([known, place.size + np.arange(self.ns + more)])
            put = np.concatenate([place[known], self.nq + np.arange(self.ns + more)])
            yield int(first), int(last), take, put

    @property
    def _place_of_runs(self) -> np.ndarray:
        return np.zeros((0, 0), dtype=int) if self._place is None else self._place

    @cached_property
    def _triangle(self) -> tuple[np.ndarray, np.ndarray]:
        width = self.function.width + 1
        cols, rows = np.tril_indices(width)
        return rows, cols

    def defects(self, end: np.ndarray, X: np.ndarray) -> np.ndarray:
        """``(nlinked, ns)`` end minus next node, in units of the state scale."""
        _, nodes = self.split(X)
        return ((end[:, self.linked] - nodes[:, self.linked + 1]) / self.state_scale[:, None]).T

    # --- weak priors: (index into X, centre, 1/sigma) ---

    @cached_property
    def priors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variables with a prior, its centre and inverse spread, all scaled."""
        index, centre, inverse = [], [], []
        start = self.scaling.to_q(np.array([parameter.start for parameter in self.declared]))
        for j, parameter in enumerate(self.declared):
            if parameter.prior is not None:
                spread = parameter.prior if parameter.positive else parameter.prior / parameter.scale
                index.append(j)
                centre.append(start[j])
                inverse.append(1.0 / spread)
        own = [(self.plant.explicit_count, 0.0, BRISTLE_SPREAD)]
        own += [
            (self.plant.explicit_count + 1 + k, state.initial, state.spread)
            for k, state in enumerate(self.plant.effect_states)
        ]
        clocks = [self.plant.explicit_count + 1 + k for k, state in enumerate(self.plant.effect_states) if state.clock]
        for first, since in zip(self.stretches, self.since, strict=True):
            for position, initial, spread in own:
                scale = self.state_scale[position]
                index.append(self.nq + self.ns * int(first) + position)
                centre.append((initial + since * (position in clocks)) / scale)
                inverse.append(scale / spread)
        return np.array(index, dtype=int), np.array(centre), np.array(inverse)

    def prior_residual(self, X: np.ndarray) -> np.ndarray:
        """Residuals of the priors."""
        index, centre, inverse = self.priors
        return (X[index] - centre) * inverse

    # --- inequalities among the parameters ---

    @property
    def ncon(self) -> int:
        """Number of these inequalities."""
        return int(_constraint_function(self.plant).size1_out(0))

    def constraints(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values ``(nc,)`` (>= 0 wanted, divided by their typical size) and Jacobian ``(nc, nq)`` in ``q``."""
        value, slope = self._constraints(q)
        size = self._constraint_size
        return value / size, slope / size[:, None]

    def _constraints(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values = self.values | dict(zip(self.free, self.scaling.to_values(q), strict=True))
        value, by_theta = self._map_constraints(self._column(self.runs[0], values, self.plant))
        slope = np.zeros((value.shape[0], self.nq))
        slope[:, self._shared] = by_theta[:, self._index]
        return value[:, 0], slope * self.scaling.slope(q)

    @cached_property
    def _constraint_size(self) -> np.ndarray:
        start = np.array([parameter.start for parameter in self.declared])
        _, slope = self._constraints(self.scaling.to_q(start))
        return np.asarray(np.maximum(np.abs(slope).max(axis=1, initial=0.0), 1e-12))

    def set_smoothing(self, smoothing: Smoothing) -> None:
        """Widths used from now on (numbers, no new code is compiled)."""
        self.smoothing = smoothing


def _made_again(*made: Any) -> Shooting:
    """A problem from the arguments of its class, and two things that are set afterwards."""
    *arguments, smoothing, relaxation = made
    problem = Shooting(*arguments)
    problem.set_smoothing(smoothing)
    problem.relaxation = relaxation
    return problem
