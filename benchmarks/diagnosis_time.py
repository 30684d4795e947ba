"""Wall clock of a full diagnosis: three training and two held-out runs of 6 s at 1 kHz, by the commands a user types.

    python benchmarks/diagnosis_time.py [--every 9] [--seed 1] [--workers N]

Takes every n-th of the servo cases of ``hidden_effects.py`` and prints for each the seconds of ``pneuid.identify`` and of
``pneuid.diagnose``, their start and compilation included. The first case also fills the cache of compiled functions.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from hidden_cases import Case, cases
from hidden_runs import PLAN, TRAINING, hidden_of, servo_rig

from pneuid.virtual_rig import ATMOSPHERE, record_servo, write_csv


def written(case: Case, folder: Path) -> list[str]:
    """Writes the case's rig file and recordings; names of the recordings."""
    drawn, top = servo_rig(case)
    supplies = {f"run_{i + 1}.csv": run.supply * top for i, run in enumerate(PLAN)}
    (folder / "rig.toml").write_text(drawn.rig_toml(supplies))
    hidden = hidden_of(case, drawn.truth.bore)
    for i, (run, (name, supply)) in enumerate(zip(PLAN, supplies.items(), strict=True)):
        record = record_servo(
            drawn.truth, hidden, run.excitation, 6.0, case.seed * 100 + i, supply=supply + ATMOSPHERE, rate=drawn.rate,
            sensors=drawn.sensors,
        )  # fmt: skip
        write_csv(folder / name, record)
    return list(supplies)


def command(folder: Path, *words: str) -> float:
    """Seconds of one command in a folder; raises ``CalledProcessError`` where it fails."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-m", *words], cwd=folder, check=True, capture_output=True)
    return time.monotonic() - began


def timed(case: Case, workers: int | None) -> dict[str, object]:
    """Seconds of both commands, and what the diagnosis said."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        runs = written(case, folder)
        train, held = runs[:TRAINING], runs[TRAINING:]
        fitted = command(folder, "pneuid.identify", "--rig", "rig.toml", "--data", *train, "--out", "fit")
        found = command(
            folder, "pneuid.diagnose", "fit/model.json", "--data", *train, "--hold-out", *held, "--out", "diagnosis",
            *(() if workers is None else ("--workers", str(workers))),
        )  # fmt: skip
        said = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    return {"key": case.key, "identify": fitted, "diagnose": found, "verdict": said["verdict"], "effects": said["effects"]}


def main(given: Sequence[str] | None = None) -> None:
    """Print a line per case and the median."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=9)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, help="processes of the diagnosis; as the command has it when left out")
    chosen = parser.parse_args(given)
    rows = []
    for case in [one for one in cases([chosen.seed], []) if one.category == "servo"][:: chosen.every]:
        rows.append(timed(case, chosen.workers))
        print("{key}: identify {identify:.0f} s, diagnose {diagnose:.0f} s: {verdict} {effects}".format(**rows[-1]), flush=True)
    for name in ("identify", "diagnose"):
        seconds = [float(str(row[name])) for row in rows]
        below = sum(one < 60.0 for one in seconds)
        print(f"{name}: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s, below 60 s in {below} of {len(rows)}")


if __name__ == "__main__":
    main()
