"""The functions and numbers of one identified model that the exported C consists of.

Every function is the very symbolic one that the Python controllers compile, so the two cannot drift apart; every
number is read from a built controller.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields

import casadi as ca
import numpy as np

from controllers.base import Measurement
from controllers.control_model import EFFECTS, P1, P2, ControlModel, V, X, Z
from controllers.horizon import bristle_function, stage_function
from controllers.inverse_valve import same_effect
from controllers.model_plant import STEP, step_function
from controllers.mpc import ASIDE, ROUNDED_LAMINAR, ROUNDED_OPENING, TOLERANCE, Mpc, observer_function
from controllers.observer import ObserverGains, memory_size, start_memory
from controllers.registry import build
from controllers.servo import Servo
from controllers.tuning import Design


@dataclass(frozen=True)
class Piece:
    """One generated function: the file it stands in, its C name, what it does, and its arguments by name."""

    file: str
    name: str
    words: str
    function: ca.Function
    arguments: tuple[str, ...]
    results: tuple[str, ...]


@dataclass(frozen=True)
class Controllers:
    """The controllers that are exported, built and tuned for one model.

    design_supply : pressure they were tuned for, Pa absolute.
    """

    model: ControlModel
    servo: Servo
    nmpc: Mpc
    design_supply: float


def tuned(model: ControlModel, design: Design, refined: bool = True) -> Controllers:
    """Both controllers with their gains, refined on the model unless told otherwise."""
    servo, nmpc = (build(name, model, design, refined) for name in ("servo", "nmpc"))
    if not (isinstance(servo, Servo) and isinstance(nmpc, Mpc)):
        raise TypeError("the registry's servo and nmpc are no longer what the export is written for")
    return Controllers(model, servo, nmpc, design.supply)


def pieces(found: Controllers) -> tuple[Piece, ...]:
    """The generated functions, in the order they are called."""
    model, interval = found.model, found.nmpc.sample_time
    return (
        Piece(
            "pneuid_servo_law.c", "pneuid_servo_law",
            "One sample of the servo: observer, loops and inverse valve.",
            _dense(found.servo.symbolic()),
            ("memory", "seen", "target", "applied", "gains", "theta"), ("u", "after"),
        ),
        Piece(
            "pneuid_observer.c", "pneuid_observer", "The observer's memory one sample on.",
            _dense(observer_function(model, interval)), ("memory", "seen", "applied", "gains", "theta"), ("after",),
        ),
        Piece(
            "pneuid_horizon.c", "pneuid_bristle",
            "The bristle [m] after one stage of constant speed and the model's friction [N] in its middle.",
            _bristle(model, interval), ("state", "theta"), ("after", "force"),
        ),
        Piece(
            "pneuid_horizon.c", "pneuid_stage",
            "One stage of the plan and its derivatives by state (row by row) and by command change, all scaled.",
            _stage(model, interval), ("s", "du", "force", "psup", "theta"), ("after", "A", "B"),
        ),
        Piece(
            "pneuid_same_effect.c", "pneuid_same_effect",
            "The command [V] that does to the model theta what u [V] does to the model meant.",
            _dense(same_effect(model)), ("u", "state", "psup", "lead", "meant", "theta"), ("command",),
        ),
        Piece(
            "pneuid_plant_step.c", "pneuid_plant_step",
            "The plant's state h seconds on, h at most PNEUID_PLANT_STEP; given: command [V] and supply [Pa, absolute].",
            _dense(step_function(model)), ("state", "given", "h", "theta"), ("after",),
        ),
    )  # fmt: skip


def _dense(function: ca.Function) -> ca.Function:
    """The function with dense results."""
    given = function.sx_in()
    found = function.call(given)
    return ca.Function(function.name(), given, [ca.densify(item) for item in found], {"cse": True})


def _bristle(model: ControlModel, interval: float) -> ca.Function:
    """The bristle's step as a function of a plant state, whose speed is the stage's."""
    state, theta = ca.SX.sym("state", model.states), model.theta_symbol()
    given = [state[Z], state[X], state[V], state[P1], state[P2], state[EFFECTS:], theta]
    return _dense(ca.Function("controllers_bristle", [state, theta], bristle_function(model, interval).call(given)))


def _stage(model: ControlModel, interval: float) -> ca.Function:
    """The stage with its derivatives row by row, as C stores them."""
    function = stage_function(model, interval)
    given = function.sx_in()
    after, A, B = function.call(given)
    return _dense(ca.Function("controllers_stage", given, [after, A.T, B]))


# --- numbers ---


def sizes(found: Controllers) -> dict[str, str]:
    """Compile-time numbers by macro name, as C text."""
    model, nmpc = found.model, found.nmpc
    places = {"X": X, "V": V, "P1": P1, "P2": P2, "Z": Z, "EFFECTS": EFFECTS}
    counts = {
        "STATES": model.states, "THETA": model.theta.size, "SERVO_GAINS": len(fields(found.servo.gains)),
        "SERVO_MEMORY": memory_size(model) + 1, "OBSERVER_GAINS": len(fields(ObserverGains)),
        "OBSERVER_MEMORY": memory_size(model),
        "OBSERVER_ALPHA": [item.name for item in fields(ObserverGains)].index("alpha"),
        "STAGES": nmpc.horizon.N, "NX": nmpc.horizon.nx,
    }  # fmt: skip
    reals = {
        "SERVO_INTERVAL": found.servo.sample_time, "NMPC_INTERVAL": nmpc.sample_time, "NMPC_TOLERANCE": TOLERANCE,
        "NMPC_ASIDE": ASIDE, "PLANT_STEP": STEP,
    }  # fmt: skip
    return {f"PNEUID_{name}": str(value) for name, value in (places | counts).items()} | {
        f"PNEUID_{name}": repr(value) for name, value in reals.items()
    }


def scalars(found: Controllers) -> dict[str, float]:
    """Constants by name."""
    model = found.model
    return {
        "pneuid_neutral": model.neutral, "pneuid_lowest": model.lowest, "pneuid_highest": model.highest,
        "pneuid_nmpc_change": found.nmpc.change_weight, "pneuid_nmpc_supply": found.nmpc.gains.supply,
        "pneuid_ambient": model.value("patm"),
    }  # fmt: skip


def arrays(found: Controllers) -> dict[str, tuple[str, Mapping[str, float] | list[float]]]:
    """Constant arrays by name: the macro of their size, and the numbers, with names where they have some."""
    model, nmpc = found.model, found.nmpc
    names = model.plant.theta_names
    rounded = model.with_values(smooth_opening=ROUNDED_OPENING, smooth_laminar=ROUNDED_LAMINAR)
    rest = start_memory(model, Measurement(0.0, 0.0, 0.0, 0.0))
    gains = nmpc.gains
    observer = {item.name: float(getattr(gains, item.name)) for item in fields(ObserverGains)}
    program = nmpc.program
    # those of the pressures follow the measured supply in every step
    upper = np.where(np.isin(np.arange(nmpc.horizon.nx), (P1, P2)), np.inf, program.upper[1])
    return {
        "pneuid_theta": ("PNEUID_THETA", _named(names, model.theta)),
        "pneuid_theta_rounded": ("PNEUID_THETA", _named(names, rounded)),
        "pneuid_servo_gains": ("PNEUID_SERVO_GAINS", _named(_field_names(found.servo.gains), astuple(found.servo.gains))),
        "pneuid_servo_rest": ("PNEUID_SERVO_MEMORY", [*map(float, rest), 0.0]),
        "pneuid_observer_gains": ("PNEUID_OBSERVER_GAINS", observer),
        "pneuid_observer_rest": ("PNEUID_OBSERVER_MEMORY", [*map(float, rest)]),
        "pneuid_scale": ("PNEUID_NX", [*map(float, nmpc.horizon.scale)]),
        "pneuid_nmpc_weight": ("PNEUID_NX", [*map(float, program.Q[0])]),
        "pneuid_nmpc_terminal": ("PNEUID_NX", [*map(float, program.Q[-1])]),
        "pneuid_nmpc_give": ("PNEUID_NX", [*map(float, program.give)]),
        "pneuid_nmpc_lower": ("PNEUID_NX", [*map(float, program.lower[1])]),
        "pneuid_nmpc_upper": ("PNEUID_NX", [*map(float, upper)]),
    }  # fmt: skip


def _field_names(gains: object) -> tuple[str, ...]:
    return tuple(item.name for item in fields(gains))  # type: ignore[arg-type]


def _named(names: tuple[str, ...], values: object) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, np.asarray(values, dtype=float), strict=True)}
