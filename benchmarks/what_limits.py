"""What stands in the way where less than nine tenths of the error is explained, by refits of the right effect.

    python benchmarks/what_limits.py benchmarks/results/hidden_effects.jsonl --workers 2

Of the result file's cases with one hidden effect, a base error of 1.5 floors and more, and less than 90 % of the excess
explained. The right effect is added to the base model from several starts, and what that explains of the held-out error is
measured with

- ``training``: the end that predicts the training runs best, as a diagnosis would choose it
- ``any start``: the end that predicts the held-out runs best, which no diagnosis can know
- ``all runs``: the same model fitted to training and held-out runs together

The first of them that reaches 90 % tells what stands in the way: the ``diagnosis`` (another effect was named, or its refit
ended elsewhere), the ``choice`` among ends, the ``recordings`` (the training runs leave open what the held-out ones ask for),
or, where none does, the ``form`` (the hidden effect's differs from the catalogue's, or the fit misses the optimum).
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from hidden_cases import KNOWN, Case
from hidden_runs import runs_of

from pneuid import api
from pneuid.criticism.refitting.refits import Asked
from pneuid.criticism.refitting.refitter import Refitter
from pneuid.criticism.refitting.restarts import best_end, typical_start
from pneuid.criticism.refitting.trial import Judge, Trial, judge_of
from pneuid.criticism.screening.scores import screen
from pneuid.errors import ComputationError, UserError
from pneuid.estimation.fit import Fit, fit
from pneuid.estimation.preparation import prepare

ASKED, LEAST_ERROR = 0.9, 1.5
"""Share of the excess to explain, and the base model's error in floors from which it is asked."""

SIZES = (3.0, 16.0)
"""Amplitudes, in units of their scales, to start from besides what screening suggests."""

CAUSES = {"training": "diagnosis", "any start": "choice", "all runs": "recordings"}


def examined(row: dict[str, Any]) -> dict[str, Any]:
    """One case: shares of the excess explained, and what stands in the way."""
    warnings.simplefilter("ignore")
    began = time.monotonic()
    case = Case(row["category"], row["rig"], tuple(row["names"]), row["level"], row["seed"])
    said: dict[str, Any] = {"key": case.key, "verdict": row["verdict"], "effects": row["effects"], "named": row["explained"]}
    try:
        train, held, rig = runs_of(case)
        base = fit(api.plant_of(rig), train)
        judge = judge_of(base, [prepare(run, base.plant, base.noise) for run in held])
        shares = explained_by(base, judge, case.names[0])
    except (UserError, ComputationError, RuntimeError, ValueError) as error:
        return said | {"cause": "failed", "said": str(error)[:200]}
    return said | shares | {"cause": cause_of(shares), "seconds": time.monotonic() - began}


def cause_of(shares: dict[str, float]) -> str:
    """What stands in the way, by the shares of the excess explained."""
    return next((cause for name, cause in CAUSES.items() if shares[name] >= ASKED), "form")


def explained_by(base: Fit, judge: Judge, name: str) -> dict[str, float]:
    """Share of the base model's held-out excess explained with the right effect, by the runs that it was fitted to."""
    refitter = Refitter(list(KNOWN))
    standing = judge.trial(base)
    ends = [judge.trial(one, name) for one in _ends(base, standing, refitter, name)]
    chosen = best_end(ends, judge)
    luckiest = min(ends, key=lambda end: end.whole)
    everything = (*base.runs, *judge.held)
    joint = [refitter.on(end.fit, everything) for end in (chosen, luckiest)]
    sharper = [refitter.sharper(one) for one in joint]
    best = min((judge.trial(one, name) for one in (*joint, *sharper)), key=lambda end: end.whole)
    # the floor of the best model is the lowest, as in a diagnosis
    judge = judge.again(min((chosen, luckiest, best), key=lambda end: end.error), standing)
    excess = judge.judged(standing).whole - 1.0
    found = {"training": chosen, "any start": luckiest, "all runs": best}
    return {what: 1.0 - (judge.judged(end).whole - 1.0) / excess for what, end in found.items()}


def _ends(base: Fit, standing: Trial, refitter: Refitter, name: str) -> Iterator[Fit]:
    """Refits of the base model with the effect from several starts, the best of them followed further."""
    (score,) = screen(base, [KNOWN[name]], list(KNOWN))
    starts = [score.whole_start, *(typical_start(standing, score, size) for size in SIZES)]
    ways: tuple[dict[str, Any], ...] = ({}, {"way": 1.0, "anew": True}, {"cold": True})
    asked = [Asked(score.effect, start, score.gain, **way) for start in starts for way in ways]
    made = [make() for _, make in refitter.each(base, asked)]
    yield from made
    best = min(made, key=lambda one: one.relaxed_cost)
    yield from (refitter.sharper(best), refitter.completed(best))


def asking(path: Path) -> list[dict[str, Any]]:
    """Rows of the result file that ask for an examination."""
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    return [
        row
        for row in rows
        if len(row["names"]) == 1 and row["category"] in {"servo", "bench", "within", "varied"}
        and row.get("error_before", 0.0) >= LEAST_ERROR and row["explained"] < ASKED
    ]  # fmt: skip


def main() -> None:
    """Examine the cases of a result file, and count what stands in the way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", help="result files of hidden_effects.py")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    rows = [row for path in given.results for row in asking(path)]
    counts: Counter[tuple[str, str]] = Counter()
    with ProcessPoolExecutor(given.workers) as pool:
        for row, found in zip(rows, pool.map(examined, rows), strict=True):
            counts[row["category"], found["cause"]] += 1
            shares = [f"{name} {found[name]:.2f}" for name in ("named", *CAUSES) if np.isfinite(found.get(name, np.nan))]
            print(f"{found['key']:58s} {found['verdict']:9s} {', '.join(shares)}: {found['cause']}", flush=True)
    print("\n".join(f"{category:8s} {cause:12s} {count:4d}" for (category, cause), count in sorted(counts.items())))


if __name__ == "__main__":
    main()
