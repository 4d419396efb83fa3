# SPDX-License-Identifier: MIT
"""FMUs in fmpy: its validation, its simulation, its build of the sources, and the headers of the
standard, which it contains.
"""

import re
import zipfile
from functools import partial
from pathlib import Path

import dahl as package
import fmu_instance
import numpy as np
import pytest
from dahl.binding import models
from dahl.simulators.fmu import VERSIONS
from fmu_instance import Instance
from programs import run
from test_fmu import DAHL, EVERY, walk

pytestmark = pytest.mark.checks

WITHOUT = "unproven: FMUs in fmpy: fmpy is not here; tools/setup.sh checks installs it"
ONLY_MODEL_EXCHANGE = {  # of FMI 2.0
    *("EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode", "CompletedIntegratorStep"),
    *("SetTime", "SetContinuousStates", "GetDerivatives", "GetEventIndicators"),
    *("GetContinuousStates", "GetNominalsOfContinuousStates"),
}
FLAGS = "-std=c99 -Wall -Wextra -pedantic -Werror -shared -fPIC".split()


@pytest.fixture(autouse=True)
def fmpy():
    return pytest.importorskip("fmpy", reason=WITHOUT)


@pytest.fixture(params=VERSIONS, ids="fmi{}".format)
def fmi(request) -> int:
    return request.param


@pytest.fixture
def export(dahl, fmi):
    return partial(fmu_instance.export, dahl, fmi)


@pytest.fixture
def header(fmpy, fmi) -> Path:
    return Path(fmpy.__file__).parent / "c-code" / f"fmi{fmi}Functions.h"


@EVERY
def test_fmpy_finds_no_problem(export, model):
    from fmpy.validation import validate_fmu

    assert not validate_fmu(str(export(model)))


def test_fmpy_simulates_the_bits_of_python_before_and_after_its_own_build(dahl, fmpy):
    from fmpy.build import build_platform_binary

    angles = walk(5) * 1e-5
    rows = np.array(list(enumerate(angles)), dtype=[("time", float), ("angle", float)])
    moves = np.diff(angles[:-1], prepend=angles[0])  # fmpy initializes with the first row
    expected = package.Friction(package.Plan(100, 0.2)).run(moves.astype(np.float32))
    units = [fmu_instance.export(dahl, fmi, DAHL, name=f"unit{fmi}.fmu") for fmi in VERSIONS]
    for path in list(units):
        built = path.with_suffix("")
        with zipfile.ZipFile(path) as content:
            names = [name for name in content.namelist() if not name.startswith("binaries")]
            content.extractall(built, names)
        build_platform_binary(built, all_warnings=True)
        units.append(built)
    for unit in units:
        stop = rows["time"][-1]
        done = fmpy.simulate_fmu(str(unit), stop_time=stop, output_interval=1, input=rows)
        assert done["torque"][1:].tolist() == expected.tolist()  # one row after the input


@pytest.mark.parametrize(
    "words",
    [("parallel",), (models.with_key("breakaway").name,), ("loaded", "--fixed-stiffness")],
)
def test_a_plain_compiler_builds_the_sources_with_the_headers_of_the_standard(
    export, fmi, header, words
):
    """The headers come first, so the compiler compares each declaration with theirs. The built file
    has each function of the standard.
    """
    model, *more = words
    path = export(models.table()[model], *more)
    with zipfile.ZipFile(path) as content:
        content.extractall("unit")
    sources = sorted(Path("unit/sources").glob("*.c"))
    run("gcc", *FLAGS, "-include", header, *sources, "-o", "unit/built.so")
    ours, built = Instance(path).initialize(), Instance(path, Path("unit/built.so").resolve())
    built.initialize()
    for angle in walk(6) * 1e-5:
        assert ours.step(angle=angle) == built.step(angle=angle)
    names = run("nm", "-D", "unit/built.so")
    defined = {*re.findall(rf" T fmi{fmi}(\w+)$", names, re.MULTILINE)}
    found = re.findall(rf"^#define fmi{fmi}(\w+) +fmi.FullName", header.read_text(), re.MULTILINE)
    assert defined == {*found} - (ONLY_MODEL_EXCHANGE if fmi == 2 else set())
