"""How an excitation is played on rival models: a servo follows it in closed loop, a bench's motor imposes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pneuid.criticism.decision.diagnosis import Command
from pneuid.criticism.next_experiment.excitations import LOWER_SUPPLY, Axis, Excitation
from pneuid.criticism.next_experiment.rival import Played, Rival
from pneuid.estimation.settled import starting_states
from pneuid.physics.gas import R_AIR, RHO_REFERENCE
from pneuid.recording import LEAST_TRAVEL

MARGIN = 0.06
"""Share of the stroke that stays free at either end, on every rival."""

HIGHEST_PRESSURE = 1.05
"""Largest chamber pressure, over the supply's (absolute), that a rival may reach."""

SHRINK = (1.0, 0.6, 0.35)
"""Sizes of an excitation that are tried, largest first, until every rival stays inside the limits."""

BANDWIDTH = 12.0
"""Of the position controller that makes a servo's command, rad/s."""

SETTLING = 0.4
"""Seconds at rest before the excitation starts."""

TURNING = 0.02
"""Seconds that a bench's motor takes to change its speed."""


@dataclass(frozen=True)
class Scene:
    """A command, the plant's inputs ``(nw, N)`` under it, and what each rival does."""

    command: Command
    inputs: np.ndarray
    played: tuple[Played, ...]


def play(rivals: Sequence[Rival], excitation: Excitation, seconds: float) -> Scene | None:
    """The excitation on every rival, None where it does not fit into the limits at any size."""
    return (_on_servo if rivals[0].plant.servo else _on_bench)(rivals, excitation, seconds)


def _moments(rival: Rival, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Times from the start of the record and of the excitation, s."""
    t = np.arange(round((SETTLING + seconds) / rival.dt) // rival.hold * rival.hold) * rival.dt
    return t, np.maximum(t - SETTLING, 0.0)


# --- servo rigs ---


def top_speed(rival: Rival) -> float:
    """Speed in m/s at which the open valve's choked flow fills the larger chamber at the supply's pressure."""
    rig = rival.plant.rig
    conductance = rival.fit.values.get("C", rig.conductance)
    return float(0.6 * conductance * RHO_REFERENCE * R_AIR * rig.temperature / rig.A1)


def rest(rival: Rival, x: float, supply: float) -> np.ndarray:
    """State of a servo rig at rest at ``x`` (m), chambers in balance near 60 % of the supply (Pa absolute)."""
    rig, known = rival.plant.rig, {state.name: state.initial for state in rival.plant.effect_states}
    level = 0.6 * (supply - rig.patm)
    known |= {"x": x, "p2": rig.patm + level, "p1": rig.patm + min(level * rig.A2 / rig.A1, supply - rig.patm)}
    return np.array([known.get(name, 0.0) for name in rival.plant.states])


def _followed(rival: Rival, reference: np.ndarray, supply: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Command ``(N,)`` of a position controller that follows ``reference`` (m) on this model, null where ``closed``."""
    rig, K = rival.plant.rig, rival.hold
    gain, slope = rig.full_scale / top_speed(rival), np.gradient(reference, rival.dt)
    inputs = np.vstack([np.full(reference.size, rig.null), supply])
    u, s = inputs[0], rest(rival, float(reference[0]), float(supply[0]))
    for k in range(0, u.size - K, K):
        wanted = gain * (BANDWIDTH * (reference[k + K] - s[0]) + slope[k])
        after = rig.null if closed[k + K] else rig.null + float(np.clip(wanted, -rig.full_scale, rig.full_scale))
        u[k : k + K + 1] = np.linspace(u[k], after, K + 1)
        s = rival.moved(s, inputs, k)[0][:, K]
        if not np.all(np.isfinite(s)):
            break
    u[k + K :] = u[k + K]
    return u.copy()


def _on_servo(rivals: Sequence[Rival], excitation: Excitation, seconds: float) -> Scene | None:
    """The command by which the first rival follows the excitation, small enough for all."""
    first, rig = rivals[0], rivals[0].plant.rig
    t, moving = _moments(first, seconds)
    share = moving / moving[-1]
    axis = Axis(2 * MARGIN * rig.stroke, (1 - 2 * MARGIN) * rig.stroke, 0.7 * top_speed(first))
    path, closed = excitation.path(moving, axis), excitation.closed(share) & (t > SETTLING)
    supply = rig.patm + (rig.supply - rig.patm) * (1.0 - (1.0 - LOWER_SUPPLY) * excitation.lowered(share))
    for size in SHRINK:
        reference = axis.middle + size * (path - axis.middle)
        inputs = np.vstack([_followed(first, reference, supply, closed), supply])
        done = tuple(rival.played(rest(rival, float(reference[0]), float(supply[0])), inputs) for rival in rivals)
        if all(_within(rival, supply, one.states) for rival, one in zip(rivals, done, strict=True)):
            return Scene(Command(t, done[0].states[0], {"u": inputs[0], "psup": supply}), inputs, done)
    return None


def _within(rival: Rival, supply: np.ndarray, states: np.ndarray) -> bool:
    """Whether a rival moves, and keeps inside stroke and pressure limits: behind a dead zone the axis may stay where it is."""
    rig = rival.plant.rig
    if np.ptp(states[0]) < LEAST_TRAVEL[rig.kind]:
        return False
    room, highest = MARGIN * rig.stroke, HIGHEST_PRESSURE * float(supply.max())
    inside = bool(np.all(np.isfinite(states)) and states[0].min() > room and states[0].max() < rig.stroke - room)
    return inside and bool(states[2:4].max() < highest and states[2:4].min() > 0.5 * rig.patm)


# --- benches ---


def _on_bench(rivals: Sequence[Rival], excitation: Excitation, seconds: float) -> Scene | None:
    """The excitation as the motor's motion, within the positions, speeds and pressures that were recorded."""
    first, known = rivals[0], rivals[0].fit.ranges
    t, moving = _moments(first, seconds)
    speed = max(float(np.max(np.abs(run.input("v")))) for run in first.fit.runs)
    axis = Axis(known["x_low"], known["x_high"], speed)
    x = gaussian_filter1d(excitation.path(moving, axis), 0.5 * TURNING / first.dt, mode="nearest")
    v = np.gradient(x, first.dt)
    exchanged = gaussian_filter1d(excitation.lowered(moving / moving[-1]), TURNING / first.dt, mode="nearest")

    def level(chamber: str, share: np.ndarray) -> np.ndarray:
        low, high = known[f"{chamber}_low"], known[f"{chamber}_high"]
        return np.asarray(low + (high - low) * share)

    p1, p2 = level("p1", 0.9 - 0.8 * exchanged), level("p2", 0.1 + 0.8 * exchanged)
    given = {"x": x, "v": v, "a": np.gradient(v, first.dt), "p1": p1, "p2": p2}
    inputs = np.vstack([given[name] for name in first.plant.inputs])
    done = tuple(rival.played(_unstrained(rival, inputs), inputs) for rival in rivals)
    if not all(np.all(np.isfinite(one.outputs)) for one in done):
        return None
    return Scene(Command(t, x, {name: given[name] for name in first.plant.rig.chambers}), inputs, done)


def _unstrained(rival: Rival, inputs: np.ndarray) -> np.ndarray:
    """At rest with a relaxed bristle, effects' states at their initial values or settled on the first of ``inputs``."""
    states = np.zeros((len(rival.plant.states), 1))
    own = starting_states(rival.plant, states, inputs[:, :1], rival.theta[:, None])
    states[len(states) - len(own) :] = own
    return states[:, 0]
