"""Sanity check: one channel delayed against the others, told from the chamber balances of a valve-driven rig.

A spool or a line that lags delays the effect of u: that is physics, and u may be shifted back freely. Pressures that answer
before the command, or that compression shows in before the piston has moved, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from pneuid.plausibility.balance import MOTION, Rates, Signals, Windows, balance, misfit, rates, windows
from pneuid.plausibility.finding import Finding
from pneuid.plausibility.servo import pressure_reference, unit_of_pressure, upright
from pneuid.recording import Recording
from pneuid.rig import Rig

_REACH = 0.03
"""Largest delay looked for [s]."""
_COARSE, _FINE = 6e-3, 2e-3
_LATEST_SPOOL = -0.036
"""A lag of the valve up to this is physics [s]."""
_LESS = 0.6
"""Share of the misfit that a shift may leave. A dead zone or a throttled exhaust imitates a skew in one chamber to 0.65."""
_LEAST = 4e-3
"""Smallest delay reported [s]; a smaller one is like a line or a filter."""
_SAMPLES, _WINDOWS = 4000, 500
"""Samples and windows looked at, from the start of the longest run."""


def channel_skew(rig: Rig, runs: Sequence[Recording]) -> Finding | None:
    """x, p1, p2 or u recorded later than the others, in ms, by the shift that fits the chamber balances best."""
    if upright(rig, runs) is None or unit_of_pressure(rig, runs) or pressure_reference(rig, runs):
        return None  # the balances are off for another reason, which comes first
    run = max(runs, key=lambda one: one.n)
    cut = slice(0, _SAMPLES)
    whole = Signals(*(getattr(Signals.of(run), name)[cut] for name in ("t", "u", "x", "p1", "p2", "psup")))
    least = max(_LEAST, 2.0 / run.rate)
    if whole.t[-1] < 10 * _REACH or least > 0.5 * _REACH:
        return None
    flows = rates(rig, whole)
    best = [_best(rig, whole, chamber, flows[chamber - 1]) for chamber in (1, 2)]
    if any(one is None for one in best):
        return None
    (u1, x1, gain1), (u2, x2, gain2) = (one for one in best if one is not None)
    if max(gain1, gain2) < _LESS and abs(x1 - x2) <= _COARSE and abs(x1 + x2) > 2 * least:
        late = 0.5 * (x1 + x2)
        return _finding("x", late) if late > 0 else _finding("p1, p2", -late)
    if max(gain1, gain2) < _LESS and max(abs(x1), abs(x2)) < least and min(u1, u2) > least:
        return _finding("u", 0.5 * (u1 + u2))
    for signal, shift, other, gain in (("p1", x1, x2, gain1), ("p2", x2, x1, gain2)):
        if gain < _LESS and shift < -least and abs(other) < least:
            return _finding(signal, -shift)
    return None


def _finding(signal: str, late: float) -> Finding:
    verb = "come" if "," in signal else "comes"
    return Finding(
        "channel_skew", signal,
        f"the chamber balances fit best when {signal} {verb} {1e3 * late:.0f} ms earlier than recorded",
        f"{signal} {'are' if ',' in signal else 'is'} delayed by about {1e3 * late:.0f} ms against the other channels",
        "look for a filter, a slow sensor or a second clock in that channel; record all channels with one converter",
    )  # fmt: skip


def _best(rig: Rig, run: Signals, chamber: int, own: Rates) -> tuple[float, float, float] | None:
    """Shifts of u and x [s] that fit one chamber best, and the misfit left over that without a slip."""
    first, last = windows(run.t, _WINDOWS)
    inside = (run.t[first] > 1.5 * _REACH) & (run.t[last] < run.t[-1] - 1.5 * _REACH)
    where = first[inside], last[inside]

    # the columns of flow depend on u alone, those of motion and storage on x alone
    @cache
    def with_u(shift: float) -> Windows:
        return balance(rig, replace(run, u=np.interp(run.t + shift, run.t, run.u)), chamber, own, where)

    @cache
    def with_x(shift: float) -> Windows:
        return balance(rig, replace(run, x=np.interp(run.t + shift, run.t, run.x)), chamber, own, where)

    @cache
    def left(of_u: float, of_x: float) -> float:
        columns = with_u(of_u).columns.copy()
        columns[:, MOTION] = with_x(of_x).columns[:, MOTION]
        return misfit(Windows(with_x(of_x).stored, columns))

    reach = (np.arange(-5, 6) * _COARSE).tolist()
    of_u = (_LATEST_SPOOL, *reach)
    base = min(left(u, 0.0) for u in of_u if u <= 1e-9)
    around = min(((u, x) for u in of_u for x in reach), key=lambda at: left(*at))
    near = (-2 * _FINE, -_FINE, 0.0, _FINE, 2 * _FINE)
    best = min(
        ((round(around[0] + u, 6), round(around[1] + x, 6)) for u in near for x in near), key=lambda at: left(*at)
    )
    return None if not np.isfinite(base) or base <= 0.0 else (*best, left(*best) / base)
