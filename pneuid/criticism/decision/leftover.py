"""What a model leaves of the held-out runs, and whether noise and open parameters excuse it."""

from __future__ import annotations

import numpy as np

from pneuid.criticism.comparison.defects import equation_defects
from pneuid.criticism.refitting.trial import Judge, Trial

DEFECT_RATIO = 1.5
"""Defect of a balance over what noise alone leaves, below which nothing unknown can be named in any equation."""

FAR_OFF = 3.0
"""Error on the training runs, in floors, from which what they leave open of the parameters is no excuse for the held-out error,
where a balance leaves a defect above noise as well; of the held-out runs, from which second looks need no such balance."""


def loudest(trial: Trial) -> float:
    """Largest defect of a balance over what noise alone leaves; on a bench, which has no such defects, that of the force."""
    ratios = [item.rms / max(item.expected_rms, 1e-12) for item in equation_defects(trial.fit)]
    return max(ratios, default=float(np.sqrt(trial.error)))


def explained_away(trial: Trial, judge: Judge) -> bool:
    """Whether noise, and what the training runs leave open of the parameters, are all that the held-out error needs.

    What training runs that the model cannot follow leave open is no excuse.
    """
    if trial.fit.lacking and trial.error - 1.0 >= judge.small:
        return False
    unlearned = judge.fits(trial) > FAR_OFF**2 and loudest(trial) > DEFECT_RATIO
    return judge.explains(trial) and not unlearned


def explained_share(before: Trial, after: Trial, first: Trial) -> float:
    """Share of the base model's excess that the step from ``before`` to ``after`` removes."""
    excess = first.whole - 1.0
    return float((before.whole - after.whole) / excess) if excess > 0 and np.isfinite(after.whole) else 0.0
