"""The multiple-shooting problem with its intervals chained to long windows: a path that is continuous by construction.

Where a break-away makes the step from the relaxed nodes to hard continuity too long, the solver can walk along paths that
are continuous already: every window is simulated from its first node, and what varies are the parameters and those few
first nodes. With one window a run there is nothing left to close; a cut where a slip happens at the wrong time lets the
parameters move until it happens at the right one.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pneuid.cores import threads
from pneuid.estimation.shooting import Evaluation, Shooting
from pneuid.mapped import Ends


@dataclass(frozen=True)
class Walked:
    """A simulated path: state at the start of every interval ``(ns, base.nint)`` and at every window's end ``(ns, nint)``, SI;
    data cost of every interval ``(base.nint,)``."""

    path: np.ndarray
    end: np.ndarray
    costs: np.ndarray


class Chained(Shooting):
    """``base`` with its intervals chained; a new window starts with every stretch and after every interval of ``cuts``.

    Same parameters, data and interval function; ``nint`` and the nodes count windows. Nothing links the windows.
    """

    def __init__(self, base: Shooting, cuts: Sequence[int] = ()) -> None:
        self.__dict__.update(vars(copy(base)))
        self.__dict__.pop("priors", None)  # belongs to the nodes of the short intervals
        self.base = base
        run_ends = base.first[1:]
        self.starts = np.union1d(base.stretches, np.asarray(cuts, dtype=int) + 1)
        self.starts = self.starts[self.starts < base.nint]
        self.stretches = np.searchsorted(self.starts, base.stretches)
        self.lengths = np.diff(np.append(self.starts, base.nint))
        self.nint = int(self.starts.size)
        self.first = np.concatenate([[0], np.searchsorted(self.starts, run_ends)]).astype(int)
        self.size = self.nq + self.ns * self.nint
        self.linked = np.zeros(0, dtype=int)
        self._key: bytes | None = None

    def from_base(self, X: np.ndarray) -> np.ndarray:
        """Variables of this problem from those of ``base``."""
        q, nodes = self.base.split(X)
        return self.join(q, nodes[:, self.starts])

    def to_base(self, X: np.ndarray) -> np.ndarray:
        """Variables of ``base``, with nodes on the simulated path."""
        return self.base.join(X[: self.nq], self.walked(X).path)

    def evaluate_values(self, X: np.ndarray) -> tuple[np.ndarray, float]:
        """Physical end states ``(ns, nint)`` and the data cost ``sum r^2 / 2``."""
        walked = self.walked(X)
        return walked.end, float(np.sum(walked.costs))

    def interval_costs(self, X: np.ndarray) -> np.ndarray:
        """The data cost of every interval of ``base``, ``(base.nint,)``, along the windows' paths."""
        return self.walked(X).costs

    def evaluate(self, X: np.ndarray) -> Evaluation:
        """End states, sensitivities and Gram blocks of the windows, by the chain rule from those of the intervals."""
        return self.linked_up(self.base.evaluate(self.to_base(X)), self.walked(X).end)

    def linked_up(self, parts: Evaluation, end: np.ndarray) -> Evaluation:
        """What the intervals' ``parts`` say of the windows, which end at the states ``end`` ``(ns, nint)``."""
        nq, ns, width = self.nq, self.ns, self.nq + self.ns
        # derivative of an interval's first state by [q, window's first state], and of the windows' ends
        state = np.zeros((self.base.nint, ns, width))
        window = np.tile(np.eye(ns, width, nq), (self.nint, 1, 1))
        across, shared = parts.sensitivity[:, :, nq:], parts.sensitivity[:, :, :nq]
        for going, at in self._in_step:
            state[at] = window[going]
            window[going] = across[at] @ window[going]
            window[going, :, :nq] += shared[at]
        # the Gram block by [q, window's first state, 1]: that by [q, interval's first state, 1], the middle of which moves so
        half = parts.gram.copy()
        half[:, :, nq:width] = 0.0
        half[:, :, :width] += parts.gram[:, :, nq:width] @ state
        chained = half.copy()
        chained[:, nq:width] = 0.0
        chained[:, :width] += state.transpose(0, 2, 1) @ half[:, nq:width]
        return Evaluation(end, window, np.add.reduceat(chained, self.starts, axis=0))

    @cached_property
    def _in_step(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The windows that have a first interval, and it; those that have a second one, and it; and so on."""
        steps = [np.flatnonzero(self.lengths > k) for k in range(int(self.lengths.max()))]
        return [(going, self.starts[going] + k) for k, going in enumerate(steps)]

    def walked(self, X: np.ndarray) -> Walked:
        """The path at ``X``, simulated once for all who ask."""
        key = X.tobytes()
        if key != self._key:
            self._key, self._walked = key, self._walk(X)
        return self._walked

    def _walk(self, X: np.ndarray) -> Walked:
        q, start = self.split(X)
        ends, squares = self._in_a_row(start, self.data, self.base.theta(q))
        path = np.roll(ends[:, 0].T, 1, axis=1)
        path[:, self.starts] = start
        return Walked(path, ends[self.starts + self.lengths - 1, 0].T, 0.5 * squares[:, 0, 0])

    @cached_property
    def _in_a_row(self) -> Ends:
        return Ends(self.function.values, self.lengths, threads())
