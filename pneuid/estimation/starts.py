"""Other starts of a fit that did not lead to a good end: each is made for one weak point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pneuid.estimation.first_guess import TYPICAL_VS, typical_damping, typical_presliding
from pneuid.plant import Plant

SOFTER = {"sigma0": 0.3, "sigma1": 0.6, "vs": 2.0}
"""Another start of the pre-sliding parameters, relative to the first, tried where that one does not lead to an exact fit."""

PEAK = 1.7
"""Most of the static friction over Coulomb friction from which the exact stage is started again; typical of a seal."""

AGAIN = ((5.0, 0.6), (3.0, 1.2))
"""Factor by which the Stribeck velocity is raised for that, and micro-viscous damping over the root of stiffness times mass:
wide peaks with much damping."""

SOFT = 3.0
"""Factor by which the bristle is made softer in the last of these starts."""

HIGH, NARROW = 3.0, 3.0e-3
"""Static over Coulomb friction, and Stribeck velocity in m/s, from which break-away under laws of pressure starts as well:
where it is so, a fit from a low and wide one flattens the peak and bends the laws of the Stribeck velocity instead."""

DEFLECTIONS = (50e-6, 20e-6)
"""Deflections in m at which seals break away, from which tight defects find the right parameters; the softest first, for loose
defects often end too stiff."""

LOWEST_PEAK, TYPICAL_PEAK = 1.1, 1.6
"""Lowest and typical static friction over Coulomb friction."""

Values = Mapping[str, float]


def softer(plant: Plant, guess: Values) -> dict[str, float]:
    """Values (SI) of a start with softer pre-sliding than ``guess``; empty for a law that has none."""
    return {} if plant.law.static else {name: guess[name] * share for name, share in SOFTER.items() if name in guess}


def from_far(plant: Plant, guess: Values, best: Values, turn: int) -> dict[str, float]:
    """Softer pre-sliding; on the next turn, from the ``best`` values that this found, a typical one.

    A stiffness too high at the start puts every break-away too early, and the Stribeck curve then bends to excuse it, which
    looks like a missing effect. From a soft start the curve is found; where that helped, the stiffness starts once more.
    """
    if turn == 0:
        return softer(plant, guess)
    fresh = typical_presliding(plant, best.get("Fs", best["Fc"]))
    return {**best, **{name: value for name, value in fresh.items() if name in best}}


def seals(plant: Plant, values: Values) -> list[dict[str, float]]:
    """``values`` (SI) with the break-away of typical seals, of two deflections each, the softer first: with the peak that they
    have, within what seals have, and with a typical one. Laws of break-away keep their peak.
    """
    own = float(np.clip(values.get("Fs", values["Fc"]), LOWEST_PEAK * values["Fc"], HIGH * values["Fc"]))
    laws = any(effect.break_away(values, HIGH) for effect in plant.effects)
    typical = {} if laws or "Fs" not in values else {"Fs": TYPICAL_PEAK * values["Fc"], "vs": TYPICAL_VS}
    peaks = [{"Fs": own}, typical] if typical else [{}]
    every = [
        peak | typical_presliding(plant, peak.get("Fs", own), deflection) for peak in peaks for deflection in DEFLECTIONS
    ]
    return [{**values, **{name: value for name, value in one.items() if name in values}} for one in every]


def damped(plant: Plant, values: Values) -> dict[str, float]:
    """``values`` (SI) with the micro-viscous damping of a typical seal of their stiffness."""
    if "sigma1" not in values:
        return dict(values)
    return {**values, "sigma1": typical_damping(plant, values["sigma0"])}


def break_aways(plant: Plant, relaxed: Values) -> Iterator[dict[str, float]]:
    """Values (SI) that start the exact stage again where the ``relaxed`` ones do not lead to a good end, by their names.

    The relaxed fit hardly sees a break-away: its jumps between intervals take up what a peak of friction does. It may end
    at one ten times too high and narrow, with next to no damping, all else being right; from a wide one with damping the exact
    stage finds its way. The last one has a softer bristle.
    """
    if plant.law.static:
        return
    for wider, damping in AGAIN if "sigma1" in relaxed else ():
        found = {"sigma1": damping * float(np.sqrt(relaxed["sigma0"] * plant.rig.mass))}
        if "Fs" in relaxed:
            found |= {"Fs": min(relaxed["Fs"], PEAK * relaxed["Fc"]), "vs": wider * relaxed["vs"]}
        yield found
    softer_ones = {"sigma0": SOFT, "sigma1": np.sqrt(SOFT)}
    yield {name: float(relaxed[name] / share) for name, share in softer_ones.items() if name in relaxed}


def from_sliding(plant: Plant, slid: Values) -> list[dict[str, float]]:
    """Starts from the laws of sliding friction (``slid``, all parameters): with the break-away that these values have, and with
    a high and narrow peak that follows the laws of sliding. None where no effect gives break-away a law of its own.

    A seal whose static friction is half as large again is found from the first, the one of 2011, five times as large and all
    but gone at 2 mm/s, from the second.
    """
    laws = {name: value for effect in plant.effects for name, value in effect.break_away(slid, HIGH).items()}
    if not laws or "Fs" not in slid:
        return []
    return [dict(slid), {**slid, "Fs": HIGH * slid["Fc"], "vs": NARROW, **laws}]
