"""Every effect of the catalogue, and functions of time, inside the controllers: one suite, at twice the typical size."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from controllers import loop
from controllers.control_model import ControlModel, KnownFriction
from controllers.horizon import stage_function, stage_scale
from controllers.model_plant import ModelPlant
from controllers.nominal import rig_of
from controllers.references import Sine
from controllers.registry import build
from controllers.tuning import Design, authority, default_bandwidth
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.plant import Plant
from pneuid.step import substep
from pneuid.virtual_rig.truth import TruthServo

TRUTH = TruthServo()
SUPPLY = TRUTH.patm + 5e5
RANGES = {"p1_low": 2e5, "p1_high": 6e5, "p2_low": 2e5, "p2_high": 6e5, "x_low": 0.05, "x_high": 0.45}
INTERVAL = 2e-3
SERVO = [*(name for name, effect in CATALOGUE.items() if "servo" in effect.rigs), "spline:force(t)", "spline:valve(t)"]


def model_of(name: str | None) -> ControlModel:
    """The virtual rig's numbers, and an effect at twice its typical size, its shape as a fit would start it."""
    seal, plant = TRUTH.friction, Plant(rig_of(TRUTH), "lugre", effects_by_name([name] if name else []))
    values = plant.starts() | {part: getattr(seal, part) for part in ("Fc", "Fs", "vs", "sigma0", "sigma1", "sigma2")}
    values |= {"n": TRUTH.polytropic, "C": TRUTH.conductance}
    for parameter in plant.parameters:
        if plant.owner[parameter.name] is not None and parameter.off is not None:
            values[parameter.name] = min(parameter.off + 2.0 * parameter.scale, parameter.upper)
    return ControlModel(plant, plant.theta(values, RANGES))


def _finely(model: ControlModel, u: float, force: float, count: int = 64) -> ca.Function:
    """State to the state after one stage by many of the plant's own steps."""
    s = ca.SX.sym("s", model.states)
    plant, given = KnownFriction(model, 0.0, force), ca.DM([u, SUPPLY])
    after = substep(plant, s, given, ca.DM.zeros(2), INTERVAL / count, ca.DM(model.theta))
    return ca.Function("step", [s], [after]).fold(count)


@pytest.mark.parametrize("name", SERVO)
def test_a_stage_is_what_the_plant_does_in_that_time(name):
    """Within a twentieth, whether a contact sticks, slips or lets go in it: 0.04 to 1.2 mm of travel at these speeds."""
    model = model_of(name)
    u, force, scale = 0.7, 20.0, stage_scale(model)
    stage, finely = stage_function(model, INTERVAL), _finely(model, u, force)
    for speed in (-0.3, -0.1, -0.05, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6):
        state = model.rest(0.24, 4e5, 3.6e5)
        state[1] = speed
        given = np.append(np.delete(state, 4) / scale[:-1], u / scale[-1])
        found = np.asarray(stage(given, 0.0, force, SUPPLY, model.theta)[0]).ravel()[:-1] * scale[:-1]
        exact = np.delete(np.asarray(finely(state)).ravel(), 4)
        moved = np.abs(exact - np.delete(state, 4))
        np.testing.assert_array_less(np.abs(found - exact), 0.05 * moved + 0.02 * scale[:-1], err_msg=f"{speed} m/s")


@pytest.mark.parametrize("name", SERVO)
def test_no_effect_takes_the_valve_s_authority_away(name):
    base, found = authority(model_of(None), SUPPLY), authority(model_of(name), SUPPLY)
    assert found.gain == pytest.approx(base.gain, rel=0.4)
    assert default_bandwidth(model_of(name), SUPPLY, 1e-3) == pytest.approx(
        default_bandwidth(model_of(None), SUPPLY, 1e-3), rel=0.2
    )


@pytest.mark.parametrize("name", ["friction_presliding_memory", "backlash", "line_delay", "spline:force(t)"])
@pytest.mark.parametrize("controller", ["servo", "nmpc"])
def test_effects_with_fast_states_of_their_own_are_followed(name, controller):
    """On the model itself, with sensor noise: 50 mm at 1 Hz within 0.2 mm."""
    model = model_of(name)
    made = build(controller, model, Design(SUPPLY), refined=False)
    track = Sine("sine", 0.25, 2.0, 0.05, 1.0, 0.5)
    assert loop.metrics(loop.run(made, ModelPlant(model), track, SUPPLY, seed=1)).rms < 0.2e-3
