"""Sanity checks on rigs that no threshold was set on: how often each check fires wrongly, how often each slip is found.

    python benchmarks/plausibility_rates.py --seeds 1000 1020 --out benchmarks/results/plausibility.json

Each seed draws a servo rig and a bench (bore 10 to 200 mm, 0.1 to 100 kg, 4 to 10 bar, 100 Hz to 10 kHz, the sheet's
conductance up to a quarter off). A servo rig is driven by four excitations, each once with nothing hidden and once
with a strong physical effect drawn at random; a bench by three motions at two pairs of pressures. Every record is
checked alone, which is the hard case, as it is (any finding is false) and changed as a slip would change it (found:
the slip's check is the first finding). Rigs that hide a delay (a slow sensor, a skew) count apart: there the delay's
finding is right.
"""

from __future__ import annotations

import argparse
import json
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pneuid.plausibility import check_recordings
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import (
    ATMOSPHERE,
    BENCH_EFFECTS,
    HIDDEN_EFFECTS,
    NOTHING,
    TruthBench,
    TruthServo,
    in_proportion,
    random_bench,
    random_servo,
    record_bench,
    record_servo,
)

Record = dict[str, np.ndarray]
Truth = TruthServo | TruthBench
Change = Callable[[Record, Truth], Record]
Slip = tuple[str, bool, Change]
DELAYS = ("channel_skew", "sensor_lag_p1", "sensor_lag_p2")
EXCITATIONS = ("multisine", "steps", "slow", "sine")
MOTIONS = ("strokes", "reciprocation", "sine")


def pressures(record: Record, change: Callable[[np.ndarray], np.ndarray]) -> Record:
    """Both pressures changed; below vacuum there is no number to hand in."""
    return {**record, **{name: np.maximum(change(record[name]), 0.0) for name in ("p1", "p2")}}


def unit(factor: float) -> Change:
    """Gauge pressures times ``factor``."""
    return lambda record, _truth: pressures(record, lambda p: ATMOSPHERE + factor * (p - ATMOSPHERE))


def late(*signals: str) -> Change:
    """Signals that come 12 ms late, three samples where that is more."""

    def change(record: Record, _truth: Truth) -> Record:
        t = record["t"]
        delay = max(0.012, 3.0 * float(np.median(np.diff(t))))
        return {**record, **{name: np.interp(t - delay, t, record[name]) for name in signals}}

    return change


def clipped(signal: str) -> Change:
    """A sensor that ends at the 92nd percentile."""
    return lambda record, _truth: {**record, signal: np.minimum(record[signal], np.percentile(record[signal], 92))}


def swap(record: Record, _truth: Truth) -> Record:
    """The columns of p1 and p2 exchanged."""
    return {**record, "p1": record["p2"], "p2": record["p1"]}


def mirrored(record: Record, truth: Truth) -> Record:
    """x counted from the other end."""
    return {**record, "x": truth.stroke - record["x"]}


def turned(record: Record, truth: Truth) -> Record:
    """u the wrong way about the valve's null."""
    if not isinstance(truth, TruthServo):
        raise TypeError(type(truth))
    return {**record, "u": 2.0 * truth.null - record["u"]}


COMMON: dict[str, Change] = {
    "absolute as gauge": lambda record, _truth: pressures(record, lambda p: p + ATMOSPHERE),
    "gauge as absolute": lambda record, _truth: pressures(record, lambda p: p - ATMOSPHERE),
}
SERVO_SLIPS: dict[str, Slip] = {
    "p1 and p2 swapped": ("swapped_chambers", False, swap),
    "u reversed": ("reversed_command", False, turned),
    "x from the rod end": ("reversed_position", False, mirrored),
    "absolute as gauge": ("pressure_reference", False, COMMON["absolute as gauge"]),
    "gauge as absolute": ("pressure_reference", True, COMMON["gauge as absolute"]),
    "kPa as bar": ("unit_of_pressure", False, unit(100.0)),
    "bar as kPa": ("unit_of_pressure", False, unit(0.01)),
    "psi as kPa": ("unit_of_pressure", False, unit(1 / 6.895)),
    "psi as bar": ("unit_of_pressure", False, unit(14.5)),
    "x 12 ms late": ("channel_skew", False, late("x")),
    "p1 12 ms late": ("channel_skew", False, late("p1")),
    "p1 and p2 12 ms late": ("channel_skew", False, late("p1", "p2")),
    "p2 clipped": ("clipped_sensor", False, clipped("p2")),
    "p1 clipped": ("clipped_sensor", False, clipped("p1")),
}
BENCH_SLIPS: dict[str, Slip] = {
    "F reversed": ("reversed_force", False, lambda r, _truth: {**r, "F": -r["F"]}),
    "x from the rod end": ("reversed_bench_position", False, mirrored),
    "p1 and p2 swapped": ("bench_chambers", False, swap),
    "gauge as absolute": ("bench_reference", True, COMMON["gauge as absolute"]),
    "kPa as bar": ("bench_unit", False, unit(100.0)),
    "psi as kPa": ("bench_unit", False, unit(1 / 6.895)),
    "F clipped": ("clipped_sensor", False, clipped("F")),
}


class Count:
    """Findings by kind of rig and check, and slips found of those tried."""

    def __init__(self) -> None:
        self.records: Counter[str] = Counter()
        self.false: Counter[str] = Counter()
        self.who: list[str] = []
        self.tried: Counter[str] = Counter()
        self.found: Counter[str] = Counter()
        self.named: Counter[str] = Counter()

    def clean(self, kind: str, label: str, rig: Rig, record: Record) -> None:
        """Check a record as it is."""
        names = found_in(rig, record)
        self.records[kind] += 1
        for name in names:
            self.false[f"{kind}: {name}"] += 1
            self.who.append(f"{label}: {name}")

    def slips(self, kind: str, table: dict[str, Slip], rigs: tuple[Rig, Rig], truth: Truth, record: Record) -> None:
        """Check a record with each slip; ``rigs`` state gauge and absolute pressures."""
        for slip, (check, absolute, change) in table.items():
            names = found_in(rigs[absolute], change(record, truth))
            key = f"{kind}: {slip}"
            self.tried[key] += 1
            self.found[key] += names[:1] == [check]
            self.named[key] += bool(names)


def found_in(rig: Rig, record: Record) -> list[str]:
    """Names of the checks that fire."""
    return [one.check for one in check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record)])]


def absolute(rig_text: str) -> Rig:
    """The rig as written by one who states absolute pressures."""
    raw = tomllib.loads(rig_text)
    raw["conventions"]["pressure"] = "abs"
    if "supply" in raw:
        raw["supply"]["pressure"] = f"{float(raw['supply']['pressure'].split()[0]) + ATMOSPHERE!r} Pa"
    return Rig.from_dict(raw)


def servo(seed: int, count: Count) -> None:
    """All records of one servo rig."""
    drawn = random_servo(seed)
    text = drawn.rig_toml({})
    rigs = (Rig.from_dict(tomllib.loads(text)), absolute(text))
    duration = float(np.clip(4.0, 1500.0 / drawn.rate, max(2.0, 8000.0 / drawn.rate)))
    rng = np.random.default_rng((seed, 9))
    for number, excitation in enumerate(EXCITATIONS):
        name = str(rng.choice(list(HIDDEN_EFFECTS)))
        for label, hidden in (("nothing", NOTHING), (name, HIDDEN_EFFECTS[name]["strong"])):
            record = record_servo(
                drawn.truth, in_proportion(hidden, drawn.truth.bore), excitation, duration, 10 * seed + number,
                rate=drawn.rate, sensors=drawn.sensors,
            )  # fmt: skip
            kind = "servo" if label == "nothing" else "servo, delay hidden" if label in DELAYS else "servo, effect hidden"
            count.clean(kind, f"seed {seed} {excitation} {label}", rigs[0], record)
            if label == "nothing":
                count.slips(f"servo {excitation}", SERVO_SLIPS, rigs, drawn.truth, record)


def bench(seed: int, count: Count) -> None:
    """All records of one bench."""
    drawn = random_bench(seed)
    text = drawn.rig_toml("lugre")
    rigs = (Rig.from_dict(tomllib.loads(text)), absolute(text))
    rng = np.random.default_rng((seed, 9))
    for motion in MOTIONS:
        for pair in (rng.uniform(0.0, 6e5, 2), (rng.uniform(2e5, 6e5), 0.0)):
            name = str(rng.choice(list(BENCH_EFFECTS)))
            for label, hidden in (("nothing", NOTHING), (name, BENCH_EFFECTS[name]["strong"])):
                record = record_bench(
                    drawn.truth, pair[0] + ATMOSPHERE, pair[1] + ATMOSPHERE, motion,
                    in_proportion(hidden, drawn.truth.bore), seed, sensors=drawn.sensors, step=50e-6,
                )  # fmt: skip
                kind = "bench" if label == "nothing" else "bench, effect hidden"
                count.clean(kind, f"seed {seed} {motion} {label}", rigs[0], record)
                if label == "nothing":
                    count.slips(f"bench {motion}", BENCH_SLIPS, rigs, drawn.truth, record)


def main() -> None:
    """Count, print and save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1020), metavar=("FIRST", "AFTER"))
    parser.add_argument("--kinds", nargs="+", choices=("servo", "bench"), default=("servo", "bench"))
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    count = Count()
    for seed in range(*given.seeds):
        for kind in given.kinds:
            {"servo": servo, "bench": bench}[kind](seed, count)
        table = dict(vars(count))
        given.out.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
        print(f"seed {seed}: records {sum(count.records.values())}, false {dict(count.false)}", flush=True)
    for slip, tried in count.tried.items():
        print(f"{slip}: {count.found[slip]} of {tried} named, {count.named[slip]} warned of at all")


if __name__ == "__main__":
    main()
