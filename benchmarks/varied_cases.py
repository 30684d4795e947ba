"""Cases of ``hidden_effects.py`` in which all is drawn: the rig, the excitations, the strength and the form of what hides.

The form is drawn whole, with every constant of the hidden equations (``virtual_rig.forms``). No rule of the diagnosis was
made on them; they show what it is worth off the beaten track.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pneuid.virtual_rig import (
    EXCITATIONS,
    Hidden,
    Motion,
    RandomBench,
    RandomServo,
    drawn_form,
    in_proportion,
    random_bench,
    random_servo,
    reciprocation,
    sine,
    strokes,
)

RATES = (500.0, 2000.0)
"""Lowest and highest rate [Hz] of the loggers: at 100 Hz most effects do not show."""

BORES = (0.016, 0.125)  # m


@dataclass(frozen=True)
class Run:
    """One run to record: the excitation, and the supply over the rig's highest."""

    excitation: str
    supply: float


def drawn_servo(seed: int) -> RandomServo:
    """The first random rig of ``seed``, and its successors, within the bores, at a rate within the rates."""
    drawn = next(
        rig for rig in (random_servo(seed + 100_000 * k) for k in range(100)) if BORES[0] <= rig.truth.bore <= BORES[1]
    )
    return replace(drawn, rate=float(np.clip(drawn.rate, *RATES)))


def drawn_bench(seed: int) -> RandomBench:
    """The first random bench of ``seed``, and its successors, within the bores."""
    return next(
        rig for rig in (random_bench(seed + 100_000 * k) for k in range(100)) if BORES[0] <= rig.truth.bore <= BORES[1]
    )


def drawn_hidden(hidden: Hidden, bore: float, seed: int) -> Hidden:
    """``hidden``, the strong preset of the default rig, at a third to the whole of its strength and with another form."""
    rng = np.random.default_rng((seed, 11))
    share = 3.0 ** rng.uniform(-1.0, 0.0)
    nothing, places = Hidden(), {
        "pressure_reference": rng.uniform(2e5, 4e5), "pressure_saturation": rng.uniform(4.5e5, 8e5),
        "bump_at": rng.uniform(0.35, 0.65), "bump_width": rng.uniform(0.05, 0.12), "taper": rng.uniform(0.15, 0.45),
        "gravity_incline_share": rng.uniform(0.3, 0.9), "leak_critical_ratio": rng.uniform(0.15, 0.5),
        "supply_tank": 0.4e-3 * 2.0 ** rng.uniform(-1.0, 1.0), "backlash_load_share": rng.uniform(0.5, 0.9),
        "cogging_pitch": rng.uniform(0.03, 0.08), "relief_at": rng.uniform(2e5, 4e5), "clamp_at": rng.uniform(1.5e5, 3.5e5),
    }  # fmt: skip
    kept = {
        name: value * (share if name not in ("supply_droop", "exhaust_restriction", "end_cushion") else share**0.5)
        for name, value in vars(hidden).items()
        if value != getattr(nothing, name)
    }  # the fall of pressure grows with the square of the flow; a cushion has to be longer than the end stops are soft
    return in_proportion(replace(nothing, form=drawn_form(rng), **(places | kept)), bore)


def drawn_plan(seed: int) -> list[Run]:
    """Three training runs, one of them to the ends, and two held-out ones."""
    rng = np.random.default_rng((seed, 12))
    others = [name for name in EXCITATIONS if name != "travel"]
    train = ["travel", *rng.choice(others, 2, replace=False)]
    held = rng.choice(list(EXCITATIONS), 2, replace=False)
    return [Run(str(name), float(share)) for name, share in zip([*train, *held], rng.uniform(0.45, 1.0, 5), strict=True)]


def drawn_motions(seed: int) -> list[tuple[Motion, float, float]]:
    """Motion and the two pressures [Pa gauge] of three training runs and two held-out ones on a bench."""
    rng = np.random.default_rng((seed, 13))

    def one(kind: str) -> Motion:
        if kind == "reciprocation":
            return reciprocation(rng.uniform(0.3e-3, 1.0e-3), rng.uniform(0.3e-3, 1.5e-3), turning=0.04)
        if kind == "sine":
            return sine(rng.uniform(0.01, 0.08), rng.uniform(0.3, 1.5), cycles=3)
        speeds = np.exp(rng.uniform(np.log(4e-4), np.log(0.2), 4)).tolist()
        return strokes(speeds, travel=rng.uniform(0.1, 0.2), longest=0.8, dwell=float(np.exp(rng.uniform(np.log(0.1), 0.0))))

    kinds = ["strokes", "reciprocation", str(rng.choice(["strokes", "sine"])), "strokes", "sine"]
    return [(one(kind), float(rng.uniform(0.0, 6e5)), float(rng.uniform(0.0, 6e5))) for kind in kinds]
