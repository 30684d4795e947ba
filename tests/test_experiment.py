"""The next experiment: excitations stay inside, the command file can be read back, a pair of rivals is separated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import base_fit, rig

from pneuid.criticism.decision.diagnosis import Command, Diagnosis
from pneuid.criticism.next_experiment import proposal
from pneuid.criticism.next_experiment.excitations import BENCH_LIBRARY, SERVO_LIBRARY, Axis
from pneuid.criticism.next_experiment.playing import MARGIN, play
from pneuid.criticism.next_experiment.proposal import _groups, propose
from pneuid.criticism.next_experiment.rival import Rival
from pneuid.effects import CATALOGUE, effects_by_name
from pneuid.estimation.fit import fit
from pneuid.plant import Plant
from pneuid.recording import Recording
from pneuid.rig import Rig
from pneuid.virtual_rig import Hidden, TruthBench, record_bench, strokes

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
    inputs = {"u": np.array([0.0, 1.0, -1.0]), "psup": np.full(3, 7.01325e5)}
    command = Command(T[:3], np.array([0.1, 0.2, 0.3]), inputs)
    lines = command.csv(101325.0, gauge=True).splitlines()
    assert lines[0] == "t [s],u [V],psup [kPa],x_expected [mm]" and len(lines) == 4
    assert lines[2] == "0.001,1.00000,600.00,200.000"
    assert command.csv(101325.0, gauge=False).splitlines()[1].split(",")[2] == "701.33"


def test_a_bench_s_command_file_has_its_motion_and_pressures():
    command = Command(T[:2], np.array([0.1, 0.2]), {"p1": np.full(2, 4.01325e5), "p2": np.full(2, 1.01325e5)})
    lines = command.csv(101325.0, gauge=True).splitlines()
    assert lines[0] == "t [s],p1 [kPa],p2 [kPa],x [mm]"
    assert lines[1] == "0,300.00,0.00,100.00000"


def test_a_model_follows_a_small_excitation_inside_the_limits():
    rival = Rival(base_fit())
    gentle = next(item for item in SERVO_LIBRARY if item.name == "small steps")
    scene = play([rival], gentle, 1.0)
    assert scene is not None
    (own,), command = scene.played, scene.command
    room = MARGIN * rig().stroke
    assert own.states[0].min() > room and own.states[0].max() < rig().stroke - room
    assert np.abs(command.inputs["u"]).max() <= 10.0 and command.inputs["psup"] == pytest.approx(6e5 + 101325.0)
    # a model follows its own recording
    assert rival.unable(command.t, scene.inputs, own, own) < 1.0


def test_an_excitation_under_which_the_axis_stays_where_it_is_is_not_offered():
    gentle = next(item for item in SERVO_LIBRARY if item.name == "small steps")
    still = replace(gentle, path=lambda t, axis: np.full(t.shape, axis.middle))
    assert play([Rival(base_fit())], still, 1.0) is None


def test_one_model_alone_needs_no_experiment():
    assert propose([base_fit()], [CATALOGUE["gravity"]]) is None


def test_what_acts_alike_stays_together_and_the_rest_is_told_apart():
    assert _groups(4, [(0, 2)]) == [[0, 2], [1], [3]]
    assert _groups(3, [(0, 1), (1, 2)]) == [[0, 1, 2]]
    assert _groups(2, []) == [[0], [1]]


def _bench_fits(names, own=None):
    own = own or rig("bench")
    truth, seen = TruthBench(), []
    for i, (speeds, p1, p2) in enumerate((((0.002, 0.05), 3e5, 2e5), ((0.01, 0.1), 1e5, 4e5))):
        motion = strokes(speeds, longest=0.5, dwell=0.2)
        record = record_bench(truth, p1 + truth.patm, p2 + truth.patm, motion, Hidden(gravity=12.0), seed=i)
        recorded = {name: column for name, column in record.items() if name[0] != "p" or name in own.chambers}
        seen.append(Recording.from_arrays(f"run_{i}.csv", own, **recorded))
    return [fit(Plant(own, "lugre", effects_by_name([name])), seen, exact=False) for name in names]


def test_a_bench_is_offered_a_motion_and_told_what_no_motion_tells():
    """A load and the force sensor's zero are one force on a bench; friction by direction is not, before it slides.

    No motion tells the first two, but seconds at rest with nothing pulling on the sensor.
    """
    names = ["gravity", "sensor_offset_F", "friction_direction"]
    fits = _bench_fits(names)
    found = propose(fits, [CATALOGUE[name] for name in names])
    assert found is not None and found.command is not None
    assert found.rivals == (("gravity",), ("sensor_offset_F",), ("friction_direction",))
    assert found.power > 0.99 and found.read == ("F",)
    assert "a zero reading (nothing pulling on the force sensor, some seconds recorded)" in found.why
    assert "none for gravity or friction_direction" in found.why and found.excitation.name in found.why
    known = fits[0].ranges
    assert found.command.x.min() >= known["x_low"] - 1e-9 and found.command.x.max() <= known["x_high"] + 1e-9
    assert set(found.command.inputs) == {"p1", "p2"}


@pytest.mark.parametrize(("stated", "pressures"), [(("bore",), {"p1"}), ((), set())], ids=["rod_side_open", "rod_alone"])
def test_a_bench_with_open_sides_is_offered_a_motion_with_the_pressures_that_it_has(stated, pressures):
    raw = rig("bench").to_dict()
    own = Rig.from_dict({**raw, "cylinder": {key: raw["cylinder"][key] for key in (*stated, "stroke")}})
    names = ["gravity", "friction_direction"]
    found = propose(_bench_fits(names, own), [CATALOGUE[name] for name in names])
    assert found is not None and found.command is not None
    assert set(found.command.inputs) == pressures == set(own.chambers)
    assert found.command.csv(own.patm, gauge=True).splitlines()[0] == ",".join(
        ["t [s]", *(f"{name} [kPa]" for name in sorted(pressures)), "x [mm]"]
    )


def test_nothing_is_proposed_among_effects_that_act_alike(monkeypatch):
    monkeypatch.setattr(proposal, "NEEDED", np.inf)  # no reading can be as sure
    names = ["gravity", "sensor_offset_F"]
    found = propose(_bench_fits(names), [CATALOGUE[name] for name in names])
    assert found is not None and found.command is None and found.power == 0.0 and not found.read
    assert "gravity and sensor_offset_F act alike" in found.why and "nothing pulls on it" in found.why


@pytest.mark.parametrize(
    ("beside", "started_from"), [((), "base"), (("leakage_internal",), "without gravity")], ids=["alone", "beside a leak"]
)
def test_rivals_beside_another_effect_are_fitted_with_it(beside, started_from, monkeypatch):
    best = SimpleNamespace(plant=SimpleNamespace(effects=[CATALOGUE[name] for name in ("gravity", *beside)]), name="best")
    rig_of_base = SimpleNamespace(rig=SimpleNamespace(kind="servo"), effects=[])
    base = SimpleNamespace(plant=rig_of_base, name="base")

    class Refits:
        def without(self, fit, name):
            assert fit is best
            return SimpleNamespace(plant=rig_of_base, name=f"without {name}")

        def each(self, fit, asked):
            return [(one, lambda one=one: f"{one.effect.name} from {fit.name}") for one in asked]

    seen = {}
    monkeypatch.setattr(proposal, "screen", lambda *_: [])

    def told(fits, effects):
        seen.update(zip([one.name for one in effects], fits, strict=True))

    monkeypatch.setattr(proposal, "propose", told)
    named = ("gravity", "load_spring", *beside)
    verdict = SimpleNamespace(diagnosis=Diagnosis("ambiguous", named, (), beside=beside), best=best)
    proposal.for_verdict(verdict, base, CATALOGUE, Refits())
    assert seen == {"gravity": best, "load_spring": f"load_spring from {started_from}"}
