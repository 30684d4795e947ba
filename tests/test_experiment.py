"""The next experiment: excitations stay inside, the command file can be read back, a pair of rivals is separated."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import base_fit, rig

from pneuid.criticism.diagnosis import Command
from pneuid.criticism.excitations import BENCH_LIBRARY, SERVO_LIBRARY, Axis
from pneuid.criticism.experiment import MARGIN, _playable, _Rival, propose

AXIS = Axis(0.06, 0.44, 0.6)
T = np.arange(6000) * 1e-3


@pytest.mark.parametrize("excitation", [*SERVO_LIBRARY, *BENCH_LIBRARY], ids=lambda item: item.name)
def test_every_excitation_moves_within_the_axis(excitation):
    x = excitation.path(T, AXIS)
    assert x.shape == T.shape and x.min() >= AXIS.low - 1e-9 and x.max() <= AXIS.high + 1e-9 and np.ptp(x) > 1e-5
    share = T / T[-1]
    assert excitation.closed(share).dtype == bool
    lowered = excitation.lowered(share)
    assert lowered.min() >= 0.0 and lowered.max() <= 1.0


def test_the_command_file_has_units_and_the_rigs_convention():
    command = Command(T[:3], np.array([0.0, 1.0, -1.0]), np.full(3, 7.01325e5), np.array([0.1, 0.2, 0.3]))
    lines = command.csv(101325.0, gauge=True).splitlines()
    assert lines[0] == "t [s],u [V],psup [kPa],x_expected [mm]" and len(lines) == 4
    assert lines[2] == "0.001,1.00000,600.00,200.000"
    assert command.csv(101325.0, gauge=False).splitlines()[1].split(",")[2] == "701.33"


def test_a_model_follows_a_small_excitation_inside_the_limits():
    rival = _Rival(base_fit())
    gentle = next(item for item in SERVO_LIBRARY if item.name == "small steps")
    played = _playable([rival], gentle, 1.0)
    assert played is not None
    command, states = played
    room = MARGIN * rig().stroke
    assert states[0][0].min() > room and states[0][0].max() < rig().stroke - room
    assert np.abs(command.u).max() <= 10.0 and command.supply == pytest.approx(6e5 + 101325.0)
    # a model follows its own recording
    assert rival.unable(command, states[0], states[0]) < 1.0


def test_one_model_alone_needs_no_experiment():
    assert propose([base_fit()], ["gravity"]) is None
