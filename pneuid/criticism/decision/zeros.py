"""What a reading of the sensors at zero says of candidates that shift a sensor by a constant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.criticism.decision.acceptance import Tried
from pneuid.criticism.refitting.trial import Trial
from pneuid.criticism.screening.scores import Score
from pneuid.effect import Effect
from pneuid.estimation.fit import Fit
from pneuid.zero_reading import ZeroReading, shown_with

SURE = 3.0
"""Standard deviations by which a sensor must be off for the reading to show it, and a fit for the two to differ."""

PART = 0.25
"""Share of what a fit asks for by which the reading may differ: a constant takes up some of whatever else the model lacks."""

READ = "zero reading {}: {}"
NONE_OF = "{} ruled out: the sensor shows none"
OTHER = "{} ruled out: these runs ask for {}, the sensor shows {}"
TAKE_OFF = "; that is not next to nothing: take it off in rig.toml ([columns], offset) and identify again"
HELD = (
    "{} is {} in the model, the sensor shows {}: there it stands in for something else; identify without it (--drop) and "
    "diagnose again"
)
AGREES = "the zero reading shows what these runs ask for: {} of {}, whatever else acts like it"


def shifted(effect: Effect) -> str | None:
    """The signal that an effect shifts by a constant; None for any other effect."""
    return effect.equation.removeprefix("sensor_") if effect.constant and effect.equation.startswith("sensor_") else None


@dataclass(frozen=True)
class Zeros:
    """A zero reading as evidence; without one (``reading`` None) nothing is ruled out or confirmed."""

    reading: ZeroReading | None = None

    def left(self, catalogue: Mapping[str, Effect]) -> dict[str, Effect]:
        """The catalogue without the shifts of sensors whose zero is right."""
        return {name: effect for name, effect in catalogue.items() if name not in self._absent(catalogue.values())}

    def possible(self, tried: Tried) -> Tried:
        """Those tried whose shift is not another one than the reading shows."""
        return [pair for pair in tried if not self.contradicts(pair[1].fit, pair[0].effect)]

    def confirms(self, fit: Fit, effect: Effect) -> bool:
        """Whether the reading shows the shift that a fit with this effect asks for."""
        return self._agreement(fit, effect) is True

    def contradicts(self, fit: Fit, effect: Effect) -> bool:
        """Whether the reading shows another shift than a fit with this effect asks for."""
        return self._agreement(fit, effect) is False

    def deny(self, fit: Fit) -> bool:
        """Whether the reading contradicts any effect of a fit."""
        return any(self.contradicts(fit, effect) for effect in fit.plant.effects)

    def preferred(self, chosen: tuple[Score, Trial], rivals: Tried) -> tuple[Score, Trial]:
        """Of effects that these data do not tell apart the one that the reading shows, else the chosen one."""
        return next((pair for pair in (chosen, *rivals) if self.confirms(pair[1].fit, pair[0].effect)), chosen)

    def said(self, catalogue: Mapping[str, Effect], fit: Fit, refused: Mapping[str, Fit]) -> list[str]:
        """Sentences on what was read, and on what that rules out or shows.

        fit : with what was named; refused : fits by the name of the effect that they were not accepted with for it.
        """
        if self.reading is None:
            return []
        standing = {effect.name: effect for effect in fit.plant.effects}
        absent = [name for name in self._absent(catalogue.values()) if name not in standing]
        words = [READ.format(self.reading.name, self.reading), *([NONE_OF.format(", ".join(absent))] if absent else [])]
        for name, other in refused.items():
            if name not in standing:
                asked, zero, much = _compared(self.reading, other, catalogue[name])
                words.append(OTHER.format(name, asked, zero) + (TAKE_OFF if much else ""))
        for effect in standing.values():
            if self.contradicts(fit, effect):
                words.append(HELD.format(effect.name, *_compared(self.reading, fit, effect)[:2]))
            elif self.confirms(fit, effect):
                words.append(AGREES.format(effect.name, _compared(self.reading, fit, effect)[0]))
        return words

    def _absent(self, effects: Iterable[Effect]) -> Sequence[str]:
        """Names of shifts of sensors whose zero is right."""
        zeros = {} if self.reading is None else self.reading.zeros
        read = [(effect.name, zeros[signal]) for effect in effects if (signal := shifted(effect) or "") in zeros]
        return [name for name, zero in read if abs(zero.value) < SURE * zero.std]

    def _agreement(self, fit: Fit, effect: Effect) -> bool | None:
        """Whether reading and fit agree; None where the effect shifts no sensor that was read, or the fit lacks it."""
        zero = None if self.reading is None else self.reading.zeros.get(shifted(effect) or "")
        if zero is None or effect.name not in {other.name for other in fit.plant.effects}:
            return None
        value, std = shift_of(fit, effect)
        return bool(abs(zero.value - value) < max(SURE * np.hypot(zero.std, std), PART * abs(value)))


NOTHING_READ = Zeros()
"""What is known where no zero reading was taken."""


def _compared(reading: ZeroReading, fit: Fit, effect: Effect) -> tuple[str, str, bool]:
    """The shift in a fit and what the sensor shows, in words, and whether that is much beside it."""
    signal = str(shifted(effect))
    (value, std), zero = shift_of(fit, effect), reading.zeros[signal]
    return shown_with(signal, value, std), shown_with(signal, zero.value, zero.std), abs(zero.value) > PART * abs(value)


def shift_of(fit: Fit, effect: Effect) -> tuple[float, float]:
    """The shift in a fit and its standard error, SI; none of a relaxed fit, which knows no error."""
    (name,) = (item.name for item in effect.parameters(fit.plant.rig, fit.plant.law))
    errors = {} if fit.spread is None else dict(zip(fit.problem.free, fit.spread.std, strict=True))
    return fit.values[name], float(errors.get(name, 0.0))
