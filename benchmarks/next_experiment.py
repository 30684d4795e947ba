"""Does the proposed recording decide? Ambiguous servo cases are diagnosed, it is played, and they are diagnosed again.

    python benchmarks/next_experiment.py benchmarks/results/hidden_effects.jsonl --workers 2

The cases are those that the result file of ``hidden_effects.py`` calls ambiguous, or that ``--cases`` names. The command of the
proposal is played open loop on the virtual rig that hides the effect, twice with noise of its own: one recording joins
the training runs, one the held-out runs. Counts are printed: proposals, and verdicts ``effect`` with the right name.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from hidden_effects import KNOWN, Case, cases, fit, hidden_of, on_bench, servo_rig, servo_runs

from pneuid import api
from pneuid.criticism.decision import diagnose
from pneuid.criticism.experiment import for_verdict
from pneuid.criticism.unknown import explained
from pneuid.recording import Recording
from pneuid.virtual_rig import record_command


def played(case: Case) -> dict[str, Any]:
    """One case before and after the proposed recording, as a line of the result file."""
    warnings.simplefilter("ignore")
    began = time.monotonic()
    train, held, rig = servo_runs(case)
    base = fit(api.plant_of(rig), train)
    before = explained(diagnose(base, held, KNOWN), held)
    row: dict[str, Any] = {"key": case.key, "names": list(case.names), "before": _said(before.diagnosis)}
    proposal = for_verdict(before, base, KNOWN)
    if proposal is None:
        return row | {"proposed": None, "seconds": time.monotonic() - began}
    drawn, _ = servo_rig(case)
    command, hidden = proposal.command, hidden_of(case, drawn.truth.bore)
    new = [
        Recording.from_arrays(
            name, rig,
            **record_command(
                drawn.truth, hidden, command.u, command.supply, float(command.x[0]), case.seed * 100 + 50 + i,
                rate=drawn.rate, sensors=drawn.sensors,
            ),
        )
        for i, name in enumerate(("next_1.csv", "next_2.csv"))
    ]  # fmt: skip
    train, held = [*train, new[0]], [*held, new[1]]
    after = explained(diagnose(fit(api.plant_of(rig), train), held, KNOWN), held)
    return row | {
        "proposed": proposal.excitation.name, "power": proposal.power, "rivals": list(proposal.rivals),
        "after": _said(after.diagnosis), "seconds": time.monotonic() - began,
    }  # fmt: skip


def _said(diagnosis: Any) -> dict[str, Any]:
    return {"verdict": diagnosis.verdict, "effects": list(diagnosis.effects)}


def wanted(given: argparse.Namespace) -> list[Case]:
    """Ambiguous servo cases of the result files, and the named ones."""
    rows = [json.loads(line) for path in given.results for line in path.read_text("utf-8").splitlines()]
    keys = {row["key"] for row in rows if row["verdict"] == "ambiguous"} | set(given.cases)
    seeds = sorted({int(key.rsplit("/", 1)[1]) for key in keys})
    return [case for case in cases(seeds, []) if case.key in keys and not on_bench(case)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Play every case and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="*", type=Path, help="result files of hidden_effects.py")
    parser.add_argument("--cases", nargs="+", default=[], metavar="KEY", help="as in the result file")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    chosen, proposed, right = wanted(given), 0, 0
    with ProcessPoolExecutor(given.workers) as pool:
        for row in pool.map(played, chosen):
            print(json.dumps(row), flush=True)
            if row["before"]["verdict"] == "ambiguous" and row["proposed"] is not None:
                proposed += 1
                right += row["after"] == {"verdict": "effect", "effects": row["names"]}
    print(f"{len(chosen)} cases, {proposed} ambiguous with a proposal, {right} of them then named alone")


if __name__ == "__main__":
    main()
