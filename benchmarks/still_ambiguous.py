"""Whether what a diagnosis calls ambiguous is still so with a second seed, and with twice the recordings.

    python benchmarks/still_ambiguous.py benchmarks/results/hidden_effects.jsonl --workers 2

The ambiguous cases of a result file of ``hidden_effects.py`` with one hidden effect, on rigs that the seed does not draw: the
same rig is diagnosed with recordings of another seed (other noise, other random motions), and with these and its own
together, six training and four held-out runs. Another verdict with the right effect means that the first one could have
told, or that more of the same tells it.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from hidden_cases import KNOWN, Case
from hidden_runs import runs_of

from pneuid import api
from pneuid.criticism.decision.verdict import diagnose
from pneuid.errors import ComputationError, UserError
from pneuid.estimation.fit import fit
from pneuid.recording import Recording
from pneuid.rig import Rig

OTHER = 50
"""Added to a case's seed for the second one; the benchmark's seeds go in hundreds."""


def again(row: dict[str, Any]) -> dict[str, Any]:
    """One case with a second seed, and with both: verdicts and effects."""
    warnings.simplefilter("ignore")
    case = Case(row["category"], row["rig"], tuple(row["names"]), row["level"], row["seed"])
    other = replace(case, seed=case.seed + OTHER)
    train, held, rig = runs_of(case)
    train_2, held_2, _ = runs_of(other)
    return {
        "key": case.key, "second": said(train_2, held_2, rig),
        "longer": said([*train, *renamed(train_2)], [*held, *renamed(held_2)], rig),
    }  # fmt: skip


def renamed(runs: Sequence[Recording]) -> list[Recording]:
    """Recordings that can stand beside those of the same names."""
    return [replace(run, name=f"again_{run.name}") for run in runs]


def said(train: Sequence[Recording], held: Sequence[Recording], rig: Rig) -> dict[str, Any]:
    """Verdict and effects on these recordings."""
    try:
        found = diagnose(fit(api.plant_of(rig), train), held, KNOWN).diagnosis
    except (UserError, ComputationError, RuntimeError, ValueError) as error:
        return {"verdict": "failed", "effects": [str(error)[:200]]}
    return {"verdict": found.verdict, "effects": list(found.effects)}


def asking(path: Path) -> list[dict[str, Any]]:
    """Ambiguous rows of a result file that can be asked again."""
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    return [
        row
        for row in rows
        if row["verdict"] == "ambiguous" and len(row["names"]) == 1 and row["category"] in {"servo", "bench", "within"}
    ]


def main() -> None:
    """Ask the ambiguous cases of result files again, and count the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", help="result files of hidden_effects.py")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    rows = list({row["key"]: row for path in given.results for row in asking(path)}.values())
    counts: Counter[tuple[str, str]] = Counter()
    with ProcessPoolExecutor(given.workers) as pool:
        for row, found in zip(rows, pool.map(again, rows), strict=True):
            for what in ("second", "longer"):
                counts[what, found[what]["verdict"]] += 1
            lines = [f"{what}: {found[what]['verdict']} {found[what]['effects']}" for what in ("second", "longer")]
            print(f"{row['key']:50s} {'; '.join(lines)}", flush=True)
    print("\n".join(f"{what:8s} {verdict:10s} {count:4d}" for (what, verdict), count in sorted(counts.items())))


if __name__ == "__main__":
    main()
