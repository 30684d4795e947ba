"""The FMUs: valid by FMPy's judgement, and equal to Python under inputs that move."""

from __future__ import annotations

import zipfile

import helpers
import numpy as np
import pytest

from controllers.control_model import ControlModel
from controllers.export.fmu import fmu_bytes, units
from controllers.export.pieces import tuned
from controllers.export.recorded import hard_track, record
from controllers.export.sources import c_sources
from controllers.model_plant import ModelPlant
from controllers.tuning import Design
from pneuid.compiled import compiler
from pneuid.model import nominal_model

fmpy = pytest.importorskip("fmpy", reason="no FMPy")
pytestmark = [
    pytest.mark.skipif(compiler() is None, reason="no C compiler"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy"),
]
SUPPLY = 6e5


@pytest.fixture(scope="module")
def found():
    model = nominal_model(helpers.rig(), helpers.TRUTH, helpers.RANGES)
    return tuned(ControlModel(model.plant, model.theta()), Design(SUPPLY), refined=False)


@pytest.fixture(scope="module")
def files(found, tmp_path_factory):
    """Path of each FMU by its name."""
    folder, sources = tmp_path_factory.mktemp("fmu"), c_sources(found, "a <model> & more")
    paths = {}
    for unit in units(found):
        paths[unit.name] = folder / f"{unit.name}.fmu"
        paths[unit.name].write_bytes(fmu_bytes(unit, sources, "a <model> & more"))
    return paths


def played(path, step, t, columns, **options):
    """Answer of an FMU to inputs given at every communication point."""
    rows = np.array(list(zip(t, *columns.values(), strict=True)), dtype=[(n, float) for n in ("time", *columns)])
    return fmpy.simulate_fmu(
        str(path), start_time=0.0, stop_time=t[-1], step_size=step, output_interval=step, input=rows, **options
    )


@pytest.mark.parametrize("name", ["pneuid_plant", "pneuid_servo", "pneuid_nmpc"])
def test_fmpy_finds_no_fault(name, files):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(files[name])) == []
    with zipfile.ZipFile(files[name]) as archive:
        names = set(archive.namelist())
    assert {"modelDescription.xml", "sources/fmu_slave.c", "sources/pneuid_model.h"} <= names


@pytest.mark.parametrize("step", [1e-3, 2.5e-4])
def test_the_plant_moves_as_in_python(step, files, found):
    """A sine with noise on it and a supply that breathes, held between communication points on both sides."""
    model = found.model
    t = step * np.arange(301)
    u = 3.0 * np.sin(2.0 * np.pi * 2.0 * t) + np.random.default_rng(0).uniform(-2.0, 2.0, t.size)
    supply = SUPPLY + 3e4 * np.sin(9.0 * t)
    start = {"x_start": 0.2, "p1_start": 3.0e5, "p2_start": 3.5e5}
    seen = played(files["pneuid_plant"], step, t, {"u": u, "psup": supply}, start_values=start)
    plant = ModelPlant(model)
    plant.reset(0.2, SUPPLY)
    plant.array[:] = model.rest(0.2, 3.0e5, 3.5e5)
    states = []
    for k in range(t.size):
        states.append(plant.array.copy())
        plant._given[1] = supply[k]  # the plant is built for a supply that stays
        plant.step(u[k], step)
    states = np.array(states)
    assert np.ptp(states[:, 2]) > 2e4
    for place, (name, scale) in enumerate({"x": 1.0, "v": 1.0, "p1": 1e5, "p2": 1e5}.items()):
        np.testing.assert_allclose(seen[name] / scale, states[:, place] / scale, atol=1e-10)


def test_a_parameter_of_the_plant_can_be_set(files, found):
    t = 1e-3 * np.arange(101)
    columns = {"u": np.full(t.size, 5.0), "psup": np.full(t.size, SUPPLY)}
    plain = played(files["pneuid_plant"], 1e-3, t, columns)
    wide = played(files["pneuid_plant"], 1e-3, t, columns, start_values={"C": 2.0 * found.model.value("C")})
    assert wide["x"][-1] - wide["x"][0] > 1.2 * (plain["x"][-1] - plain["x"][0])


@pytest.mark.parametrize("name", ["servo", "nmpc"])
def test_a_controller_commands_as_in_python(name, files, found):
    controller = getattr(found, name)
    track = hard_track(found.model, controller.sample_time, 0.4, controller.preview, 0.15 if name == "nmpc" else 0.0)
    run = record(controller, ModelPlant(found.model), track, SUPPLY, seed=5)
    columns = dict(zip(("x", "p1", "p2", "psup"), run.seen.T, strict=True))
    for place, signal in enumerate(("position", "velocity", "acceleration", "jerk")[: 4 if name == "servo" else 2]):
        columns |= {f"{signal}[{i}]": run.target[i : i + run.u.size, place] for i in range(controller.preview)}
    seen = played(files[f"pneuid_{name}"], controller.sample_time, run.t, columns, output=["u"])
    # what a step returns acts from its end on
    np.testing.assert_allclose(seen["u"][1:], run.u[:-1], atol=1e-9)
    assert np.ptp(run.u) > 15.0


def test_a_wrong_step_is_refused(files):
    t = 0.7e-3 * np.arange(11)
    with pytest.raises(Exception, match="fmi2DoStep"):
        played(files["pneuid_servo"], 0.7e-3, t, {"x": np.full(t.size, 0.25)})
