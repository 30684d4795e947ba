"""The valve-driven rig: one plant for closed loops, and whole open-loop runs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pneuid.errors import ComputationError
from pneuid.virtual_rig import layout as at
from pneuid.virtual_rig.hidden import NOTHING, Hidden
from pneuid.virtual_rig.kernel import advance, friction_of, rounded, run_commands
from pneuid.virtual_rig.packing import pack
from pneuid.virtual_rig.sensors import CONTROL_SENSORS, RECORDED_ONLY, Sensors
from pneuid.virtual_rig.truth import TruthServo

Array = NDArray[np.float64]

STEP = 20e-6
"""Default integration step [s]; 5 to 20 us is the sensible range."""


def substeps_for(interval: float, step: float) -> int:
    """Number of equal steps, none longer than ``step`` [s], that make up ``interval`` [s]."""
    if not (interval > 0.0 and step > 0.0):
        raise ValueError(f"interval and step must be positive, got {interval} s and {step} s")
    return max(1, math.ceil(interval / step - 1e-9))


def rest_state(par: Array, x0: float, supply: float) -> Array:
    """A state at rest at ``x0`` [m]: chambers near 60 % of the supply's gauge pressure, forces in balance.

    Raises ``ValueError`` when ``x0`` is outside the stroke or the supply not above ambient pressure.
    """
    if not 0.0 <= x0 <= par[at.STROKE]:
        raise ValueError(f"x0 must be within 0 and the stroke {par[at.STROKE]} m, got {x0} m")
    if not supply > par[at.PATM]:
        raise ValueError(f"supply must be above ambient pressure {par[at.PATM]} Pa absolute, got {supply} Pa")
    level = 0.6 * (supply - par[at.PATM])
    load = (par[at.MASS] + par[at.S_LOAD_MASS]) * par[at.GRAVITY] + par[at.H_PULL]
    p2 = level
    p1 = (p2 * par[at.AREA_2] + load) / par[at.AREA_1]
    highest = 0.95 * (supply - par[at.PATM])
    y = np.zeros(at.STATES)
    y[at.X], y[at.SPOOL], y[at.PSUP] = x0, par[at.NULL], supply
    y[at.P1] = par[at.PATM] + min(max(p1, 0.0), highest)
    y[at.P2] = par[at.PATM] + p2
    y[at.T1] = y[at.T2] = par[at.TEMPERATURE]
    y[at.PEXH], y[at.LOAD_X] = par[at.PATM], x0
    y[[at.LINE_A1, at.LINE_B1, at.POCKET_1, at.CUSHION_1, at.SIDE_1]] = y[at.P1]
    y[[at.LINE_A2, at.LINE_B2, at.POCKET_2, at.CUSHION_2, at.SIDE_2]] = y[at.P2]
    return y


def check_states(states: Array, samples: int, interval: float) -> None:
    """Raise ``ComputationError`` when a run ended early or holds a state that is not finite."""
    if states.shape[0] != samples or not np.all(np.isfinite(states)):
        when = interval * (states.shape[0] - 1)
        raise ComputationError(f"the virtual rig's state stopped being finite at t = {when:.4f} s; use a smaller step")


def channels(states: Array) -> dict[str, Array]:
    """The true signals of a run by name, SI: x, v, z, p1, p2, psup, T1, T2, spool [V]."""
    columns = {"x": at.X, "v": at.V, "z": at.Z, "p1": at.P1, "p2": at.P2, "psup": at.PSUP, "T1": at.T1, "T2": at.T2}
    return {name: states[:, column].copy() for name, column in (columns | {"spool": at.SPOOL}).items()}


class ServoPlant:
    """The rig as a plant for a controller: reset, step, measure.

    ``step`` [s] is the integration step. ``parameters`` and the state array may be handed to
    ``kernel.advance`` by a compiled controller. Raises ``ValueError`` for sensors that need their past (lags, skew, drift),
    which only recordings have.
    """

    def __init__(
        self,
        truth: TruthServo,
        hidden: Hidden = NOTHING,
        sensors: Sensors = CONTROL_SENSORS,
        step: float = STEP,
    ) -> None:
        past = [name for name in RECORDED_ONLY if getattr(hidden, name) != 0.0]
        if past:
            raise ValueError(f"the plant of a control loop reads its sensors now; {', '.join(past)} is for recordings")
        self.truth = truth
        self.hidden = hidden
        self.sensors = sensors
        self.integration_step = step
        self.parameters = pack(truth, hidden)
        self._supply = truth.supply
        self._y = rest_state(self.parameters, 0.5 * truth.stroke, truth.supply)

    def reset(self, x0: float, supply: float | None = None) -> None:
        """Put the piston at rest at ``x0`` [m] under a regulated ``supply`` pressure (absolute Pa).

        Raises ``ValueError`` for a position outside the stroke or a supply below ambient pressure.
        """
        self._supply = self.truth.supply if supply is None else supply
        self._y = rest_state(self.parameters, x0, self._supply)

    @property
    def state(self) -> dict[str, float]:
        """The true state by name, SI; see ``channels``."""
        return {name: float(values[0]) for name, values in channels(self._y[None, :]).items()}

    @property
    def array(self) -> Array:
        """The state itself, ``float64[layout.STATES]``, not a copy."""
        return self._y

    def step(self, u: float, dt: float, u_end: float | None = None) -> None:
        """Advance by ``dt`` [s] under the command ``u`` [V], held, or ramped to ``u_end`` when given.

        Raises ``ComputationError`` when the command is not finite or the state stops being so.
        """
        last = u if u_end is None else u_end
        if not (math.isfinite(u) and math.isfinite(last)):
            raise ComputationError(f"the virtual rig was given a command that is not finite: {u} V to {last} V")
        substeps = substeps_for(dt, self.integration_step)
        advance(self._y, float(u), float(last), self._supply, dt, substeps, self.parameters)
        if not math.isfinite(self._y[at.X] + self._y[at.V] + self._y[at.P1] + self._y[at.P2]):
            raise ComputationError(f"the virtual rig's state is not finite after u = {u} V; use a smaller step")

    def measure(self, rng: np.random.Generator | None = None) -> dict[str, float]:
        """x [m], p1, p2 (absolute Pa) as the sensors see them; without ``rng`` without noise."""
        s = self.sensors
        noise = np.zeros(3) if rng is None else rng.standard_normal(3)
        values = (
            ("x", self._y[at.X] + s.x_noise * noise[0], s.x_grid),
            ("p1", self._y[at.P1] + s.p_noise * noise[1] + self.hidden.sensor_offset_p1, s.p_grid),
            ("p2", self._y[at.P2] + s.p_noise * noise[2] + self.hidden.sensor_offset_p2, s.p_grid),
        )
        return {name: float(rounded(value, grid)) for name, value, grid in values}

    def friction(self) -> float:
        """The true friction force now [N], positive against positive motion."""
        return float(friction_of(self._y, self.parameters))


def run_open_loop(
    truth: TruthServo,
    hidden: Hidden,
    u: Array,
    dt: float,
    *,
    x0: float | None = None,
    supply: float | Array | None = None,
    input_hold: str = "linear",
    step: float = STEP,
    initial: Array | None = None,
) -> dict[str, Array]:
    """True signals under a command array ``u`` [V], one sample every ``dt`` [s], noise-free.

    ``supply`` is the regulated pressure (absolute Pa), one number or one per sample; ``initial`` a
    state ``float64[layout.STATES]`` instead of rest at ``x0`` (mid-stroke by default).
    Returns t, u and the ``channels``. Raises ``ComputationError`` when the state stops being finite
    and ``ValueError`` for an unknown ``input_hold``.
    """
    ramp = holds_linear(input_hold)
    par = pack(truth, hidden)
    commands = np.ascontiguousarray(u, dtype=np.float64)
    pressure = np.broadcast_to(np.asarray(truth.supply if supply is None else supply, dtype=np.float64), commands.shape)
    pressure = np.ascontiguousarray(pressure)
    start = rest_state(par, 0.5 * truth.stroke if x0 is None else x0, float(pressure[0]))
    y = start if initial is None else np.array(initial, dtype=np.float64)
    states = run_commands(y, commands, pressure, ramp, dt, substeps_for(dt, step), par)
    check_states(states, commands.size, dt)
    run: dict[str, Array] = {"t": dt * np.arange(commands.size, dtype=np.float64), "u": commands.copy()}
    return run | channels(states)


def holds_linear(input_hold: str) -> bool:
    """True for ``"linear"``, False for ``"zero-order"``; ``ValueError`` for anything else."""
    if input_hold not in ("linear", "zero-order"):
        raise ValueError(f"input_hold is 'linear' or 'zero-order', got {input_hold!r}")
    return input_hold == "linear"
