"""Steady friction: points from constant-velocity sections, one curve per pressure pair (eq. 5 to 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import f as f_distribution

from pneuid.errors import UserError
from pneuid.estimation.bench.sections import LEAST_SAMPLES, LEAST_TRAVEL, constant_velocity_sections
from pneuid.physics.motion import GRAVITY, pressure_force
from pneuid.recording import Recording
from pneuid.rig import Rig

SAME_PRESSURE = 20.0e3
"""Mean pressures closer together than this are one condition, Pa."""

STRAIGHT_ABOVE = 0.03
"""Speed in m/s above which the study takes the curve for straight."""

CREEP = 0.5e-3
"""Speed in m/s below which the study takes the mean force for Fs."""

SAME_SPEED = 0.05
"""Speeds closer together than this share are one."""

LEAST_SPEEDS = 5
LEAST_RATIO = 4.0
"""Fewer different speeds, or a smaller ratio of the largest to the smallest, show no Stribeck curve."""

LONG_ENOUGH = 0.5
"""Sections shorter than this share of the longest at their speed are left out: friction may not have settled in them."""

XATOL, FATOL, LONGEST = 1e-9, 1e-14, 4000
"""Where the simplex search ends: parameters relative to their start, sum of squares in N^2, iterations."""

DOUBT = 1e-3
"""Probability of the falling part by chance above which it is not taken for seen."""


@dataclass(frozen=True)
class Point:
    """Mean friction of one section: ``v`` (m/s, signed), ``force`` (N, with the sign of ``v``), ``scatter`` its standard
    deviation over the section (N), mean pressures (Pa absolute), samples averaged, ``travel`` of the whole section (m)."""

    run: str
    v: float
    force: float
    scatter: float
    p1: float
    p2: float
    samples: int
    travel: float


@dataclass(frozen=True)
class Value:
    """An estimate and its standard error, SI."""

    value: float
    std: float


@dataclass(frozen=True)
class Condition:
    """One pressure pair: its runs, its points and the coefficients of eq. 5 that they show.

    p1, p2 : mean measured pressures (Pa, absolute); Fc, Fs (N), vs (m/s), sigma2 (N s/m), each None where these data do
    not show it; offset : constant force (N), None with one direction only; rms : of the residual, N; verdict : in words.
    """

    runs: tuple[str, ...]
    p1: float
    p2: float
    points: tuple[Point, ...]
    Fc: Value
    Fs: Value | None
    vs: Value | None
    sigma2: Value | None
    offset: Value | None
    rms: float
    verdict: str

    def steady(self, v: np.ndarray) -> np.ndarray:
        """Fitted steady friction (N,) in N at speeds ``v`` (m/s), offset left out; eq. 8."""
        level = np.full(v.shape, self.Fc.value)
        if self.Fs is not None and self.vs is not None:
            level += (self.Fs.value - self.Fc.value) * np.exp(-((v / self.vs.value) ** 2))
        viscous = 0.0 if self.sigma2 is None else self.sigma2.value
        return np.asarray(level * np.sign(v) + viscous * v)


def friction_of(rig: Rig, run: Recording) -> np.ndarray:
    """Force balance without inertia (N,) in N: what resists steady motion in +x; eq. 6. Gravity on the incline is taken off."""
    still = np.full(run.n, rig.patm)
    p1, p2 = run.signals.get("p1", still), run.signals.get("p2", still)
    mass = rig.run(run.name).mass or rig.mass
    weight = mass * GRAVITY * np.sin(rig.incline)
    return np.asarray(run.signals["F"] + pressure_force(p1, p2, rig.A1, rig.A2, rig.patm) - weight)


def steady_points(rig: Rig, run: Recording, noise: float) -> list[Point]:
    """One point per constant-velocity section; ``noise`` of the position, m, 1-sigma."""
    force = friction_of(rig, run)
    still = np.full(run.n, rig.patm)
    used = np.asarray(run.weights["F"] * run.weights["x"] > 0.0)
    found = []
    for section in constant_velocity_sections(run.t, run.signals["x"], noise):
        inside = np.zeros(run.n, dtype=bool)
        inside[section.middle] = True
        inside &= used
        if not inside.any():
            continue
        p1, p2 = (float(np.mean(run.signals.get(name, still)[inside])) for name in ("p1", "p2"))
        mean, scatter = float(np.mean(force[inside])), float(np.std(force[inside]))
        travel = abs(float(run.signals["x"][section.last - 1] - run.signals["x"][section.first]))
        found.append(Point(run.name, section.v, mean, scatter, p1, p2, int(inside.sum()), travel))
    return found


def _settled(points: Sequence[Point]) -> list[Point]:
    """The points of the longer sections at every speed and direction."""
    kept = []
    for point in points:
        alike = [other for other in points if abs(other.v - point.v) <= SAME_SPEED * abs(point.v)]
        if point.travel >= LONG_ENOUGH * max(other.travel for other in alike):
            kept.append(point)
    return kept


def conditions(rig: Rig, runs: Sequence[Recording], noise: float) -> list[Condition]:
    """Pressure pairs met in ``runs``, each with its curve, in the order of p1 and p2.

    Raises ``UserError`` where no run has a constant-velocity section.
    """
    points = [point for run in runs for point in steady_points(rig, run, noise)]
    if not points:
        names = ", ".join(run.name for run in runs)
        raise UserError(
            f"{names}: no constant-velocity section found (x straight over t for at least {LEAST_SAMPLES} samples and "
            f"{LEAST_TRAVEL * noise * 1e6:.3g} um); record strokes at steady speeds"
        )
    groups: list[list[Point]] = []
    for point in sorted(points, key=lambda item: (item.p1, item.p2)):
        for group in groups:
            if all(
                abs(np.mean([getattr(p, n) for p in group]) - getattr(point, n)) < SAME_PRESSURE for n in ("p1", "p2")
            ):
                group.append(point)
                break
        else:
            groups.append([point])
    return sorted((_condition(group) for group in groups), key=lambda item: (round(item.p1, -4), round(item.p2, -4)))


def _condition(met: Sequence[Point]) -> Condition:
    points = sorted(_settled(met), key=lambda item: item.v)
    p1, p2 = (float(np.mean([getattr(point, name) for point in points])) for name in ("p1", "p2"))
    v, force = np.array([point.v for point in points]), np.array([point.force for point in points])
    found, verdict = _coefficients(v, force)
    seen = {name: found.get(name) for name in ("Fc", "Fs", "vs", "sigma2", "offset")}
    runs = tuple(dict.fromkeys(point.run for point in met))
    level = seen.pop("Fc") or Value(0.0, 0.0)
    return Condition(runs, p1, p2, tuple(points), level, **seen, rms=found.rms, verdict=verdict)


def _coefficients(v: np.ndarray, force: np.ndarray) -> tuple[_Estimates, str]:
    """What the points show of eq. 5, and the verdict on Fs and vs; an unseen coefficient is left out."""
    speeds = _distinct(np.abs(v))
    slowest = speeds[0]
    # over a narrow range of speeds Fc and the viscous part trade with each other
    line = _linear(v, force, speeds[-1] >= LEAST_RATIO * slowest)
    if len(speeds) < LEAST_SPEEDS or speeds[-1] < LEAST_RATIO * slowest:
        word = "one speed shows" if len(speeds) == 1 else f"{len(speeds)} speeds show"
        return line, f"{word} the level of friction only: Fs and vs not seen"
    curve = _stribeck(v, force)
    freedom = max(v.size - len(curve), 1)
    gain = (line.rms**2 - curve.rms**2) / 2.0 / max(curve.rms**2 / freedom, 1e-30)
    if gain <= 0.0 or float(f_distribution.sf(gain, 2, freedom)) > DOUBT:
        return line, f"friction does not fall with speed above {slowest * 1e3:.3g} mm/s: Fs and vs not seen"
    if curve["Fs"].value <= curve["Fc"].value:
        return line, "friction rises from rest: Fs and vs not seen"
    if curve["vs"].value <= slowest:
        for name in ("Fs", "vs"):  # the curve stays, so that the slow points do not lift Fc
            del curve[name]
        return curve, f"vs lies below the slowest speed, {slowest * 1e3:.3g} mm/s: Fs and vs not seen"
    return curve, "all four coefficients seen"


class _Estimates(dict[str, Value]):
    """Coefficients by name with the rms of the residual."""

    rms: float = 0.0


def _distinct(speeds: np.ndarray) -> list[float]:
    """Different speeds, slowest first."""
    found: list[float] = []
    for speed in np.sort(speeds):
        if not found or speed > found[-1] * (1.0 + SAME_SPEED):
            found.append(float(speed))
    return found


def _estimates(names: Sequence[str], values: np.ndarray, jacobian: np.ndarray, residual: np.ndarray) -> _Estimates:
    """Standard errors from the scatter of the residual about the curve."""
    freedom = max(residual.size - len(names), 1)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * float(residual @ residual) / freedom
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = _Estimates({name: Value(float(a), float(b)) for name, a, b in zip(names, values, std, strict=True)})
    found.rms = float(np.sqrt(np.mean(residual**2)))
    return found


def _linear(v: np.ndarray, force: np.ndarray, viscous: bool) -> _Estimates:
    """``Fc sgn(v) + sigma2 v + offset`` by least squares; the offset with both directions only."""
    columns = {"Fc": np.sign(v)}
    if viscous:
        columns["sigma2"] = v
    if v.min() < 0.0 < v.max():
        columns["offset"] = np.ones(v.size)
    A = np.column_stack(list(columns.values()))
    values, *_ = np.linalg.lstsq(A, force, rcond=None)
    return _estimates(list(columns), values, A, force - A @ values)


def _starts(v: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Fc, Fs, vs, sigma2 as the study starts: the straight part above 30 mm/s, the creep force, the speed of least friction."""
    speed, level = np.abs(v), force * np.sign(v)
    straight = speed > STRAIGHT_ABOVE
    if len(_distinct(speed[straight])) < 2:
        straight = speed >= np.median(speed)
    sigma2, Fc = np.polyfit(speed[straight], level[straight], 1)
    slow = speed <= max(CREEP * (1.0 + SAME_SPEED), float(speed.min()) * (1.0 + SAME_SPEED))
    Fs, vs = float(np.mean(level[slow])), float(speed[np.argmin(level)])
    Fc = max(float(Fc), 0.05 * abs(Fs))
    return np.array([Fc, max(Fs, 1.01 * Fc), vs, max(float(sigma2), 1e-3 * Fc / float(speed.max()))])


def _curve(parameters: np.ndarray, v: np.ndarray) -> np.ndarray:
    Fc, Fs, vs, sigma2 = parameters[:4]
    offset = parameters[4] if parameters.size > 4 else 0.0
    bristle = Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2))
    return np.asarray(bristle * np.sign(v) + sigma2 * v + offset)


def _stribeck(v: np.ndarray, force: np.ndarray) -> _Estimates:
    """Eq. 5 by a simplex search on eq. 7, the sum of squares; Nelder, Mead, Computer Journal 7 (1965) 308."""
    both = bool(v.min() < 0.0 < v.max())
    centre = 0.5 * (np.mean(force[v > 0]) + np.mean(force[v < 0])) if both else 0.0
    start = _starts(v, force - centre)
    scale = np.append(start, max(0.05 * start[0], abs(centre))) if both else start

    def cost(q: np.ndarray) -> float:
        p = q * scale
        if p[2] <= 1e-3 * scale[2] or p[0] <= 0.0:
            return 1e12
        return float(np.sum((_curve(p, v) - force) ** 2))

    q = np.append(np.ones(4), centre / scale[4]) if both else np.ones(4)
    for _ in range(3):  # a restart keeps a flat simplex from ending early
        q = minimize(cost, q, method="Nelder-Mead", options={"xatol": XATOL, "fatol": FATOL, "maxiter": LONGEST}).x
    values = q * scale
    steps = 1e-6 * scale
    jacobian = np.column_stack(
        [(_curve(values + d, v) - _curve(values - d, v)) / (2 * d[k]) for k, d in enumerate(np.diag(steps))]
    )
    return _estimates(
        ["Fc", "Fs", "vs", "sigma2", "offset"][: values.size], values, jacobian, force - _curve(values, v)
    )
