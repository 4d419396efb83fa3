# SPDX-License-Identifier: MIT
"""The library gives equal bits with every compiler, optimization and word size."""

from itertools import product
from pathlib import Path

import pytest
from conftest import ROOT, need
from programs import run
from sources import CORE, INCLUDES, PARTS

GOLDEN = ROOT / "tests/lib/golden_bits.txt"
DEFAULT = "gcc -O2"  # the others run with --checks
LEVELS = ("-O0", "-O1", "-O2", "-O3")
COMMANDS = [" ".join(one) for one in product(("gcc", "clang"), LEVELS)]
COMMANDS += [" ".join(one) for one in product(COMMANDS, ("-m32", "-ffast-math"))]
FAST = [f"{compiler} -O3 -ffast-math" for compiler in ("gcc", "clang")]
COMMANDS += ["tcc", *(" ".join(one) for one in product(FAST, ("-m32", "-march=x86-64-v3")))]


@pytest.mark.parametrize(
    "command",
    [pytest.param(one, marks=[] if one == DEFAULT else pytest.mark.checks) for one in COMMANDS],
)
def test_each_compiler_and_option_gives_the_golden_bits(command: str, tmp_path: Path) -> None:
    compiler, *flags = command.split()
    words = [need(compiler, "equal bits"), "-std=c99", *flags, *INCLUDES, "-o", tmp_path / "bits"]
    run(*words, ROOT / "tests/lib/bits.c", *CORE, *PARTS)
    if "v3" in command and "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("unproven: equal bits with AVX2: this processor has none")
    assert run(tmp_path / "bits") == GOLDEN.read_text()
