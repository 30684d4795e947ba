"""Cost of screening the whole catalogue, warm, in passes of the interval function with derivatives over the same runs.

Both are timed in turn in one run, so that what else the machine does counts for both; the first screening, which derives and
builds the functions, is reported apart.
"""

from __future__ import annotations

import argparse
from timeit import timeit

import numpy as np
from hidden_cases import KNOWN, Case
from hidden_runs import runs_of

from pneuid import api
from pneuid.criticism.screening.scores import screen
from pneuid.estimation.fit import Fit, fit

CASES = {
    "servo": Case("servo", "default", ("gravity",), "strong", 1),
    "bench": Case("bench", "default", ("friction_position",), "strong", 1),
}


def measured(base: Fit, repeats: int) -> tuple[float, list[float], list[float]]:
    """The first screening, then warm screenings and passes in turn, s."""
    problem, X = base.problem, base.relaxed.X

    def screened() -> None:
        screen(base, list(KNOWN.values()), list(KNOWN))

    cold = timeit(screened, number=1)
    problem.evaluate(X)
    pairs = [(timeit(screened, number=1), timeit(lambda: problem.evaluate(X), number=1)) for _ in range(repeats)]
    return cold, [one for one, _ in pairs], [two for _, two in pairs]


def main() -> None:
    """Print one line per kind of rig."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    for kind, case in CASES.items():
        train, _, rig = runs_of(case)
        base = fit(api.plant_of(rig), train, exact=False)
        cold, warm, passes = measured(base, given.repeats)
        ratio = float(np.median(np.array(warm) / np.array(passes)))
        print(
            f"{kind}: {sum(run.n for run in base.runs)} samples, {len(KNOWN)} effects known; warm {np.median(warm):.2f} s, "
            f"a pass {np.median(passes):.3f} s: {ratio:.1f} passes; the first screening {cold:.1f} s"
        )


if __name__ == "__main__":
    main()
