"""A first guess without iterations: chambers from measured position, then mechanics from measured pressures.

A start for the fit, never an estimate: pre-sliding parameters stay at their typical values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from pneuid.estimation.differentiate import Motion
from pneuid.estimation.own import declared
from pneuid.estimation.preparation import Run
from pneuid.estimation.settled import starting_states
from pneuid.physics import motion as mechanics
from pneuid.physics.gas import R_AIR, RHO_REFERENCE, T_REFERENCE
from pneuid.physics.smoothing import FINE
from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES, relaxed

FOLLOWING = 4
"""Steps a sample in which the states of effects are followed along the measurements."""

WINDOW = 0.01
"""Length over which the chamber balances are integrated, s."""

BREAK_AWAY = ("Fs", "vs", "sigma0", "sigma1")
"""Parameters of the base model that show at break-away and next to nowhere else."""

TYPICAL_VS = 0.01
TYPICAL_DEFLECTION, TYPICAL_DAMPING = 4.0e-5, 0.4
"""Deflection in m at which a seal breaks away, and its micro-viscous damping over the root of stiffness times mass."""

_OPEN_RANGES = {"p1_low": 0.0, "p1_high": 1e9, "p2_low": 0.0, "p2_high": 1e9, "x_low": 0.0, "x_high": 1.0}
"""Ranges that hold no effect back, Pa and m: a start knows of no fit yet."""


def motions(runs: Sequence[Run]) -> list[Motion]:
    """Smoothed motion of every run."""
    return [run.motion for run in runs]


def _flow_per_conductance(p_from: np.ndarray, p_to: np.ndarray, b: float, T: float) -> np.ndarray:
    up, down = np.maximum(p_from, p_to), np.minimum(p_from, p_to)
    ratio = np.clip(down / up, b, 1.0 - FINE.laminar)
    psi = np.sqrt(1.0 - ((ratio - b) / (1.0 - b)) ** 2)
    return np.asarray(np.sign(p_from - p_to) * RHO_REFERENCE * np.sqrt(T_REFERENCE / T) * up * psi)


def _chambers(plant: Plant, runs: Sequence[Run], moved: Sequence[Motion]) -> dict[str, float]:
    """``n`` and ``C`` by linear least squares on pressure changes over short windows (unknowns ``n C`` and ``n``)."""
    rig = plant.rig
    design, change = [], []
    for run, motion in zip(runs, moved, strict=True):
        s = np.clip((run.input("u") - rig.null) / rig.full_scale, -1.0, 1.0)
        fill, empty, supply = np.maximum(s, 0.0), np.maximum(-s, 0.0), run.input("psup")
        dt = np.diff(run.t)
        stride = max(2, round(WINDOW / np.median(dt)))
        for signal, opening, drain, area, volume in (
            ("p1", fill, empty, rig.A1, rig.V01 + rig.A1 * motion.x),
            ("p2", empty, fill, -rig.A2, rig.V02 + rig.A2 * (rig.stroke - motion.x)),
        ):
            p = run.measured(signal)
            inflow = opening * _flow_per_conductance(supply, p, rig.critical_ratio, rig.temperature)
            outflow = drain * _flow_per_conductance(p, np.full_like(p, rig.patm), rig.critical_ratio, rig.temperature)
            rates = np.vstack([R_AIR * rig.temperature * (inflow - outflow), -p * area * motion.v]) / volume
            cumulative = np.hstack([np.zeros((2, 1)), np.cumsum(0.5 * (rates[:, 1:] + rates[:, :-1]) * dt, axis=1)])
            ends = np.arange(0, run.n, stride)
            used = (run.weight(signal)[ends[1:]] > 0) & (run.weight(signal)[ends[:-1]] > 0)
            design.append(np.diff(cumulative[:, ends], axis=1).T[used])
            change.append(np.diff(p[ends])[used])
    A, y = np.vstack(design), np.concatenate(change)
    (nC, n), *_ = np.linalg.lstsq(A, y, rcond=None)
    if not 1.0 <= n <= 1.4:
        n = float(np.clip(n, 1.0, 1.4))
        nC = float(A[:, 0] @ (y - n * A[:, 1]) / (A[:, 0] @ A[:, 0]))
    return {"n": float(np.clip(n, 1.02, 1.38)), "C": float(nC / n)}


def resisting_force(plant: Plant, run: Run, motion: Motion) -> np.ndarray:
    """Force (N,) in N that the balance leaves to friction and to what the model lacks."""
    rig = plant.rig
    mass = run.own.mass
    signals = run.recording.signals
    still = np.full(run.n, rig.patm)
    p1, p2 = signals.get("p1", still), signals.get("p2", still)
    driving = signals["F"] if not plant.servo else 0.0
    pressure = mechanics.pressure_force(p1, p2, rig.A1, rig.A2, rig.patm)
    return np.asarray(driving + pressure - mass * (motion.a + mechanics.GRAVITY * np.sin(rig.incline)))


def _mechanics(plant: Plant, runs: Sequence[Run], moved: Sequence[Motion]) -> dict[str, float]:
    """``Fc`` and ``sigma2`` from sliding samples, ``Fs`` from the largest forces near rest."""
    force = np.concatenate([resisting_force(plant, run, motion) for run, motion in zip(runs, moved, strict=True)])
    v = np.concatenate([motion.v for motion in moved])
    top = np.percentile(np.abs(v), 99)
    sliding = np.abs(v) > max(0.05 * top, 1e-5)
    A = np.column_stack([np.sign(v[sliding]), v[sliding], np.ones(sliding.sum())])
    (Fc, sigma2, _), *_ = np.linalg.lstsq(A, force[sliding], rcond=None)
    typical = float(np.median(np.abs(force[sliding]))) + 1e-9
    Fc = max(float(Fc), 0.1 * typical)
    sigma2 = max(float(sigma2), 0.02 * typical / max(top, 1e-6))
    slow = np.abs(v) < 0.02 * top
    Fs = float(np.percentile(np.abs(force[slow]), 90)) if slow.sum() > 20 else 1.3 * Fc
    Fs = float(np.clip(Fs, 1.1 * Fc, 3.0 * Fc))
    guess = {"Fc": Fc, "Fs": Fs, "vs": TYPICAL_VS, "sigma2": sigma2, **typical_presliding(plant, Fs)}
    return {name: guess[name] for name in plant.law.fitted}


def typical_presliding(plant: Plant, Fs: float, deflection: float = TYPICAL_DEFLECTION) -> dict[str, float]:
    """Stiffness in N/m and damping in N s/m of a seal that breaks away at ``Fs`` (N) after a ``deflection`` (m)."""
    sigma0 = Fs / deflection
    return {"sigma0": sigma0, "sigma1": typical_damping(plant, sigma0)}


def typical_damping(plant: Plant, sigma0: float) -> float:
    """Micro-viscous damping in N s/m of a seal with the stiffness ``sigma0`` (N/m)."""
    return TYPICAL_DAMPING * float(np.sqrt(sigma0 * plant.rig.mass))


def first_guess(plant: Plant, runs: Sequence[Run], moved: Sequence[Motion]) -> dict[str, float]:
    """Start values (SI) of all parameters: the base from the data, effects and single runs from their declarations."""
    found = plant.starts() | _mechanics(plant, runs, moved)
    if plant.servo:
        found |= _chambers(plant, runs, moved)
    every = declared(plant, [run.own for run in runs])
    found |= {parameter.name: parameter.start for parameter in every if parameter.name not in found}
    for parameter in every:
        inside = np.clip(found[parameter.name], parameter.lower, parameter.upper)
        found[parameter.name] = float(inside)
    return found


def first_nodes(plant: Plant, runs: Sequence[Run], moved: Sequence[Motion], values: dict, every: int) -> np.ndarray:
    """Node states ``(ns, nint)`` from the measurements: smoothed motion, pressures, bristle from the force balance."""
    each = zip(runs, moved, strict=True)
    return np.hstack([first_states(plant, run, motion, values)[0][:, ::every] for run, motion in each])


def first_states(plant: Plant, run: Run, motion: Motion, values: dict) -> tuple[np.ndarray, np.ndarray]:
    """The same ``(ns, N)`` at every sample of one run, and how fast the states that effects bring forget ``(ne, N)``, 1/s."""
    z = bristle(plant, run, motion, values)
    states, decays = {"x": motion.x, "v": motion.v, "z": z}, np.zeros((0, run.n))
    if plant.servo:
        states |= {signal: _averaged(run.measured(signal)) for signal in ("p1", "p2")}
    if plant.effect_states:
        own, decays = followed_effects(plant, run, motion, z, values)
        states |= {state.name: row for state, row in zip(plant.effect_states, own, strict=True)}
    return np.vstack([states[name] for name in plant.states]), decays


@once_per_structure(STRUCTURES)
def _coefficients(plant: Plant) -> ca.Function:
    """``(s, w, theta) -> (Fs [N], sigma0 [N/m], sigma2 [N s/m])``, effects included."""
    s, w = ca.SX.sym("s", len(plant.states)), ca.SX.sym("w", len(plant.inputs))
    theta = ca.SX.sym("theta", len(plant.theta_names))
    k = plant.evaluate(s, w, theta).coefficients
    return ca.Function("coefficients", [s, w, theta], [ca.vertcat(k.Fs, k.sigma0, k.sigma2)])


def follows_state(plant: Plant) -> bool:
    """Whether friction's coefficients follow the state, so that the bristle cannot be read before their laws are known."""
    return bool(_coefficients(plant).sparsity_jac(0, 0).nnz() > 0)


def operating_points(
    plant: Plant, run: Run, motion: Motion, values: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States ``(ns, N)`` as measured, the bristle relaxed and effects at their initial states, inputs ``(nw, N)`` and theta of
    ``values`` (SI), held back by no range of data."""
    known = {"x": motion.x, "v": motion.v} | {own.name: np.full(run.n, own.initial) for own in plant.effect_states}
    if plant.servo:
        known |= {name: _averaged(run.measured(name)) for name in ("p1", "p2")}
    states = np.vstack([known.get(name, np.zeros(run.n)) for name in plant.states])
    given = np.vstack([run.input(name) for name in plant.inputs])
    return states, given, plant.theta(values, _OPEN_RANGES, run.own.mass)


def bristle(plant: Plant, run: Run, motion: Motion, values: dict) -> np.ndarray:
    """Deflection (N,) in m that carries the resisting force, at the friction coefficients of the measured pressures.

    A start that clips it at a level of other pressures puts every stick of the run into the wrong place, from where the slips
    after it do not find their time.
    """
    at = _coefficients(plant)
    states, given, column = operating_points(plant, run, motion, values)
    level, stiffness, viscous = np.asarray(at(states, given, column[:, None]))
    force = resisting_force(plant, run, motion) - viscous * motion.v
    return np.asarray(np.clip(force, -level, level) / stiffness)


def followed_effects(
    plant: Plant, run: Run, motion: Motion, z: np.ndarray, values: dict
) -> tuple[np.ndarray, np.ndarray]:
    """States ``(ne, N)`` that the effects bring, followed along the measured trajectory from their starts, and how
    fast they forget ``(ne, N)``, 1/s; ``z`` (N,) is the bristle's deflection in m."""
    count = len(plant.states) - len(plant.effect_states)
    known = {"x": motion.x, "v": motion.v, "z": z}
    known |= {name: _averaged(run.measured(name)) for name in ("p1", "p2") if name in plant.outputs}
    given = np.vstack([run.input(name) for name in plant.inputs])
    column = np.repeat(plant.theta(values, _OPEN_RANGES, run.own.mass)[:, None], run.n, axis=1)
    signals = np.vstack([known.get(name, np.zeros(run.n)) for name in plant.states[:count]])
    every = np.vstack([signals, np.zeros((len(plant.effect_states), run.n))])
    first = starting_states(plant, every[:, :1], given[:, :1], column[:, :1])
    first[[state.clock for state in plant.effect_states]] += run.t[0]
    moved, decays = (np.asarray(item) for item in _following(plant, run.n)(first, signals, given, column, run.data[0]))
    return np.hstack([first, moved[:, :-1]]), decays


@once_per_structure(STRUCTURES)
def _following(plant: Plant, samples: int) -> ca.Function:
    """``(own, core, w, theta, step) -> (own after each sample, its decay)``, ``samples`` columns; the bristle is not own."""
    count = len(plant.states) - len(plant.effect_states)
    core, own = ca.SX.sym("core", count), ca.SX.sym("own", len(plant.effect_states))
    w, theta, step = ca.SX.sym("w", len(plant.inputs)), ca.SX.sym("theta", len(plant.theta_names)), ca.SX.sym("step")
    relaxing = plant.evaluate(ca.vertcat(core, own), w, theta).relaxing[1:]
    rates = ca.Function("rates", [own, core, w, theta], [ca.vertcat(*(item[0] for item in relaxing)),
                                                         ca.vertcat(*(item[1] for item in relaxing))])  # fmt: skip
    after, h = own, step / FOLLOWING
    for _ in range(FOLLOWING):
        # through the middle, or what swings with little damping would build up
        source, decay = rates(after, core, w, theta)
        source, decay = rates(relaxed(after, source, decay, 0.5 * h), core, w, theta)
        after = relaxed(after, source, decay, h)
    # sample by sample: a state may hold on or let go depending on where it is itself
    along = ca.Function("followed", [own, core, w, theta, step], [after, rates(own, core, w, theta)[1]])
    return along.mapaccum(samples)


def _averaged(y: np.ndarray) -> np.ndarray:
    """Five-point moving average, ends kept."""
    padded = np.pad(y, 2, mode="edge")
    return np.convolve(padded, np.full(5, 0.2), mode="valid")
