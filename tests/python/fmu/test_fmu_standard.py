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
from dahl.binding import models
from fmu_instance import Instance
from test_fmu import EVERY, export, walk

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
    return Path(fmpy.__file__).parent / "c-code" / "fmi2Functions.h"


@EVERY
def test_fmpy_finds_no_problem(dahl, model):
    from fmpy.validation import validate_fmu

    assert not validate_fmu(str(export(dahl, model)))


def test_fmpy_simulates_the_bits_of_python_before_and_after_its_own_build(dahl, fmpy, tmp_path):
    from fmpy.build import build_platform_binary

    path, angles = export(dahl), walk(5) * 1e-5
    rows = np.array(list(enumerate(angles)), dtype=[("time", float), ("angle", float)])
    moves = np.diff(angles[:-1], prepend=angles[0])  # fmpy initializes with the first row
    expected = package.Friction(package.Plan(100, 0.2)).run(moves.astype(np.float32))
    with zipfile.ZipFile(path) as content:
        names = [name for name in content.namelist() if not name.startswith("binaries")]
        content.extractall(tmp_path / "unit", names)
    build_platform_binary(tmp_path / "unit", all_warnings=True)
    for unit in (path, tmp_path / "unit"):
        stop = rows["time"][-1]
        done = fmpy.simulate_fmu(str(unit), stop_time=stop, output_interval=1, input=rows)
        assert done["torque"][1:].tolist() == expected.tolist()  # one row after the input


@pytest.mark.parametrize(
    "words", [("parallel",), ("elastoplastic",), ("loaded", "--fixed-stiffness")]
)
def test_a_plain_compiler_builds_the_sources_with_the_headers_of_the_standard(dahl, header, words):
    """The headers come first, so the compiler compares each declaration with theirs."""
    model, *more = words
    path = export(dahl, models.table()[model], *more)
    with zipfile.ZipFile(path) as content:
        content.extractall("unit")
    sources = sorted(Path("unit/sources").glob("*.c"))
    command = ["gcc", *FLAGS, "-include", header, *sources, "-o", "unit/built.so"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ours, built = Instance(path).initialize(), Instance(path, Path("unit/built.so").resolve())
    built.initialize()
    for angle in walk(6) * 1e-5:
        assert ours.step(angle=angle) == built.step(angle=angle)


def test_the_sources_define_each_function_with_the_prefix_of_the_tool(dahl, header):
    with zipfile.ZipFile(export(dahl)) as content:
        content.extractall("unit")
    words = ["gcc", "-c", "-DFMI2_FUNCTION_PREFIX=shaft_", "unit/sources/fmu.c"]
    subprocess.run(words, check=True)
    names = subprocess.run(["nm", "-g", "fmu.o"], capture_output=True, text=True, check=True)
    defined = {*re.findall(r" T (\w+)$", names.stdout, re.MULTILINE)}
    standard = {*re.findall(r"^#define fmi2(\w+) +fmi2FullName", header.read_text(), re.MULTILINE)}
    assert defined == {f"shaft_fmi2{name}" for name in standard - ONLY_MODEL_EXCHANGE}
