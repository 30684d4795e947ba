"""The procedure of the 2011 study from raw bench runs to pressure laws, and the start it gives to the joint fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pneuid.estimation.bench.laws import TARGETS, Law, pressure_laws
from pneuid.estimation.bench.presliding import Presliding, damping, presliding
from pneuid.estimation.bench.steady import Condition, Value, conditions
from pneuid.estimation.noise import sensor_noise
from pneuid.recording import Recording
from pneuid.rig import Rig

XI = 0.45
"""Damping ratio where none is stated: the middle of the 0.2 to 0.7 that the study calls usual."""

LOWEST_VS = 2.0e-4
"""Floor of vs in the pressure laws, m/s (contract)."""


@dataclass(frozen=True)
class Study:
    """Result of the classic route, SI.

    conditions, presliding : one per pressure pair, same order; laws : by coefficient; sigma0, sigma1 : over all pairs,
    None where no reversal is resolved; held_out : pressure pairs kept from the laws; xi : damping ratio assumed.
    """

    rig: Rig
    conditions: tuple[Condition, ...]
    presliding: tuple[Presliding, ...]
    laws: dict[str, Law]
    sigma0: Value | None
    sigma1: Value | None
    held_out: tuple[Condition, ...]
    xi: float

    def steady(self, v: np.ndarray, p1: float, p2: float) -> np.ndarray:
        """Steady friction (N,) in N by the laws at speeds ``v`` (m/s) and pressures (Pa, absolute)."""
        at = {name: float(law.at(p1 - self.rig.patm, p1 - p2)) for name, law in self.laws.items()}
        Fc = max(at["Fc"], 0.0)
        Fs, vs = max(at.get("Fs", Fc), Fc), max(at.get("vs", LOWEST_VS), LOWEST_VS)
        level = Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2))
        return np.asarray(level * np.sign(v) + max(at.get("sigma2", 0.0), 0.0) * v)

    def coefficients(self) -> dict[str, Value]:
        """Base values at zero gauge, k1..k8, sigma0, sigma1: those that were found."""
        found = {}
        for target, (ps, dp) in TARGETS.items():
            law = self.laws.get(target)
            if law is None:
                continue
            found[target] = law.base
            found |= {name: value for name, value in ((ps, law.ps), (dp, law.dp)) if value is not None}
        if self.sigma0 is not None and self.sigma1 is not None:
            found |= {"sigma0": self.sigma0, "sigma1": self.sigma1}
        return found


def classic_route(rig: Rig, runs: Sequence[Recording], hold_out: Sequence[Recording] = (), xi: float = XI) -> Study:
    """The 2011 procedure on ``runs``; ``hold_out`` gives the pressure pairs for its verification.

    ``xi`` is the damping ratio of eq. 11. Raises ``UserError`` where no run has a constant-velocity section.
    """
    noise = position_noise(rig, [*runs, *hold_out])
    met = tuple(conditions(rig, runs, noise))
    slid = tuple(presliding(rig, item, runs, noise) for item in met)
    laws = pressure_laws(met, rig.patm)
    sigma0 = _mean([item.sigma0 for item in slid if item.sigma0 is not None])
    sigma1 = None
    if sigma0 is not None:
        viscous = laws["sigma2"].base.value if "sigma2" in laws else 0.0
        sigma1 = damping(sigma0, viscous, rig.mass, xi)
    held = tuple(conditions(rig, hold_out, noise)) if hold_out else ()
    return Study(rig, met, slid, laws, sigma0, sigma1, held, xi)


def position_noise(rig: Rig, runs: Sequence[Recording]) -> float:
    """1-sigma of the position, m: the rig's, else from the data's roughness; not below a tenth of a ppm of the range."""
    span = max(float(np.ptp(run.signals["x"])) for run in runs)
    return max(sensor_noise(rig.noise, {"x": [run.signals["x"] for run in runs]})["x"], 1e-7 * span)


def _mean(values: Sequence[Value]) -> Value | None:
    """Mean over pressure pairs, its standard error from their scatter."""
    if not values:
        return None
    y = np.array([item.value for item in values])
    if y.size == 1:
        return values[0]
    return Value(float(np.mean(y)), float(np.std(y, ddof=1) / np.sqrt(y.size)))
