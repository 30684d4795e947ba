"""FMI 2.0 co-simulation units around the exported C: the identified plant, the servo, the predictive controller.

The slave, the description and the C are this project's own; an FMU holds the sources and a binary for the machine it was
built on. Source: Functional Mock-up Interface 2.0.4, chapters 2.2 (description) and 4 (co-simulation).
"""

from __future__ import annotations

import io
import platform
import sys
import tempfile
import uuid
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from controllers.export.emit import number
from controllers.export.library import build_library
from controllers.export.pieces import Controllers
from controllers.export.sources import HEADERS, NMPC, PLANT, SERVO, template

_EXPONENTS: dict[str, dict[str, str]] = {
    "m": {"m": "1"}, "m/s": {"m": "1", "s": "-1"}, "m/s2": {"m": "1", "s": "-2"}, "m/s3": {"m": "1", "s": "-3"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"}, "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"},
}  # fmt: skip
"""Units of the variables in SI base units."""


@dataclass(frozen=True)
class Variable:
    """One real variable: name in FMI, words, unit (None: that of a model parameter, told in the words), start, role
    (input, output, parameter, tunable)."""

    name: str
    words: str
    unit: str | None
    start: float
    role: str

    @property
    def macro(self) -> str:
        """Name in C: ``position[3]`` is ``position_3``."""
        return self.name.replace("[", "_").replace("]", "")


@dataclass(frozen=True)
class Unit:
    """One FMU to build: its name, what it does, its variables in order, its C files and its fixed step [s] if any."""

    name: str
    words: str
    variables: tuple[Variable, ...]
    files: tuple[str, ...]
    adapter: str
    step: float | None


def units(found: Controllers) -> tuple[Unit, ...]:
    """The three units of an export."""
    return _plant(found), _controller(found, "servo"), _controller(found, "nmpc")


def _plant(found: Controllers) -> Unit:
    model = found.model
    patm = model.value("patm")
    level = patm + 0.6 * (found.design_supply - patm)
    x = 0.5 * model.value("stroke")
    own = [
        Variable(item.name, f"{item.symbol} in {item.unit}", None, model.value(item.name), "tunable")
        for item in model.plant.parameters
    ]
    rest = (
        Variable("u", "command to the valve", "V", model.neutral, "input"),
        Variable("psup", "supply pressure, absolute", "Pa", found.design_supply, "input"),
        Variable("x", "position", "m", x, "output"),
        Variable("v", "velocity", "m/s", 0.0, "output"),
        Variable("p1", "pressure of chamber 1, absolute", "Pa", level, "output"),
        Variable("p2", "pressure of chamber 2, absolute", "Pa", level, "output"),
        Variable("x_start", "position at the start, at rest", "m", x, "parameter"),
        Variable("p1_start", "pressure of chamber 1 at the start, absolute", "Pa", level, "parameter"),
        Variable("p2_start", "pressure of chamber 2 at the start, absolute", "Pa", level, "parameter"),
    )
    return Unit(
        "pneuid_plant", "Identified pneumatic servo axis", (*rest, *own), PLANT, "fmu_plant.c", None,
    )  # fmt: skip


def _controller(found: Controllers, kind: str) -> Unit:
    model, predictive = found.model, kind == "nmpc"
    controller = found.nmpc if predictive else found.servo
    x, supply = 0.5 * model.value("stroke"), found.design_supply
    given = [
        Variable("x", "measured position", "m", x, "input"),
        Variable("p1", "measured pressure of chamber 1, absolute", "Pa", supply, "input"),
        Variable("p2", "measured pressure of chamber 2, absolute", "Pa", supply, "input"),
        Variable("psup", "supply pressure, absolute", "Pa", supply, "input"),
    ]
    columns = [("position", "m", x), ("velocity", "m/s", 0.0)]
    if not predictive:
        columns += [("acceleration", "m/s2", 0.0), ("jerk", "m/s3", 0.0)]
    for column, unit, start in columns:
        given += [
            Variable(f"{column}[{i}]", f"reference {column}, {i} samples ahead", unit, start, "input")
            for i in range(controller.preview)
        ]
    u = Variable("u", "command that acts from the end of the step on", "V", model.neutral, "output")
    words = "Predictive position controller (NMPC)" if predictive else "Friction-compensating position servo"
    files, step = (NMPC if predictive else SERVO), controller.sample_time
    return Unit(f"pneuid_{kind}", words, (*given, u), files, f"fmu_{kind}.c", step)


def fmu_bytes(unit: Unit, sources: Mapping[str, str], model_name: str) -> bytes:
    """The FMU as a zip archive; ``sources`` as ``c_sources`` gives them.

    Raises ``UserError`` without a C compiler and ``ComputationError`` when the code does not compile.
    """
    own = (unit.adapter, "fmu_slave.c")
    texts = {name: sources[name] for name in (*unit.files, *HEADERS)}
    texts |= {name: template(name) for name in (*own, "fmu_unit.h", "fmi2.h")}
    # the identifier follows the content, so the same model gives the same FMU
    identity = "".join([*texts.values(), *(repr(item) for item in unit.variables)])
    guid = "{" + str(uuid.uuid5(uuid.NAMESPACE_URL, identity)) + "}"
    texts["fmu_variables.h"] = _variables_header(unit, guid)
    compiled = (*own, *unit.files)
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        flags = ("-O2", "-fvisibility=hidden")
        binary = build_library(Path(folder), Path(folder) / "binary", compiled, flags).read_bytes()
    place, ending = _platform()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        content: dict[str, str | bytes] = {
            "modelDescription.xml": _description(unit, guid, model_name, compiled),
            f"binaries/{place}/{unit.name}{ending}": binary,
            **{f"sources/{name}": text for name, text in sorted(texts.items())},
        }
        for name, data in content.items():
            # no time of day, so that the same model gives the same archive
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _platform() -> tuple[str, str]:
    """Folder and ending of a binary of this machine, after the standard's table (2.3)."""
    bits = "64" if sys.maxsize > 2**32 else "32"
    names = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib"), "Windows": ("win", ".dll")}
    folder, ending = names.get(platform.system(), (platform.system().lower(), ".so"))
    return folder + bits, ending


def _variables_header(unit: Unit, guid: str) -> str:
    """Places of the variables and their start values."""
    count = len(unit.variables)
    own = [i for i, item in enumerate(unit.variables) if item.role == "tunable"]
    lines = ["#ifndef PNEUID_FMU_VARIABLES_H", "#define PNEUID_FMU_VARIABLES_H", "", f'#define FMU_GUID "{guid}"']
    lines += [f"#define FMU_REALS {count}"]
    if own:
        lines += [f"#define FMU_PARAMETERS {own[0]}", f"#define FMU_PARAMETER_COUNT {len(own)}"]
    lines += ["", "enum {", ",\n".join(f"    FMU_{item.macro} = {i}" for i, item in enumerate(unit.variables)), "};"]
    lines += ["", "static const double fmu_start[FMU_REALS] = {"]
    lines += [f"    {number(item.start)}, /* {item.name} */" for item in unit.variables]
    return "\n".join([*lines, "};", "", "#endif", ""])


def _description(unit: Unit, guid: str, model_name: str, compiled: Sequence[str]) -> str:
    """modelDescription.xml."""
    root = ET.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=unit.name, guid=guid,
        description=f"{unit.words}, from the identified model {model_name}", generationTool="pneuid",
        variableNamingConvention="structured", numberOfEventIndicators="0",
    )  # fmt: skip
    simulation = ET.SubElement(
        root, "CoSimulation", modelIdentifier=unit.name, canHandleVariableCommunicationStepSize=_truth(unit.step is None),
        canInterpolateInputs="false", canNotUseMemoryManagementFunctions="true",
    )  # fmt: skip
    files = ET.SubElement(simulation, "SourceFiles")
    for name in compiled:
        ET.SubElement(files, "File", name=name)
    defined = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(item.unit for item in unit.variables if item.unit):
        ET.SubElement(ET.SubElement(defined, "Unit", name=name), "BaseUnit", _EXPONENTS[name])
    step = unit.step or 1e-3
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step))
    _variables(root, unit)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode")


_ATTRIBUTES = {
    "input": {"causality": "input", "variability": "continuous"},
    "output": {"causality": "output", "variability": "continuous", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "fixed", "initial": "exact"},
    "tunable": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def _variables(root: ET.Element, unit: Unit) -> None:
    """The variables and, for outputs, what they depend on."""
    listed = ET.SubElement(root, "ModelVariables")
    outputs = []
    for i, item in enumerate(unit.variables):
        words = {"name": item.name, "valueReference": str(i), "description": item.words}
        variable = ET.SubElement(listed, "ScalarVariable", words | _ATTRIBUTES[item.role])
        real = ET.SubElement(variable, "Real")
        if item.unit:
            real.set("unit", item.unit)
        if item.role == "output":
            outputs.append(str(i + 1))
        else:
            real.set("start", repr(float(item.start)))
    structure = ET.SubElement(root, "ModelStructure")
    for part in ("Outputs", "InitialUnknowns"):
        block = ET.SubElement(structure, part)
        for place in outputs:
            ET.SubElement(block, "Unknown", index=place)


def _truth(value: bool) -> str:
    return "true" if value else "false"
