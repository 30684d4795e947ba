"""How much of an effect's state is new after an interval, and what a fit that knows it does not invent."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers import rig
from hypothesis import given
from hypothesis import strategies as st

from pneuid.effects import effects_by_name
from pneuid.estimation import forgetting
from pneuid.estimation.forgetting import LEAST, renewed
from pneuid.estimation.preparation import Run, data_ranges, noise_of, prepare
from pneuid.estimation.shooting import OWN_DEFECT, Shooting
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.virtual_rig import ATMOSPHERE, record_servo
from pneuid.virtual_rig.truth import TruthServo


@cache
def made(effect: str) -> tuple[Plant, Run, Recording]:
    at = rig()
    record = record_servo(TruthServo(), excitation="travel", duration=1.0, seed=3, supply=7e5 + ATMOSPHERE)
    run = Recording.from_arrays("run.csv", at, **{name: record[name] for name in ("t", "u", "x", "p1", "p2")})
    plant = Plant(at, "lugre", effects_by_name([effect] if effect else []))
    return plant, prepare(run, plant, noise_of(at, [run])), run


@given(st.floats(1e-4, 10.0))
def test_a_state_of_one_time_constant_renews_as_white_noise_through_it_does(interval):
    """Seals that warm over 20 s; the share by the exponential's own series where the interval is short."""
    plant, run, _ = made("friction_warmup")
    (share,) = renewed(plant, [run, run], interval)
    assert share == pytest.approx(np.sqrt(1.0 - np.exp(-2.0 * interval / 20.0)), rel=1e-6)
    assert share <= np.sqrt(2.0 * interval / 20.0)


@pytest.mark.parametrize("name", ["friction_lag", "sensor_lag_p1", "valve_lag"])
def test_what_forgets_within_the_interval_is_new_after_it(name):
    plant, run, _ = made(name)
    assert np.all(renewed(plant, [run], 0.02) > 0.999)


@pytest.mark.parametrize(("rate", "share"), [(0.0, LEAST), (np.nan, 1.0), (np.inf, 1.0), (1e-9, LEAST)])
def test_the_share_can_be_divided_by_whatever_the_rate(rate, share, monkeypatch):
    """Records at rest move no such state; one too fast for the sampling runs away."""
    plant, run, _ = made("friction_presliding_memory")
    monkeypatch.setattr(forgetting, "_rates", lambda *_: np.array([rate]))
    assert renewed(plant, [run], 0.02) == pytest.approx([share])


def test_a_model_without_such_states_has_none():
    plant, run, _ = made("")
    assert renewed(plant, [run], 0.02).shape == (0,)


def test_defects_of_slow_states_are_held_in_proportion():
    plant, run, recording = made("friction_warmup")
    problem = Shooting(plant, [run], plant.parameter_names, plant.starts(), data_ranges([recording], plant), 2)
    share = np.sqrt(1.0 - np.exp(-2.0 * 0.02 / 20.0))
    assert problem.state_scale[-1] == pytest.approx(OWN_DEFECT * share * plant.effect_states[-1].scale, rel=1e-3)
    assert problem.state_scale[:-1] == pytest.approx(plant.state_scales[:-1])
