"""A zero reading as the next experiment: which rivals it tells apart, how surely, and what it would show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pneuid.criticism.decision.zeros import shift_of, shifted
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.estimation.noise import noise_from_roughness
from pneuid.signals import PRESSURES
from pneuid.zero_reading import mean_error, shown_with

HOW = {"p": "both chambers vented", "F": "nothing pulling on the force sensor"}


@dataclass(frozen=True)
class Expected:
    """What one sensor would show at zero if its shift were what is missing: ``value``, known to ``std``, SI."""

    signal: str
    value: float
    std: float

    @property
    def separation(self) -> float:
        """Twice the log of the likelihood ratio of shift and none."""
        return (self.value / self.std) ** 2


def expected(fits: Sequence[Fit], effects: Sequence[Effect]) -> list[Expected | None]:
    """What a zero reading would show of each rival; None for one that shifts no sensor."""
    found: list[Expected | None] = []
    for fit, effect in zip(fits, effects, strict=True):
        signal = shifted(effect)
        if signal is None:
            found.append(None)
            continue
        noise = fit.noise.get(signal) or noise_from_roughness(fit.runs[0].recording.signals[signal])
        found.append(Expected(signal, shift_of(fit, effect)[0], mean_error(noise)))
    return found


def told(one: Expected | None, other: Expected | None) -> float:
    """By how much a zero reading tells two rivals apart, whichever is right: each shift shows, or does not."""
    return sum(item.separation for item in (one, other) if item is not None)


def asked_for(signals: Sequence[str]) -> str:
    """How the reading of these signals is taken."""
    both = [HOW["p"]] if any(signal in PRESSURES for signal in signals) else []
    return f"a zero reading ({', '.join([*both, *([HOW['F']] if 'F' in signals else [])])}, some seconds recorded)"


def would_show(seen: Mapping[str, Expected | None]) -> str:
    """What the reading would show if each of the rivals, by name, were what is missing."""
    shifts = [f"{item.signal} {shown_with(item.signal, item.value)}" for item in seen.values() if item is not None]
    others = [name for name, item in seen.items() if item is None]
    none = f", and none for {' or '.join(others)}" if others else ""
    return f"it would show {' or '.join(shifts)}{none}"
