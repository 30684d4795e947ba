"""Cases of ``hidden_effects.py``: which effects hide in which rig, how strongly, category by category."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pneuid.effects import CATALOGUE, LAW_STEPS
from pneuid.virtual_rig import BENCH_EFFECTS, HIDDEN_EFFECTS, OUTSIDE_EFFECTS, Friction

DRAWN = 1000
"""Seeds of varied cases per seed of the benchmark."""

KNOWN = CATALOGUE | LAW_STEPS
"""All that the diagnosis chooses from."""

BORES = {"default": 0.032, "half": 0.016, "double": 0.064}
LAWS = {
    "law:lugre": Friction(),
    "law:dahl": Friction(Fc=20.0, Fs=20.0, sigma0=1.5e5, sigma1=0.0),
    "law:stribeck": Friction(sigma0=2.0e7, sigma1=0.0),
}
"""True friction of benches whose rig file says coulomb."""

PAIRS = (
    ("gravity", "leakage_internal"), ("friction_pressure", "valve_dead_zone"), ("friction_direction", "load_spring"),
    ("supply_droop", "load_mass"), ("valve_offset", "leakage_external_2"), ("friction_position", "heat_transfer"),
    ("valve_hysteresis", "friction_viscous_nonlinear"), ("friction_warmup", "exhaust_restriction"),
    ("end_cushion", "valve_asymmetry"), ("line_delay", "friction_pressure"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One case: the category, the rig, what hides in it, how strongly, and the seed."""

    category: str
    rig: str
    names: tuple[str, ...]
    level: str
    seed: int

    @property
    def key(self) -> str:
        """The case in one word."""
        return "/".join((self.category, self.rig, "+".join(self.names) or "none", self.level, str(self.seed)))


def cases(seeds: Sequence[int], nulls: Sequence[int]) -> Iterator[Case]:
    """Every case, spread so that a part of them already covers all effects."""
    for i, seed in enumerate(seeds):
        for level in ("strong", "weak"):
            size = tuple(BORES)[(i + (level == "weak")) % len(BORES)]
            yield from (Case("servo", size, (name,), level, seed) for name in HIDDEN_EFFECTS)
            yield from (Case(bench, size, (name,), level, seed) for bench in ("bench", "within") for name in BENCH_EFFECTS)
        yield from (Case("bench", "default", (law,), "strong", seed) for law in LAWS)
        yield from (Case("varied", "random", (name,), "drawn", _own(seed, j)) for j, name in enumerate(HIDDEN_EFFECTS))
        yield from (Case("varied", "random bench", (name,), "drawn", _own(seed, j)) for j, name in enumerate(BENCH_EFFECTS))
        yield from (Case("varied", rig, (), "none", _own(seed, 100)) for rig in ("random", "random bench"))
        yield from (Case("pair", "default", pair, ("strong", "weak")[i % 2], seed) for pair in PAIRS)
        yield from (
            Case("drawn pair", tuple(BORES)[(i + j) % len(BORES)], pair, ("strong", "weak")[j % 2], seed)
            for j, pair in enumerate(drawn_pairs(seed))
        )
        for name, item in OUTSIDE_EFFECTS.items():
            yield from (Case("outside", rig, (name,), ("strong", "weak")[i % 2], seed) for rig in item.rigs)
    for i, seed in enumerate(nulls):
        yield Case("null", ("random", "random", "random bench", "default")[i % 4], (), "none", seed)
        if i % 5 == 0:
            yield Case("sheet", "random", (), "none", seed)


def drawn_pairs(seed: int) -> list[tuple[str, str]]:
    """Pairs of effects, none of which names the other as what it is easily confused with."""
    apart = [
        (one, other) for one, other in combinations(HIDDEN_EFFECTS, 2) if not CATALOGUE[one].resembles(CATALOGUE[other])
    ]
    rng = np.random.default_rng((seed, 17))
    return [apart[i] for i in rng.choice(len(apart), len(PAIRS), replace=False)]


def _own(seed: int, number: int) -> int:
    """A seed of its own for each varied case, so that every one has another rig."""
    return seed * DRAWN + number


def in_catalogue(case: Case) -> bool:
    """Whether the catalogue holds all that the case hides, or need not."""
    return case.category == "outside" or all(name in KNOWN for name in case.names)


def on_bench(case: Case) -> bool:
    """Whether the case stands on the friction bench."""
    return case.category in ("bench", "within") or case.rig.endswith("bench")
