"""The controllers by name: how each is built for a model and how its gains are refined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from controllers.base import Controller
from controllers.cascade import Cascade, CascadeEso, CascadeGains
from controllers.control_model import ControlModel
from controllers.mpc import Mpc, MpcEso, MpcGains
from controllers.pid import Pid
from controllers.servo import Servo
from controllers.tuning import (
    Design,
    Trial,
    cascade_bandwidth,
    cascade_gains,
    mpc_bandwidth,
    mpc_gains,
    pid_gains,
    refine_bandwidth,
    refine_gains,
)  # fmt: skip

FAST, SLOW = 1e-3, 2e-3
"""Sample times in s of the servo loops and of the predictive controllers."""

PID_EVALUATIONS = 80


@dataclass(frozen=True)
class Entry:
    """One controller of the registry.

    label : for figures; build : controller with the gains of the formulas; refine : better gains, in place; compensates :
    whether it uses the model's friction.
    """

    label: str
    build: Callable[[ControlModel, Design], Controller]
    refine: Callable[[Controller, ControlModel, Design], None]
    compensates: bool = False


def _refine_pid(controller: Any, model: ControlModel, design: Design) -> None:
    names = ("proportional", "integral", "derivative", "feed_forward")
    refine_gains(controller, names, Trial(model, design.supply), PID_EVALUATIONS)


def _cascade(
    label: str, kind: type[Cascade], only: Callable[[CascadeGains], CascadeGains], compensates: bool = False
) -> Entry:
    """A member of the cascade family; ``only`` sets the gains that it does without to zero."""

    def build(model: ControlModel, design: Design) -> Controller:
        return kind(model, only(cascade_gains(model, design, FAST)), FAST)

    def refine(controller: Any, model: ControlModel, design: Design) -> None:
        w = design.bandwidth or cascade_bandwidth(model, design.supply, FAST)

        def gains_at(factor: float) -> CascadeGains:
            return only(cascade_gains(model, replace(design, bandwidth=factor * w), FAST))

        refine_bandwidth(controller, gains_at, Trial(model, design.supply))

    return Entry(label, build, refine, compensates)


def _mpc(label: str, kind: type[Mpc], only: Callable[[MpcGains], MpcGains], compensates: bool = False) -> Entry:
    def build(model: ControlModel, design: Design) -> Controller:
        return kind(model, only(mpc_gains(model, design, SLOW)), SLOW)

    def refine(controller: Any, model: ControlModel, design: Design) -> None:
        w = design.bandwidth or mpc_bandwidth(model, design.supply, SLOW)

        def gains_at(factor: float) -> MpcGains:
            return only(mpc_gains(model, replace(design, bandwidth=factor * w), SLOW))

        refine_bandwidth(controller, gains_at, Trial(model, design.supply))

    return Entry(label, build, refine, compensates)


CONTROLLERS: dict[str, Entry] = {
    "pid": Entry("PID + feed-forward", lambda model, design: Pid(model, pid_gains(model, design), FAST), _refine_pid),
    "cascade": _cascade("cascade", Cascade, lambda gains: replace(gains, alpha=0.0)),
    "cascade_eso": _cascade("cascade + ESO", CascadeEso, lambda gains: replace(gains, alpha=0.0, integral=0.0)),
    "servo": _cascade("servo (LuGre + ESO)", Servo, lambda gains: replace(gains, integral=0.0), compensates=True),
    "nmpc_eso": _mpc("NMPC, ESO only", MpcEso, lambda gains: replace(gains, alpha=0.0)),
    "nmpc": _mpc("NMPC (LuGre + ESO)", Mpc, lambda gains: gains, compensates=True),
}
"""Every controller by name."""


def build(name: str, model: ControlModel, design: Design, refined: bool = True) -> Controller:
    """A controller of the registry for ``model``, its gains refined on the model unless told otherwise.

    Raises ``KeyError`` listing the names for an unknown one.
    """
    if name not in CONTROLLERS:
        raise KeyError(f"no controller {name!r}; there are {', '.join(CONTROLLERS)}")
    entry = CONTROLLERS[name]
    controller = entry.build(model, design)
    if refined:
        entry.refine(controller, model, design)
    return controller
