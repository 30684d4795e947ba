"""The signature of an effect: how the base model responds with it and without it, in the experiment that tells most."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from pneuid.effect import Effect, Parameter
from pneuid.plant import Plant
from pneuid.rig import Rig
from pneuid.step import substep, substeps_needed

DT = 1.0e-3
"""Sampling interval of the responses, s."""

_SETTLING = 0.4
"""Time at rest with the valve closed before an experiment, s: the bristle and the effect's states find their places."""

_SENSORS = {"x": 20e-6, "p1": 500.0, "p2": 500.0, "F": 0.2}
"""Noise (SI) of ordinary sensors, which a difference has to exceed to be seen where the rig does not say."""


@dataclass(frozen=True)
class Signature:
    """Responses of a plant with and without one effect.

    values : the effect's own parameters, SI; experiment : words; t : ``(N,)`` in s; command : the exciting signal (``u`` or
    ``x``) and its course ``(N,)``; without, with_it : signal -> ``(N,)``, SI, absolute pressures; noise : 1-sigma, SI.
    """

    effect: Effect
    values: dict[str, float]
    experiment: str
    t: np.ndarray
    command: tuple[str, np.ndarray]
    without: dict[str, np.ndarray]
    with_it: dict[str, np.ndarray]
    noise: dict[str, float]

    @property
    def contrast(self) -> float:
        """Root mean square difference in noises, of the signal that shows it most; 0 where a response is not finite."""
        ratios = [
            np.sqrt(np.mean((self.with_it[name] - self.without[name]) ** 2)) / self.noise[name] for name in self.without
        ]
        return float(max(ratios)) if np.all(np.isfinite(ratios)) else 0.0


def typical_value(item: Parameter) -> float:
    """A typical value of a parameter (SI): its start for a shape, one typical size beside the off-value for an amplitude."""
    if item.off is None:
        return item.start
    return float(np.clip(item.off + item.scale, item.lower, item.upper))


def signature(effect: Effect, rig: Rig) -> Signature:
    """The signature on ``rig`` at the declared start values, in the experiment in which it stands out most.

    Raises ``ValueError`` where the effect cannot show on this kind of rig.
    """
    if rig.kind not in effect.rigs:
        raise ValueError(f"{effect.name} cannot show on a {rig.kind} rig")
    law = next(name for name in (rig.friction, *effect.laws) if name in effect.laws)
    base, plant = Plant(rig, law), Plant(rig, law, [effect])
    experiments = _servo_experiments(rig) if plant.servo else _bench_experiments(rig)
    noise = {name: rig.noise.get(name) or _SENSORS[name] for name in plant.outputs}
    own = {item.name: typical_value(item) for item in effect.parameters(rig, plant.law)}
    found = []
    for words, w in experiments.items():
        t = DT * np.arange(w.shape[1])
        without, with_it = _respond(base, {}, w), _respond(plant, own, w)
        keep = t >= _SETTLING
        cut = [{name: y[keep] for name, y in found.items()} for found in (without, with_it)]
        command = (plant.inputs[0], w[0, keep])
        found.append(Signature(effect, own, words, t[keep] - t[keep][0], command, cut[0], cut[1], noise))
    return max(found, key=lambda item: item.contrast)


def _respond(plant: Plant, own: dict[str, float], w: np.ndarray) -> dict[str, np.ndarray]:
    """Outputs ``(N,)`` over the inputs ``(nw, N)``, linear between samples, from rest at mid-stroke."""
    ranges = {"p1_low": plant.rig.patm, "p1_high": 1e6, "p2_low": plant.rig.patm, "p2_high": 1e6}
    ranges |= {"x_low": 0.0, "x_high": plant.rig.stroke if plant.servo else float(w[0].max())}
    theta = plant.theta(plant.starts() | own, ranges)
    count = max(4, substeps_needed(plant, theta, DT))
    s, now, slope = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(w)), ca.SX.sym("slope", len(w))
    shown = ca.vertcat(*(plant.evaluate(s, now, theta).outputs[name] for name in plant.outputs))
    one = ca.Function("one", [s, now, slope], [substep(plant, s, now, slope, DT / count, theta)])
    moved, part = ca.MX.sym("s", len(plant.states)), [ca.MX.sym("w", len(w)), ca.MX.sym("slope", len(w))]
    end = moved
    for j in range(count):
        end = one(end, part[0] + j * DT / count * part[1], part[1])
    sample = ca.Function("sample", [moved, *part], [end])
    slopes = np.diff(w, axis=1) / DT
    start = _at_rest(plant, w)
    states = np.column_stack([start, np.asarray(sample.mapaccum(w.shape[1] - 1)(start, w[:, :-1], slopes))])
    outputs = np.asarray(ca.Function("shown", [s, now], [shown]).map(w.shape[1])(states, w))
    return dict(zip(plant.outputs, outputs, strict=True))


def _at_rest(plant: Plant, w: np.ndarray) -> np.ndarray:
    """State at mid-stroke with chambers halfway to the supply that balance each other."""
    rig = plant.rig
    known = {own.name: own.initial for own in plant.effect_states}
    if plant.servo:
        p1 = 0.5 * (rig.patm + w[1, 0])
        known |= {"x": 0.5 * rig.stroke, "p1": p1, "p2": rig.patm + (p1 - rig.patm) * rig.A1 / rig.A2}
    return np.array([known.get(name, 0.0) for name in plant.states])


def _course(*pieces: tuple[float, float]) -> np.ndarray:
    """Samples of a polyline through ``(duration in s, value at its end)`` after settling at zero."""
    times = np.cumsum([0.0, _SETTLING, *(seconds for seconds, _ in pieces)])
    values = [0.0, 0.0, *(value for _, value in pieces)]
    return np.interp(np.arange(round(times[-1] / DT)) * DT, times, values)


def _servo_experiments(rig: Rig) -> dict[str, np.ndarray]:
    """Inputs ``(2, N)``, command in V and supply in Pa, by what they are called."""
    quick = 0.003
    pulse = [
        (quick, 0.6),
        (0.12, 0.6),
        (quick, 0.0),
        (0.35, 0.0),
        (quick, -0.6),
        (0.12, -0.6),
        (quick, 0.0),
        (0.35, 0.0),
    ]
    dwell = [(quick, 0.3), (0.1, 0.3), (quick, 0.0), (1.4, 0.0)]
    small = [(0.25, 0.06), (0.5, -0.06), (0.4, 0.04), (0.3, -0.04), (0.15, 0.0)]
    lively = [piece for k in range(8) for piece in [(0.01, 0.9 * (-1) ** k), (0.06, 0.9 * (-1) ** k)]]
    to_the_ends = [(quick, 0.5), (0.25, 0.5), (quick, 0.1), (0.3, 0.1), (quick, -0.5), (0.66, -0.5), (quick, -0.1), (0.4, -0.1)]
    found = {
        "large steps with the valve closed between them": pulse,
        "a short step, then a long dwell with the valve closed": dwell,
        "slow small commands about null": small,
        "fast reversals at almost full opening": lively,
        "strokes into both ends": to_the_ends,
    }
    supply = rig.supply
    commands = {words: rig.null + rig.full_scale * _course(*pieces) for words, pieces in found.items()}
    return {words: np.vstack([u, np.full_like(u, supply)]) for words, u in commands.items()}


def _bench_experiments(rig: Rig) -> dict[str, np.ndarray]:
    """Inputs ``(5, N)`` of a bench: position, speed, acceleration and chamber pressures."""
    t = DT * np.arange(round((_SETTLING + 2.0) / DT))
    # motion sets in smoothly after settling
    phase, onset = (
        2 * np.pi * np.maximum(t - _SETTLING, 0.0),
        1.0 - np.exp(-((np.maximum(t - _SETTLING, 0.0) / 0.1) ** 3)),
    )
    found = {}
    for words, size, frequency in (
        ("slow strokes", 0.02, 0.5), ("fast reversals", 0.02, 3.0), ("strokes within the pre-sliding range", 2e-4, 1.0),
    ):  # fmt: skip
        x = 0.1 + size * onset * np.sin(frequency * phase)
        v = np.gradient(x, DT)
        pressures = np.tile([[rig.patm + 3e5], [rig.patm + 2e5]], t.size)
        found[f"{words} with 3 and 2 bar in the chambers"] = np.vstack([x, v, np.gradient(v, DT), pressures])
    return found
