# SPDX-License-Identifier: MIT
"""What the numeric proofs share: C programs with the core of the library in one piece."""

from __future__ import annotations

import subprocess
from pathlib import Path

from conftest import ROOT
from sources import INCLUDES, as_one


def build(folder: Path, program: str, *words: str) -> Path:
    """One C program of the project's tests, in a folder."""
    target = folder / Path(program).stem
    command = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
    command += [*INCLUDES, str(ROOT / program), str(as_one(folder)), "-o", str(target)]
    subprocess.run([*command, *words, "-lm"], check=True, timeout=120)
    return target
