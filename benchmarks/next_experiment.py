"""Does the proposed recording decide? Ambiguous cases are diagnosed, it is played, and they are diagnosed again.

    python benchmarks/next_experiment.py benchmarks/results/hidden_effects.jsonl --workers 2

The cases are those that the result file of ``hidden_effects.py`` calls ambiguous, or that ``--cases`` names. The command of the
proposal is played open loop on the virtual rig that hides the effect (a bench imposes its motion), twice with noise of its
own: one recording joins the training runs, one the held-out runs. Where it asks for a zero reading, that is taken of the same
rig's sensors. Counts are printed: proposals, verdicts ``effect`` with the
right name, and ``ambiguous`` ones among effects that the proposal calls alike.
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

import numpy as np
from hidden_cases import DRAWN, KNOWN, Case, cases, on_bench
from hidden_runs import bench_rig, hidden_of, runs_of, servo_rig, standing

from pneuid import api
from pneuid.criticism.decision.diagnosis import Command
from pneuid.criticism.decision.rest import explained
from pneuid.criticism.decision.verdict import diagnose
from pneuid.criticism.decision.zeros import Zeros
from pneuid.criticism.next_experiment.proposal import for_verdict
from pneuid.estimation.fit import fit
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import Motion, record_bench, record_command, record_zero
from pneuid.zero_reading import ZeroReading


def played(case: Case) -> dict[str, Any]:
    """One case before and after the proposed recording, as a line of the result file."""
    warnings.simplefilter("ignore")
    began = time.monotonic()
    train, held, rig = runs_of(case)
    base = fit(api.plant_of(rig), train)
    before = explained(diagnose(base, held, KNOWN), held)
    row: dict[str, Any] = {"key": case.key, "names": list(case.names), "before": _said(before.diagnosis)}
    proposal = for_verdict(before, base, KNOWN)
    if proposal is None or (proposal.command is None and not proposal.read):
        rivals = [] if proposal is None else proposal.rivals
        return row | {"proposed": None, "rivals": rivals, "seconds": time.monotonic() - began}
    if proposal.command is not None:
        new = [
            Recording.from_arrays(name, rig, **recorded(case, proposal.command, case.seed * 100 + 50 + i))
            for i, name in enumerate(("next_1.csv", "next_2.csv"))
        ]
        train, held = [*train, new[0]], [*held, new[1]]
        base = fit(api.plant_of(rig), train)
    zero = read_at_zero(case, rig, proposal.read) if proposal.read else None
    after = explained(diagnose(base, held, KNOWN, zeros=Zeros(zero)), held)
    names = [*(["zero reading"] if zero else []), *([proposal.excitation.name] if proposal.excitation else [])]
    return row | {
        "proposed": " and ".join(names), "power": proposal.power, "rivals": proposal.rivals,
        "after": _said(after.diagnosis), "seconds": time.monotonic() - began,
    }  # fmt: skip


def read_at_zero(case: Case, rig: Rig, signals: Sequence[str]) -> ZeroReading:
    """What the sensors of the case's rig show with both chambers vented and nothing pulling."""
    if on_bench(case):
        stand = standing(case)
        bench = bench_rig(stand)
        shown = record_zero(hidden_of(stand, bench.truth.bore), bench.truth.patm, bench.sensors, case.seed)
    else:
        drawn, _ = servo_rig(case)
        shown = record_zero(hidden_of(case, drawn.truth.bore), drawn.truth.patm, drawn.sensors, case.seed)
    return ZeroReading.from_arrays("zero.csv", rig, **{signal: shown[signal] for signal in signals})


def recorded(case: Case, command: Command, seed: int) -> dict[str, np.ndarray]:
    """What the rig of the case shows under a command."""
    if not on_bench(case):
        drawn, _ = servo_rig(case)
        return record_command(
            drawn.truth, hidden_of(case, drawn.truth.bore), command.inputs["u"], command.inputs["psup"], float(command.x[0]),
            seed, rate=drawn.rate, sensors=drawn.sensors,
        )  # fmt: skip
    stand = standing(case)
    bench, v = bench_rig(stand), np.gradient(command.x, command.t)
    motion = Motion(command.t, command.x, v, np.gradient(v, command.t))
    return record_bench(
        bench.truth, command.inputs["p1"], command.inputs["p2"], motion, hidden_of(stand, bench.truth.bore), seed,
        sensors=bench.sensors,
    )  # fmt: skip


def _said(diagnosis: Any) -> dict[str, Any]:
    return {"verdict": diagnosis.verdict, "effects": list(diagnosis.effects)}


def wanted(given: argparse.Namespace) -> list[Case]:
    """Ambiguous cases of the result files, and the named ones."""
    rows = [json.loads(line) for path in given.results for line in path.read_text("utf-8").splitlines()]
    keys = {row["key"] for row in rows if row["verdict"] == "ambiguous"} | set(given.cases)
    own = {int(key.rsplit("/", 1)[1]) for key in keys}
    seeds = sorted(own | {seed // DRAWN for seed in own})  # a varied case has a seed of its own
    # seed by seed, as the strength alternates with the place of a seed in its list
    return [case for seed in seeds for case in cases([seed], []) if case.key in keys]


def main(arguments: Sequence[str] | None = None) -> None:
    """Play every case and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="*", type=Path, help="result files of hidden_effects.py")
    parser.add_argument("--cases", nargs="+", default=[], metavar="KEY", help="as in the result file")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    chosen, proposed, right, alike = wanted(given), 0, 0, 0
    with ProcessPoolExecutor(given.workers) as pool:
        for row in pool.map(played, chosen):
            print(json.dumps(row), flush=True)
            if row["before"]["verdict"] == "ambiguous" and row["proposed"] is not None:
                proposed += 1
                right += row["after"] == {"verdict": "effect", "effects": row["names"]}
                named = set(row["after"]["effects"])
                alike += len(named) > 1 and any(named <= set(group) for group in row["rivals"]) and set(row["names"]) <= named
    print(f"{len(chosen)} cases, {proposed} ambiguous with a proposal; then {right} named alone, {alike} among effects alike")


if __name__ == "__main__":
    main()
