"""Pressure laws by regression over conditions (eq. 13) and whether each is needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

from pneuid.estimation.bench.steady import Condition, Value

TARGETS = {"Fc": ("k1", "k2"), "Fs": ("k3", "k4"), "vs": ("k5", "k6"), "sigma2": ("k7", "k8")}
"""Coefficient -> names of its slopes with ps and dp, in the order of the study."""

SIGNIFICANT = 0.01
"""Probability by chance below which slopes count as needed."""

ALONG = 0.05
"""Least singular value of the normalised regressors: below it two of them went along with each other."""


@dataclass(frozen=True)
class Law:
    """``target = base + k_ps ps + k_dp dp`` with ps = p1, dp = p1 - p2 gauge (eq. 13, 14), SI.

    dp is None where it went along with ps in these data, so that only their sum is seen; p_slopes : probability of the
    slopes by chance (F-test against a constant); conditions : how many it rests on; rms : of the residual, in the
    target's unit.
    """

    target: str
    base: Value
    ps: Value | None
    dp: Value | None
    p_slopes: float | None
    conditions: int
    rms: float

    def at(self, ps: np.ndarray | float, dp: np.ndarray | float) -> np.ndarray | float:
        """The law at gauge pressures, Pa."""
        first = 0.0 if self.ps is None else self.ps.value
        second = 0.0 if self.dp is None else self.dp.value
        return self.base.value + first * ps + second * dp

    @property
    def needed(self) -> bool | None:
        """Whether the data ask for the slopes; None where that cannot be tested."""
        return None if self.p_slopes is None else self.p_slopes < SIGNIFICANT


def pressure_laws(conditions: Sequence[Condition], patm: float) -> dict[str, Law]:
    """The laws of every coefficient that at least one condition shows; weights 1/std^2, ``patm`` in Pa."""
    laws = {}
    for target in TARGETS:
        seen = [(item, getattr(item, target)) for item in conditions if getattr(item, target) is not None]
        if seen:
            laws[target] = _law(target, [item for item, _ in seen], [value for _, value in seen], patm)
    return laws


def _law(target: str, conditions: Sequence[Condition], values: Sequence[Value], patm: float) -> Law:
    ps = np.array([item.p1 - patm for item in conditions])
    dp = np.array([item.p1 - item.p2 for item in conditions])
    y, std = np.array([item.value for item in values]), np.array([item.std for item in values])
    # an error far below the others' is luck of few points, not knowledge
    std = np.maximum(std, max(0.3 * float(np.median(std)), 1e-9 * float(np.max(np.abs(y)))))
    design = [np.ones(y.size)]
    for column in (ps, dp):
        trial = np.column_stack([*design, column])
        lengths = np.maximum(np.linalg.norm(trial, axis=0), 1e-30)
        if y.size > trial.shape[1] and np.linalg.svd(trial / lengths, compute_uv=False)[-1] > ALONG:
            design.append(column)
    A = np.column_stack(design)
    fitted, covariance, chi2 = _weighted(A, y, std)
    freedom = y.size - A.shape[1]
    errors = np.sqrt(np.diag(covariance) * (max(chi2 / freedom, 1.0) if freedom > 0 else 1.0))
    slopes = {}
    for k, column in enumerate(design[1:], start=1):
        slopes["ps" if column is ps else "dp"] = Value(float(fitted[k]), float(errors[k]))
    by_chance = None
    if slopes and freedom > 0:
        _, _, constant = _weighted(A[:, :1], y, std)
        ratio = (constant - chi2) / len(slopes) / max(chi2 / freedom, 1e-30)
        by_chance = float(f_distribution.sf(ratio, len(slopes), freedom))
    rms = float(np.sqrt(np.mean((y - A @ fitted) ** 2)))
    base = Value(float(fitted[0]), float(errors[0]))
    return Law(target, base, slopes.get("ps"), slopes.get("dp"), by_chance, int(y.size), rms)


def _weighted(A: np.ndarray, y: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Weighted least squares: values, covariance for unit chi-square, chi-square."""
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-30)
    W = A / scale / std[:, None]
    values, *_ = np.linalg.lstsq(W, y / std, rcond=None)
    chi2 = float(np.sum((y / std - W @ values) ** 2))
    return values / scale, np.linalg.pinv(W.T @ W) / np.outer(scale, scale), chi2


def chance_of(value: Value, freedom: int) -> float:
    """Probability that a slope as large as ``value`` comes from none (two-sided t-test)."""
    return float(2.0 * t_distribution.sf(abs(value.value) / max(value.std, 1e-300), max(freedom, 1)))
