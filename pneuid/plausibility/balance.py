"""The chamber balances of a valve-driven rig in integral form, as a straight line through the recorded data.

Over a window of about 30 ms the base model says (``mdot`` by ISO 6358-1 from rig.toml, gas at ambient temperature)

    V * dp / 1.2 = c_flow * R*T * int(mdot dt)  -  c_motion * p * dV  +  leaks and an offset of the spool

with ``c_flow`` near 1 (the true conductance over the data sheet's) and ``c_motion = n / 1.2`` between 0.83 and 1.17. Nothing
is differentiated, so noise and uneven time do little. The signs of the two coefficients tell what sits the wrong way
round, their size and the misfit tell units and references. Leaks, gravity, friction, payload, a dead zone or a lag of the spool
change the size of the coefficients, never their signs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from pneuid.physics.gas import R_AIR
from pneuid.physics.valve import mass_flow
from pneuid.recording import Recording
from pneuid.rig import Rig

FloatArray = NDArray[np.float64]

WINDOW = 0.03
"""Length of a window [s]: long against the spool and the sensors' noise, short against the motion."""
FEWEST_WINDOWS = 40
"""With fewer windows nothing is concluded."""
MOST_WINDOWS = 4000
"""Windows kept of one run; more tell nothing new."""
_EXPONENT = 1.2
_LAMINAR = 1e-3
FLOW, MOTION = 0, 1
"""Columns of ``Windows.columns``."""


@dataclass(frozen=True)
class Signals:
    """The recorded arrays (N,) of one run that the balances use, SI, absolute pressures, possibly changed on trial."""

    t: FloatArray
    u: FloatArray
    x: FloatArray
    p1: FloatArray
    p2: FloatArray
    psup: FloatArray

    @classmethod
    def of(cls, run: Recording) -> Signals:
        """The signals as recorded."""
        return cls(run.t, *(run.signals[name] for name in ("u", "x", "p1", "p2", "psup")))


@dataclass(frozen=True)
class Windows:
    """The balance of one chamber over W windows: ``stored`` (W,) [J] against ``columns`` (W, 5) [J]."""

    stored: FloatArray
    columns: FloatArray


@dataclass(frozen=True)
class Line:
    """A straight-line fit: coefficients of flow and motion, their partial correlations, and the share left over."""

    flow: float
    motion: float
    flow_correlation: float
    motion_correlation: float
    misfit: float


def windows(t: FloatArray, most: int = MOST_WINDOWS) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last sample of each window (W,), at least two steps long, not many more than ``most`` of them."""
    last = np.searchsorted(t, t + WINDOW)
    last = np.maximum(last, np.arange(t.size) + 2)
    first = np.flatnonzero(last < t.size)
    first = first[:: max(1, first.size // most)]
    return first, last[first]


@dataclass(frozen=True)
class Rates:
    """Enthalpy flows (N,) [W] into one chamber that do not depend on the command: through the fully open edges to the
    supply and to the surroundings (negative), and through the piston from the other chamber at the same conductance."""

    filling: FloatArray
    emptying: FloatArray
    across: FloatArray


def rates(rig: Rig, run: Signals) -> tuple[Rates, Rates]:
    """The flows of chamber 1 and chamber 2."""
    ambient = np.full(run.t.size, rig.patm)

    def flow(upstream: FloatArray, downstream: FloatArray) -> FloatArray:
        rate = mass_flow(
            ca.DM(upstream), ca.DM(downstream), rig.conductance, rig.critical_ratio, rig.temperature, _LAMINAR
        )
        return R_AIR * rig.temperature * np.asarray(rate).ravel()

    across = flow(run.p2, run.p1)
    return (
        Rates(flow(run.psup, run.p1), flow(run.p1, ambient), across),
        Rates(flow(run.psup, run.p2), flow(run.p2, ambient), -across),
    )


def balance(
    rig: Rig, run: Signals, chamber: int, own: Rates, where: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> Windows:
    """The windows ``where`` (first and last samples) of ``chamber`` 1 or 2, whose flows are ``own``."""
    first, last = where
    step = np.diff(run.t)

    def over(rate: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step)])
        return np.asarray(total[last] - total[first])

    sign = 1.0 if chamber == 1 else -1.0
    p, area, dead = (run.p1, rig.A1, rig.V01) if chamber == 1 else (run.p2, rig.A2, rig.V02)
    room = dead + area * (run.x if chamber == 1 else rig.stroke - run.x)
    opening = sign * np.clip((run.u - rig.null) / rig.full_scale, -1.0, 1.0)
    opened = np.where(opening > 0.0, own.filling, own.emptying)
    columns = (
        over(opening * opened),
        -sign * area * 0.5 * (p[last] + p[first]) * (run.x[last] - run.x[first]),
        over(opened),  # an offset of the spool
        over(own.across),
        over(-own.emptying),  # leakage to the surroundings
    )
    stored = 0.5 * (room[last] + room[first]) * (p[last] - p[first]) / _EXPONENT
    return Windows(stored, np.column_stack(columns))


def chambers(rig: Rig, run: Signals) -> tuple[Windows, Windows]:
    """The windows of chamber 1 and chamber 2."""
    where = windows(run.t)
    first, second = rates(rig, run)
    return balance(rig, run, 1, first, where), balance(rig, run, 2, second, where)


def pooled(rig: Rig, runs: Sequence[Signals]) -> tuple[Windows, Windows]:
    """The windows of all runs together, per chamber."""
    every = [chambers(rig, run) for run in runs]
    return _joined([pair[0] for pair in every]), _joined([pair[1] for pair in every])


def _joined(parts: Sequence[Windows]) -> Windows:
    return Windows(np.concatenate([one.stored for one in parts]), np.vstack([one.columns for one in parts]))


def fit(found: Windows) -> Line | None:
    """The least-squares line through the windows; None where they are too few or show no flow, motion or pressure change."""
    y, columns = found.stored, found.columns
    scale = np.sqrt(np.sum(columns**2, axis=0))
    used = scale > 0.0
    if y.size < FEWEST_WINDOWS or not (used[FLOW] and used[MOTION] and np.any(y)):
        return None
    columns = columns[:, used] / scale[used]
    coefficients = np.linalg.lstsq(columns, y, rcond=None)[0]
    rest = y - columns @ coefficients
    flow, motion = (coefficients[:2] / scale[:2]).tolist()
    flow_r, motion_r = (_partial(columns, y, number) for number in (FLOW, MOTION))
    return Line(flow, motion, flow_r, motion_r, float(np.sum(rest**2) / np.sum(y**2)))


def misfit(found: Windows) -> float:
    """Share of the stored energy that the best line leaves over; ``inf`` where the windows are too few."""
    scale = np.sqrt(np.sum(found.columns**2, axis=0))
    columns = found.columns / np.where(scale > 0.0, scale, 1.0)
    total = float(found.stored @ found.stored)
    if found.stored.size < FEWEST_WINDOWS or total == 0.0:
        return float("inf")
    # a ridge at rounding keeps columns that are zero or alike solvable
    normal = columns.T @ columns + 1e-12 * np.eye(columns.shape[1])
    right = columns.T @ found.stored
    return 1.0 - float(right @ np.linalg.solve(normal, right)) / total


def _partial(columns: FloatArray, y: FloatArray, number: int) -> float:
    """Correlation of one column with ``y`` after the other columns are taken out of both."""
    others = np.delete(columns, number, axis=1)
    both = np.column_stack([columns[:, number], y])
    left = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    size = float(np.prod(np.sqrt(np.sum(left**2, axis=0))))
    return float(left[:, 0] @ left[:, 1]) / size if size > 0.0 else 0.0
