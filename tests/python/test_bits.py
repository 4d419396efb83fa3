# SPDX-License-Identifier: MIT
"""The library gives the same bits from every compiler, at every optimisation, with -ffast-math, in
32 and 64 bits.
"""

import itertools
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests/lib/golden_bits.txt"
# float.c is no part of the guarantee: it calls libm.
SOURCES = sorted(str(f) for f in (ROOT / "lib").glob("*.c") if f.name != "float.c")

BUILDS = [
    (compiler, [level, *extra])
    for compiler, level, extra in itertools.product(
        ["gcc", "clang"], ["-O0", "-O1", "-O2", "-O3"], [[], ["-m32"], ["-ffast-math"]]
    )
]
FAST = ["-O3", "-ffast-math"]
BUILDS += [(c, [*FAST, m]) for c in ("gcc", "clang") for m in ("-m32", "-march=x86-64-v3")]


@pytest.mark.parametrize("compiler, flags", BUILDS, ids=[" ".join([c, *f]) for c, f in BUILDS])
def test_same_bits(compiler: str, flags: list[str], tmp_path: Path) -> None:
    assert shutil.which(compiler), f"{compiler} is missing: tools/setup.sh installs it"
    program = tmp_path / "bits"
    options = ["-std=c99", *flags, f"-I{ROOT}/lib", "-o", str(program)]
    command = [compiler, *options, f"{ROOT}/tests/lib/bits.c", *SOURCES]
    subprocess.run(command, check=True)
    if "-march=x86-64-v3" in flags and "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX2")
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    assert printed == GOLDEN.read_text()
