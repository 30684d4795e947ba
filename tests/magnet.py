"""A bench with a magnet towards mid-stroke, which no effect of the catalogue is: its runs, fit and unknown function."""

from __future__ import annotations

from functools import cache

from helpers import rig

from pneuid.criticism.prediction.frozen import Frozen
from pneuid.criticism.prediction.noise_floor import noise_floor
from pneuid.criticism.unknown.function_search import Found, search
from pneuid.criticism.unknown.probes import Probing
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import (
    ATMOSPHERE,
    Friction,
    Hidden,
    TruthBench,
    record_bench,
    sine,
)

STAND = rig("bench", {"sensors": {"x": "0.3 um", "p1": "0.5 kPa", "p2": "0.5 kPa"}})


@cache
def magnet_runs() -> tuple[Recording, Recording]:
    """Two runs of a bench with a magnet towards mid-stroke, which no effect of the catalogue is."""
    runs = []
    for seed, frequency in ((3, 0.5), (4, 0.4)):
        record = record_bench(
            TruthBench(friction=Friction()), 3e5 + ATMOSPHERE, 2e5 + ATMOSPHERE,
            sine(amplitude=0.09, frequency=frequency, cycles=2), Hidden(magnetic_detent=15.0), seed,
        )  # fmt: skip
        runs.append(Recording.from_arrays(f"b{seed}.csv", STAND, **record))
    return runs[0], runs[1]


@cache
def magnet() -> tuple[Fit, Probing]:
    """The base model fitted to the first run, and its probes."""
    found = fit(Plant(STAND, "lugre"), [magnet_runs()[0]], exact=False)
    return found, Probing(found)


@cache
def searched() -> Found:
    """What the search finds on the magnet's runs."""
    found, _ = magnet()
    held = magnet_runs()[1]
    model = Frozen(found.plant, found.values, found.ranges, found.noise, found.substeps)
    floor = noise_floor(model, [prepare(held, found.plant, found.noise)], 1)
    return search(found, [held], floor.value)
