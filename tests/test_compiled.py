"""Libraries that are compiled beside what else is done."""

from __future__ import annotations

import os
import threading

import casadi as ca
import numpy as np
import pytest
from helpers import RANGES, rig, values_of

import pneuid.compiled
import pneuid.interval
from pneuid.compiled import compiled_library
from pneuid.interval import begin, interval_function
from pneuid.plant import Plant

SOURCE = "double twice(double x) { return 2.0 * x; }"


@pytest.fixture
def built(monkeypatch, tmp_path):
    """Libraries built in an empty cache, in order; two cores, whatever this machine has."""
    monkeypatch.setenv("PNEUID_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PNEUID_THREADS", "2")
    made, build = [], pneuid.compiled._build

    def noted(tool, source, library):
        made.append(library.name)
        return build(tool, source, library)

    monkeypatch.setattr(pneuid.compiled, "_build", noted)
    pneuid.interval._build.forget()
    pneuid.interval.begin.forget()
    yield made
    pneuid.interval._build.forget()
    pneuid.interval.begin.forget()


def test_what_is_begun_is_waited_for_and_built_once(built):
    pneuid.compiled.begin(SOURCE, "pneuid_test")
    pneuid.compiled.begin(SOURCE, "pneuid_test")
    library = compiled_library(SOURCE, "pneuid_test")
    assert library is not None and library.exists() and built == [library.name]
    pneuid.compiled.begin(SOURCE, "pneuid_test")  # there already
    assert compiled_library(SOURCE, "pneuid_test") == library and len(built) == 1


def test_with_one_core_nothing_is_begun(built, monkeypatch):
    monkeypatch.setenv("PNEUID_THREADS", "1")
    pneuid.compiled.begin(SOURCE, "pneuid_test")
    assert built == [] and compiled_library(SOURCE, "pneuid_test") is not None and len(built) == 1


def test_what_does_not_compile_is_tried_once(built):
    pneuid.compiled.begin("this is no C", "pneuid_test")
    assert compiled_library("this is no C", "pneuid_test") is None and len(built) == 1


def test_whoever_needs_the_library_hears_of_a_full_disk(built, monkeypatch):
    def full(*_):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(pneuid.compiled, "_build", full)
    pneuid.compiled.begin(SOURCE, "pneuid_test")
    with pytest.raises(OSError, match="no space left"):
        compiled_library(SOURCE, "pneuid_test")


def test_no_more_are_compiled_at_once_than_there_are_cores(built, monkeypatch):
    going, most, full = [0], [0], threading.Lock()
    gate = threading.Event()

    def slow(tool, source, library):
        with full:
            going[0] += 1
            most[0] = max(most[0], going[0])
        gate.wait(10.0)
        with full:
            going[0] -= 1
        return False

    monkeypatch.setattr(pneuid.compiled, "_build", slow)
    pneuid.compiled._places.cache_clear()
    for k in range(5):
        pneuid.compiled.begin(f"{SOURCE} /* {k} */", "pneuid_test")
    gate.set()
    for begun in [pneuid.compiled._BEGUN.pop(key) for key in list(pneuid.compiled._BEGUN)]:
        begun.result(timeout=10.0)
    assert 1 <= most[0] <= 2


def test_a_forked_process_does_not_wait_for_what_its_parent_has_begun(built, monkeypatch):
    pneuid.compiled.begin(SOURCE, "pneuid_test")
    begun = dict(pneuid.compiled._BEGUN)
    monkeypatch.setattr(os, "getpid", lambda: -1)
    assert compiled_library(SOURCE, "pneuid_test") is not None
    assert begun == pneuid.compiled._BEGUN
    monkeypatch.undo()
    for key in begun:
        pneuid.compiled._BEGUN.pop(key).result(timeout=60.0)


def test_one_library_serves_every_number_of_substeps_and_is_the_one_that_was_begun(built):
    plant = Plant(rig("servo"), "lugre")
    begin(plant, plant.parameter_names, 5)
    functions = [interval_function(plant, plant.parameter_names, 5, substeps) for substeps in (1, 2, 3)]
    assert len(built) == 1
    theta = plant.theta(values_of(plant), RANGES)
    start, data = np.array([0.1, 0.05, 3e5, 2e5, 0.0]), np.zeros((11, 5))
    data[0], data[1:3], data[3] = 1e-3, 6e5, 6e5
    exact = [pneuid.interval._chains(plant, plant.parameter_names, 5, n)["values"]() for n in (1, 2, 3)]
    for function, one in zip(functions, exact, strict=True):
        end, _ = pneuid.mapped.Mapped(function.values, 1)(start[:, None], data, theta[:, None])
        np.testing.assert_allclose(end[:, 0], np.asarray(one(start, data, ca.DM(theta))[0])[:, 0], rtol=1e-9, atol=1e-12)
