# SPDX-License-Identifier: MIT
"""Where the product's C stands, by what each part is for; the only place where tests say so. Files
are found by folder: one more, or a function that moves from one to another, changes nothing here.
"""

from __future__ import annotations

import functools
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIB = ROOT / "lib"
BESIDE = ("batch", "cores", "float", "node", "parts")  # what comes beside the element itself


def _found(*folders: str, kind: str = "c") -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob(f"*.{kind}"))


def _is_core(path: Path) -> bool:
    return not path.relative_to(LIB).parts[0].startswith(BESIDE)


CORE = [path for path in _found("lib") if _is_core(path)]  # one element, as firmware links it
PARTS = [path for path in _found("lib") if path.relative_to(LIB).parts[0] in ("cores", "parts")]
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
    """The value of a macro of a header, as the preprocessor knows it."""
    command = ["cc", "-E", "-dM", *INCLUDES, "-include", header, "-x", "c", "/dev/null"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    text = next(line.split()[2] for line in said.splitlines() if line.split()[1] == name)
    return float.fromhex(text) if text.startswith("0x") else float(text.rstrip("f"))


def as_one(folder: Path, files: list[Path] = CORE, name: str = "library.c") -> Path:
    """One C file of many, for a compiler or prover that should see all at once."""
    unit = folder / name
    unit.write_text("".join(f'#include "{path}"\n' for path in files))
    return unit


def with_main(test: Path, folder: Path) -> Path:
    """One C file of a Unity test with the main that runs it."""
    main = folder / f"{test.stem}_main.c"
    words = [f"-DSOURCE={test}", f"-DMAIN={main}", "-P", ROOT / "tests/unity_main.cmake"]
    subprocess.run(["cmake", *words], check=True)
    return main
