"""Sanity checks: each slip is caught in data changed as a user's slip would, and no clean rig gives a finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from helpers import BENCH, SERVO
from test_real_data import EMPS_FILE, ZILLEN, emps_run, needs_emps, needs_zillen

from pneuid.plausibility import CHECKS, check_recordings
from pneuid.recording import Recording
from pneuid.resources import scenario_path
from pneuid.rig import Rig, RunSettings
from pneuid.virtual_rig import (
    ATMOSPHERE,
    HIDDEN_EFFECTS,
    NOTHING,
    Hidden,
    TruthBench,
    TruthServo,
    record_bench,
    record_servo,
)

Record = dict[str, np.ndarray]
PRESSURES = ("p1", "p2")


@dataclass(frozen=True)
class Stand:
    """A virtual servo rig with what it hides, driven once."""

    hidden: Hidden = NOTHING
    excitation: str = "multisine"
    bar: float = 5.0
    bore: float = 0.032


@cache
def truth_of(stand: Stand) -> TruthServo:
    return TruthServo() if stand.bore == 0.032 else TruthServo().scaled(stand.bore)


@cache
def record_of(stand: Stand, seed: int = 100) -> Record:
    supply = stand.bar * 1e5 + ATMOSPHERE
    return record_servo(truth_of(stand), stand.hidden, stand.excitation, 3.0, seed, supply=supply)


def servo_rig(stand: Stand, pressure: str = "gauge") -> Rig:
    """The rig as its user would describe it: the valve's data sheet is 20 % off."""
    truth = truth_of(stand)
    supply = stand.bar + (ATMOSPHERE / 1e5 if pressure == "abs" else 0.0)
    cylinder = {
        key: f"{getattr(truth, name)} m" for key, name in (("bore", "bore"), ("rod", "rod_2"), ("stroke", "stroke"))
    }
    cylinder |= {key: f"{getattr(truth, key)} m^3" for key in ("dead_volume_1", "dead_volume_2")}
    changes = {
        "conventions": {"pressure": pressure},
        "cylinder": cylinder,
        "load": {"mass": f"{truth.mass} kg"},
        "valve": {**SERVO["valve"], "conductance": f"{truth.conductance / 1.2} m^3/(s*Pa)"},
        "supply": {"pressure": f"{supply} bar"},
        "runs": {},
    }
    return Rig.from_dict({**SERVO, **changes})


def found_in(rig: Rig, record: Record) -> list[str]:
    findings = check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record)])
    for finding in findings:
        assert "\n" not in finding.line
        assert finding.advice
        assert any(character.isdigit() for character in finding.seen), finding.seen
    return [finding.check for finding in findings]


def with_pressures(record: Record, change: Callable[[np.ndarray], np.ndarray]) -> Record:
    return {**record, **{name: change(record[name]) for name in PRESSURES}}


def unit_slip(record: Record, factor: float) -> Record:
    return with_pressures(record, lambda p: ATMOSPHERE + factor * (p - ATMOSPHERE))


def late(record: Record, signals: tuple[str, ...], seconds: float) -> Record:
    return {**record, **{name: np.interp(record["t"] - seconds, record["t"], record[name]) for name in signals}}


def clipped(record: Record, signal: str) -> Record:
    return {**record, signal: np.minimum(record[signal], np.percentile(record[signal], 92))}


# --- a valve-driven rig ---

SERVO_SLIPS: dict[str, tuple[str, str, Callable[[Record], Record]]] = {
    "p1 and p2": ("swapped_chambers", "gauge", lambda r: {**r, "p1": r["p2"], "p2": r["p1"]}),
    "u": ("reversed_command", "gauge", lambda r: {**r, "u": -r["u"]}),
    "x": ("reversed_position", "gauge", lambda r: {**r, "x": 0.5 - r["x"]}),
    "absolute as gauge": ("pressure_reference", "gauge", lambda r: with_pressures(r, lambda p: p + ATMOSPHERE)),
    "gauge as absolute": ("pressure_reference", "abs", lambda r: with_pressures(r, lambda p: p - ATMOSPHERE)),
    "kPa as bar": ("unit_of_pressure", "gauge", lambda r: unit_slip(r, 100.0)),
    "bar as kPa": ("unit_of_pressure", "gauge", lambda r: unit_slip(r, 0.01)),
    "psi as kPa": ("unit_of_pressure", "gauge", lambda r: unit_slip(r, 1 / 6.895)),
    "psi as bar": ("unit_of_pressure", "gauge", lambda r: unit_slip(r, 14.5)),
    "p1 alone, bar as kPa": ("unit_of_pressure", "gauge", lambda r: {**r, "p1": unit_slip(r, 0.01)["p1"]}),
    "p2 alone, bar as kPa": ("unit_of_pressure", "gauge", lambda r: {**r, "p2": unit_slip(r, 0.01)["p2"]}),
    "x late": ("channel_skew", "gauge", lambda r: late(r, ("x",), 0.010)),
    "p1 late": ("channel_skew", "gauge", lambda r: late(r, ("p1",), 0.010)),
    "p2 late": ("channel_skew", "gauge", lambda r: late(r, ("p2",), 0.012)),
    "both pressures late": ("channel_skew", "gauge", lambda r: late(r, PRESSURES, 0.015)),
    "u late": ("channel_skew", "gauge", lambda r: late(r, ("u",), 0.012)),
    "p2 clipped": ("clipped_sensor", "gauge", lambda r: clipped(r, "p2")),
}


@pytest.mark.parametrize("slip", SERVO_SLIPS)
@pytest.mark.parametrize("stand", [Stand(), Stand(HIDDEN_EFFECTS["leakage_internal"]["strong"], "multisine", 6.0)])
def test_a_slip_on_a_servo_rig_is_named(slip, stand):
    check, pressure, change = SERVO_SLIPS[slip]
    names = found_in(servo_rig(stand, pressure), change(record_of(stand)))
    assert names[:1] == [check]


def test_the_delay_is_estimated():
    rig = servo_rig(Stand())
    for name, seconds in (("x", 0.010), ("p1", 0.012), ("u", 0.014)):
        record = late(record_of(Stand()), (name,), seconds)
        (finding,) = check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record)])
        assert finding.signal == name
        told = float(finding.suspected.split("about ")[1].split(" ms")[0])
        assert told == pytest.approx(1e3 * seconds, abs=2.0)


DELAYS = ("channel_skew", "sensor_lag_p1", "sensor_lag_p2")
"""Hidden effects that are a delayed channel: to say so is right."""

CLEAN = [
    Stand(excitation="steps", bar=7.0),
    Stand(excitation="slow"),
    Stand(excitation="sine", bar=3.0),
    Stand(bore=0.05, bar=6.0),
    Stand(bore=0.02, excitation="steps", bar=6.0),
    Stand(HIDDEN_EFFECTS["leakage_internal"]["weak"], "sine", 4.0, 0.063),
    *[
        Stand(levels["strong"], excitation)
        for (name, levels), excitation in zip(
            HIDDEN_EFFECTS.items(), cycle(("multisine", "slow", "steps", "sine")), strict=False
        )
        if name not in DELAYS
    ],
    Stand(Hidden(heat_transfer=1.0)),
    Stand(Hidden(valve_lag=0.015)),
    Stand(Hidden(valve_lag=0.02), "steps"),
    Stand(Hidden(leakage_external_1=0.05)),
    Stand(Hidden(leakage_external_2=0.08), "steps"),
    Stand(Hidden(valve_offset=0.05), "sine"),
    Stand(Hidden(valve_asymmetry=0.3)),
    Stand(Hidden(load_spring=200.0)),
    Stand(Hidden(sensor_offset_p1=1e4)),
]  # fmt: skip


@pytest.mark.parametrize(
    "stand", CLEAN, ids=lambda stand: f"{stand.excitation}-{stand.bar:g}bar-{1e3 * stand.bore:g}mm"
)
def test_a_physical_effect_is_no_slip(stand):
    assert found_in(servo_rig(stand), record_of(stand, 7)) == []


def test_a_rate_too_low_for_presliding_is_named_with_the_law():
    stand = Stand(excitation="sine", bar=5.0)
    slow = {name: values[::40] for name, values in record_of(stand).items()}
    (finding,) = check_recordings(servo_rig(stand), [Recording.from_arrays("run.csv", servo_rig(stand), **slow)])
    assert finding.check == "sample_rate"
    assert "25 Hz" in finding.seen and "lugre" in finding.suspected
    static = Rig.from_dict({**servo_rig(stand).to_dict(), "friction": "coulomb"})
    assert check_recordings(static, [Recording.from_arrays("run.csv", static, **slow)]) == ()


# --- a bench ---


def bench_rig(pressure: str = "gauge", **changes: Any) -> Rig:
    return Rig.from_dict({**BENCH, "friction": "stribeck", "conventions": {"pressure": pressure}, **changes})


@cache
def bench_record(p1: float = 5.0, p2: float = 2.0, hidden: Hidden = NOTHING) -> Record:
    return record_bench(TruthBench(), p1 * 1e5 + ATMOSPHERE, p2 * 1e5 + ATMOSPHERE, "strokes", hidden, 3, step=50e-6)


BENCH_SLIPS: dict[str, tuple[str, str, Callable[[Record], Record]]] = {
    "F": ("reversed_force", "gauge", lambda r: {**r, "F": -r["F"]}),
    "x": ("reversed_bench_position", "gauge", lambda r: {**r, "x": 0.5 - r["x"]}),
    "p1 and p2": ("bench_chambers", "gauge", lambda r: {**r, "p1": r["p2"], "p2": r["p1"]}),
    "kPa as bar": ("bench_unit", "gauge", lambda r: unit_slip(r, 100.0)),
    "psi as kPa": ("bench_unit", "gauge", lambda r: unit_slip(r, 1 / 6.895)),
    "one chamber, absolute as gauge": (
        "bench_reference", "gauge", lambda r: {name: r[name] + ATMOSPHERE * (name == "p1") for name in r if name != "p2"},
    ),
    "gauge as absolute": (
        "bench_reference", "abs", lambda r: with_pressures(r, lambda p: np.maximum(p - ATMOSPHERE, 0.0)),
    ),
    "F clipped": ("clipped_sensor", "gauge", lambda r: clipped(r, "F")),
}  # fmt: skip


@pytest.mark.parametrize("slip", BENCH_SLIPS)
def test_a_slip_on_a_bench_is_named(slip):
    check, pressure, change = BENCH_SLIPS[slip]
    p2 = 0.0 if check == "bench_reference" else 2.0
    assert check in found_in(bench_rig(pressure), change(bench_record(5.0, p2)))


@pytest.mark.parametrize(
    ("p1", "p2", "hidden"),
    [
        (5.0, 2.0, NOTHING), (0.0, 0.0, NOTHING), (3.0, 3.0, NOTHING), (1.0, 4.0, NOTHING), (6.0, 0.0, NOTHING),
        (5.0, 2.0, Hidden(gravity=15.0)), (3.0, 3.0, Hidden(friction_direction=0.3)),
        (4.0, 1.0, Hidden(sensor_offset_F=5.0)), (2.0, 2.0, Hidden(load_spring=200.0)),
        (5.0, 4.0, Hidden(friction_position=0.5)), (1.0, 0.0, Hidden(friction_direction=-0.3)),
    ],
)  # fmt: skip
def test_a_bench_with_a_physical_effect_has_no_slip(p1, p2, hidden):
    assert found_in(bench_rig(), bench_record(p1, p2, hidden)) == []


@pytest.mark.parametrize(("reaches", "expected"), [(1.0, []), (0.6, ["clipped_sensor"])])
def test_a_bench_may_hold_its_largest_speed_but_not_be_outrun(reaches, expected):
    made = record_bench(TruthBench(), 5e5 + ATMOSPHERE, 2e5 + ATMOSPHERE, "strokes", seed=3, step=50e-6, with_truth=True)
    top = reaches * np.abs(made["true_v"]).max()
    record = {name: made[name] for name in ("t", "x", "p1", "p2", "F")} | {"v": np.clip(made["true_v"], -top, top)}
    assert found_in(bench_rig(), record) == expected


# --- all of them ---


def test_every_check_has_a_slip_that_triggers_it():
    by_record = {case[0] for case in (*SERVO_SLIPS.values(), *BENCH_SLIPS.values())}
    assert by_record | {"sample_rate", "misnamed_run", "supply_too_low", "mass_out_of_scale"} == set(CHECKS)


@pytest.mark.parametrize("stated", [4.5, 5.0])
def test_a_supply_that_a_chamber_exceeds_is_named(stated):
    rig = servo_rig(Stand(bar=stated))
    found = check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record_of(Stand(bar=7.0)))])
    finding = next(one for one in found if one.check == "supply_too_low")
    assert finding.signal == "run.csv"
    assert f"above the supply of {stated:g} bar" in finding.seen


def test_the_supply_to_state_follows_the_rigs_convention():
    least = {}
    for pressure in ("gauge", "abs"):
        rig = servo_rig(Stand(bar=5.0), pressure)
        found = check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record_of(Stand(bar=7.0)))])
        advice = next(one for one in found if one.check == "supply_too_low").advice
        assert f"({pressure})" in advice
        least[pressure] = float(advice.split('supply = "')[1].split(" bar")[0])
    assert 5.0 < least["gauge"] <= 7.0
    assert least["abs"] - least["gauge"] == pytest.approx(ATMOSPHERE / 1e5, abs=0.02)


def test_a_supply_that_is_fitted_is_no_slip():
    rig = replace(servo_rig(Stand(bar=5.0)), runs={"run.csv": RunSettings(free=("supply",))})
    found = check_recordings(rig, [Recording.from_arrays("run.csv", rig, **record_of(Stand(bar=7.0)))])
    assert "supply_too_low" not in {one.check for one in found}


@pytest.mark.parametrize(("rig", "mass", "named"), [
    ("servo", 2.4e-3, True), ("servo", 2400.0, True), ("servo", 0.1, False), ("servo", 60.0, False), ("bench", 1e-3, True),
    ("bench", 0.6, False),
])  # fmt: skip
def test_a_mass_out_of_scale_is_named(rig, mass, named):
    found = replace(servo_rig(Stand()) if rig == "servo" else bench_rig(), mass=mass)
    record = record_of(Stand()) if rig == "servo" else bench_record(3.0, 3.0, NOTHING)
    checks = [one.check for one in check_recordings(found, [Recording.from_arrays("run.csv", found, **record)])]
    assert ("mass_out_of_scale" in checks) is named


def test_the_unit_that_the_rig_file_states_is_the_one_suspected():
    columns = {"p1": {"column": "A", "unit": "kPa"}, "p2": {"column": "B", "unit": "kPa"}}
    rig = Rig.from_dict({**SERVO, "columns": columns, "supply": {"pressure": "5 bar"}, "runs": {}})
    record = Recording.from_arrays("run.csv", rig, **unit_slip(record_of(Stand()), 0.01))
    assert "(bar written as kPa)" in check_recordings(rig, [record])[0].suspected


@pytest.mark.parametrize("written", ["log_mon_2.csv", "data/Log-Mon2.csv", "log_mon2.txt"])
def test_a_table_of_a_run_under_another_name_is_named(written):
    rig = replace(servo_rig(Stand()), runs={written: RunSettings(supply=4e5)})
    record = Recording.from_arrays("log_mon2.csv", rig, **record_of(Stand()))
    finding = check_recordings(rig, [record])[0]
    assert (finding.check, finding.signal) == ("misnamed_run", "log_mon2.csv")
    assert written in finding.seen
    assert "5 bar gauge" in finding.seen


@pytest.mark.parametrize("written", ["log_mon1.csv", "log_mon22.csv", "log_mon2.csv"])
def test_a_table_of_another_run_is_no_slip(written):
    rig = replace(servo_rig(Stand()), runs={written: RunSettings()})
    assert check_recordings(rig, [Recording.from_arrays("log_mon2.csv", rig, **record_of(Stand()))]) == ()


def test_nothing_is_said_of_no_recordings():
    assert check_recordings(servo_rig(Stand()), []) == ()


@needs_emps
def test_the_axis_of_emps_gives_no_finding():
    rig, run = emps_run()
    assert EMPS_FILE.exists()
    assert check_recordings(rig, [run]) == ()


@needs_zillen
@pytest.mark.parametrize(("rig_file", "seal"), [("rig.toml", "O-ring"), ("rig_257.toml", "O-ring257")])
def test_the_seals_of_zillen_give_no_finding(rig_file, seal):
    rig = Rig.from_toml(scenario_path(f"real/zillen/{rig_file}"))
    runs = [Recording.read(ZILLEN / f"{seal}_{bar}bar.csv", rig) for bar in (1, 3, 5, 7)]
    assert check_recordings(rig, runs) == ()
    for run in runs:
        assert check_recordings(rig, [run]) == ()
