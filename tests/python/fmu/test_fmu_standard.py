# SPDX-License-Identifier: MIT
"""FMUs in fmpy: its validation, its simulation, its build of the sources, and the headers of the
standard, which it contains.
"""

from __future__ import annotations

import re
import subprocess
import zipfile
from pathlib import Path

import dahl as package
import numpy as np
import pytest
from fmu_instance import Instance
from test_fmu import EVERY, MODELS, export, walk

pytestmark = [pytest.mark.checks, pytest.mark.usefixtures("library")]

WITHOUT = "unproven: FMUs in fmpy: fmpy is not here; tools/setup.sh checks installs it"
ONLY_MODEL_EXCHANGE = {
    *("EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode", "CompletedIntegratorStep"),
    *("SetTime", "SetContinuousStates", "GetDerivatives", "GetEventIndicators"),
    *("GetContinuousStates", "GetNominalsOfContinuousStates"),
}
FLAGS = "-std=c99 -Wall -Wextra -pedantic -Werror -shared -fPIC".split()


@pytest.fixture(autouse=True)
def fmpy():
    return pytest.importorskip("fmpy", reason=WITHOUT)


@pytest.fixture
def header(fmpy) -> Path:
    """Return the header of the standard."""
    return Path(fmpy.__file__).parent / "c-code" / "fmi2Functions.h"


@pytest.fixture
def simulate(fmpy):
    """Return the torques that fmpy computes along walk(5)."""

    def run(path: Path) -> list[float]:
        rows = [(row * 1e-3, angle) for row, angle in enumerate(walk(5) * 1e-5)]
        signal = np.array(rows, dtype=[("time", float), ("angle", float)])
        stop = rows[-1][0]
        done = fmpy.simulate_fmu(str(path), stop_time=stop, output_interval=1e-3, input=signal)
        return done["torque"][1 : len(rows)].tolist()  # a step ends one row after its input

    return run


def expected() -> list[float]:
    angles = walk(5)[:-1] * 1e-5
    moves = np.diff(angles, prepend=angles[0])  # fmpy initializes with the first row
    return package.Friction(package.Plan(100, 0.2)).run(moves.astype(np.float32)).tolist()


@EVERY
def test_fmpy_finds_no_problem(dahl, model):
    from fmpy.validation import validate_fmu

    assert not validate_fmu(str(export(dahl, model)))


def test_fmpy_simulates_the_bits_of_python(dahl, simulate):
    assert simulate(export(dahl)) == expected()


def test_fmpy_builds_the_sources_to_the_same_bits(dahl, simulate, tmp_path):
    from fmpy.build import build_platform_binary

    path = export(dahl)
    with zipfile.ZipFile(path) as content:
        names = [name for name in content.namelist() if not name.startswith("binaries")]
        content.extractall(tmp_path / "unit", names)
    build_platform_binary(tmp_path / "unit", all_warnings=True)
    assert simulate(tmp_path / "unit") == expected()


@EVERY
def test_a_plain_compiler_builds_the_sources_with_the_headers_of_the_standard(dahl, header, model):
    """The headers come first, so the compiler compares each declaration with theirs."""
    path = export(dahl, model)
    with zipfile.ZipFile(path) as content:
        content.extractall("unit")
    sources = sorted(Path("unit/sources").glob("*.c"))
    words = ["gcc", *FLAGS, "-include", header, *sources, "-o", "unit/built.so"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ours, built = Instance(path).initialize(), Instance(path, Path("unit/built.so").resolve())
    built.initialize()
    for angle in walk(6) * 1e-5:
        assert ours.step(angle=angle) == built.step(angle=angle)


def test_a_static_library_has_the_prefix_of_the_tool(dahl):
    with zipfile.ZipFile(export(dahl)) as content:
        content.extractall("unit")
    words = ["gcc", "-c", "-DFMI2_FUNCTION_PREFIX=shaft_", "unit/sources/fmu.c"]
    subprocess.run(words, check=True)
    names = subprocess.run(["nm", "-g", "fmu.o"], capture_output=True, text=True, check=True)
    functions = re.findall(r" T (\w+)$", names.stdout, re.MULTILINE)
    assert len(functions) == 34 and all(name.startswith("shaft_fmi2") for name in functions)


def test_all_functions_of_a_co_simulation_are_exported(dahl, header):
    text = header.read_text()
    functions = {*re.findall(r"^#define fmi2(\w+) +fmi2FullName", text, re.MULTILINE)}
    one = Instance(export(dahl, MODELS[0]))
    assert {name for name in functions if not hasattr(one.functions, f"fmi2{name}")} == (
        ONLY_MODEL_EXCHANGE
    )
