"""Where the error is: its energy split over regions a person can name.

A rule is one to three conditions on signals, such as ``v < 0 and p2 > 400 kPa gauge``. Of all rules on rounded
thresholds the one is taken whose share ``e`` of the squared error stands out most from its share ``s`` of the samples,
by the divergence ``e log(e/s) + (1-e) log((1-e)/(1-s))``: it is largest at the true region, neither inside nor around
it. A further condition must earn its place, and what one or two stretches of 200 ms carry alone is not reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.prediction.horizons import Prediction
from pneuid.plant import Plant
from pneuid.signals import PRESSURES, SIGNALS
from pneuid.units import to_display

LEAST_LIFT = 1.8
"""Share of error over share of samples below which the error counts as uniform."""

LEAST_SAMPLES, LEAST_SHARE = 0.02, 0.2
"""Smallest share of the samples, and of the signal's error, that makes a region worth naming."""

RULES_PER_SIGNAL, RULES = 2, 5
"""At most so many regions for one signal, and for all of them."""

SECOND_EARNS, THIRD_EARNS = 1.15, 1.3
"""Factor by which a second and a third condition must raise the divergence."""

SURE_LIFT, SURE = 1.3, 4.0
"""The lift must exceed the first by so many of its standard errors (jackknife over blocks): many rules are tried."""

LEAST_EVENTS = (3.0, 4.0, 8.0)
"""Blocks that must share the region's error (inverse sum of squared shares), for one, two and three conditions."""

BLOCK_SECONDS = 0.2
"""Errors within one block are one event: the length of a prediction window, s."""

NEAR_FLOOR = 1.2
"""Mean squared error over noise floor squared below which nothing but noise is left."""

MOST_SAMPLES = 20_000
"""Samples beyond this number are thinned evenly."""

WHEN_OR_WHICH = 0.8
"""Weight of rules on time or run: a physical condition that says nearly as much tells more."""


@dataclass(frozen=True)
class Region:
    """A region where the error of ``signal`` concentrates.

    share : share of that signal's squared error that falls in it; samples : its share of the predicted samples;
    region : the rule in display units, pressures gauge (and marked so).
    """

    signal: str
    share: float
    samples: float
    region: str

    @property
    def lift(self) -> float:
        """How many times the signal's mean squared error the region's is."""
        return self.share / self.samples


@dataclass(frozen=True)
class _Condition:
    """One condition: feature, side (-1 below, 1 above, 0 neither), words, and the cut it is (1) or is not (-1) in."""

    feature: str
    side: int
    text: str
    cut: int
    sign: int


@dataclass(frozen=True)
class _Catalogue:
    """All C conditions side by side: which go together ``(C, C)``, their weight, and the cut as ``a + b cut`` (C,)."""

    conditions: tuple[_Condition, ...]
    goes: np.ndarray
    weight: np.ndarray
    cut: np.ndarray
    a: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, conditions: Sequence[_Condition]) -> _Catalogue:
        """Conditions with what the search needs of them."""
        b = np.array([float(item.sign) for item in conditions])
        return cls(
            tuple(conditions),
            np.array([[_goes_with(one, other) for other in conditions] for one in conditions]),
            np.array([WHEN_OR_WHICH if item.feature in ("t", "run") else 1.0 for item in conditions]),
            np.array([item.cut for item in conditions]),
            (1.0 - b) / 2.0,
            b,
        )

    def totals(self, cuts: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Total weight (C,) of the samples that meet each condition; ``cuts`` (M, N), ``weight`` (N,)."""
        share = np.asarray(np.einsum("mn,n->m", cuts, weight), dtype=float)[self.cut]
        return np.asarray(self.a * float(weight.sum()) + self.b * share)

    def pair_totals(self, cuts: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Total weight ``(C, C)`` of the samples that meet both of two conditions."""
        # einsum: products this small take a threaded BLAS a thousand times longer on a busy machine
        share = self.b * np.asarray(np.einsum("mn,n->m", cuts, weight), dtype=float)[self.cut]
        joint = np.asarray(np.einsum("in,jn->ij", cuts * weight, cuts), dtype=float)[np.ix_(self.cut, self.cut)]
        mixed = np.outer(self.a, share)
        found = np.outer(self.a, self.a) * float(weight.sum()) + mixed + mixed.T + np.outer(self.b, self.b) * joint
        return np.asarray(found)


@dataclass(frozen=True)
class _Samples:
    """The usable samples of one signal: squared error (N,), cuts ``(M, N)`` as 0/1, block number (N,)."""

    energy: np.ndarray
    cuts: np.ndarray
    block: np.ndarray

    def inside(self, condition: _Condition) -> np.ndarray:
        """Whether each sample meets ``condition`` (N,)."""
        return np.asarray((self.cuts[condition.cut] > 0) == (condition.sign > 0))

    def part(self, chosen: np.ndarray) -> _Samples:
        """Some of the samples."""
        return _Samples(self.energy[chosen], self.cuts[:, chosen], self.block[chosen])


def find_regions(
    predictions: Sequence[Prediction], plant: Plant, noise_floor: Mapping[str, float] | None = None
) -> list[Region]:
    """Regions where the error of ``predictions`` concentrates, largest share first; none where it is uniform.

    noise_floor : rmse per signal that noise alone gives (SI); signals that reach it are passed over.
    """
    predictions = [item for item in predictions if item.index.size]
    if not predictions:
        return []
    thin = 1 + sum(item.index.size for item in predictions) // MOST_SAMPLES
    conditions, cuts = _conditions(predictions, plant, thin)
    if not conditions:
        return []
    block = _blocks(predictions, thin)
    known = _Catalogue.of(conditions)
    found: list[Region] = []
    for i, signal in enumerate(plant.outputs):
        error = np.concatenate([item.error[i, ::thin] for item in predictions])
        usable = np.isfinite(error)
        energy = error[usable] ** 2
        floor = (noise_floor or {}).get(signal, 0.0)
        if usable.sum() < 50 or not 0.0 < energy.sum() < np.inf or energy.mean() < NEAR_FLOOR * floor**2:
            continue
        samples = _Samples(energy / energy.sum(), cuts[:, usable], block[usable])
        found += _regions_of(signal, samples, known)
    return sorted(found, key=lambda item: -item.share)[:RULES]


# --- conditions ---


def _conditions(predictions: Sequence[Prediction], plant: Plant, thin: int) -> tuple[list[_Condition], np.ndarray]:
    """Every condition that splits the samples into two parts of at least the least share, and the cuts ``(M, N)``."""
    found: list[_Condition] = []
    cuts: list[np.ndarray] = []

    def useful(cut: np.ndarray) -> bool:
        return bool(LEAST_SAMPLES <= cut.mean() <= 1.0 - LEAST_SAMPLES)

    for name, y in _features(predictions, plant, thin).items():
        for level in _levels(name, y):
            if useful(y > level):
                shown = _shown(name, level, plant)
                found.append(_Condition(name, 1, shown.format(sign=">"), len(cuts), 1))
                found.append(_Condition(name, -1, shown.format(sign="<"), len(cuts), -1))
                cuts.append(y > level)
    runs = np.concatenate([np.full(item.index[::thin].size, k) for k, item in enumerate(predictions)])
    for k, item in enumerate(predictions):
        if useful(runs == k):
            found.append(_Condition("run", 0, f"run {item.run.name}", len(cuts), 1))
            cuts.append(runs == k)
    return found, np.array(cuts, dtype=np.float32)


def _features(predictions: Sequence[Prediction], plant: Plant, thin: int) -> dict[str, np.ndarray]:
    """Signals (N,) that a rule may speak of, SI, pressures gauge, ``|v|`` and ``|u|`` (from null) beside the signed."""
    parts: dict[str, list[np.ndarray]] = {}
    for item in predictions:
        run, at = item.run, item.index[::thin]
        own = {"x": run.motion.x, "v": run.input("v") if "v" in run.inputs else run.motion.v, "t": run.t}
        absolute = {name: run.recording.signals[name] for name in PRESSURES if name in run.recording.signals}
        if "u" in run.inputs:
            own["u"] = run.input("u") - plant.rig.null
        if "psup" in run.inputs:
            absolute["psup"] = run.input("psup")
        own |= {name: p - plant.rig.patm for name, p in absolute.items()}
        for name, y in own.items():
            parts.setdefault(name, []).append(y[at])
    found = {name: np.concatenate(y) for name, y in parts.items() if len(y) == len(predictions)}
    for name in ("v", "u"):
        if name in found:
            found[f"|{name}|"] = np.abs(found[name])
    return found


def _levels(name: str, y: np.ndarray) -> np.ndarray:
    """Rounded thresholds of a feature (SI)."""
    if name in ("v", "u"):
        top = float(np.percentile(np.abs(y), 99))
        outer = _rounded(top * np.array([0.2, 0.5])) if name == "v" else np.zeros(0)
        return np.unique(np.concatenate([-outer, [0.0], outer]))
    if name in ("|v|", "|u|"):
        return np.unique(_rounded(float(np.percentile(y, 99)) * np.array([0.02, 0.05, 0.2, 0.5])))
    low, high = np.percentile(y, [2, 98])
    if high - low < 1e-3 * max(abs(high), abs(low), 1e-12):
        return np.zeros(0)
    step = float(_rounded(np.array([(high - low) / 6]))[0])
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)


def _rounded(values: np.ndarray) -> np.ndarray:
    """The nearest of 1, 2, 5 times a power of ten, on a logarithmic scale."""
    positive = np.asarray(values)[np.asarray(values) > 0]
    decade = 10.0 ** np.floor(np.log10(positive))
    choices = np.array([1.0, 2.0, 5.0, 10.0])
    nearest = np.argmin(np.abs(np.log(choices[:, None]) - np.log(positive / decade)), axis=0)
    return np.asarray(choices[nearest] * decade)


def _shown(name: str, level: float, plant: Plant) -> str:
    """The condition's words with ``{sign}`` in place of < or >."""
    bare = name.strip("|")
    signal = SIGNALS[bare]
    value = f"{to_display(level, signal.unit, signal.display_unit):.6g}"
    if bare in PRESSURES:
        return f"{name} {{sign}} {value} {signal.display_unit} gauge"
    if name == "u":
        return f"u {{sign}} {plant.rig.null + level:.6g} V"
    if name == "|u|" and plant.rig.null != 0.0:
        return f"|u - {plant.rig.null:.6g} V| {{sign}} {value} V"
    if level == 0.0:
        return f"{name} {{sign}} 0"
    return f"{name} {{sign}} {value} {signal.display_unit}"


def _blocks(predictions: Sequence[Prediction], thin: int) -> np.ndarray:
    """Number (N,) of the block of 200 ms that a sample belongs to, no block spanning two runs."""
    parts, first = [], 0
    for item in predictions:
        numbers = np.floor(item.run.t[item.index[::thin]] / BLOCK_SECONDS).astype(int)
        parts.append(first + numbers - numbers.min())
        first = int(parts[-1].max()) + 1
    return np.concatenate(parts)


# --- search ---


def _regions_of(signal: str, samples: _Samples, known: _Catalogue) -> list[Region]:
    found: list[Region] = []
    left = np.ones(samples.energy.size, dtype=bool)
    for _ in range(RULES_PER_SIGNAL):
        kept = samples.part(left)
        if kept.energy.sum() < LEAST_SHARE:
            break
        for rule in _best_rules(kept, known):
            inside = np.all([samples.inside(item) for item in rule], axis=0)
            share, size = float(samples.energy[inside].sum()), float(inside.mean())
            # what the rule names beyond the region already named
            fresh = float(samples.energy[inside & left].sum())
            large = fresh >= max(LEAST_SHARE, 0.5 * share) and share >= LEAST_LIFT * size and size >= LEAST_SAMPLES
            if large and _convincing(kept, inside[left], len(rule)):
                break
        else:
            break
        found.append(Region(signal, share, size, _words(rule)))
        left &= ~inside
    return found


def _convincing(samples: _Samples, inside: np.ndarray, conditions: int) -> bool:
    """Whether the lift is large, and large beyond the chance of a few blocks and many rules."""
    block = np.unique(samples.block, return_inverse=True)[1]
    count = int(block.max()) + 1
    energy, size = np.bincount(block, samples.energy, count), np.bincount(block, minlength=count)
    energy_in, size_in = np.bincount(block, samples.energy * inside, count), np.bincount(block, inside, count)

    def lift(without: np.ndarray | float, a: tuple) -> np.ndarray:
        e_in, e, n_in, n = (item.sum() - without * item for item in a)
        return np.asarray((e_in / np.maximum(e, 1e-300)) / np.maximum(n_in / np.maximum(n, 1), 1e-9))

    parts = (energy_in, energy, size_in, size)
    whole = float(lift(0.0, parts)[0])
    events = energy_in.sum() ** 2 / max(float(np.sum(energy_in**2)), 1e-300)
    if whole < LEAST_LIFT or events < LEAST_EVENTS[conditions - 1]:
        return False
    others = np.log(np.maximum(lift(1.0, parts), 1e-9))
    error = float(np.sqrt((count - 1) / count * np.sum((others - others.mean()) ** 2)))
    return np.log(whole) - SURE * error > np.log(SURE_LIFT)


def _best_rules(samples: _Samples, known: _Catalogue) -> list[list[_Condition]]:
    """The best rule, and behind it the best with fewer conditions.

    Every single condition and every pair is tried; the best pair may get a third.
    """
    cuts, n = samples.cuts, samples.energy.size
    energy = (samples.energy / samples.energy.sum()).astype(np.float32)
    even = np.full(n, 1.0 / n, dtype=np.float32)
    weight = known.weight
    single = weight * _divergence(known.totals(cuts, energy), known.totals(cuts, even))
    best, score = [[int(np.argmax(single))]], float(single.max())
    pair = _divergence(known.pair_totals(cuts, energy), known.pair_totals(cuts, even))
    pair *= known.goes * np.minimum.outer(weight, weight)
    if pair.max() >= SECOND_EARNS * score:
        first, second = (int(k) for k in np.unravel_index(np.argmax(pair), pair.shape))
        best, score = [[first, second], *best], float(pair.max())
        both = samples.inside(known.conditions[first]) & samples.inside(known.conditions[second])
        third = _divergence(known.totals(cuts, energy * both), known.totals(cuts, even * both))
        third *= known.goes[first] * known.goes[second] * np.minimum(weight, min(weight[first], weight[second]))
        if third.max() >= THIRD_EARNS * score:
            best.insert(0, [first, second, int(np.argmax(third))])
    return [[known.conditions[k] for k in rule] for rule in best]


def _divergence(share: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Divergence of the error's split from the samples' split; 0 below the least lift or the least samples."""
    e, s = (np.clip(np.asarray(y, dtype=float), 1e-9, 1 - 1e-9) for y in (share, samples))
    found = e * np.log(e / s) + (1 - e) * np.log((1 - e) / (1 - s))
    return np.where((e > s) & (samples >= LEAST_SAMPLES), found, 0.0)


def _goes_with(a: _Condition, b: _Condition) -> bool:
    """Whether two conditions say more together than one of them: other features, or the two ends of a band."""
    if a.feature == b.feature:
        return a.side * b.side < 0
    pair = {a.feature: a.side, b.feature: b.side}
    # "v < 0 and |v| > 20 mm/s" is "v < -20 mm/s"
    return not any(name in pair and pair.get(f"|{name}|") == 1 for name in ("v", "u"))


def _words(rule: Sequence[_Condition]) -> str:
    """The rule as text, motion first, run and time last; the two ends of a band as ``p2 = 200 to 400 kPa gauge``."""
    order = ["v", "|v|", "u", "|u|", "x", "p1", "p2", "psup", "t", "run"]
    parts: dict[str, str] = {}
    for item in sorted(rule, key=lambda item: (order.index(item.feature), -item.side)):
        before = parts.get(item.feature)
        parts[item.feature] = item.text if before is None else _band(before, item.text)
    return " and ".join(parts.values())


def _band(above: str, below: str) -> str:
    """``x > 100 mm`` and ``x < 200 mm`` as ``x = 100 to 200 mm``."""
    name, low = above.split(" > ")
    return f"{name} = {low.split(' ')[0]} to {below.split(' < ')[1]}"
