# SPDX-License-Identifier: MIT
"""gcc and clang, nearly every warning they have, as errors: over lib, port and host_sim on this
machine, and over what firmware links with the compilers of small cores. And gcc's -fanalyzer over
lib. static_tools.py has the lists, and the reason for each warning of clang that is off.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need

CLAIM = "no warning of {} at its strictest"
# What is in the rest of the words that a core's compiler is called with, by a name for the core.
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


# --- each fault is seen --------------------------------------------------------------------------

PLANTED = {  # the warning that names it, and a function
    "-Wconversion": "uint8_t dahl_x(uint32_t x); uint8_t dahl_x(uint32_t x) { return x; }",
    "-Wsign-conversion": "uint32_t dahl_x(int x); uint32_t dahl_x(int x) { return x; }",
    "-Wmissing-prototypes": "int32_t dahl_x(int32_t x) { return x; }",
    "-Wuninitialized": "int dahl_x(void); int dahl_x(void) { int y; return y; }",
    "-Wdouble-promotion": "float dahl_x(float x); float dahl_x(float x) { return x * 1.5; }",
    "-Wfloat-equal": "int dahl_x(float x); int dahl_x(float x) { return x == 0.1f; }",
    "-Wvla": "int dahl_x(int n); int dahl_x(int n) { int y[n]; y[0] = n; return y[0]; }",
    "-Wcast-qual": "char *dahl_x(const char *x); char *dahl_x(const char *x) { return (char *)x; }",
    "-Wshadow": "int dahl_x(int x); int dahl_x(int x) { { int x = 3; (void)x; } return x; }",
    "-Wswitch-default": "void dahl_x(int x); void dahl_x(int x) { switch (x) { case 1: break; } }",
}


OF_CLANG = {"-Wconversion": "-W(implicit-int-)?conversion"}


def planted(tmp_path: Path, source: str) -> Path:
    """A copy of lib/torque.c with a fault at its end."""
    file = tmp_path / "torque.c"
    shutil.copy(ROOT / "lib/torque.c", file)
    file.write_text(f"{file.read_text()}{source}\n")
    return file


@pytest.mark.parametrize("compiler", ["gcc", "clang-19"])
@pytest.mark.parametrize("warning", PLANTED)
def test_planted_fault_is_warned_of(warning: str, compiler: str, tmp_path: Path) -> None:
    words = static.GCC if compiler == "gcc" else static.CLANG
    tool = need(compiler, CLAIM.format(compiler))
    file = planted(tmp_path, PLANTED[warning])
    status, text = static.call(tool, *words, "-O2", "-c", file, cwd=tmp_path)
    assert status != 0 and re.search(
        rf"\[-W(error[=,])?(-W)?{OF_CLANG.get(warning, warning)[2:]}", text
    ), text


def test_planted_leak_is_seen_by_the_analyzer(tmp_path: Path) -> None:
    source = """#include <stdlib.h>
int dahl_x(int n);
int dahl_x(int n) { int *p = malloc(4u); return p != NULL ? n : 0; }"""
    words = [*static.GCC, "-fanalyzer", "-c", planted(tmp_path, source)]
    status, text = static.call(need("gcc", CLAIM.format("gcc")), *words, cwd=tmp_path)
    assert status != 0 and "-Werror=analyzer-malloc-leak" in text
