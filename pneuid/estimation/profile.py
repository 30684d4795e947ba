"""Profile likelihood: how the best cost rises when one parameter is pinned away from its estimate.

The standard error is a parabola's; the profile is the cost itself, so it shows what a parabola hides: an interval longer
to one side, or open because a bound or another parameter takes over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from pneuid.errors import UserError
from pneuid.estimation.fit import Fit
from pneuid.estimation.shooting import Shooting
from pneuid.estimation.solver import Monitor
from pneuid.estimation.stages import MISFIT, polished
from pneuid.estimation.task import values_at
from pneuid.formats.rig_toml import nearest

LEVEL = float(chi2.ppf(0.95, 1))
"""Rise of the sum of squares at the ends of a 95 % interval of one parameter."""

STEP = 0.8
"""Distance of the pinned values in standard errors."""

MOST_STEPS = 6
"""Steps to one side after which the interval counts as open there."""


@dataclass(frozen=True)
class Profile:
    """Cost along one parameter.

    values : pinned values (k,), increasing, SI, the estimate among them; rise : of the sum of squared weighted residuals
    over its least (k,), in units of the noise; low, high : ends of the 95 % interval, None where it is open.
    """

    name: str
    unit: str
    estimate: float
    std: float
    values: np.ndarray
    rise: np.ndarray
    low: float | None
    high: float | None

    def to_dict(self) -> dict[str, Any]:
        """For a JSON file, SI."""
        return {**vars(self), "values": self.values.tolist(), "rise": self.rise.tolist()}


def profile(found: Fit, name: str, monitor: Monitor | None = None) -> Profile:
    """Profile likelihood of the parameter ``name`` around an exact fit; all others are fitted again at every value.

    Venzon, Moolgavkar, Applied Statistics 37 (1988) 87, eq. (2). Raises ``UserError`` for a relaxed fit, a name that
    is not fitted, or a parameter on its bound.
    """
    problem, exact, spread = found.exact_problem, found.exact, found.spread
    if problem is None or exact is None or spread is None:
        raise UserError(f"--profile {name}: the fit is relaxed, so its cost says nothing about single parameters")
    if name not in problem.free:
        near = nearest(name, list(problem.free)) or ";"
        raise UserError(f"--profile {name}: is not fitted{near} there are {', '.join(problem.free)}")
    j = problem.free.index(name)
    if found.verdicts[name] == "on its bound":
        raise UserError(f"--profile {name}: it lies on its bound, so there is nothing to either side to look at")
    slope = problem.scaling.slope(exact.X[: problem.nq])[j]
    step = STEP * float(spread.std[j] / slope)
    noise = max(found.cost_per_sample, 1.0) if found.cost_per_sample > MISFIT else 1.0
    points = {0.0: 0.0}
    for side in (-1.0, 1.0):
        X, rise = exact.X, 0.0
        for k in range(1, MOST_STEPS + 1):
            q = float(exact.X[j] + side * k * step)
            if not problem.scaling.lower[j] < q < problem.scaling.upper[j]:
                break
            X, cost = _pinned(problem, X, j, q, 1.02 * exact.cost + 20.0 * LEVEL, monitor)
            rise = 2.0 * (cost - exact.cost) / noise
            points[side * k * step] = rise
            if rise > 1.3 * LEVEL:
                break
    offsets = np.array(sorted(points))
    heights = np.array([points[offset] for offset in offsets])
    scale = [_value(problem, exact.X, j, offset) for offset in offsets]
    ends = [_crossing(offsets, heights, side) for side in (-1.0, 1.0)]
    low, high = (None if end is None else _value(problem, exact.X, j, end) for end in ends)
    return Profile(
        name, problem.declared[j].unit, _value(problem, exact.X, j, 0.0), float(spread.std[j]), np.array(scale),
        heights, low, high,
    )  # fmt: skip


def _pinned(
    problem: Shooting, X: np.ndarray, j: int, q: float, limit: float, monitor: Monitor | None
) -> tuple[np.ndarray, float]:
    """Best point and cost with the j-th parameter held at ``q``, started from ``X``."""
    at = X.copy()
    at[j] = q
    free = [name for name in problem.free if name != problem.free[j]]
    values = problem.values | values_at(problem, at)
    smaller = Shooting(problem.plant, problem.runs, free, values, problem.ranges, problem.substeps, problem.samples)
    smaller.set_smoothing(problem.smoothing)
    found = polished(smaller, np.delete(at, j), limit, monitor)
    index, centre, inverse = problem.priors
    own = index == j
    prior = 0.5 * float(np.sum(((q - centre[own]) * inverse[own]) ** 2))
    return np.insert(found.X, j, q), found.cost + prior


def _value(problem: Shooting, X: np.ndarray, j: int, offset: float) -> float:
    """Value (SI) of the j-th parameter at an offset of its search variable from ``X``."""
    q = X[: problem.nq].copy()
    q[j] += offset
    return float(problem.scaling.to_values(q)[j])


def _crossing(offsets: np.ndarray, rise: np.ndarray, side: float) -> float | None:
    """Offset to one side at which the rise reaches ``LEVEL``, None where it does not."""
    chosen = side * offsets >= 0
    order = np.argsort(np.abs(offsets[chosen]))
    # the root of the rise is nearly straight, so linear interpolation is enough
    distance, root = np.abs(offsets[chosen])[order], np.sqrt(np.maximum(rise[chosen][order], 0.0))
    above = np.flatnonzero(root >= np.sqrt(LEVEL))
    if above.size == 0:
        return None
    k = int(above[0])
    share = (np.sqrt(LEVEL) - root[k - 1]) / max(root[k] - root[k - 1], 1e-12)
    return float(side * (distance[k - 1] + share * (distance[k] - distance[k - 1])))
