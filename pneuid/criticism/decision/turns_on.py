"""What the named effects make an equation turn on: the signals by which what their forms lack can differ from them."""

from __future__ import annotations

import casadi as ca

from pneuid.physics.smoothing import Expression
from pneuid.plant import Plant, Stages

_STANDS_FOR = {"z": "v"}
"""Signals as which a state is seen: a bristle is bent the way the rod moves, and a clock shows the time."""


def own_signals(plant: Plant, base: Plant, equation: str) -> set[str] | None:
    """Signals that the parameters which ``plant`` has more than ``base`` bring into an equation; None for one not looked into.

    equation : ``force``, ``friction``, ``valve``, ``flow_1`` or ``flow_2``; what acts on a mass turns on all that moves it.
    """
    s, w = (ca.SX.sym(name, len(of)) for name, of in (("s", plant.states), ("w", plant.inputs)))
    theta = [ca.SX.sym(name) for name in plant.theta_names]
    value = _of(plant, plant.evaluate(s, w, ca.vertcat(*theta)), equation)
    if value is None:
        return None
    own = [one for one in theta if one.name() not in set(base.theta_names)]
    if not own:
        return set()
    slopes = ca.jacobian(value, ca.vertcat(*own))
    named = zip((*plant.states, *plant.inputs), (*ca.vertsplit(s), *ca.vertsplit(w)), strict=True)
    seen_as = _STANDS_FOR | {state.name: "t" for state in plant.effect_states if state.clock}
    return {seen_as.get(name, name) for name, one in named if ca.depends_on(slopes, one)}


def _of(plant: Plant, stages: Stages, equation: str) -> Expression:
    """What an equation says, None where that is not looked into."""
    if equation == "force":
        return stages.explicit[plant.states.index("v")] if plant.servo else stages.outputs["F"]
    if equation == "friction":
        return stages.friction
    if equation == "valve" and stages.edges is not None:
        edges = stages.edges
        return ca.vertcat(edges.supply_1, edges.supply_2, edges.exhaust_1, edges.exhaust_2)
    flows = {"flow_1": stages.mdot1, "flow_2": stages.mdot2}
    return flows.get(equation)
