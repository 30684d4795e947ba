"""Recordings too slow to show break-away: what a fit to them leaves is no evidence of a missing force or friction."""

from __future__ import annotations

import numpy as np

from pneuid.estimation.first_guess import first_guess, motions, typical_presliding
from pneuid.estimation.fit import Fit
from pneuid.step import fastest_rates

FEWEST = 3.0
"""Samples per swing of the load on its bristles below which fits of break-away end anywhere: of 39 random rigs that lack
nothing, five of the nine with fewer have no exact fit and a defect of the force above noise, none of the others has."""

TOO_SLOW = (
    "{rate:.0f} Hz are {samples:.1f} samples per swing of the load on its bristles: such recordings do not show break-away, "
    "the fit is not exact, and no force or friction is judged; record at {wanted:.0f} Hz or more"
)


def too_slow(found: Fit) -> str | None:
    """In words that the runs of a fit without an exact end are too slow to judge what acts on the piston; else None.

    Where an effect is missing the stiffness found may be far too high; one beyond what is typical of the static friction that
    the data show does not count.
    """
    plant, values = found.plant, found.values
    if found.exact is not None or not plant.servo or plant.law.static:
        return None
    guess = first_guess(plant, found.runs, motions(found.runs))
    usual = typical_presliding(plant, guess.get("Fs", guess["Fc"]))["sigma0"]
    softest = {**values, "sigma0": min(values["sigma0"], usual)}
    dt = max(float(np.median(run.data[0])) for run in found.runs)
    swing = 2.0 * np.pi / fastest_rates(plant, plant.theta(softest, found.ranges))["bristle"]
    if swing / dt >= FEWEST:
        return None
    return TOO_SLOW.format(rate=1.0 / dt, samples=swing / dt, wanted=2.0 * FEWEST / swing)
