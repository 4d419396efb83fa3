# SPDX-License-Identifier: MIT
"""Functional mock-up units (FMI 2.0 and 3.0, co-simulation) of the friction models.

An FMU is a zip file with modelDescription.xml, a shared object and its C sources (port/fmu,
port/simulators). If MinGW-w64 was there at build time, it has a DLL for Windows. Both are built
once for all models. For each version of FMI they contain a block with the model, the names, the
limits and the start values; write() replaces both blocks. An FMU therefore needs no compiler when
it is written, and reads no file when it runs.
"""

from __future__ import annotations

import hashlib
import math
import platform
import re
import struct
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from dahl import paths
from dahl.binding import parameters
from dahl.binding.models import Model
from dahl.binding.slip import SLIP_MAX
from dahl.errors import RunError
from dahl.io import files
from dahl.version import __version__

# Value references of port/fmu/variables.h.
ANGLE, LOAD, TORQUE, RATIO, THETA, OWN, SIGMA0 = range(7)
FC = SIGMA0 + SLIP_MAX
TIME = FC + SLIP_MAX
SIGMA1 = TIME + 1
VALUES = SIGMA1 + 1

MARK = b"dahl fmu start\0\0"
BLOCK = struct.Struct(f"={len(MARK)}s40s16s4I{VALUES * '16s3d'}")  # fmu_start_t
ANGLE_MAX = 1e30  # rad
TIME_MAX = 1e30  # s
TORQUE_LIMITS = parameters.TORQUE_MIN, parameters.TORQUE_MAX  # of sigma0 and Fc
OUTPUT_LIMITS = -SLIP_MAX * parameters.TORQUE_MAX, SLIP_MAX * parameters.TORQUE_MAX
FINE_TRAVEL = 2.0**-20  # of one count, as in port/simulators/friction.c; changes F by 1e-6 of Fc

UNITS = {  # exponents of the SI base units
    "rad": {"rad": 1},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "s": {"s": 1},
}
VERSIONS = 2, 3  # of FMI
HEADERS = ("dahl.h", "dahl_can_bus.h", "dahl_encoder.h", "dahl_frames.h", "dahl_parts.h")
DATE = (1980, 1, 1, 0, 0, 0)  # of each file in the zip, so that equal content gives equal bytes


@dataclass(frozen=True)
class Variable:
    """A variable of type Real: low <= value < high."""

    name: str
    causality: str
    unit: str
    description: str
    start: float
    low: float
    high: float


@dataclass(frozen=True)
class Fmu:
    """Contents of an FMU; `name` is its modelIdentifier."""

    name: str
    model: Model
    sigma0: Sequence[float]  # N m/rad
    Fc: Sequence[float]  # N m
    theta_per_count: float = 0.0  # rad; 0: moves by angle
    own: float | None = None  # value of the model's own key, if that is a number
    kinds: Sequence[str] = ()  # of the model parallel: dahl or slip for each element
    fixed_stiffness: bool = False  # of the model loaded
    fmi: int = 2  # one of VERSIONS

    @property
    def slips(self) -> int:
        """Bit k is set if element k slips."""
        return sum(1 << k for k, kind in enumerate(self.kinds) if kind == "slip")

    def variables(self) -> dict[int, Variable]:
        """Return the variables by value reference."""
        return dict(sorted((self._inputs_and_outputs() | self._parameters()).items()))

    def _inputs_and_outputs(self) -> dict[int, Variable]:
        torque, ratio = "torque with the sign of the motion", "torque over the largest at load 1"
        variables = {
            ANGLE: Variable("angle", "input", "rad", "angle", 0.0, -ANGLE_MAX, ANGLE_MAX),
            TORQUE: Variable("torque", "output", "N.m", torque, 0.0, *OUTPUT_LIMITS),
            RATIO: Variable("ratio", "output", "", ratio, 0.0, *OUTPUT_LIMITS),
        }
        if self.model.name == "loaded":
            variables[LOAD] = Variable("load", "input", "", "load that scales Fc", 1.0, 0.0, 2.0)
        if self.fmi == 3:  # which requires an independent variable
            limits = -TIME_MAX, TIME_MAX
            variables[TIME] = Variable("time", "independent", "s", "time", 0.0, *limits)
        return variables

    def _parameters(self) -> dict[int, Variable]:
        variables = {}
        if not self.fixed_stiffness:
            variables[THETA] = self._theta_per_count()
        if self.own is not None:
            model = self.model
            limits = model.low, math.nextafter(model.high, math.inf)
            variables[OWN] = _parameter(model.key, "", model.meaning, self.own, *limits)
        names = _names("sigma0", len(self.sigma0))
        for k, (name, value) in enumerate(zip(names, self.sigma0, strict=True)):
            text = "stiffness at rest"
            variables[SIGMA0 + k] = _parameter(name, "N.m/rad", text, value, *TORQUE_LIMITS)
        names = _names("Fc", len(self.Fc))
        if self.model.has_two_limits:
            names = self.model.limit_names
        for k, (name, value) in enumerate(zip(names, self.Fc, strict=True)):
            variables[FC + k] = _parameter(name, "N.m", "Coulomb torque", value, *TORQUE_LIMITS)
        text, limits = "presliding damping; 0: none", (0.0, parameters.TORQUE_MAX)
        variables[SIGMA1] = _parameter("sigma1", "N.m.s/rad", text, 0.0, *limits)
        return variables

    def _theta_per_count(self) -> Variable:
        text, low = "angle of one count, to which the angle is rounded", parameters.TORQUE_MIN
        if self.model.name == "dahl":
            text, low = f"{text}; 0: it is not rounded", 0.0
        limits = low, parameters.TORQUE_MAX
        return _parameter("theta_per_count", "rad", text, self.theta_per_count, *limits)


def default_theta_per_count(model: Model, sigma0: Sequence[float], Fc: Sequence[float]) -> float:  # noqa: N803
    """Return 0 for Dahl's model, which can move by angle, else a fine count [rad]."""
    if model.name == "dahl":
        return 0.0
    stiffest = [sigma0[min(k, len(sigma0) - 1)] / torque for k, torque in enumerate(Fc)]
    return float(np.float32(FINE_TRAVEL / max(stiffest)))


def write(path: Path, fmu: Fmu) -> str:
    """Write the FMU and return its GUID. Raises dahl.RunError if the shared object is not built."""
    guid = _guid(_contents(fmu, ""))
    with files.replace_atomic(path) as part, zipfile.ZipFile(part, "w") as archive:
        for name, content in _contents(fmu, guid).items():
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(info, content)
    return guid


def _parameter(name: str, unit: str, text: str, *numbers: float) -> Variable:
    return Variable(name, "parameter", unit, text, *numbers)


def _names(name: str, count: int) -> list[str]:
    """Return the name of one value, or the names of several with an index."""
    return [name] if count == 1 else [f"{name}[{k}]" for k in range(count)]


def _contents(fmu: Fmu, guid: str) -> dict[str, bytes]:
    """Return the files of the FMU by name."""
    sources = _sources(fmu.fmi) | {"start.h": _start_header(fmu, guid)}
    compiled = [name for name in sources if name[-2:] == ".c"]
    if fmu.fmi == 3:
        sources["buildDescription.xml"] = _build_description(fmu, compiled)
    return {
        "modelDescription.xml": _model_description(fmu, guid, compiled),
        **{
            f"binaries/{folder}/{fmu.name}{path.suffix}": _binary(path, fmu, guid)
            for folder, path in platforms(fmu.fmi).items()
        },
        **{f"sources/{name}": content for name, content in sources.items()},
        "documentation/licenses/license.txt": paths.LICENSE.read_bytes(),
    }


def _guid(contents: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, content in contents.items():
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"


def _sources(fmi: int) -> dict[str, bytes]:
    """Return the C sources. They share one folder, so that a tool needs no include path."""
    others = {f"fmi{version}.c" for version in VERSIONS if version != fmi}
    folders = [paths.PORT / name for name in ("fmu", "simulators")]
    folders += [paths.LIB / name for name in ("arith", "model", "parts")]
    sources = [file for folder in folders for file in sorted(folder.glob("*.[ch]"))]
    sources = [file for file in sources if file.name not in others]
    sources += [paths.INCLUDE / name for name in HEADERS]
    flat = {
        file.name: re.sub(rb'(#include ")\.\./\w+/', rb"\1", file.read_bytes()) for file in sources
    }
    if len(flat) != len(sources):
        raise RunError(f"{paths.LIB}: two source files of an FMU have the same name")
    return flat


def _counts(fmu: Fmu) -> list[int]:
    """Return the integers of fmu_start_t."""
    return [len(fmu.sigma0), len(fmu.Fc), fmu.slips, int(fmu.fixed_stiffness)]


def platforms(fmi: int) -> dict[str, Path]:
    """Return the built binary for each platform: for this machine, and for Windows if it exists."""
    library, bits = paths.fmu_library(), struct.calcsize("P") * 8
    found = {f"linux{bits}" if fmi == 2 else f"{platform.machine()}-linux": library}
    windows = library.with_name("dahl_fmu.dll")
    return found | (
        {"win64" if fmi == 2 else "x86_64-windows": windows} if windows.exists() else {}
    )


def _binary(path: Path, fmu: Fmu, guid: str) -> bytes:
    """Return a binary with the start values of this FMU in the block of each version."""
    head, *parts = path.read_bytes().split(MARK)
    if len(parts) != len(VERSIONS):
        raise RunError(f"{path}: not the shared object of port/fmu")
    used, unused = fmu.variables(), Variable("", "", "", "", 0.0, 0.0, 0.0)
    rows = (used.get(reference, unused) for reference in range(VALUES))
    values = (value for row in rows for value in (row.name.encode(), row.start, row.low, row.high))
    model = fmu.model.name.encode()
    block = BLOCK.pack(MARK, guid.encode(), model, *_counts(fmu), *values)
    return head + b"".join(block + part[len(block) - len(MARK) :] for part in parts)


def _start_header(fmu: Fmu, guid: str) -> bytes:
    words = [MARK.rstrip(b"\0").decode(), guid, fmu.model.name]
    head = [*(f'"{word}"' for word in words), *map(str, _counts(fmu))]
    lines = [
        "/* SPDX-License-Identifier: MIT */",
        f"/* Written by dahl fmu {__version__}: model, name, start, low and high of each value. */",
        f"#define FMU_START {{{', '.join(head)}, {{ \\",
        *(
            f'    [{reference}] = {{"{row.name}", {row.start.hex()}, {row.low.hex()},'
            f" {row.high.hex()}}}, /* {row.start:g} */ \\"
            for reference, row in fmu.variables().items()
        ),
        "}}",
    ]
    return ("\n".join(lines) + "\n").encode()


def _model_description(fmu: Fmu, guid: str, sources: list[str]) -> bytes:
    """Return modelDescription.xml."""
    is_fmi2 = fmu.fmi == 2
    root = ET.Element("fmiModelDescription", fmiVersion=f"{fmu.fmi}.0", modelName=fmu.name)
    root.attrib |= {
        "guid" if is_fmi2 else "instantiationToken": guid,
        "description": f"friction torque, model {fmu.model.name} of dahl",
        "version": __version__,
        "license": "MIT",
        "generationTool": f"dahl {__version__}",
        "variableNamingConvention": "structured",
    }
    state = "FMUstate" if is_fmi2 else "FMUState"
    flags = [f"canGetAndSet{state}", f"canSerialize{state}"]
    flags += ["canHandleVariableCommunicationStepSize"]
    flags += ["canNotUseMemoryManagementFunctions"] if is_fmi2 else []
    simulation = ET.SubElement(
        root, "CoSimulation", {"modelIdentifier": fmu.name} | dict.fromkeys(flags, "true")
    )
    if is_fmi2:
        _add_files(ET.SubElement(simulation, "SourceFiles"), "File", sources)
    _add_units(root, {variable.unit for variable in fmu.variables().values()})
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="errors; always on")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize="0.001")
    _add_variables(root, fmu)
    _add_structure(root, fmu)
    return _xml(root)


def _build_description(fmu: Fmu, sources: list[str]) -> bytes:
    """Return sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=fmu.name)
    _add_files(ET.SubElement(configuration, "SourceFileSet", language="C99"), "SourceFile", sources)
    return _xml(root)


def _xml(root: ET.Element) -> bytes:
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _add_files(parent: ET.Element, tag: str, names: list[str]) -> None:
    for name in names:
        ET.SubElement(parent, tag, name=name)


def _add_units(root: ET.Element, used: set[str]) -> None:
    units = ET.SubElement(root, "UnitDefinitions")
    for name, exponents in UNITS.items():
        if name in used:
            unit = ET.SubElement(units, "Unit", name=name)
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in exponents.items()})


def _add_variables(root: ET.Element, fmu: Fmu) -> None:
    listed = ET.SubElement(root, "ModelVariables")
    for reference, variable in fmu.variables().items():
        attributes = {
            "name": variable.name,
            "valueReference": str(reference),
            "causality": variable.causality,
            "variability": "fixed" if variable.causality == "parameter" else "continuous",
            "description": variable.description,
        }
        number = {"unit": variable.unit} if variable.unit else {}
        if variable.causality in ("input", "parameter"):
            number["start"] = repr(variable.start)
        if fmu.fmi == 2:
            scalar = ET.SubElement(listed, "ScalarVariable", attributes)
            ET.SubElement(scalar, "Real", number)
        else:
            ET.SubElement(listed, "Float64", attributes | number)


def _add_structure(root: ET.Element, fmu: Fmu) -> None:
    """Add ModelStructure. Before the first step the outputs are 0, and between steps an input
    changes no output, so no output depends on an input.
    """
    structure = ET.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        group = ET.SubElement(structure, f"{kind}s") if fmu.fmi == 2 else structure
        for index, (reference, variable) in enumerate(fmu.variables().items(), 1):
            if variable.causality != "output":
                continue
            if fmu.fmi == 2:
                ET.SubElement(group, "Unknown", index=str(index), dependencies="")
            else:
                ET.SubElement(group, kind, valueReference=str(reference), dependencies="")
