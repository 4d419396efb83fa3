# SPDX-License-Identifier: MIT
"""Random frames, valid and invalid, on a node that is built with sanitizers: they stay silent."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from conftest import ROOT

CHECKS = "address,undefined,float-divide-by-zero,float-cast-overflow"
COMPILERS = {"gcc": CHECKS, "clang": CHECKS + ",implicit-conversion"}


@pytest.mark.parametrize(
    ("compiler", "frames"),
    [
        ("clang", 1_000_000),
        pytest.param("gcc", 10_000_000, marks=pytest.mark.long),
        pytest.param("clang", 10_000_000, marks=pytest.mark.long),
    ],
)
def test_random_frames_with_sanitizers(tmp_path, compiler, frames):
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not installed (tools/setup.sh installs it where it can)")
    program = tmp_path / "fuzz"
    sources = ["tests/port/fuzz_frames.c", "host_sim/node.c", "port/frames.c"]
    sources += sorted(str(path) for path in (ROOT / "lib").glob("*.c"))
    command = [compiler, "-std=c99", "-O1", "-g", f"-fsanitize={COMPILERS[compiler]}"]
    command += ["-fno-sanitize-recover=all", "-Ilib", "-Iport", "-Ihost_sim", "-Itests/port"]
    built = subprocess.run(
        [*command, *sources, "-o", program, "-lm"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    done = subprocess.run(
        [program, str(frames)], capture_output=True, text=True, timeout=250, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{frames} frames, ")
