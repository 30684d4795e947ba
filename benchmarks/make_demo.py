"""Writes the embedded demonstration: ``python benchmarks/make_demo.py`` fills ``scenarios/demo``.

Three recordings to train on and two held out, at five supply pressures, from the virtual rig with one hidden effect; the
rig file is what the engineer knows. ``study.toml`` there holds the truth for the closed-loop study.
"""

from __future__ import annotations

from pneuid.resources import scenario_path
from pneuid.virtual_rig import ATMOSPHERE, TruthServo, record_servo, write_csv
from pneuid.virtual_rig.hidden import Hidden

RUNS = (
    ("train_1.csv", "multisine", 3.0),
    ("train_2.csv", "steps", 5.0),
    ("train_3.csv", "slow", 7.0),
    ("hold_out_1.csv", "multisine", 4.0),
    ("hold_out_2.csv", "steps", 6.5),
)
"""File, excitation and supply in bar gauge."""

HIDDEN = Hidden(friction_pressure=0.85)
SEED = 2011


def main() -> None:
    """Write the recordings."""
    folder = scenario_path("demo")
    for number, (name, excitation, bar) in enumerate(RUNS):
        supply = bar * 1e5 + ATMOSPHERE
        write_csv(folder / name, record_servo(TruthServo(), HIDDEN, excitation, 6.0, SEED + number, supply=supply))
        print(f"wrote {folder / name}")


if __name__ == "__main__":
    main()
