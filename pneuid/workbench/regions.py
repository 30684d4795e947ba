"""The samples that a region's words mean: ``v < 0 and p2 > 400 kPa gauge`` as a mask.

The words come from metrics.json as well as from a comparison just made, so they are read rather than passed around.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

_NUMBER = r"[+-]?\d+(?:\.\d*)?(?:e[+-]?\d+)?"
_ONE_SIDED = re.compile(rf"(?P<name>\|?\w+(?: - {_NUMBER} V)?\|?) (?P<sign>[<>]) (?P<level>{_NUMBER})(?: .*)?")
_BAND = re.compile(rf"(?P<name>\|?\w+\|?) = (?P<low>{_NUMBER}) to (?P<high>{_NUMBER})(?: .*)?")


def region_mask(text: str, run: str, features: Mapping[str, np.ndarray], null: float = 0.0) -> np.ndarray:
    """Samples (N,) of ``run`` inside the region that ``text`` names.

    features : signals (N,) in display units, pressures gauge; null : valve null in V, for ``|u - null|``. A condition on a
    signal that the run does not have is met by no sample.
    """
    size = next(iter(features.values())).size
    inside = np.ones(size, dtype=bool)
    for condition in text.split(" and "):
        if condition.startswith("run "):
            inside &= condition == f"run {run}"
            continue
        inside &= _condition(condition, features, null, size)
    return inside


def _condition(condition: str, features: Mapping[str, np.ndarray], null: float, size: int) -> np.ndarray:
    one, band = _ONE_SIDED.fullmatch(condition), _BAND.fullmatch(condition)
    found = one or band
    name = found["name"] if found else ""
    bare = name.strip("|").split(" - ")[0]
    if found is None or bare not in features:
        return np.zeros(size, dtype=bool)
    values = features[bare]
    if name.startswith("|"):
        values = np.abs(values - null) if bare == "u" else np.abs(values)
    if one:
        level = float(one["level"])
        return np.asarray(values > level if one["sign"] == ">" else values < level)
    return np.asarray((values > float(found["low"])) & (values < float(found["high"])))


def stretches(t: np.ndarray, inside: np.ndarray, least: float, most: int = 80) -> list[tuple[float, float]]:
    """The stretches (s) of consecutive samples inside, neighbours closer than ``least`` joined, the longest ``most``."""
    if not inside.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    first, last = t[edges[0::2]], t[np.minimum(edges[1::2], t.size - 1)]
    joined: list[tuple[float, float]] = []
    for a, b in zip(first, last, strict=True):
        if joined and a - joined[-1][1] < least:
            joined[-1] = (joined[-1][0], float(b))
        else:
            joined.append((float(a), float(b)))
    longest = sorted(joined, key=lambda pair: pair[0] - pair[1])[:most]
    return sorted(longest)
