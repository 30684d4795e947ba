"""Rivals of an effect: others that explain as much of the held-out runs and of the training runs."""

from __future__ import annotations

from pneuid.criticism.all_runs import SURE, TELLING
from pneuid.criticism.rounds import Tried, costs
from pneuid.criticism.screening import Score
from pneuid.criticism.trial import Judge, Trial


def alike(chosen: tuple[Score, Trial], tried: Tried, current: Trial, judge: Judge) -> Tried:
    """Effects that explain the held-out runs and the training runs about as well as the chosen one.

    Where that one leaves noise alone, so must they.
    """
    excess = max(current.error - 1.0, 1e-12)
    clean = chosen[1].error - 1.0 < judge.small

    def close(trial: Trial) -> bool:
        before, best, other = costs(current, chosen[1], trial)
        ahead = (trial.error - chosen[1].error) / excess < TELLING
        ahead = ahead and (trial.error - 1.0 < judge.small or not clean)
        return ahead and other - best < max(TELLING * (before - best), SURE)

    return [pair for pair in tried if close(pair[1])]


def contains(one: tuple[Score, Trial], other: tuple[Score, Trial], current: Trial) -> bool:
    """Whether the first effect is the second one in a limit, and gains nothing by being more.

    Of two friction laws the one with more parameters explains whatever the other one does.
    """
    if one[0].effect.richer_law and other[0].effect.richer_law:
        return len(one[1].fit.plant.parameters) > len(other[1].fit.plant.parameters)
    _, cost, plain = costs(current, one[1], other[1])
    return other[0].effect.name in one[0].effect.contains and plain - cost < SURE


def alike_in_training(tried: Tried, current: Trial) -> list[bool]:
    """Which of the trials fit the training runs about as well as the best of them."""
    gains = [now - after for _, trial in tried for now, after in [costs(current, trial)]]
    best = max(gains, default=0.0)
    return [gain >= best - max(TELLING * best, SURE) for gain in gains]
