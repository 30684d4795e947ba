"""How far the number of each parameter can be trusted, and what recording would make it better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.comparison.comparison import Spread
from pneuid.effect import Parameter
from pneuid.estimation.own import Own
from pneuid.model import Estimate, Model

NORMAL_95 = 1.96
"""Half width in standard errors of the interval that holds 95 % of a normal distribution."""

STRONG = 0.95
"""Correlation from which on data determine a combination of two parameters rather than each."""

WELL = "well determined"


@dataclass(frozen=True)
class Trust:
    """One parameter's trust.

    symbol : as in formulas; low, high : 95 % interval in the estimate's unit (SI), None where there is no standard error;
    record : the recording that would determine it, empty where it is well determined or no fit has judged it.
    """

    estimate: Estimate
    symbol: str
    low: float | None
    high: float | None
    record: str


def trust(model: Model) -> tuple[Trust, ...]:
    """Trust in every parameter of ``model``, in its order.

    The interval is symmetric on the scale on which the parameter is searched, so that of a positive one is
    ``value exp(+-1.96 std/value)``; it ends at the physical bounds. A parameter on its bound has none.
    """
    plant = model.plant
    declared = {item.name: item for item in plant.parameters}
    words = {effect.name: effect.experiment for effect in plant.effects}
    found = []
    for item in model.parameters:
        own = declared[item.name] if item.run is None else _of_run(model, item.name, item.run)
        low, high = _interval(item, own.positive)
        known = item.verdict == WELL or item.std is None
        record = "" if known else own.experiment or words.get(item.effect or "", "")
        found.append(Trust(item, own.symbol, low, high, record))
    return tuple(found)


def _of_run(model: Model, quantity: str, run: str) -> Parameter:
    """Declaration of a quantity that one run has for itself."""
    rig = model.rig
    return Own(run, rig.mass, rig.supply, (quantity,)).parameters()[0]


def _interval(item: Estimate, positive: bool) -> tuple[float | None, float | None]:
    if item.std is None or not item.std > 0.0:
        return None, None
    if positive and item.value > 0.0:
        spread = float(np.exp(min(NORMAL_95 * item.std / item.value, 50.0)))
        low, high = item.value / spread, item.value * spread
    else:
        low, high = item.value - NORMAL_95 * item.std, item.value + NORMAL_95 * item.std
    return max(low, item.lower), min(high, item.upper)


@dataclass(frozen=True)
class Pair:
    """Two parameters and the correlation of their errors."""

    first: str
    second: str
    correlation: float


def strong_pairs(spread: Spread, least: float = STRONG) -> tuple[Pair, ...]:
    """Pairs with ``|r| > least``, strongest first."""
    rows, columns = np.triu_indices(len(spread.names), 1)
    found = [
        Pair(spread.names[i], spread.names[j], float(spread.correlation[i, j]))
        for i, j in zip(rows, columns, strict=True)
        if abs(spread.correlation[i, j]) > least
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair.correlation)))


def recordings_wanted(found: Sequence[Trust]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Each recording that would help, with the parameters (``name``, ``name in RUN``) it is for; most parameters first."""
    wanted: dict[str, list[str]] = {}
    for item in found:
        if item.record:
            name = item.estimate.name if item.estimate.run is None else f"{item.estimate.name} in {item.estimate.run}"
            wanted.setdefault(item.record, []).append(name)
    ordered = sorted(wanted.items(), key=lambda entry: -len(entry[1]))
    return tuple((record, tuple(names)) for record, names in ordered)
