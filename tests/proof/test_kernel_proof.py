# SPDX-License-Identifier: MIT
"""The kernel g(u) = 1 - exp(-u): every float against MPFR; certificates for every a and angle."""

from __future__ import annotations

import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import kernel_tools as tools
import pytest
from conftest import built

KERNEL = tools.LIB / "kernel.h"
ALL = 0x8000_0000  # bit patterns of the non-negative floats, NaN included
MIDDLE = 0x4000_0000  # 2.0f: the kernel's work is below, so the parts take 45 s and 30 s
SKIPPED = 77


def all_floats(program: Path, first: int, last: int, stride: int) -> tuple[int, dict[str, float]]:
    """kernel_all on a range of bit patterns: exit code and the numbers it printed."""
    command = [str(program), *(hex(value) for value in (first, last, stride))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=False)
    if done.returncode == SKIPPED:
        pytest.skip(done.stdout.strip())
    pairs = re.findall(r"(\w[\w ]*?) (-?[\d.]+(?:e[+-]\d+)?|-?0x\S+)(?:,|\n| at)", done.stdout)
    numbers = {name: float.fromhex(n) if "x" in n else float(n) for name, n in pairs}
    return done.returncode, numbers


def assert_sound(numbers: dict[str, float], floats: int) -> None:
    assert numbers["floats"] >= floats
    assert numbers["bound"] == tools.header_number("DAHL_KERNEL_ERROR", KERNEL)
    for name in ("beyond the bound", "falls", "one too early or late", "steps of another g"):
        assert numbers[name] == 0, name
    # As MPFR alone has it, from the worst float that was found: the comparison does compare.
    worst = max(-numbers["lowest"], numbers["highest"])
    assert 0.5 * numbers["bound"] < worst <= numbers["bound"]


def test_floats_with_a_stride() -> None:
    """Every 499th float: error, monotony, g = 1, both signs through dahl_step; NaN, subnormals."""
    code, numbers = all_floats(built("tests", "lib", "kernel_all"), 0, ALL, 499)
    assert code == 0
    assert_sound(numbers, ALL // 499)
    # All ones from the first float with v = u/ln 2 >= 32 on: 32 ln 2 = 22.1807.
    assert abs(numbers["ones from"] - 22.18071) < 1e-2


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_every_float() -> None:
    """All 2^31 of them, on two processes."""
    program = built("tests", "lib", "kernel_all")
    with ThreadPoolExecutor(2) as pool:
        parts = [
            pool.submit(all_floats, program, *part, 1) for part in ((0, MIDDLE), (MIDDLE, ALL))
        ]
        results = [part.result() for part in parts]
    assert [code for code, _ in results] == [0, 0]
    assert sum(numbers["floats"] for _, numbers in results) == ALL
    assert_sound(results[0][1], MIDDLE)
    assert 22.18071 < results[1][1]["ones from"] < 22.18073


FAULTS = {
    "coefficient": ("dahl_horner(257941187u", "dahl_horner(257941179u"),
    "last coefficient": ("644112u - (", "644000u - ("),
    "table word": ("1366689387u", "1366689371u"),
    "shift": (">> (v.shift - 2)", ">> (v.shift - 1)"),
    "table not rounded up": ("2773451308u", "2773451300u"),
    "rounding term missing": ("(v.shift - 32)) + 2u", "(v.shift - 32))"),
    "mantissa not normalised": ("(uint32_t)(product >> 31)", "(uint32_t)(product >> 31) & ~7u"),
    "one too early": ("v.shift < -5 ? all", "v.shift < -4 ? all"),
    "half of a factor lost": ("dahl_mulhi(~(h >> 1), ", "dahl_mulhi(~(h >> 1) & ~0xfffu, "),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_in_the_kernel(fault: str, tmp_path: Path) -> None:
    built("tests", "lib", "kernel_all")
    top = tools.copy_of_lib(tmp_path)
    tools.edit(top / "lib" / "kernel.h", *FAULTS[fault])
    program = tools.build(top, "tests/lib/kernel_all.c", "-lmpfr")
    code, _ = all_floats(program, 0, ALL, 40009)
    assert code == 1, f"{fault}: not noticed"
