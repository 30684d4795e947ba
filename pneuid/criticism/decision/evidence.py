"""What the ranking says of an effect: as it was screened, and as its refit ended."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from pneuid.criticism.decision.diagnosis import Candidate
from pneuid.criticism.decision.leftover import explained_share
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score
from pneuid.estimation.fit import comparable_costs


def as_screened(score: Score) -> Candidate:
    """The effect before any refit."""
    return Candidate(score.effect.name, score.effect.equation, score.gain, indistinguishable_from=score.group)


def as_refitted(score: Score, trial: Trial, current: Trial, first: Trial) -> Candidate:
    """The effect once its ``trial`` is there, beside the model of ``current``; the excess is that of ``first``."""
    return Candidate(
        effect=score.effect.name, equation=score.effect.equation, screen_gain=score.gain,
        hold_out_error_ratio=float(np.sqrt(trial.whole / current.whole)) if np.isfinite(trial.whole) else None,
        excess_explained=explained_share(current, trial, first),
        p_value=chance(score, trial, current), indistinguishable_from=score.group,
    )  # fmt: skip


def chance(score: Score, trial: Trial, current: Trial) -> float:
    """Probability that white noise alone lowers the cost as much as the refit did (likelihood ratio: Wilks, Ann. Math. Stat. 9
    (1938) 60)."""
    now, after = comparable_costs(current.fit, trial.fit)
    return float(chi2.sf(max(2 * (now - after), 0.0), max(score.freedom, 1)))


def leading(scores: Sequence[Score]) -> str:
    """The first three of a screening, in words."""
    shown = ", ".join(f"{score.effect.name} {100 * score.gain:.1f} %" for score in scores[:3])
    return f"screening predicts these drops of the cost: {shown}" if scores else "no candidate left to screen"
