# SPDX-License-Identifier: MIT
"""gcc and clang accept lib, port and host_sim with nearly all their warnings as errors, and the
compilers of small cores the C of firmware. gcc -fanalyzer accepts lib. static_tools.py gives a
reason for each warning of clang that is off.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need

CLAIM = "no warning of {} at its strictest"
# Name of a core, by the other words that its compiler is called with.
ARM = "arm-none-eabi-gcc"
CORES = {
    "m0": [ARM, "-mthumb", "-mcpu=cortex-m0"],
    "m3": [ARM, "-mthumb", "-mcpu=cortex-m3"],
    "m33": [ARM, "-mthumb", "-mcpu=cortex-m33", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"],
    "rv32": ["riscv64-unknown-elf-gcc", "-march=rv32imac", "-mabi=ilp32", "--specs=picolibc.specs"],
}
HOST = [*static.FIRMWARE, *static.DESK]


def compile_all(folder: Path, files: list[Path], *words: object) -> None:
    static.clean(*words, "-c", *files, cwd=folder)


@pytest.mark.parametrize(
    "level",
    ["-O2", *(pytest.param(x, marks=pytest.mark.long) for x in ("-O0", "-Og", "-Os", "-O3"))],
)
def test_gcc_has_no_warning(level: str, tmp_path: Path) -> None:
    compile_all(tmp_path, HOST, need("gcc", CLAIM.format("gcc")), *static.GCC, level)


def test_clang_has_no_warning(tmp_path: Path) -> None:
    tool = need("clang-19", CLAIM.format("clang-19"))
    static.clean(tool, *static.CLANG, "-fsyntax-only", *HOST, cwd=tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("core", CORES)
def test_small_core_has_no_warning(core: str, tmp_path: Path) -> None:
    compiler, *words = CORES[core]
    own = ROOT / "port" / ("riscv" if core == "rv32" else "cortex_m")
    files = [*static.FIRMWARE, *own.glob("*.c")]
    tool = need(compiler, CLAIM.format(compiler))
    compile_all(
        tmp_path, files, tool, *words, *static.GCC, f"-I{own}", f"-I{ROOT}/port/slcan", "-Os"
    )


@pytest.mark.long
def test_analyzer_of_gcc_finds_nothing(tmp_path: Path) -> None:
    compile_all(tmp_path, static.LIB, need("gcc", CLAIM.format("gcc")), *static.GCC, "-fanalyzer")
