# SPDX-License-Identifier: MIT
"""What the numeric proofs share: numbers out of the headers, programs built from a copy of lib/."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

from conftest import ROOT

LIB = ROOT / "lib"


def header_number(name: str, file: Path) -> float:
    """The value of a `#define name value` in a header."""
    found = re.search(rf"^#define {name} (\S+)", file.read_text(), re.MULTILINE)
    assert found, f"{name} is not defined in {file.name}"
    text = found[1].rstrip("f")
    return float.fromhex(text) if text.startswith("0x") else float(text)


def copy_of_lib(tmp_path: Path) -> Path:
    """lib/ and the C tests, where a program of them is built."""
    for part in ("lib", "tests/lib", "tests/proof"):
        shutil.copytree(ROOT / part, tmp_path / part, dirs_exist_ok=True)
    return tmp_path


def build(top: Path, program: str, *words: str) -> Path:
    """One C program of a (copied) tree, with the core of its lib/ in one piece: half the time."""
    core = top / "core.c"
    core.write_text("".join(f'#include "{name}.c"\n' for name in CORE))
    target = top / Path(program).stem
    command = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
    command += [f"-I{top / 'lib' / 'include'}", str(top / program), str(core), "-o", str(target)]
    subprocess.run([*command, *words, "-lm"], check=True, timeout=120)
    return target


CORE = sorted(
    f"lib/{file.parent.name}/{file.stem}"
    for folder in ("arith", "model")
    for file in (LIB / folder).glob("*.c")
)
