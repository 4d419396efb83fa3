# SPDX-License-Identifier: MIT
"""The DLL of an FMU: in Wine it has the torques of the shared object for Linux, bit for bit."""

import os
import re
import shutil
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fmu_instance
import pytest
from dahl.simulators.fmu import VERSIONS
from fmu_instance import Instance
from programs import call, run
from test_fmu import DAHL, EVERY, walk

pytestmark = pytest.mark.checks

MINGW = "x86_64-w64-mingw32-gcc"
WINE = shutil.which("wine64", path=f"{os.environ['PATH']}:/usr/lib/wine")
FOLDERS = {2: "win64", 3: "x86_64-windows"}
VERSION = pytest.mark.parametrize("fmi", VERSIONS)


@pytest.fixture(scope="module", autouse=True)
def compiler() -> None:
    if not shutil.which(MINGW):
        pytest.skip(f"unproven: FMUs for Windows: {MINGW} is missing (tools/setup.sh checks)")


@pytest.fixture(scope="module")
def wine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Run windows.c in Wine, in a folder of its own that all tests share."""
    if not WINE:
        pytest.skip("unproven: FMUs for Windows: wine64 is missing (tools/setup.sh checks)")
    folder = tmp_path_factory.mktemp("wine")
    program = folder / "windows.exe"
    source = Path(__file__).with_name("windows.c")
    run(MINGW, "-std=c99", "-Wall", "-Wextra", "-Werror", source, "-o", program)
    quiet = {"WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree,mshtml="}
    env = os.environ | quiet | {"WINEPREFIX": str(folder / "prefix")}
    yield lambda *words, angles: run(WINE, program, *words, input=angles, env=env)
    call(Path(WINE).with_name("wineserver"), "-k", env=env)  # ends those of this folder


def unpacked(path: Path) -> Path:
    with zipfile.ZipFile(path) as content:
        (name,) = (name for name in content.namelist() if name.endswith(".dll"))
        return Path(content.extract(name, path.parent))


@VERSION
@EVERY
def test_the_torques_in_wine_have_the_bits_of_linux(dahl, wine, fmi, model) -> None:
    path = fmu_instance.export(dahl, fmi, model)
    one, angles = Instance(path).initialize(), walk(7) * 1e-5
    expected = [struct.pack(">d", one.step(angle=angle)).hex() for angle in angles]
    lines = "\n".join(map(float.hex, map(float, angles)))
    assert wine(unpacked(path), fmi, one.guid, angles=lines).split() == expected
    assert len(set(expected)) > 20


@VERSION
def test_the_dll_exports_the_functions_of_the_shared_object_and_needs_only_windows(
    dahl, fmi, library
) -> None:
    dll = unpacked(fmu_instance.export(dahl, fmi, DAHL))
    assert dll.parent.name == FOLDERS[fmi]
    said = run(MINGW.replace("gcc", "objdump"), "-p", dll)
    ours = run("nm", "-D", "--defined-only", library.with_name("dahl_fmu.so"))
    names = r"\bfmi[23]\w+$"
    assert {*re.findall(names, said, re.M)} == {*re.findall(names, ours, re.M)}
    assert {*re.findall(r"DLL Name: (.*)", said)} <= {"KERNEL32.dll", "msvcrt.dll"}
