# SPDX-License-Identifier: MIT
"""The C files of the product by purpose, found by folder, so that a new file needs no change."""

from __future__ import annotations

import functools
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIB = ROOT / "lib"
NOT_CORE = ("batch", "compensator", "cores", "float", "node", "parts")


def _found(*folders: str, kind: str = "c") -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob(f"*.{kind}"))


def _is_core(path: Path) -> bool:
    return not path.relative_to(LIB).parts[0].startswith(NOT_CORE)


CORE = [path for path in _found("lib") if _is_core(path)]  # one element, as firmware links it
PARTS = [path for folder in ("compensator", "cores", "parts") for path in _found(f"lib/{folder}")]
FLOAT = [path for path in _found("lib") if path.relative_to(LIB).parts[0].startswith("float")]
BATCHES = [path for path in _found("lib") if path.relative_to(LIB).parts[0].startswith("batch")]
EXACT = CORE + PARTS + BATCHES  # the same bits everywhere
ALL = EXACT + FLOAT
NODE = [path for path in _found("lib", "port", "host_sim") if path.stem in ("node", "frames")]
FOLDERS = sorted(
    {path.parent for path in _found("lib", kind="h")} | {ROOT / "port", ROOT / "host_sim"}
)
INCLUDES = [f"-I{folder}" for folder in FOLDERS]


@functools.cache
def number(name: str, header: str = "dahl.h") -> float:
    """Return the value of a macro of a header by the preprocessor."""
    command = ["cc", "-E", "-dM", *INCLUDES, "-include", header, "-x", "c", "/dev/null"]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    text = next(line.split()[2] for line in output.splitlines() if line.split()[1] == name)
    return float.fromhex(text) if text.startswith("0x") else float(text.rstrip("f"))


def as_one(folder: Path, files: list[Path] = CORE, name: str = "library.c") -> Path:
    """Write one C file that includes many, for a compiler or prover that must read all at once."""
    unit = folder / name
    unit.write_text("".join(f'#include "{path}"\n' for path in files))
    return unit


def with_main(test: Path, folder: Path) -> Path:
    """Write the main of a Unity test and return one C file of both."""
    main = folder / f"{test.stem}_main.c"
    words = [f"-DSOURCE={test}", f"-DMAIN={main}", "-P", ROOT / "tests/unity_main.cmake"]
    subprocess.run(["cmake", *words], check=True)
    return main
