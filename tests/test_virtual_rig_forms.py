"""The form in which hidden effects act: each constant belongs to one effect and changes it alone."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from pneuid.virtual_rig import ATMOSPHERE, IDEAL_SENSORS, Excitation, Form, TruthServo, drawn_form, preset, record_servo

RIG = TruthServo()


def _to_the_end(t, stroke, top_speed, rng):
    """Half a second that moves to the cap's end and turns."""
    s = np.clip((t - 0.02) / 0.25, 0.0, 1.0) - np.clip((t - 0.32) / 0.15, 0.0, 1.0) * 0.6
    return stroke * (0.26 - 0.25 * s), -0.25 * stroke * np.gradient(s, t)


def _jumps(t, stroke, top_speed, rng):
    """Jumps of the reference there and back."""
    return stroke * (0.2 + 0.5 * ((t > 0.1) & (t < 0.35))), np.zeros_like(t)


QUICK = Excitation("quick", _to_the_end, dither=0.01)
JUMPS = Excitation("jumps", _jumps, dither=0.01)

FORMED = {
    "friction_pressure": "pressure_power pressure_rod_share",
    "friction_dwell": "dwell_power dwell_wear",
    "friction_warmup": "run_in_strokes run_in_slower run_in_fast_share",
    "friction_lag": "film_squeeze",
    "friction_viscous_nonlinear": "viscous_power",
    "friction_presliding_memory": "maxwell_spread",
    "load_spring": "spring_centre spring_hardening",
    "backlash": "contact_stiffness contact_damping",
    "mounting_compliance": "bracket_hardens_at bracket_damping body_mass",
    "end_cushion": "cushion_ring cushion_needle",
    "valve_dead_zone": "lap_rounding lap_spread",
    "valve_lag": "slew spool_return",
    "valve_hysteresis": "play_spread",
    "valve_null_leakage": "clearance_fade",
    "valve_critical_ratio": "critical_vent",
    "heat_transfer": "wall_volume wall_pressure",
    "dead_volume": "pocket_share pocket_rod_side pocket_bore",
    "line_delay": "tube_area tube_drag",
    "exhaust_restriction": "gallery",
    "inlet_mixing": "mixing_from mixing_leaving",
    "sensor_lag_p1": "averages",
    "channel_skew": "scan_x scan_p1 scan_p2",
    "valve_flow_force": "jet_exhaust port_push",
    "valve_curve": "hole_radius hole_vent",
    "side_volume_1": "side_bore side_exponent",
}
"""Which effect each constant of a form belongs to."""


@pytest.mark.parametrize("effect", sorted(FORMED))
def test_every_constant_of_a_form_changes_its_effect_and_no_other(effect):
    """Other values of the effect's own constants change the record, those of all other effects leave every bit."""
    own = FORMED[effect].split()
    hidden = preset(effect)

    def record(form: Form) -> dict[str, np.ndarray]:
        # quick moves to an end, and jumps at a low supply: cushions, the spool's slew and unchoked flow act
        runs = [
            record_servo(RIG, replace(hidden, form=form), how, 0.6, 5, supply=supply + ATMOSPHERE, sensors=IDEAL_SENSORS)
            for how, supply in ((QUICK, 7e5), (JUMPS, 2e5))
        ]
        return {name: np.concatenate([run[name] for run in runs]) for name in ("x", "p1", "p2")}

    usual, drawn = record(Form()), drawn_form(np.random.default_rng(4))
    for name in own:
        other = record(replace(Form(), **{name: getattr(drawn, name)}))
        assert max(np.max(np.abs(other[s] - usual[s])) for s in ("x", "p1", "p2")) > 0.0, name
    rest = record(replace(drawn, **{name: getattr(Form(), name) for name in own}))
    assert all(np.array_equal(rest[s], usual[s]) for s in ("x", "p1", "p2"))


def test_every_constant_of_a_form_belongs_to_an_effect():
    assert sorted(" ".join(FORMED.values()).split()) == sorted(item.name for item in fields(Form))
    with pytest.raises(ValueError, match="slew"):
        Form(slew=float("nan"))
