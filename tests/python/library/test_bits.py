# SPDX-License-Identifier: MIT
"""The library gives equal bits with every compiler, optimization and word size."""

import itertools
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, need
from sources import CORE, INCLUDES, PARTS

GOLDEN = ROOT / "tests/lib/golden_bits.txt"
QUICK = [("gcc", ["-O2"])]  # the others run with --checks
MORE = [
    (compiler, [level, *extra])
    for compiler, level, extra in itertools.product(
        ["gcc", "clang"], ["-O0", "-O1", "-O2", "-O3"], [[], ["-m32"], ["-ffast-math"]]
    )
]
MORE += [("tcc", [])]
FAST = ["-O3", "-ffast-math"]
MORE += [(c, [*FAST, m]) for c in ("gcc", "clang") for m in ("-m32", "-march=x86-64-v3")]
BUILDS = [pytest.param(*build, id=" ".join([build[0], *build[1]])) for build in QUICK]
BUILDS += [
    pytest.param(*build, id=" ".join([build[0], *build[1]]), marks=pytest.mark.checks)
    for build in MORE
    if build not in QUICK
]


@pytest.mark.parametrize("compiler, flags", BUILDS)
def test_each_compiler_and_option_gives_the_golden_bits(
    compiler: str, flags: list[str], tmp_path: Path
) -> None:
    program = tmp_path / "bits"
    options = ["-std=c99", *flags, *INCLUDES, "-o", program]
    command = [need(compiler, "equal bits"), *options, ROOT / "tests/lib/bits.c", *CORE, *PARTS]
    subprocess.run(command, check=True)
    if "-march=x86-64-v3" in flags and "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("unproven: equal bits with AVX2: this processor has none")
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    assert printed == GOLDEN.read_text()
