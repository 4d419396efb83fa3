# SPDX-License-Identifier: MIT
"""gcc and clang accept lib, port and host_sim with nearly all their warnings as errors, and the
compilers of small cores the C of firmware. clang-tidy and gcc -fanalyzer find nothing.
static_tools.py and clang-tidy.yaml give a reason for each warning and check that is off.
"""

from pathlib import Path

import pytest
import static_tools as static
from conftest import ROOT, need

CLAIM = "no warning of {}"
ARM = "arm-none-eabi-gcc -mthumb -Os -mcpu=cortex-"
CORES = {  # name of a core: its compiler, its folder
    "m0": (ARM + "m0", "cortex_m"),
    "m3": (ARM + "m3", "cortex_m"),
    "m33": (ARM + "m33 -mfloat-abi=hard -mfpu=fpv5-sp-d16", "cortex_m"),
    "rv32": ("riscv64-unknown-elf-gcc -march=rv32imac -mabi=ilp32 --specs=picolibc.specs", "riscv"),
}
HOST = [*static.FIRMWARE, *static.DESK]
TIDY = ["--quiet", "--warnings-as-errors=*", f"--config-file={ROOT}/tests/static/clang-tidy.yaml"]
LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("compiler", "words", "files"),
    [
        pytest.param("gcc", [*static.GCC, "-O2", "-c"], HOST, id="gcc"),
        pytest.param("gcc", [*static.GCC, "-O3", "-c"], HOST, id="gcc -O3", marks=LONG),
        pytest.param(
            "gcc", [*static.GCC, "-fanalyzer", "-c"], static.LIB, id="analyzer", marks=LONG
        ),
        pytest.param("clang-19", [*static.CLANG, "-fsyntax-only"], HOST, id="clang"),
    ],
)
def test_a_compiler_has_no_warning(
    compiler: str, words: list[str], files: list[Path], tmp_path: Path
) -> None:
    static.clean(need(compiler, CLAIM.format(compiler)), *words, *files, cwd=tmp_path)


@LONG
@pytest.mark.parametrize("core", CORES)
def test_the_compiler_of_a_small_core_has_no_warning(core: str, tmp_path: Path) -> None:
    compiler, *words = CORES[core][0].split()
    own = ROOT / "port" / CORES[core][1]
    words += [*static.GCC, f"-I{own}", f"-I{ROOT}/port/slcan", "-c"]
    tool = need(compiler, CLAIM.format(compiler))
    static.clean(tool, *words, *static.FIRMWARE, *own.glob("*.c"), cwd=tmp_path)


@pytest.mark.parametrize(
    "files",
    [
        pytest.param(static.FIRMWARE, id="firmware"),
        pytest.param(static.DESK, id="host", marks=LONG),
    ],
)
def test_clang_tidy_finds_nothing(files: list[Path]) -> None:
    tool = need("clang-tidy-19", CLAIM.format("clang-tidy"))
    status, text = static.call(tool, *TIDY, *files, "--", *static.PLAIN)
    assert status == 0, text
